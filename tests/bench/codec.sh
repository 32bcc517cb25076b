#!/bin/sh
# What the codec costs and gains, as one flat object of named numbers: build/bench/codec.json.
# usage: codec.sh, from the repository's root, after make bench-bakes. Keys end in SCENE_DIRECTIONS;
# those without a scene's name are the worst over the scenes.
set -eu
out=build/bench; mkdir -p "$out"
first() { # the first surface of a scene with directions
  awk '/^surface /{ if ($5 > 1) { print $2; exit } }' "$1/scene.txt"
}
rays() { # that it was baked with
  awk '/^BAKE_RAYS/{ print $NF }' "$1/options.mk"
}
set --
for job in floor-16 bottle-16 bottle-32 bottle-64 box-16 cube-32; do
  folder=build/bake/bench-$job
  [ -s "$folder/scene.txt" ] || { echo "codec.sh: $folder is missing: make bench-bakes" >&2; exit 1; }
  set -- "$@" "$folder" "$(first "$folder")" "$(rays "$folder")" "$(echo "$job" | tr - _)"
done
build/bench/codec "$@" > "$out/codec.json.new"
jq '. + {identical_gain_box: .identical_gain_box_16}' "$out/codec.json.new" > "$out/codec.json.part"
build/bench/venv/bin/python tests/bench/peers.py build/bench/codec "$out/codec.json.part" "$@"
mv "$out/codec.json.part" "$out/codec.json"
