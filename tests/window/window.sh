#!/bin/bash
# A real window, under a virtual X server: what keys, mouse and resizing do is read from pixels.
# usage: window.sh (from the repository's root; build/slfview, build/bench/room, build/tests/window and
# build/check-floor-layers.slf exist)
set -u
if [ "${1:-}" != inside ]; then
  out=build/tap/window; mkdir -p "$out"
  # The size of the screen bounds the window's; 24 bits, as import compares exact colours.
  # A server that starts anew when its last window closes would refuse the next one meanwhile.
  exec xvfb-run -a -n 130 -s "-screen 0 1280x1024x24 -noreset" "$0" inside "$out"
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
# Whether it comes to show what is asked for, after the keys that were pressed: NEW PREDICATE...,
# which reads NEW.png. A loaded machine may need seconds for a frame.
shows() {
  local new=$1; shift
  for _ in $(seq 60); do
    sleep 0.2; import -window "$id" "$out/$new.png"
    "$@" 2>/dev/null && return 0
  done
  return 1
}
differ() { [ "$(compare -metric AE "$out/$1.png" "$out/$2.png" null: 2>&1)" -gt "${3:-500}" ]; }
same() { [ "$(compare -metric AE "$out/$1.png" "$out/$2.png" null: 2>&1)" -eq 0 ]; }
# Without the lowest 64 rows, where messages are.
chop() { for i; do convert "$out/$i.png" -gravity south -chop 0x64 "$out/$i-above.png"; done; }
same_above() { chop "$1" "$2"; same "$1-above" "$2-above"; }
differ_above() { chop "$1" "$2"; differ "$1-above" "$2-above" "$3"; }
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

echo "1..45"
build/bench/room 64 8 1 80 "$out/room.slf" && build/bench/room 32 4 1 80 "$out/small.slf" || exit 1
slfview=$PWD/build/slfview

# A scene shows at once as matte and becomes crisp: each frame is one level of detail, and slow.so lets
# each stay for a while.
for level in 0 1 2 3; do
  "$slfview" "$out/room.slf" --output "$out/level$level.png" --size 320x240 --filter trilinear --detail $level || exit 1
done
LD_PRELOAD=$PWD/build/tests/window/slow.so "$slfview" "$out/room.slf" --size 320x240 --filter trilinear & pid=$!
wait_for xdotool search --name room.slf; id=$(xdotool search --name room.slf | head -1)
seen=
for _ in $(seq 60); do
  import -window "$id" "$out/frame.png"
  for level in 3 2 1 0; do same frame level$level && [ "${seen: -1}" != $level ] && seen+=$level; done
  [ "${seen: -1}" = 0 ] && break
done
kill "$pid"; wait "$pid" 2>/dev/null
echo "# levels seen: $seen"
check "a file shows coarse directions first, and finer ones frame by frame" eval '[[ $seen =~ ^3?2?1?0$ && $seen != 0 ]]'

cat > "$out/blue.pov" <<POV
#version 3.7;
global_settings { assumed_gamma 1 }
background { rgb <0, 0, 1> }
POV
( cd "$out" && rm -f slfview-* && exec "$slfview" room.slf small.slf --size 640x480 --watch --filter anisotropic \
    --scene blue.pov ) > "$out/stdout" 2> "$out/stderr" & pid=$!
wait_for xdotool search --name room.slf
id=$(xdotool search --name room.slf | head -1)
check "a window opens, titled with the file" [ -n "$id" ]
xdotool windowfocus "$id"
check "the first frame is a picture" shows start mean_between start 0.15 0.85
"$slfview" "$out/room.slf" --output "$out/headless.png" --backend osmesa
check "the window shows what --output writes" shows start same start headless

key h
check "H shows the help" shows help differ start help 10000
key h i
check "I shows statistics" shows statistics differ start statistics 1000
key i
check "and both go away again" shows none same start none
key m
check "M shows the cache map, with cached blocks in green" shows map eval '[ "$(green map)" -gt 50 ]'
key m l
check "L shows a slice" shows slice differ none slice 5000
sleep 1; import -window "$id" "$out/slice.png"; key Right
check "Right shows the next slice" shows slice_right differ slice slice_right 100
key l
check "back to the scene" shows none same start none

