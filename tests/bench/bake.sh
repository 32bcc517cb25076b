#!/bin/bash
# Rays a processor second of the bake, everything included (places of rays, cover, cameras, POV-Ray,
# means, packing), over those of POV-Ray's own perspective render of the same scene with as many rays,
# both on all processors. Writes build/bench/bake.json:
#   bake_planar_vs_povray, bake_curved_vs_povray         like with like: from three cameras that see nothing
#                                                        but the surface that is baked, in directions as
#                                                        oblique as a bake's (their mean n is 2/3), a third
#                                                        of the rays each
#   bake_planar_vs_own_camera, bake_curved_vs_own_camera from the scene's own camera, which mostly sees
#                                                        matte walls, where rays end
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
calculate() { awk "BEGIN { print $* }"; }

# render SCENE DECLARE SIDE CAMERA: processor seconds of POV-Ray's picture of SIDE x SIDE rays.
render() {
  local povray=(povray +Ibuild/bench/bake.pov +Lbake "+Lscenes/$1" "+W$3" "+H$3" "+WT$(nproc)" -A -D -V +FE
    +Obuild/bench/bake.exr)
  for value in $2; do povray+=("Declare=$value"); done
  printf '#version 3.7;\n#include "%s.pov"\n' "$1" > build/bench/bake.pov
  [ "$4" = own ] || echo "camera { perspective right x up y $4 }" >> build/bench/bake.pov
  cpu_s "${povray[@]}"
}

# compare SCENE SURFACE NAME DECLARE RAYS CAMERA...: the ratios, from the cameras together and from the own
compare() {
  local scene=$1 surface=$2 name=$3 declare=$4 rays=$5 bake ours theirs=0 own slices texels side
  shift 5
  bake=(make --no-print-directory bake "SCENE=$scene" "NAME=$name" "DECLARE=$declare" QUALITY=preview "RAYS=$rays")
  "${bake[@]}" > build/bench/bake.log 2>&1 || { cat build/bench/bake.log >&2; return 1; }
  rm -rf build/bake/"$name/$surface"/{0*.exr,rays*,cover*}
  ours=$(cpu_s "${bake[@]}")
  read -r texels slices < <(build/slf info build/"$name".slf | awk -v surface="$surface" '
    $1 == "surface" { here = $3 == surface }
    here && match($0, /[0-9]+x[0-9]+ texels/) { split(substr($0, RSTART), t, /[x ]/); match($0, /\([0-9]+ slices/)
      print t[1]*t[2], substr($0, RSTART + 1) + 0 }')
  side=$(calculate "int(sqrt($texels*$slices*$rays/$#))")
  for camera; do theirs=$(calculate "$theirs + $(render "$scene" "$declare" "$side" "$camera")"); done
  own=$(render "$scene" "$declare" "$side" own)
  awk -v name="$name" -v baked=$((texels*slices*rays)) -v ours="$ours" -v rendered=$((side*side*$#)) -v theirs="$theirs" \
    -v seen=$((side*side)) -v own="$own" 'BEGIN {
      printf "%s: %d rays, %.3f us a ray baked; POV-Ray %.3f us from cameras that see the surface, %.3f us from its own\n",
        name, baked, 1e6*ours/baked, 1e6*theirs/rendered, 1e6*own/seen > "/dev/stderr"
      printf "%.3f %.3f\n", theirs/rendered/(ours/baked), own/seen/(ours/baked) }'
}

# A preview has half the texels that are declared. Of the floor three places that nothing stands on; the bottle's
# body level and from 45 degrees above and below.
read -r planar planar_own < <(compare floor floor bench-planar "Mirror=1 Texels=128 Directions=16" 25 \
  'angle 108 location <-2.6, 1, -2.6> look_at <-2.6, 0, -2.601>' \
  'angle 108 location <2.6, 1, 2.6> look_at <2.6, 0, 2.599>' \
  'angle 108 location <-0.5, 1, -2.2> look_at <-0.5, 0, -2.201>')
read -r curved curved_own < <(compare bottle bottle bench-curved "Texels=64 Directions=8" 25 \
  'angle 33 location <-0.9, 0.9, -1.8> look_at <0, 0.85, 0>' \
  'angle 25 location <-0.75, 2.25, -1.5> look_at <-0.2, 1.05, -0.4>' \
  'angle 25 location <-0.9, 0.02, -1.8> look_at <-0.2, 0.95, -0.4>')
printf '{\n  "bake_planar_vs_povray": %s,\n  "bake_planar_vs_own_camera": %s,\n  "bake_curved_vs_povray": %s,\n  "bake_curved_vs_own_camera": %s\n}\n' \
  "$planar" "$planar_own" "$curved" "$curved_own" > build/bench/bake.json.part
mv build/bench/bake.json.part build/bench/bake.json
cat build/bench/bake.json
