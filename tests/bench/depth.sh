#!/bin/bash
# What reading slices where they see the same point is worth: scenes baked as layers against the paper's
# way in at least as many bytes, at the scenes' views and at views drawn at random, against POV-Ray; and
# what it costs. Writes the flat build/bench/depth.json. Run from the repository's root; bakes what is
# missing. Bytes are those of the shiny surfaces, heights included. FLIP comes out of the report's venv.
# usage: depth.sh [SCENE...] (floor bottle cube pond flight speed: all of them)
set -euo pipefail
size=320x240
out=build/bench/depth-views
mkdir -p "$out"
[ $# -gt 0 ] || set -- floor bottle cube pond flight speed
MAKEFLAGS='' make --no-print-directory all build/tests/images/compare build/bench/depth build/venv/bin/python >&2

# Views of a scene as cameras, a line each: its own, and three at random around where its shiny things are.
cameras() { # SCENE
  awk '$1 !~ /^#/ && NF { print $1, $2, $3, $4, $5, $6, $7, $8 }' "scenes/$1/views"
  awk -v scene="$1" 'BEGIN {
    srand(1998)
    for (i = 0; i < 3; i++) {
      around = 6.2832*rand(); far = scene == "bottle" ? 1.8 + 0.9*rand() : scene == "cube" ? 2.4 + 1.4*rand() : 2.6 + 0.9*rand()
      printf "random%d %.3f %.3f %.3f %.3f %.3f %.3f 65\n", i, far*cos(around), 0.9 + 2.4*rand(), far*sin(around),
        0.3*(rand() - 0.5), scene == "floor" || scene == "pond" ? 0.2 : 0.8, 0.3*(rand() - 0.5) } }'
}
truth() { # SCENE CAMERA... OUT.png
  local scene=$1 scratch; shift
  scratch=$(mktemp -d)
  cat > "$scratch/view.pov" <<POV
#version 3.7;
#include "$scene.pov"
camera { perspective location <$2, $3, $4> right x*4/3 up y angle $8 look_at <$5, $6, $7> }
POV
  local mirror=(); [ "$scene" != floor ] || mirror=(Declare=Mirror=1)
  povray "+I$scratch/view.pov" "+L$PWD/bake" "+L$PWD/scenes/$scene" "+O$scratch/big.exr" +FE +W960 +H720 -A -D -GA \
    "${mirror[@]}" > "$scratch/log" 2>&1 || { tail -n 5 "$scratch/log" >&2; exit 1; }
  oiiotool "$scratch/big.exr" --ch R,G,B --resize:filter=box $size --colorconvert linear sRGB -d uint8 -o "$9"
  rm -r "$scratch"
}
draw() { # FILE CAMERA... OUT.png OPTION...
  build/slfview "$1" --camera "$3,$4,$5,$6,$7,$8,$9" --size $size --backend osmesa --output "${10}" "${@:11}"
}
nbytes() { # FILE SURFACES, in MB
  build/slf info "$1" | awk -v names=" $2 " '/^surface/ { on = index(names, " " $3 " ") } on && $2 == "MB" { sum += $1 } END { print sum }'
}
# Sets psnr and flip: means over the views.
measure() { # SCENE SURFACES FILE MIX
  local scene=$1 file=$3 camera base surface
  while read -r -a camera; do
    base="$out/$scene-${camera[0]}"
    [ -f "$base-truth.png" ] || truth "$scene" "${camera[@]}" "$base-truth.png" < /dev/null
    if [ ! -f "$base-mask.png" ]; then
      for surface in $2; do draw "$file" "${camera[@]}" "$base-mask-$surface.png" --mask "$surface"; done
      oiiotool "$base"-mask-*.png $(for surface in ${2#* }; do [ "$2" = "$surface" ] || echo --max; done) -o "$base-mask.png"
      rm "$base"-mask-*.png
    fi
    draw "$file" "${camera[@]}" "$base-$4.png" --samples 3 --mix "$4"
    read -r db _ < <(build/tests/images/compare "$base-truth.png" "$base-$4.png" "$base-mask.png")
    echo "$db $(build/venv/bin/python tests/bench/flip.py "$base-truth.png" "$base-$4.png" "$base-mask.png")"
  done < <(cameras "$scene") | awk '$1 > 0 { db += $1; flip += $2; n++ } END { printf "%.2f %.4f\n", db/n, flip/n }' > "$out/means"
  read -r psnr flip < "$out/means"
}
gain() { # SCENE SURFACES PAPER.slf DEPTH.slf
  measure "$1" "$2" "$3" four-tap; local p=$psnr f=$flip
  measure "$1" "$2" "$4" depth
  awk -v s="$1" -v p="$p" -v d="$psnr" -v fp="$f" -v fd="$flip" -v pn="$(nbytes "$3" "$2")" -v dn="$(nbytes "$4" "$2")" 'BEGIN {
    printf "  \"depth_gain_db_%s\": %.2f,\n  \"depth_gain_bytes_ratio_%s\": %.3f,\n", s, d - p, s, dn/pn
    printf "  \"depth_psnr_%s_four_tap\": %.2f,\n  \"depth_psnr_%s\": %.2f,\n", s, p, s, d
    printf "  \"depth_flip_%s_four_tap\": %.4f,\n  \"depth_flip_%s\": %.4f,\n", s, fp, s, fd }'
}
heights_share() { # FILE SURFACE: of the surface's bytes, with the heights' coverage
  build/slf info "$1" | awk -v name="$2" '/^surface/ { on = $3 == name } on && $1 == "layer" { height = $3 == "height," || $3 == "coverage," }
    on && $2 == "MB" { sum += $1; if (height) heights += $1 } END { printf "  \"depth_heights_share_%s\": %.3f,\n", name, heights/sum }'
}

{
echo "{"
for part; do
  case $part in
    floor)
      tests/bench/bakes.sh floor_9_rays-16 depth-floor-8 depth-floor-256-16 depth-floor-96-6 paper-floor-64 >&2
      gain floor floor build/bench-floor_9_rays-16.slf build/bench-depth-floor-8.slf
      heights_share build/bench-depth-floor-8.slf floor
      measure floor floor build/bench-depth-floor-256-16.slf depth
      echo "  \"depth_psnr_floor_256_16_coded\": $psnr,"
      # The paper's way with 64x64 directions, one ray a texel; how small layers are that come out as well.
      measure floor floor build/bench-paper-floor-64.slf four-tap; p=$psnr f=$flip
      measure floor floor build/bench-depth-floor-96-6.slf depth
      awk -v p="$p" -v d="$psnr" -v fp="$f" -v fd="$flip" -v pn="$(nbytes build/bench-paper-floor-64.slf floor)" -v dn="$(nbytes build/bench-depth-floor-96-6.slf floor)" 'BEGIN {
        printf "  \"depth_bytes_vs_four_tap_64\": %s,\n", (d >= p ? sprintf("%.4f", dn/pn) : "null")
        printf "  \"depth_psnr_four_tap_64\": %.2f,\n  \"depth_psnr_floor_96_6\": %.2f,\n", p, d
        printf "  \"depth_flip_four_tap_64\": %.4f,\n  \"depth_flip_floor_96_6\": %.4f,\n", fp, fd }'
      ;;
    bottle)
      # The paper's way, too, has more texels along the bottle: better than as many around it.
      tests/bench/bakes.sh paper-bottle-16 depth-bottle-6 >&2
      gain bottle bottle build/bench-paper-bottle-16.slf build/bench-depth-bottle-6.slf
      heights_share build/bench-depth-bottle-6.slf bottle
      ;;
    cube)
      tests/bench/bakes.sh cube-16 depth-cube-12 >&2
      gain cube "cube_near cube_far cube_left cube_right cube_top" build/bench-cube-16.slf build/bench-depth-cube-12.slf
      ;;
    pond)
      tests/bench/bakes.sh pond_256_texels-16 depth-pond-8 >&2
      gain pond water build/bench-pond_256_texels-16.slf build/bench-depth-pond-8.slf
      heights_share build/bench-depth-pond-8.slf water
      build/bench/depth pond build/bench-depth-pond-8.slf | sed '1d;$d;s/\([0-9]\)$/\1,/'
      ;;
    flight)
      tests/bench/bakes.sh depth-pond-8 >&2
      tests/bench/flight.sh build/bench-depth-pond-8.slf 200 160x120 build/bench/flight | sed '$s/$/,/'
      build/venv/bin/python tests/bench/flicker.py build/bench/flight 200 | sed '$s/$/,/'
      ;;
    speed)
      tests/bench/bakes.sh depth-floor-256-16 >&2
      # Where the system places a process's memory decides how much of it the shared cache keeps: medians of nine.
      for _ in 1 2 3 4 5 6 7 8 9; do build/bench/depth mix build/bench-depth-floor-256-16.slf; done |
        jq -s 'map(to_entries[]) | group_by(.key) | map({(.[0].key): (map(.value) | sort | .[4])}) | add' | sed '1d;$d;s/\([0-9]\)$/\1,/'
      ;;
    *) echo "depth.sh: '$part': expected floor, bottle, cube, pond, flight or speed" >&2; exit 2 ;;
  esac
done | sed '$s/,$//'
echo "}"
} > build/bench/depth.json.part
mv build/bench/depth.json.part build/bench/depth.json
cat build/bench/depth.json