xdotool mousemove --window "$id" 320 100 mousedown 1 mousemove --window "$id" 370 110 mouseup 1
check "dragging orbits" shows orbit differ start orbit 10000
key r
check "R goes back" shows reset same start reset
xdotool mousemove --window "$id" 320 100 mousedown 3 mousemove --window "$id" 360 120 mouseup 3
check "the right button looks around" shows look differ start look 10000
key r; wait_for shows reset same start reset
xdotool keydown w; sleep 0.5; xdotool keyup w
check "W walks" shows walk differ start walk 10000
key r; wait_for shows reset same start reset; xdotool click 4
check "the wheel approaches" shows wheel differ start wheel 10000
key r 9
check "9 narrows the field of view" shows angle differ start angle 10000
key r; wait_for shows reset same_above start reset; key j j j
check "J coarsens the directions" shows matte differ_above start matte 5000
key k k k; wait_for shows reset same_above start reset; key F8
check "F8 is brighter" shows bright differ_above start bright 10000
key F7
check "F7 undoes it" shows dim same_above start dim
key F12; wait_for eval 'cp "$out"/slfview-*.png "$out/screenshot.png"' # renamed when it is whole
check "F12 writes what the window shows, without overlays" same start screenshot
key c
check "C prints the camera for POV-Ray" wait_for grep -q 'camera { perspective location <-2.2, 1.7, -2.4>' "$out/stdout"
xdotool windowsize "$id" 800 500
check "a resized window is redrawn at its new size" shows wide size_is wide 800x500
"$slfview" "$out/room.slf" --output "$out/headless_wide.png" --size 800x500 --backend osmesa
check "and shows the same camera" shows wide same_above wide headless_wide
xdotool windowsize "$id" 640 480; wait_for shows reset same_above start reset

# POV-Ray's picture of this view is blue.
pixel() { convert "$out/$1.png" -format "%[pixel:p{$2,$3}]" info:; }
key F5
check "F5 shows POV-Ray's picture, right of a line" shows split eval '[ "$(pixel split 500 100)" = "srgb(0,0,255)" ]'
check "and the file left of it" eval '[ "$(pixel split 100 100)" = "$(pixel start 100 100)" ]'
key F6
check "F6 shows them side by side" shows beside eval '[ "$(pixel beside 500 240)" = "srgb(0,0,255)" ] && [ "$(pixel beside 500 40)" = "srgb(0,0,0)" ]'
key F6
check "and their difference" shows difference differ_above beside difference 10000
key F6 F5
check "F5 ends it" shows reset same_above start reset

# A camera of the path 2 s after the one before: played, the view moves between them.
key Return; xdotool mousemove --window "$id" 320 100 mousedown 1 mousemove --window "$id" 420 110 mouseup 1; key Return u
wait_for eval 'ls "$out"/slfview-*.path "$out"/slfview-*.inc "$out"/slfview-*.ini'
check "U writes the path of two keys" eval '[ "$(grep -c "^[0-9]" "$out"/slfview-*.path)" = 2 ]'
import -window "$id" "$out/key2.png"; key y
check "Y plays it" shows played differ_above key2 played 10000
key y Delete r; wait_for shows reset same_above start reset

# Baked again: another light field under the same name.
mv "$out/room.slf" "$out/first.slf"; build/bench/room 64 8 0 80 "$out/new.slf"; mv "$out/new.slf" "$out/room.slf"
check "--watch reloads a file that was baked again" shows again differ_above start again 10000
"$slfview" "$out/room.slf" --output "$out/headless_again.png" --backend osmesa
check "and keeps the camera" shows again same_above again headless_again

key F4
check "F4 shows the next file" wait_for xdotool search --name small.slf
cp "$out/small.slf" "$out/dropped.slf"
check "a file is dropped on the window" build/tests/window/drop "$id" "$PWD/$out/dropped.slf"
check "and shown" wait_for xdotool search --name dropped.slf
key F3
check "F3 shows the file before" wait_for xdotool search --name "^small.slf"
# A third of a file has come, then all of it: the view is the one that the window keeps throughout.
nbytes=$(stat -c %s "$out/first.slf"); head -c $((nbytes / 3)) "$out/first.slf" > "$out/coming.slf"
build/tests/window/drop "$id" "$PWD/$out/coming.slf"
check "of a file that is still coming, what is there is shown" eval \
  'wait_for xdotool search --name coming.slf && shows coming mean_between coming 0.15 0.85'
tail -c +$((nbytes / 3 + 1)) "$out/first.slf" >> "$out/coming.slf"
"$slfview" "$out/first.slf" --output "$out/came.png" --backend osmesa
check "and then all of it" shows all same_above all came
check "which is not the same" differ_above coming all 1000
key F3
wait_for xdotool search --name "dropped.slf"; key F3; wait_for xdotool search --name "^small.slf"; sleep 0.5
import -window "$id" "$out/before.png"
echo "no light field" > "$out/broken.slf"; build/tests/window/drop "$id" "$PWD/$out/broken.slf"
check "a broken file is refused on stderr" wait_for grep -q broken.slf "$out/stderr"
check "and in the window, which goes on" shows refused differ before refused 100
build/tests/window/drop "$id" "$PWD/build/check-floor-layers.slf"
wait_for xdotool search --name check-floor-layers.slf
for mix in depth four-tap; do
  "$slfview" build/check-floor-layers.slf --output "$out/$mix.png" --mix $mix --backend osmesa
done
check "reflections are mixed by depth" shows deep same_above deep depth
key b
check "B mixes them from four taps" shows taps same_above taps four-tap
key Escape
wait_for eval '! alive'
wait "$pid"; rc=$?
check "Escape ends it in peace, with no more said than of the broken file" eval \
  '[ "$rc" -eq 0 ] && [ "$(grep -vc broken.slf "$out/stderr")" -eq 0 ]'
