#!/bin/bash
# What the codec costs and gains, as one flat object of named numbers: build/bench/codec.json.
# usage: codec.sh [PART...] (all of them), from the repository's root; bakes what is missing.
# A part is a light field of tests/bench/bakes, or the synthetic mirror: its numbers go to
# build/bench/codec.parts/PART.json, with keys that end in SCENE_DIRECTIONS. Times are the processor's, as ratios
# in one run, so that each processor measures a part. When all are there they are put together, and of those
# that a goal names the worst over the parts stands under the bare name.
set -eu
all="bottle-64 bottle-32 cube-32 box_128_texels-16 bottle-16 floor_9_rays-16 synthetic-16"
out=build/bench/codec.parts; mkdir -p "$out"
first() { # the first surface of a scene with directions
  awk '/^surface /{ if ($5 > 1) { print $2; exit } }' "$1/scene.txt"
}
rays() { # that it was baked with
  awk '/^BAKE_RAYS/{ print $NF }' "$1/options.mk"
}
measure() { # PART: ours beside libjpeg-turbo, then the other peers
  label=$(echo "$1" | sed -E 's/_[0-9]+_(rays|texels)//; s/-/_/') folder=build/bake/bench-$1 new=$out/$1.part
  rm -f "$out/$1.json"
  if [ "$1" = synthetic-16 ]; then
    build/bench/codec "$label" > "$new"
  else
    set -- "$1" "$folder" "$(first "$folder")" "$(rays "$folder")"
    build/bench/codec "$label" "$2" "$3" "$4" > "$new"
    build/bench/venv/bin/python tests/bench/peers.py build/bench/codec "$new" "$label" "$2" "$3" "$4"
  fi
  mv "$new" "$out/$1.json"
}
parts=${*:-$all}
# shellcheck disable=SC2086 # words
baked=$(printf '%s\n' $parts | grep -v '^synthetic' || true)
# shellcheck disable=SC2086
[ -z "$baked" ] || tests/bench/bakes.sh $baked
running=0
for part in $parts; do
  [ $running -lt "$(nproc)" ] || { wait -n; running=$((running - 1)); }
  measure "$part" &
  running=$((running + 1))
done
for ((; running > 0; running--)); do wait -n; done
set --
for part in $all; do
  [ -s "$out/$part.json" ] || { echo "codec.sh: $out/$part.json is still to come" >&2; exit 0; }
  set -- "$@" "$out/$part.json"
done
jq -s 'add as $n
  | def over(key): [$n | to_entries[] | select(.key | test("^" + key + "_[a-z]+_[0-9]+$")) | .value];
  $n + {identical_gain_box: $n.identical_gain_box_16,
    decode_vs_libjpeg: (over("decode_vs_libjpeg") | max),
    decode_random_vs_libjpeg: (over("decode_random_vs_libjpeg") | max),
    ratio_none_vs_libjpeg: (over("ratio_none_vs_libjpeg") | min),
    ratio_layered_vs_jxl: (over("ratio_layered_vs_jxl") | min),
    ratio_layered_vs_avif: (over("ratio_layered_vs_avif") | min),
    ratio_layered_vs_zfp: (over("ratio_layered_vs_zfp") | min),
    ratio_layered_vs_astc: (over("ratio_layered_vs_astc") | min),
    ratio_layered_vs_vq: (over("ratio_layered_vs_vq") | min)}' "$@" > build/bench/codec.json.part
mv build/bench/codec.json.part build/bench/codec.json
