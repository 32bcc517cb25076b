#!/bin/bash
# A real window, under a virtual X server: what keys, mouse and resizing do is read from pixels.
# usage: window.sh (from the repository's root; build/slfview and build/bench/room exist)
set -u
if [ "${1:-}" != inside ]; then
  out=build/tap/window; mkdir -p "$out"
  # The size of the screen bounds the window's; 24 bits, as import compares exact colours.
  exec xvfb-run -a -s "-screen 0 1280x1024x24" "$0" inside "$out"
fi
out=$2
count=0
check() { # WHAT COMMAND...
  local what=$1; shift; count=$((count + 1))
  if "$@"; then echo "ok $count - $what"; else echo "not ok $count - $what"; fi
}
wait_for() { # COMMAND...: until it holds, 20 s at most: slow machines
  for _ in $(seq 100); do "$@" > "$out/wait" 2>&1 && return 0; sleep 0.2; done; return 1
}
shot() { sleep 0.4; import -window "$id" "$out/$1.png"; } # a few frames, drawn in software
differ() { [ "$(compare -metric AE "$out/$1.png" "$out/$2.png" null: 2>&1)" -gt "${3:-500}" ]; }
same() { [ "$(compare -metric AE "$out/$1.png" "$out/$2.png" null: 2>&1)" -eq 0 ]; }
same_above() { # without the lowest 64 rows, where messages are
  for i in "$1" "$2"; do convert "$out/$i.png" -gravity south -chop 0x64 "$out/$i-above.png"; done
  same "$1-above" "$2-above"
}
key() { xdotool key "$@"; }
alive() { kill -0 "$pid" 2>/dev/null; }
size_is() { [ "$(identify -format %wx%h "$out/$1.png")" = "$2" ]; }
mean_between() { # PICTURE LOW HIGH: of the mean of all channels, 0 to 1
  identify -format '%[fx:mean]' "$out/$1.png" | awk -v l="$2" -v h="$3" '{ exit !($1 > l && $1 < h) }'
}
green() { # PICTURE: pixels of the cache map's green
  convert "$out/$1.png" -fill white -opaque 'rgb(40,220,60)' -fill black +opaque white \
    -format '%[fx:int(mean*w*h)]' info:
}

echo "1..25"
build/bench/room 64 8 1 80 "$out/room.slf" && build/bench/room 32 4 1 80 "$out/small.slf" || exit 1
slfview=$PWD/build/slfview
( cd "$out" && rm -f slfview-* && exec "$slfview" room.slf small.slf --size 640x480 --watch --filter anisotropic ) \
  > "$out/stdout" 2> "$out/stderr" & pid=$!
wait_for xdotool search --name room.slf
id=$(xdotool search --name room.slf | head -1)
check "a window opens, titled with the file" [ -n "$id" ]
xdotool windowfocus "$id"
shot start
check "the first frame is a picture" mean_between start 0.15 0.85
"$slfview" "$out/room.slf" --output "$out/headless.png" --backend osmesa
check "the window shows what --output writes" same start headless

key h; shot help
check "H shows the help" differ start help 10000
key h i; shot statistics
check "I shows statistics" differ start statistics 1000
key i; shot none
check "and both go away again" same start none
key m; shot map
check "M shows the cache map, with cached blocks in green" [ "$(green map)" -gt 50 ]
key m l; shot slice
check "L shows a slice" differ none slice 5000
key Right; shot slice_right
check "Right shows the next slice" differ slice slice_right 100
key l; shot none2
check "back to the scene" same start none2

xdotool mousemove --window "$id" 320 100 mousedown 1 mousemove --window "$id" 370 110 mouseup 1; shot orbit
check "dragging orbits" differ start orbit 10000
key r; shot reset
check "R goes back" same start reset
xdotool mousemove --window "$id" 320 100 mousedown 3 mousemove --window "$id" 360 120 mouseup 3; shot look
check "the right button looks around" differ start look 10000
key r; xdotool keydown w; sleep 0.5; xdotool keyup w; shot walk
check "W walks" differ start walk 10000
key r; xdotool click 4; shot wheel
check "the wheel approaches" differ start wheel 10000
key r 9; shot angle
check "9 narrows the field of view" differ start angle 10000
key r j j j; shot matte
check "J coarsens the directions" differ start matte 5000
key k k k F8; shot bright
check "F8 is brighter" differ start bright 10000
key F7; shot dim
check "F7 undoes it" same_above start dim
key F12; sleep 1
png=$(ls "$out"/slfview-*.png 2>/dev/null | head -1); cp "${png:-/dev/null}" "$out/screenshot.png"
check "F12 writes what the window shows, without overlays" same start screenshot
key c; sleep 0.5
check "C prints the camera for POV-Ray" grep -q 'camera { perspective location <-2.2, 1.7, -2.4>' "$out/stdout"
xdotool windowsize "$id" 800 500; shot wide
check "a resized window is redrawn at its new size" size_is wide 800x500
"$slfview" "$out/room.slf" --output "$out/headless_wide.png" --size 800x500 --backend osmesa
check "and shows the same camera" same_above wide headless_wide
key F4; sleep 1
check "F4 shows the next file" wait_for xdotool search --name small.slf
key Escape
wait_for eval '! alive'
wait "$pid"; rc=$?
check "Escape ends it, in peace and in silence" [ "$rc" -eq 0 ] && [ ! -s "$out/stderr" ]
