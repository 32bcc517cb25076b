#!/bin/bash
# Rippled water against POV-Ray's picture of the same ripples: the water is stopped, its normals go
# to POV-Ray as those of a flat mesh in the water's place, and both draw the same view.
# The pond's light field has 64x64 texels of 32x32 directions, so every reflection is soft where
# POV-Ray's is sharp: that loss is there in calm water already, and is told apart from what ripples
# add by looking at calm water, and at flat water in place of the rippled one.
# usage: ripples.sh (from the repository's root; build/check-pond.slf exists)
set -u
size=240x180
file=build/check-pond.slf
out=build/tap/pond; mkdir -p "$out"
count=0
check() { # WHAT CONDITION: an awk condition
  count=$((count + 1))
  if awk "BEGIN { exit !($2) }"; then echo "ok $count - $1"; else echo "not ok $count - $1: $2 is false"; fi
}
# PSNR in dB where the mask shows water, as drawn and after a blur of 9 pixels, which leaves what a
# light field of 32 directions can show.
psnr() { # TRUTH PICTURE MASK
  read -r sharp _ < <(build/tests/images/compare "$1" "$2" "$3")
  oiiotool "$1" --blur 9x9 -d uint8 -o "$out/blurred-truth.png"
  oiiotool "$2" --blur 9x9 -d uint8 -o "$out/blurred.png"
  read -r soft _ < <(build/tests/images/compare "$out/blurred-truth.png" "$out/blurred.png" "$3")
  sharp=${sharp:-0} soft=${soft:-0}
}

# Draws both for a view and a script, sets sharp, soft (dB).
compare() { # VIEW RIPPLES
  picture="$out/$1-$2"
  slope=$(build/tests/pond/water_mesh $file water tests/pond/$2.ripples "$out/$2.inc")
  also="#include \"$PWD/$out/$2.inc\"
    object { Water_Mesh translate 0.002*y pigment { rgb 0 }
      finish { ambient 0 diffuse 0 reflection rgb <0.84, 0.92, 0.95> } }" \
    tests/truth pond $1 $size 3 "$picture-truth.png"
  build/slfview $file --view $1 --size $size --samples 3 --backend osmesa \
    --ripple-script tests/pond/$2.ripples --output "$picture.png"
  psnr "$picture-truth.png" "$picture.png" "$out/$1-mask.png"
  echo "# figure: $1, $2 ripples (rms slope ${slope:-none}): $sharp dB, $soft dB blurred"
}
# How flat water would do in place of the ripples drawn last.
compare_flat() { # VIEW
  psnr "$picture-truth.png" "$out/$1-flat.png" "$out/$1-mask.png"
  echo "# figure: $1, flat water instead: $sharp dB, $soft dB blurred"
}

echo "1..6"
for view in shore windows; do
  build/slfview $file --view $view --size $size --backend osmesa --mask water --output "$out/$view-mask.png"
  build/slfview $file --view $view --size $size --samples 3 --backend osmesa --output "$out/$view-flat.png"
done
compare shore calm
check "calm water agrees with POV-Ray as far as 32 directions can" "$soft >= 26"
calm=$soft
compare shore gentle; rippled=$soft
check "gentle ripples cost less than 1 dB more" "$rippled >= $calm - 1"
compare_flat shore
check "gentle ripples are those of POV-Ray: flat water is worse" "$rippled > $soft"
compare shore strong; rippled=$soft
check "strong ripples cost less than 3 dB more" "$rippled >= $calm - 3"
compare_flat shore
check "strong ripples are those of POV-Ray: flat water is worse by far" "$rippled >= $soft + 1.5"
compare windows strong; rippled=$soft
compare_flat windows
check "so they are from another view" "$rippled >= $soft + 1"
