#!/usr/bin/env bash
# What decides how the droplet digs: the quick form on beds of several temperatures with one thing changed at a time,
# 0.3 s each; or, with `coarse`, the full case with grains of twice the diameter at 400 and 600 C, 0.5 s each:
#   cases/droplet-digging/studies.sh OUT [coarse]
# makes OUT/studies.csv and keeps a folder for each run in OUT; runs that are done stay. They go one after the other on
# one core, for some hours in all. With DONE=1 the table has those that are done, and none is started. The program is
# $VOIDAGE, or voidage on the PATH.
set -euo pipefail
[ $# = 1 ] || [ "$# ${2:-}" = "2 coarse" ] || { sed -n '2,8s/^# \{0,1\}//p' "$0" >&2; exit 2; }
out=$1 form=${2:-quick} here=$(dirname "$0")
export VOIDAGE=${VOIDAGE:-voidage} PLOT=0

# End of the runs, and from when on what they show is summed up.
scene=scene-quick.toml end=0.3 from=0.2 base=()
if [ "$form" = coarse ]; then
    scene=scene.toml end=0.5 from=0.3
    base=(
        --set 'grains[0].radius={uniform=[4.4e-5,5.5e-5]}' --set 'grains[0].amount.count=24250'
        --set contacts.cohesion.force=3e-3
        --set 'fluid.mesh.rectangle.holes=[{name="droplet",centre=[0.005,0.02525],radius=1.25e-3,size=5.5e-5,growth=0.2}]'
    )
fi
# A change is `key=value`, or `name|key=value|key=value ..`. Other packings show how much runs differ by chance.
hole='fluid.mesh.rectangle.holes=[{name="droplet",growth=0.2'
quick_hole="$hole,centre=[0.003,0.00825],radius=1e-3"
full_hole="$hole,centre=[0.005,0.02525],radius=1.25e-3"
half_grain='grains[0].radius={uniform=[2.2e-5,2.75e-5]}|grains[0].amount.count=15600|contacts.cohesion.force=7.5e-4'
quick=(
    nothing
    'grains[0].placement.deposit.seed=2'
    'grains[0].placement.deposit.seed=3'
    'grains[0].solidity=0.714'
    materials.glass.density=6723
    "half the grain|$half_grain"
    "half the grain and an eighth of the conductivity|$half_grain|fluid.heat.conductivity=0.0425"
    fluid.heat.conductivity=0.68
    fluid.heat.conductivity=1.36
    fluid.heat.conductivity=2.72
    droplet.heat_flux=gradient
    droplet.blowing=interstitial
    droplet.buoyancy=hydrostatic
    droplet.buoyancy=none
    droplet.inside.voidage=one
    droplet.grain_share=disc
    contacts.cohesion.force=0
    contacts.cohesion.age=0
    coupling.voidage_function=di-felice
    coupling.voidage_function=none
    "twice the edge|$quick_hole,size=1.1e-4}]"
    "half the edge|$quick_hole,size=2.75e-5}]"
    time.step=2.5e-4
    time.step=1.25e-4
    coupling.scheme=henry
    contacts.tolerance=0.1
)
full=(
    nothing
    'grains[0].solidity=0.714'
    droplet.grain_share=disc
    time.step=2.5e-4
    materials.grains.density=6723
    'grains[0].placement.deposit.seed=2'
    droplet.heat_flux=gradient
    coupling.scheme=iterated
    contacts.tolerance=2e-2
    "half the edge|$full_hole,size=2.75e-5}]"
    time.step=1.25e-4
)

mkdir -p "$out"
table=$out/studies.csv
columns=bed_C,changed,depth_m,sinking_speed_m_per_s,velocity_deviation_m_per_s,vaporisation_kg_per_s_per_m
{
    echo "# cases/droplet-digging/studies.sh OUT${2:+ $2}; depth at $end s, all else from $from to $end s"
    echo $columns,lifetime_s,solid_share_in_water
} >"$table.part"
study() {
    local bed=$1 changed=${2%%|*} keys key set=() folder
    if [ "$2" != nothing ]; then
        IFS='|' read -ra keys <<<"${2#"$changed|"}"
        for key in "${keys[@]}"; do set+=(--set "$key"); done
    fi
    folder=$out/${changed//[^A-Za-z0-9.-]/-}
    if [ "${DONE:-0}" = 1 ]; then
        grep -qs '"outcome": "done"' "$folder/${bed}C/summary.json" || return 0
    fi
    "$here/temperatures.sh" "$here/$scene" "$folder" "$bed" -- --quiet --threads 1 "${base[@]}" \
        --set time.end=$end --set output.frame_interval=$end "${set[@]}"
    awk -F, -v bed="$bed" -v changed="$changed" -v from=$from '
        NR == 1 { for (k = 1; k <= NF; k++) column[$k] = k; next }
        { time = $column["time_s"]; depth = $column["droplet_depth_m"] }
        time < from - 1e-9 { before = depth; start = time; next }
        {
            rows++
            velocity = $column["droplet_velocity_y_m_per_s"]
            velocities += velocity
            squares += velocity ^ 2
            vapour += $column["vaporisation_kg_per_s_per_m"]
            lifetime += $column["droplet_lifetime_s"]
            area = 3.14159265358979 * $column["droplet_radius_m"] ^ 2
            solid += 1 - $column["droplet_liquid_kg_per_m"] / 958.4 / area
        }
        END {
            printf "%s,%s,%.3e,%.2e,%.2e,%.2e,%.1f,%.3f\n", bed, changed, depth, (depth - before) / (time - start),
                sqrt(squares / rows - (velocities / rows) ^ 2), vapour / rows, lifetime / rows, solid / rows
        }' "$folder/${bed}C/series.csv" >>"$table.part"
}
if [ "$form" = coarse ]; then
    for changed in "${full[@]}"; do
        for bed in 400 600; do study "$bed" "$changed"; done
    done
else
    for bed in 300 400 600; do
        for changed in "${quick[@]}"; do study "$bed" "$changed"; done
    done
fi
mv "$table.part" "$table"
