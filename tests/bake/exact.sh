#!/bin/sh
# Light fields with a closed form, through POV-Ray and the gathering: see exact.c.
set -e
bake() {
  make --no-print-directory bake SCENES=tests/bake SCENE=exact QUALITY=paper \
    "NAME=$1" "DECLARE=$2" "RAYS=$3" >&2
}
bake test-place "Mirror=0 Scale=1" 1 & place=$!
bake test-mirror "Mirror=1 Scale=4" 1 & mirror=$!
bake test-diffuse "Mirror=0 Scale=0.125" 9 & diffuse=$!
bake test-reflection "Mirror=1 Scale=0.5" 9
wait $place && wait $mirror && wait $diffuse
exec build/tests/bake/exact build/bake/test-place build/bake/test-mirror build/bake/test-diffuse \
  build/bake/test-reflection
