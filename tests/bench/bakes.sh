#!/bin/bash
# Bakes the light fields of tests/bench/bakes that are missing or stale, one after another: each keeps
# all processors busy. What a bake from nothing took, in seconds of processor time, is kept beside it,
# build/bench-NAME.cpu_s.
# usage: bakes.sh [NAME...] (all of them), with QUALITY from the environment
set -eu
# NAME SCENE TEXELS RAYS DECLARE...
bake() {
  name=bench-$1 scene=$2 texels="Texels=$3" rays=$4; shift 4
  declare=("Directions=${name##*-}" "$texels" "$@")
  if [ "${QUALITY:-}" = paper ]; then
    rays=25
    [[ $name = *_texels-* ]] || texels=
    declare=("Directions=${name##*-}" $texels "$@")
  fi
  [ -d "build/bake/$name" ] || fresh=1
  count_s; before=$s
  env -u MAKEFLAGS -u MFLAGS -u MAKELEVEL make --no-print-directory bake SCENE="$scene" NAME="$name" QUALITY=paper \
    RAYS="$rays" DECLARE="${declare[*]}"
  if [ -n "${fresh:-}" ]; then count_s; awk "BEGIN { print $s - $before }" > "build/$name.cpu_s"; fi
  fresh=
}
# s: processor time of the children so far. `times` knows its own shell's alone, so no pipe and no $().
count_s() {
  times > build/bench/times
  s=$(awk -F'[ms ]' 'NR == 2 { print 60 * $1 + $2 + 60 * $4 + $5 }' build/bench/times)
}
listed() { # NAME: its line
  awk -v name="$1" '$1 == name' tests/bench/bakes | grep . || { echo "bakes.sh: tests/bench/bakes has no '$1'" >&2; exit 1; }
}
mkdir -p build/bench
[ $# -gt 0 ] || set -- $(awk '/^[^#]/ { print $1 }' tests/bench/bakes)
for wanted; do
  line=$(listed "$wanted")
  # shellcheck disable=SC2086 # words
  bake $line
done
