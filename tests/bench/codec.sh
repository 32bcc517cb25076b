#!/bin/sh
# What the codec costs and gains, as one flat object of named numbers: build/bench/codec.json.
# Bakes what it measures at QUALITY; the light fields stay for the next time.
set -eu
out=build/bench; mkdir -p "$out"
quality=${QUALITY:-preview}
rays=9; [ "$quality" = paper ] && rays=25
bake() { # SCENE DIRECTIONS DECLARE
  name=bench-$1-$2
  [ -s "build/$name.slf" ] || env -u MAKEFLAGS -u MFLAGS make --no-print-directory bake SCENE="$1" NAME="$name" \
    DECLARE="Directions=$2 $3" QUALITY="$quality" >&2
}
set --
bake floor 16 Mirror=1
bake bottle 16 ""
bake bottle 32 ""
bake bottle 64 "Texels=128"
bake box 16 "Texels=256"
bake cube 32 "Texels=64"
first() { # the first surface of a scene with directions
  awk '/^surface /{ if ($5 > 1) { print $2; exit } }' "build/bake/$1/scene.txt"
}
for job in floor_16 bottle_16 bottle_32 bottle_64 box_16 cube_32; do
  name=bench-$(echo "$job" | tr _ -)
  set -- "$@" "build/bake/$name" "$(first "$name")" "$rays" "$job"
done
build/bench/codec "$@" > "$out/codec.json.part"
mv "$out/codec.json.part" "$out/codec.json"
