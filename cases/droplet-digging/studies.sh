#!/usr/bin/env bash
# What decides how the droplet digs: the quick form on beds of several temperatures with one thing changed at a time,
# 0.3 s each:
#   cases/droplet-digging/studies.sh OUT
# makes OUT/studies.csv and keeps a folder for each run in OUT; runs that are done stay. They go one after the other on
# one core, for some hours in all. With DONE=1 the table has those that are done, and none is started. The program is
# $VOIDAGE, or voidage on the PATH.
set -euo pipefail
[ $# = 1 ] || { sed -n '2,7s/^# \{0,1\}//p' "$0" >&2; exit 2; }
out=$1 here=$(dirname "$0")
export VOIDAGE=${VOIDAGE:-voidage} PLOT=0

hole='fluid.mesh.rectangle.holes=[{name="droplet",centre=[0.003,0.00825],radius=1e-3,growth=0.2'
# Everything at 400 C, and where a regime may end: what moved something there.
everything=(
    nothing
    'grains[0].solidity=0.714'
    materials.glass.density=6723
    droplet.heat_flux=gradient
    droplet.blowing=interstitial
    droplet.buoyancy=hydrostatic
    droplet.buoyancy=none
    droplet.inside.voidage=one
    contacts.cohesion.force=0
    contacts.cohesion.age=0
    coupling.voidage_function=di-felice
    coupling.voidage_function=none
    "$hole,size=1.1e-4}]"
    "$hole,size=2.75e-5}]"
    time.step=2.5e-4
    time.step=1.25e-4
    droplet.grain_share=disc
)
edges=(
    nothing
    'grains[0].solidity=0.714'
    materials.glass.density=6723
    droplet.heat_flux=gradient
    contacts.cohesion.force=0
    "$hole,size=2.75e-5}]"
    time.step=2.5e-4
    time.step=1.25e-4
    droplet.grain_share=disc
)

mkdir -p "$out"
table=$out/studies.csv
columns=bed_C,changed,depth_m,sinking_speed_m_per_s,velocity_rms_m_per_s,vaporisation_kg_per_s_per_m
{
    echo '# cases/droplet-digging/studies.sh OUT; depth at 0.3 s, absorption of all steps, all else from 0.2 to 0.3 s'
    echo $columns,lifetime_s,solid_share_in_water,largest_absorption_number
} >"$table.part"
study() {
    local bed=$1 changed=$2 set=() folder
    [ "$changed" = nothing ] || set=(--set "$changed")
    folder=$(echo "$changed" | sed 's/.*,size=\([^}]*\).*/facets-\1/; s/.*\[0\]\.//; s/[^A-Za-z0-9.-]/-/g')
    folder=$out/$folder
    if [ "${DONE:-0}" = 1 ]; then
        grep -qs '"outcome": "done"' "$folder/${bed}C/summary.json" || return 0
    fi
    "$here/temperatures.sh" "$here/scene-quick.toml" "$folder" "$bed" -- --quiet --threads 1 \
        --set time.end=0.3 --set output.frame_interval=0.3 "${set[@]}"
    changed=$(echo "$changed" | sed 's/.*,size=\([^}]*\).*/fluid.mesh.rectangle.holes[0].size=\1/')
    awk -F, -v bed="$bed" -v changed="$changed" '
        NR == 1 { for (k = 1; k <= NF; k++) column[$k] = k; next }
        { time = $column["time_s"]; depth = $column["droplet_depth_m"] }
        { absorption = $column["droplet_absorption_number"] }
        absorption > largest { largest = absorption }
        time < 0.2 - 1e-9 { before = depth; start = time; next }
        {
            rows++
            squares += $column["droplet_velocity_y_m_per_s"] ^ 2
            vapour += $column["vaporisation_kg_per_s_per_m"]
            lifetime += $column["droplet_lifetime_s"]
            area = 3.14159265358979 * $column["droplet_radius_m"] ^ 2
            solid += 1 - $column["droplet_liquid_kg_per_m"] / 958.4 / area
        }
        END {
            printf "%s,%s,%.3e,%.2e,%.2e,%.2e,%.1f,%.3f,%.3f\n", bed, changed, depth, (depth - before) / (time - start),
                sqrt(squares / rows), vapour / rows, lifetime / rows, solid / rows, largest
        }' "$folder/${bed}C/series.csv" >>"$table.part"
}
for changed in "${everything[@]}"; do study 400 "$changed"; done
for bed in 600 300; do
    for changed in "${edges[@]}"; do study "$bed" "$changed"; done
done
mv "$table.part" "$table"
