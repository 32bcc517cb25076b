#!/bin/bash
# The floor against POV-Ray's own renders from the same cameras, at views that nothing was tuned on,
# and against kept pictures. Run from the repository's root once build/check-floor*.slf are baked.
set -u
out=build/tap/floor
mkdir -p "$out"
count=0
check() { # WHAT CONDITION: an awk condition
  count=$((count + 1))
  if awk "BEGIN { exit !($2) }"; then echo "ok $count - $1"; else echo "not ok $count - $1: $2 is false"; fi
}
# measure MATERIAL VIEW N [--shift]: the truth with N x N rays a pixel, the viewer's picture, and how they differ.
# A dull floor's takes four facets a ray, and shows nothing small: 160x120 of it are plenty.
measure() {
  local file=build/check-floor.slf declare=Declare=Mirror=0 pair=$out/$1-$2 size=160x120
  [ "$1" = dull ] || file=build/check-floor-mirror.slf declare=Declare=Mirror=1 size=240x180
  tests/truth floor "$2" $size "$3" "$pair-truth.png" $declare &&
    build/slfview $file --view "$2" --size $size --samples 4 --backend osmesa --output "$pair.png" &&
    build/slfview $file --view "$2" --size $size --backend osmesa --mask floor --output "$pair-mask.png" &&
    build/tests/images/compare ${4:-} "$pair-truth.png" "$pair.png" "$pair-mask.png"
}

echo "1..11"
# 100 rays a pixel of four facets each leave noise near 42 dB. Margins are half a dB under what was
# measured when this was written: bakes and pictures are deterministic.
while read -r view margin; do
  read -r psnr pixels < <(measure dull "$view" 10)
  echo "# figure: dull floor, $view: ${psnr:-none} dB against POV-Ray over ${pixels:-0} px"
  check "dull floor, $view, agrees with POV-Ray" "${psnr:-0} >= $margin"
  # The same file drawn the same way. Another processor may differ by a level here and there.
  count=$((count + 1)) drawn=$out/floor-$view
  build/slfview build/check-floor.slf --view "$view" --size 240x180 --samples 4 --backend osmesa --output "$drawn.png"
  if idiff -q -warn 1 -fail 0.012 -failpercent 0.5 -hardfail 0.06 "$drawn.png" "tests/images/floor-$view.png" > /dev/null
  then echo "ok $count - dull floor, $view, is the kept picture"
  else
    oiiotool "$drawn.png" "tests/images/floor-$view.png" --absdiff --mulc 16 -o "$drawn-difference-x16.png"
    echo "not ok $count - dull floor, $view, is the kept picture: see $drawn.png and -difference-x16.png"
  fi
done <<END
entrance 32.7
gallery 34.4
above 33.8
high 32.6
END
# Too few directions blur a mirror. The blur is even only where the view is steep: its cells are even
# in s and t, and the angle they span grows as 1/n, so that it reaches further towards the horizon.
# There the peak moves with the blur: 9 rays a pixel are plenty to see it.
for view in down above entrance; do
  read -r psnr _ dx dy sigma < <(measure mirror $view 3 --shift)
  echo "# figure: mirror floor, $view: ${psnr:-none} dB, blur ${sigma:-none} px, shift ${dx:-none} ${dy:-none} px"
  case $view in
  down) check "mirror floor, $view, is blurred, not shifted" "(${dx:-9})^2 + (${dy:-9})^2 < 0.25^2" ;;
  # What the blur cannot explain: half its standard deviation.
  *) check "mirror floor, $view, is shifted by less than its blur" "(${dx:-9})^2 + (${dy:-9})^2 < (${sigma:-0}/2)^2" ;;
  esac
done
