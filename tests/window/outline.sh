#!/bin/bash
# Pictures without a screen. A floor and a ball of the same radiance everywhere show that radiance at
# every pixel, up to their outlines and at any distance: a filter that let in texels that were not
# made, or that look away, would darken some. And OSMesa and EGL draw the same.
# usage: outline.sh (from the repository's root; build/slfview, build/asan/slfview and
# build/bench/room exist)
set -u
out=build/tap/outline; mkdir -p "$out"
count=0
check() { # WHAT COMMAND...
  local what=$1; shift; count=$((count + 1))
  if "$@"; then echo "ok $count - $what"; else echo "not ok $count - $what"; fi
}
# 90 texels are no power of two and no multiple of a block's 8.
build/bench/room 90 8 0 95 "$out/even.slf" || exit 1
draw() { build/slfview "$out/even.slf" --output "$out/$1.png" "${@:2}"; }
code=$(awk 'BEGIN { printf "%d", 255 * (1.055 * 0.5 ^ (1 / 2.4) - 0.055) + 0.5 }')
even() { # PICTURE SURFACE OPTIONS...: pixels of the surface that differ from the code
  draw "$1" "${@:3}" --backend osmesa && draw "$1-mask" "${@:3}" --mask "$2" --backend osmesa || return 1
  convert "$out/$1.png" "$out/$1-mask.png" -compose multiply -composite "$out/$1-seen.png"
  convert "$out/$1-mask.png" -fill "rgb($code,$code,$code)" -opaque white "$out/$1-wanted.png"
  local off; off=$(compare -metric AE -alpha off "$out/$1-seen.png" "$out/$1-wanted.png" null: 2>&1)
  echo "# $1: $off pixels of $2 are not $code, mean of the mask $(identify -format '%[fx:mean]' "$out/$1-mask.png")"
  [ "$off" = 0 ] && identify -format '%[fx:mean]' "$out/$1-mask.png" | awk '{ exit !($1 > 0.0005) }'
}

echo "1..18"
for view in door floor ball near grazing; do
  check "the ball is even at view $view" even "ball-$view" ball --view $view --filter anisotropic
done
check "the floor is even from the door" even floor-door floor --view door --filter anisotropic
check "the floor is even when grazed" even floor-grazing floor --view grazing --filter anisotropic
check "the ball is even, trilinear" even trilinear ball --view door --filter trilinear
check "the ball is even when it covers few pixels" even small ball --view door --size 40x30
check "the ball is even from far away" even far ball --camera -2.9,3.9,-2.9,0.6,1.1,0.4,120 --size 64x48
# The room's radius is 4.7; what is nearer than 1/100,000 of it would be cut off.
check "the floor is even from 1/1000 above it" even touching floor --camera -1,0.001,-1,-1,0,-1.0001,60
check "and fills the picture" eval '[ "$(identify -format "%[fx:mean]" "$out/touching-mask.png")" = 1 ]'
check "OSMesa and EGL draw the same" eval \
  'draw osmesa --backend osmesa && draw egl --backend egl && cmp "$out/osmesa.png" "$out/egl.png"'
for cache in 0 4; do
  check "a cache of $cache blocks draws the same" eval \
    'draw cache --backend osmesa --cache $cache && cmp "$out/osmesa.png" "$out/cache.png"'
done
# A flight through everything: random cameras inside objects, behind walls, on the floor, at 1e6, and
# splines between them, four frames each.
awk 'BEGIN { srand(5); for (i = 0; i < 2500; i++) {
  far = i % 10 ? 4 : 1e6
  printf "%d %g %g %g %g %g %g %g\n", i, far*(2*rand()-1), i % 7 ? far*(2*rand()-1) : 0, far*(2*rand()-1),
    4*(2*rand()-1), 4*rand(), 4*(2*rand()-1), 5 + 170*rand() } }' > "$out/flight.path"
fly() { # FRAMES
  build/slfview "$out/even.slf" --path "$out/flight.path" --bench "$1" --size 32x24 --cache 100 --backend osmesa > "$out/flight$1.json"
}
check "a flight of 10,000 frames through everything" fly 10000
# A page cache, a driver's pool: 1 MB is room for them, and 100 bytes a frame would be found.
check "takes no more memory than one of 1,000" eval \
  'fly 1000 && jq -s -e ".[0].peak_rss_mb - .[1].peak_rss_mb < 1" "$out/flight10000.json" "$out/flight1000.json"'
# OSMesa itself keeps 480 bytes when its context is destroyed, however many frames were drawn.
echo "leak:libOSMesa" > "$out/driver.supp"
check "300 frames of it under the sanitizers, without a leak" eval \
  'LSAN_OPTIONS=suppressions=$out/driver.supp:print_suppressions=0 build/asan/slfview "$out/even.slf" \
   --path "$out/flight.path" --bench 300 --size 32x24 --cache 100 --backend osmesa > "$out/asan.json" 2> "$out/asan.txt"'
