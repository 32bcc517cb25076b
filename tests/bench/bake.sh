#!/bin/bash
# Rays a processor second of the bake, everything included (places of rays, cover, cameras, POV-Ray,
# means, packing), over those of POV-Ray's own perspective render of the same scene with as many rays.
# Side by side, in processor seconds, from a camera that sees little but the surface that is baked: a
# ray of either then does the same work. Writes build/bench/bake.json.
set -eu
cd "$(dirname "$0")/../.."
mkdir -p build/bench
TIMEFORMAT='%U %S'

# cpu_s COMMAND...: processor seconds of a command, which must succeed, and all it starts.
cpu_s() {
  local times
  times=$({ time "$@" > build/bench/bake.log 2>&1; } 2>&1) || { cat build/bench/bake.log >&2; return 1; }
  awk '{ print $1 + $2 }' <<< "$times"
}
sum() { awk "BEGIN { print $* }"; }

# compare SCENE SURFACE NAME DECLARE RAYS_IN_ALL WIDTH HEIGHT CAMERA: prints the ratio.
compare() {
  scene=$1 surface=$2 name=$3 declare=$4 rays=$5 width=$6 height=$7 camera=$8
  bake=(make --no-print-directory bake "SCENE=$scene" "NAME=$name" "DECLARE=$declare" QUALITY=paper RAYS=9)
  printf '#version 3.7;\n#include "scenes/%s/%s.pov"\ncamera { perspective right x up y %s }\n' "$scene" "$scene" "$camera" \
    > build/bench/bake.pov
  povray=(povray +Ibuild/bench/bake.pov +Lbake "+Lscenes/$scene" "+W$width" "+H$height" +WT1 -A -D -V +FE "+Obuild/bench/bake.exr")
  for value in $declare; do povray+=("Declare=$value"); done
  "${bake[@]}" > build/bench/bake.log 2>&1
  rm -rf build/bake/"$name/$surface"/{0*.exr,rays*,cover*}
  ours=$(cpu_s "${bake[@]}")
  theirs=$(cpu_s "${povray[@]}")
  echo "$name: $rays rays baked in $ours s; $((width*height)) rendered in $theirs s" >&2
  sum "($rays/$ours)/($width*$height/$theirs)"
}

# 9 rays; of 16 x 16 slices 244 exist, of 8 x 8 all.
planar=$(compare floor floor bench-planar "Mirror=1 Texels=64 Directions=16" $((64*64*244*9)) 3072 2928 \
  'location <-0.3, 3.9, -1.2> angle 84 look_at <-0.3, 0, -1.201>')
curved=$(compare bottle bottle bench-curved "Texels=32 Directions=8" $((32*32*64*9)) 768 768 \
  'location <-0.9, 0.9, -1.8> angle 33 look_at <0, 0.85, 0>')
printf '{\n  "bake_planar_vs_povray": %.3f,\n  "bake_curved_vs_povray": %.3f\n}\n' "$planar" "$curved" \
  > build/bench/bake.json.part
mv build/bench/bake.json.part build/bench/bake.json
cat build/bench/bake.json
