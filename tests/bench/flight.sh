#!/bin/bash
# A flight past a column in front of a wall, over the pond: how far the water's PSNR against POV-Ray
# falls below its neighbours' in any frame, and the film of both side by side. Prints flat JSON members.
# The whole flight has 200 frames; fewer are its first.
# usage: flight.sh FILE.slf FRAMES WxH OUT (a folder), from the repository's root; FILE.slf: the pond as layers
set -eu
file=$1 frames=$2 size=$3 out=$4
from="0.6 1.4 -3.6" at="0.6 0.5 1.5" angle=70
to="$(awk -v n="$frames" 'BEGIN { print 0.6 - 3.2*(n - 1)/199 }') 1.4 -3.6"
rm -rf "$out"; mkdir -p "$out"
read -r width height <<< "${size/x/ }"
printf '0 %s %s %s\n1 %s %s %s\n' "$from" "$at" $angle "$to" "$at" $angle > "$out/path"
fps=$((frames - 1))
build/slfview "$file" --path "$out/path" --fps $fps --size "$size" --samples 2 --backend osmesa --output "$out/ours-%04d.png" >&2
build/slfview "$file" --path "$out/path" --fps $fps --size "$size" --mask water --backend osmesa --output "$out/mask-%04d.png" >&2
vector() { echo "<${1// /, }>"; }
cat > "$out/flight.pov" <<POV
#version 3.7;
#include "pond.pov"
camera { perspective location $(vector "$from") + clock*($(vector "$to") - $(vector "$from"))
  right x*$width/$height up y angle $angle look_at $(vector "$at") }
POV
povray "+I$out/flight.pov" "+L$PWD/bake" "+L$PWD/scenes/pond" "+O$out/truth-.exr" +FE +W$((2 * width)) +H$((2 * height)) \
  -A -D -GA +KFI0 "+KFF$((frames - 1))" +KI0 +KF1 > "$out/log" 2>&1 || { tail -n 5 "$out/log" >&2; exit 1; }
for ((i = 0; i < frames; i++)); do
  number=$(printf %04d $i)
  for exr in "$out"/truth-$number.exr "$out/truth-$(printf "%0${#fps}d" $i).exr"; do [ ! -f "$exr" ] || break; done
  oiiotool "$exr" --ch R,G,B --resize:filter=box "$size" --colorconvert linear sRGB -d uint8 -o "$out/truth-$number.png"
  rm -f "$exr"
  build/tests/images/compare "$out/truth-$number.png" "$out/ours-$number.png" "$out/mask-$number.png"
done > "$out/psnr"
ffmpeg -v error -y -framerate 30 -i "$out/truth-%04d.png" -framerate 30 -i "$out/ours-%04d.png" -filter_complex hstack \
  -pix_fmt yuv420p "$out/flight.mp4"
awk '{ p[NR] = $1; sum += $1 } END {
  for (i = 2; i < NR; i++) { low = p[i-1] < p[i+1] ? p[i-1] : p[i+1]; if (low - p[i] > worst) worst = low - p[i] }
  printf "  \"depth_flight_frames\": %d,\n  \"depth_flight_psnr\": %.2f,\n  \"depth_flight_worst_drop_db\": %.2f\n", NR, sum / NR, worst }' "$out/psnr"
