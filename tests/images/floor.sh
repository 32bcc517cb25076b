#!/bin/bash
# The floor against POV-Ray's own renders from the same cameras, at views that nothing was tuned on.
# usage: floor.sh (from the repository's root; build/check-floor*.slf exist)
set -u
size=240x180
out=build/tap/floor; mkdir -p "$out"
count=0
check() { # WHAT CONDITION: an awk condition
  count=$((count + 1))
  if awk "BEGIN { exit !($2) }"; then echo "ok $count - $1"; else echo "not ok $count - $1: $2 is false"; fi
}
draw() { # FILE VIEW NAME: the viewer's picture and the floor's mask
  build/slfview "$1" --view "$2" --size $size --samples 4 --backend osmesa --output "$out/$3.png" &&
    build/slfview "$1" --view "$2" --size $size --backend osmesa --mask floor --output "$out/$3-mask.png"
}

echo "1..13"
for view in entrance corner high low; do
  # 256 rays a pixel: what is left of the facets' noise lies near 42 dB over the floor.
  tests/truth floor $view $size 10 "$out/dull-$view-truth.png" && draw build/check-floor.slf $view dull-$view
  read -r psnr _ _ pixels < <(build/tests/images/compare "$out"/dull-$view{-truth,,-mask}.png)
  echo "# figure: dull floor, $view: ${psnr:-none} dB against POV-Ray over ${pixels:-0} px"
  check "dull floor, $view, agrees with POV-Ray" "${psnr:-0} >= 33"
  # 9 rays a pixel are plenty for a mirror: only its blur is looked at.
  tests/truth floor $view $size 3 "$out/mirror-$view-truth.png" Declare=Mirror=1 &&
    draw build/check-floor-mirror.slf $view mirror-$view
  read -r psnr dx dy _ < <(build/tests/images/compare "$out"/mirror-$view{-truth,,-mask}.png)
  echo "# figure: mirror floor, $view: ${psnr:-none} dB, shift ${dx:-none} ${dy:-none} px"
  check "mirror floor, $view, is blurred, not shifted" "(${dx:-9})^2 + (${dy:-9})^2 < 0.25^2"
done
# Kept pictures: the same file drawn the same way, on any machine. Another processor may differ by a
# level on one pixel in a thousand; a change of the bake's random numbers shows as more.
