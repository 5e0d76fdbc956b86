#!/usr/bin/env bash
# The droplet on beds of several temperatures, and pictures that compare them:
#   cases/droplet-digging/temperatures.sh SCENE OUT C [C ..] [-- arguments of `voidage run`]
# for example
#   cases/droplet-digging/temperatures.sh cases/droplet-digging/scene-quick.toml out/digging 300 400 600
# Runs go one after the other into OUT/300C, OUT/400C and so on; one that is there goes on from its checkpoint, one
# that is done stays. The program is $VOIDAGE, or voidage on the PATH. With PLOT=0 there are no pictures that compare.
set -euo pipefail
[ $# -ge 3 ] || { sed -n '2,7s/^# \{0,1\}//p' "$0" >&2; exit 2; }
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
[ "${PLOT:-1}" = 0 ] || "$voidage" plot "${folders[@]}" --out "$out"
