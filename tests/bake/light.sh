#!/bin/bash
# Global illumination that all slices share, objects that only trace() can parametrise, and directions
# that are chosen.
set -u
log=$(mktemp)
trap 'rm -f "$log"' EXIT
count=0
check() {
  count=$((count + 1))
  if eval "$2"; then echo "ok $count - $1"; else echo "not ok $count - $1"; sed 's/^/# /' "$log"; fi
}
bake() { make --no-print-directory bake SCENES=tests/bake "$@" > "$log" 2>&1; }
echo 1..9

# A furnace: 1 in, 1 out, in every sample of every slice. 0.001 is two half-float steps.
rm -rf build/bake/furnace
bake SCENE=furnace QUALITY=paper RAYS=9
stats=$(oiiotool --stats build/bake/furnace/ball/0000.exr)
low=$(awk '/Min:/ { print $3 }' <<< "$stats") high=$(awk '/Max:/ { print $3 }' <<< "$stats")
echo "# figure: furnace: radiance from $low to $high"
check "a white ball in a uniform sky has radiance 1" 'awk "BEGIN { exit !($low > 0.999 && $high < 1.001) }"'
check "a surface declared shiny that is matte is reported" 'grep -q "ball.: has 4x4 directions, and looks the same from all" "$log"'

rm -rf build/bake/wrap
bake SCENE=wrap DECLARE=Light=1 QUALITY=preview
check "radiosity and photons have their caches" '[ -s build/bake/wrap/light.radiosity ] && [ -s build/bake/wrap/light.photons ]'
check "matte CSG is found to need one texture" '[ "$(head -n 1 build/bake/wrap/cup/choice)" = "1 1 0" ]'
check "shiny CSG is found to need directions" '[ "$(head -n 1 build/bake/wrap/die/choice)" != "1 1 0" ]'
# 0.05 is what is asked for unless the scene says otherwise.
read -r asked _ < build/bake/wrap/die/choice
rm -rf build/bake/wrap-fine
bake SCENE=wrap NAME=wrap-fine DECLARE=Slf_Auto_Error=0.02 RAYS=1
read -r fine _ < build/bake/wrap-fine/die/choice
echo "# figure: directions of the die for an error of 0.05: $asked, of 0.02: $fine"
check "a smaller error takes more directions" '[ "$fine" -gt "$asked" ]'
check "holes of a wrap are counted" 'grep -qE "cup.: [0-9]+ of 512 texels have no surface behind them" "$log"'
# Another process, the same light: a chunk that is baked again comes out the same.
cp build/wrap.slf "$log.slf"
rm build/bake/wrap/ground/0000.exr
bake SCENE=wrap DECLARE=Light=1 QUALITY=preview
check "a chunk baked again by another process is the same" 'cmp build/wrap.slf "$log.slf"'
rm -f "$log.slf"
rm build/bake/wrap/light.photons build/bake/wrap/ground/0000.exr
bake SCENE=wrap DECLARE=Light=1 QUALITY=preview
status=$?
check "a cache that went missing is an error" '[ $status -ne 0 ] && grep -q "^slf: .*light.photons: is missing" "$log"'
