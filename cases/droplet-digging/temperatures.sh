#!/usr/bin/env bash
# The droplet on beds of several temperatures, a table of what it does, and pictures that compare them:
#   cases/droplet-digging/temperatures.sh SCENE OUT C [C ..] [-- arguments of `voidage run`]
# for example
#   cases/droplet-digging/temperatures.sh cases/droplet-digging/scene-quick.toml out/digging 300 400 600
# Runs go one after the other into OUT/300C, OUT/400C and so on; one that is there goes on from its checkpoint, one
# that is done stays. OUT/temperatures.csv has depths, and means over the 0.05 s before. The program is $VOIDAGE, or
# voidage on the PATH. With PLOT=0 there are no pictures that compare.
set -euo pipefail
[ $# -ge 3 ] || { sed -n '2,8s/^# \{0,1\}//p' "$0" >&2; exit 2; }
scene=$1 out=$2 voidage=${VOIDAGE:-voidage}
shift 2
folders=()
temperatures=()
while [ $# -gt 0 ] && [ "$1" != -- ]; do
    temperatures+=("$1")
    shift
done
[ "${1:-}" = -- ] && shift
for celsius in "${temperatures[@]}"; do
    kelvin=$(awk -v c="$celsius" 'BEGIN { printf "%.2f", c + 273.15 }')
    folder=$out/${celsius}C
    folders+=("$folder")
    grep -qs '"outcome": "done"' "$folder/summary.json" && continue
    from=(--overwrite)
    [ -f "$folder/checkpoint.voidage" ] && from=(--restart "$folder/checkpoint.voidage")
    "$voidage" run "$scene" --out "$folder" "${from[@]}" "$@" \
        --set "grains[0].temperature=$kelvin" \
        --set "fluid.heat.initial_temperature=$kelvin" \
        --set "fluid.heat.reference_temperature=$kelvin" \
        --set "fluid.boundaries.outflow.heat={open={temperature=$kelvin}}" \
        --set "fluid.boundaries.walls.heat={temperature=$kelvin}"
done

columns=bed_C,time_s,depth_m,sinking_speed_m_per_s,vaporisation_kg_per_s_per_m,lifetime_s,liquid_kg_per_m,radius_m
{
    echo $columns,solid_share_in_water,largest_absorption_number
    for k in "${!temperatures[@]}"; do
        awk -F, -v bed="${temperatures[k]}" -v at="0.05 0.1 0.2 0.3 0.4 0.5 1 2 3 4 5" '
            NR == 1 { for (k = 1; k <= NF; k++) column[$k] = k; next }
            {
                time[NR] = $column["time_s"]
                depth[NR] = $column["droplet_depth_m"]
                vapour[NR] = $column["vaporisation_kg_per_s_per_m"]
                lifetime[NR] = $column["droplet_lifetime_s"]
                liquid[NR] = $column["droplet_liquid_kg_per_m"]
                radius[NR] = $column["droplet_radius_m"]
                absorption = $column["droplet_absorption_number"] + 0
                largest[NR] = NR == 2 || absorption > largest[NR - 1] ? absorption : largest[NR - 1]
            }
            END {
                count = split(at, wanted, " ")
                end = start = 2
                for (k = 1; k <= count && wanted[k] <= time[NR] + 1e-9; k++) {
                    # A run that began later has no rows of these times.
                    if (wanted[k] <= time[2]) continue
                    while (time[end] < wanted[k] - 1e-9) end++
                    while (start < end - 1 && time[start] < wanted[k] - 0.05 - 1e-9) start++
                    mean_vapour = mean_lifetime = 0
                    for (row = start + 1; row <= end; row++) {
                        mean_vapour += vapour[row] / (end - start)
                        mean_lifetime += lifetime[row] / (end - start)
                    }
                    printf "%s,%s,%.4e,%.2e,%.3e,%.2f,%.4e,%.3e,%.3f,%.3f\n", bed, wanted[k], depth[end],
                        (depth[end] - depth[start]) / (time[end] - time[start]), mean_vapour, mean_lifetime, liquid[end],
                        radius[end], 1 - liquid[end] / 958.4 / (3.14159265358979 * radius[end] ^ 2), largest[end]
                }
            }' "${folders[k]}/series.csv"
    done
} >"$out/temperatures.csv"
[ "${PLOT:-1}" = 0 ] || "$voidage" plot "${folders[@]}" --out "$out"
