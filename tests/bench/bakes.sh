#!/bin/bash
# Bakes the light fields of tests/bench/bakes that are missing or stale, three at a time: while
# POV-Rays of one start, or it is packed, the others keep the processors busy. What a bake from nothing
# took, in seconds of processor time, is kept beside it, build/bench-NAME.cpu_s.
# usage: bakes.sh [NAME...] (all of them), with QUALITY from the environment
set -eu
# NAME SCENE TEXELS RAYS DECLARE...
bake() {
  # A preview halves the texels that a scene declares, the matte ones' too.
  name=bench-$1 scene=$2 texels=$3 rays=$4 quality=preview declared=$((2*$3)); shift 4
  if [ "${QUALITY:-}" = paper ]; then
    rays=25 quality=paper declared=
    [[ $name != *_texels-* ]] || declared=$texels
  fi
  declare=("Directions=${name##*-}" ${declared:+"Texels=$declared"} "$@")
  fresh=; [ -d "build/bake/$name" ] || fresh=1
  env -u MAKEFLAGS -u MFLAGS -u MAKELEVEL make --no-print-directory bake SCENE="$scene" NAME="$name" \
    QUALITY="$quality" RAYS="$rays" DECLARE="${declare[*]}"
  [ -n "$fresh" ] || return 0
  # `times` knows its own shell's children alone, so no pipe and no $().
  times > "build/bench/$name.times"
  awk -F'[ms ]' 'NR == 2 { print 60 * $1 + $2 + 60 * $4 + $5 }' "build/bench/$name.times" > "build/$name.cpu_s"
  rm "build/bench/$name.times"
}
listed() { # NAME: its line
  awk -v name="$1" '$1 == name' tests/bench/bakes | grep . || { echo "bakes.sh: tests/bench/bakes has no '$1'" >&2; exit 1; }
}
mkdir -p build/bench
[ $# -gt 0 ] || set -- $(awk '/^[^#]/ { print $1 }' tests/bench/bakes)
running=0
for wanted; do
  line=$(listed "$wanted")
  [ $running -lt 3 ] || { wait -n; running=$((running - 1)); }
  # shellcheck disable=SC2086 # words
  (bake $line) &
  running=$((running + 1))
done
for ((; running > 0; running--)); do wait -n; done
