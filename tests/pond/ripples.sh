#!/bin/bash
# Rippled water against POV-Ray's picture of the same ripples: the water is stopped, its normals go
# to POV-Ray as those of a flat mesh in the water's place, and both draw the same view.
# A light field of 64x64 texels and 32x32 directions shows every reflection soft where POV-Ray's is
# sharp: that loss is there in calm water already, and is told apart from what ripples add by looking
# at calm water, and at flat water in place of the rippled one. Layers show them sharp.
# usage: ripples.sh (from the repository's root; build/check-pond.slf and build/check-pond-layers.slf
# exist), or ripples.sh FILE.slf WxH for the figures of another bake of the pond
set -u
file=${1:-build/check-pond.slf} size=${2:-240x180}
out=build/tap/pond/$(basename "$file" .slf); mkdir -p "$out"
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
ours() { # PICTURE VIEW OPTION...: as many rays a pixel as POV-Ray has
  build/slfview "$file" --view "$2" --size $size --samples 3 --backend osmesa --output "$1" "${@:3}"
}

# Draws both for a view and a script, sets sharp, soft (dB).
compare() { # VIEW RIPPLES
  picture="$out/$1-$2"
  slope=$(build/tests/pond/water_mesh "$file" water tests/pond/$2.ripples "$out/$2.inc")
  also="#include \"$PWD/$out/$2.inc\"
    object { Water_Mesh translate 0.002*y pigment { rgb 0 }
      finish { ambient 0 diffuse 0 reflection rgb <0.84, 0.92, 0.95> } }" \
    tests/truth pond $1 $size 3 "$picture-truth.png"
  ours "$picture.png" $1 --ripple-script tests/pond/$2.ripples
  psnr "$picture-truth.png" "$picture.png" "$out/$1-mask.png"
  echo "# figure: $(basename "$file" .slf) $1, $2 ripples (rms slope ${slope:-none}): $sharp dB, $soft dB blurred"
}
# How flat water would do in place of the ripples drawn last.
compare_flat() { # VIEW
  psnr "$picture-truth.png" "$out/$1-flat.png" "$out/$1-mask.png"
  echo "# figure: $(basename "$file" .slf) $1, flat water instead: $sharp dB, $soft dB blurred"
}
flat() { # VIEW: its mask and its flat water
  build/slfview "$file" --view $1 --size $size --backend osmesa --mask water --output "$out/$1-mask.png"
  ours "$out/$1-flat.png" $1
}

# How far ripples move the far wall's reflection, px, for each quarter of it from its foot up.
wiggle() { # CALM.png RIPPLED.png
  build/tests/pond/wiggle "$file" shore far "$1" "$2" | awk '{ printf "%s ", $2 }'
}

if [ $# -gt 0 ]; then
  flat shore
  for ripples in calm gentle strong; do compare shore $ripples; compare_flat shore; done
  exit
fi

echo "1..11"
flat shore; flat windows
compare shore calm
check "calm water agrees with POV-Ray as far as 32 directions can" "$soft >= 26"
calm=$soft four_taps=$sharp
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

# With layers the lines on the walls are there, and the paper's claim can be seen: near the foot of a
# wall its reflection moves less than far from it. Where a reflection were a picture that is bent by
# the same angle everywhere, it would not.
file=build/check-pond-layers.slf out=build/tap/pond/check-pond-layers; mkdir -p "$out"
flat shore
compare shore calm
check "with layers calm water is sharper by 2 dB and more" "$sharp >= $four_taps + 2"
compare shore strong; rippled=$sharp
compare_flat shore
check "and so are strong ripples" "$rippled >= $sharp + 3"
compare shore corrugated
truth=$(wiggle "$out/shore-calm-truth.png" "$out/shore-corrugated-truth.png")
drawn=$(wiggle "$out/shore-calm.png" "$out/shore-corrugated.png")
echo "# figure: movement of the far wall's quarters, from its foot up, px: POV-Ray $truth, slfview $drawn"
read -r t1 t2 t3 t4 <<< "$truth"; read -r d1 d2 d3 d4 <<< "$drawn"
# The wall's upper quarter is seen in water 2.5 to 5 away from it, the lowest within 1.
check "POV-Ray's reflections move less near the wall's foot" "$t1 < $t2 && $t2 < $t3 && $t3 < $t4 && $t4 >= 3 * $t1"
check "so do ours" "$d1 < $d2 && $d2 < $d3 && $d3 < $d4 && $d4 >= 3 * $d1"
check "by as much, to a third" "$(for k in 1 2 3 4; do t=t$k d=d$k; printf '%s > 0.67*%s && %s < 1.5*%s && ' ${!d} ${!t} ${!d} ${!t}; done) 1"
