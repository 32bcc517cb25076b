#!/bin/bash
# All scenes but floor (floor.sh) and chess (its package, povray-examples, is not asked for) against
# POV-Ray's own renders, at three of their views each. No bake looks at views, and nothing was tuned on
# these. Small bakes, so that light fields of 8 x 8 directions blur what mirrors and glass show; the
# bounds are what these bakes gave, less half a dB, of the gallery, whose truth has a radiosity of its own
# each time, a dB.  scenes.sh [SCENE...]: those scenes only.
set -u
size=160x120
out=build/tap/scenes
mkdir -p "$out"
count=0
white=$out/white.png
oiiotool --pattern constant:color=1,1,1 "$size" 3 -d uint8 -o "$white"

check() { # WHAT CONDITION: an awk condition
  count=$((count + 1))
  if awk "BEGIN { exit !($2) }"; then echo "ok $count - $1"; else echo "not ok $count - $1: $2 is false"; fi
}
# measure SCENE VIEW DECLARE: the truth with 2 x 2 rays a pixel, the viewer's picture, and their PSNR
measure() {
  local scene=$1 view=$2 pair=$out/$1-$2 declare=()
  for value in $3; do declare+=("Declare=$value"); done
  tests/truth "$scene" "$view" $size 2 "$pair-truth.png" "${declare[@]}" &&
    build/slfview "build/check-scene-$scene.slf" --view "$view" --size $size --samples 2 --backend osmesa --output "$pair.png" &&
    build/tests/images/compare "$pair-truth.png" "$pair.png" "$white"
}

wanted=" $* "
want() { [ "$wanted" = "  " ] || [[ $wanted == *" $1 "* ]]; }
table() {
  cat <<END
box|Texels=64 Directions=8|front 28.3|left 26.8|above 26.8
cube|Texels=64 Directions=8|front 19.9|left 19.9|back 20.7
bottle|Texels=64 Directions=8|front 24.5|side 23.0|above 25.5
pond|Texels=64 Directions=8|shore 20.5|windows 20.8|column 21.5
gallery|Texels=64 Directions=8|entrance 27.3|ball 27.4|sculpture 25.2
END
}
echo "1..$((3*$(table | while IFS='|' read -r scene _; do want "$scene" && echo; done | wc -l)))"
while IFS='|' read -r scene declare views; do
  want "$scene" || continue
  make --no-print-directory bake "SCENE=$scene" "NAME=check-scene-$scene" "DECLARE=$declare" RAYS=1 > "$out/$scene.log" 2>&1 ||
    sed 's/^/# /' "$out/$scene.log"
  while read -r view margin; do
    read -r psnr _ < <(measure "$scene" "$view" "$declare")
    echo "# figure: $scene, $view: ${psnr:-none} dB against POV-Ray"
    check "$scene, $view, agrees with POV-Ray" "${psnr:-0} >= $margin"
  done < <(tr '|' '\n' <<< "$views")
done < <(table)
