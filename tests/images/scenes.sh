#!/bin/bash
# All scenes but floor (floor.sh) against POV-Ray's own renders, at three views each that no bake looks at
# and that nothing was tuned on; of chess the board's middle, as 32 pieces would take a minute.
# Bakes and pictures are small, so that light fields of 4 or 8 directions blur what mirrors and glass show, but as layers;
# the bounds are what these gave, less half a dB. Truths are rendered by one thread: with several the gallery's
# radiosity comes out anew each time, once 1.6 dB off.  scenes.sh [SCENE...]: those scenes only.
set -u
size=120x90
out=build/tap/scenes
mkdir -p "$out"
count=0
white=$out/white.png
oiiotool --pattern constant:color=1,1,1 "$size" 3 -d uint8 -o "$white"

check() { # WHAT CONDITION: an awk condition
  count=$((count + 1))
  if awk "BEGIN { exit !($2) }"; then echo "ok $count - $1"; else echo "not ok $count - $1: $2 is false"; fi
}
# measure SCENE FILE VIEW DECLARE: the truth with 2 x 2 rays a pixel, the viewer's picture, and their PSNR
measure() {
  local scene=$1 view=$3 pair=$out/$1-$3 declare=()
  for value in $4; do declare+=("Declare=$value"); done
  tests/truth "$scene" "$view" $size 2 "$pair-truth.png" +WT1 "${declare[@]}" &&
    build/slfview "build/$2.slf" --view "$view" --size $size --samples 2 --backend osmesa --output "$pair.png" &&
    build/tests/images/compare "$pair-truth.png" "$pair.png" "$white"
}

wanted=" $* "
want() { [ "$wanted" = "  " ] || [[ $wanted == *" $1 "* ]]; }
# The pond is one of check-bakes.
table() {
  cat <<END
box|check-scene-box|Texels=128 Directions=4|front 30.9|left 30.6|above 30.8
cube|check-scene-cube|Texels=64 Directions=4|front 19.1|left 20.3|back 19.1
cube|check-scene-cube-layers|Texels=64 Directions=8 Slf_Layers=4|front 20.9|left 21.5|back 23.8
bottle|check-scene-bottle|Texels=64 Directions=8|front 24.8|side 23.2|above 25.9
bottle|check-scene-bottle-layers|Texels=96 Along=2 Directions=6 Slf_Layers=4|front 26.8|side 25.7|above 27.7
pond|check-pond||shore 24.2|windows 24.7|column 24.8
gallery|check-scene-gallery|Texels=64 Directions=4 Fine=0|entrance 25.8|ball 24.9|sculpture 24.5
chess|check-scene-chess|Texels=256 Directions=4 Most=0|middle 26.4|across 17.7|squares 25.7
END
}
echo "1..$(table | while IFS='|' read -r scene _ _ views; do want "$scene" && tr '|' '\n' <<< "$views"; done | wc -l)"
while IFS='|' read -r scene name declare views; do
  want "$scene" || continue
  label=${name#check-} label=${label#scene-}
  make --no-print-directory bake "SCENE=$scene" "NAME=$name" "DECLARE=$declare" RAYS=1 > "$out/$scene.log" 2>&1 ||
    sed 's/^/# /' "$out/$scene.log"
  while read -r view margin; do
    read -r psnr _ < <(measure "$scene" "$name" "$view" "$declare")
    echo "# figure: $label, $view: ${psnr:-none} dB against POV-Ray"
    check "$label, $view, agrees with POV-Ray" "${psnr:-0} >= $margin"
  done < <(tr '|' '\n' <<< "$views")
done < <(table)
