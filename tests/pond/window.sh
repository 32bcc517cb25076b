#!/bin/bash
# Mouse and keys on the water, in a window on a display of its own: a click makes rings, space stops
# them, X levels the water, N shows its slopes, keys tune waves and damping, P rains, M maps the cache.
# usage: window.sh (from the repository's root; build/check-pond.slf exists)
set -u
out=build/tap/pond-window; mkdir -p "$out"
if [ "${1:-}" != inside ]; then
  # Suites look for a free display at the same time: each from a number of its own on.
  exec timeout 120 xvfb-run -a -n 110 -s "-screen 0 640x480x24" "$0" inside
fi
count=0
check() { # WHAT COMMAND...
  count=$((count + 1)) what=$1; shift
  if "$@"; then echo "ok $count - $what"; else echo "not ok $count - $what"; fi
}
window() { # the viewer's, once it is there
  for _ in $(seq 100); do
    xdotool search --pid $viewer 2>/dev/null | head -n 1 | grep . && return
    sleep 0.1
  done
}
shot() { sleep 0.7; import -window "$id" "$out/$1.png"; } # a frame or more after what came before
colours() { convert "$out/$1.png" -format %k info:; }
same() { [ "$(convert "$out/$1.png" rgb:- | cksum)" = "$(convert "$out/$2.png" rgb:- | cksum)" ]; }
differ() { ! same "$@"; }

echo "1..15"
LIBGL_ALWAYS_SOFTWARE=1 build/slfview build/check-pond.slf --size 320x240 2> "$out/log" &
viewer=$!
trap 'kill $viewer 2>/dev/null' EXIT
id=$(window)
[ -n "$id" ] || { echo "# no window: $(cat "$out/log")"; exit 1; } # import would wait for a click
xdotool windowfocus "$id" 2> /dev/null
# A file starts coarse and settles.
for _ in $(seq 30); do
  shot first; shot calm
  [ "$(colours calm)" -gt 100 ] && same first calm && break
done
check "calm water stands still" same first calm
# The first view's water, in front of the ball.
click() { xdotool mousemove --window "$id" 150 215 click 1; sleep 0.2; }
click; sleep 0.3; xdotool key space
shot rings; shot rings-later
check "a click makes rings" differ calm rings
check "space stops them" same rings rings-later
xdotool key period
shot stepped
check "a period is a step" differ rings stepped
xdotool key n n
shot slopes
check "N twice shows the slopes" differ stepped slopes
xdotool key n x
shot level
check "X levels the water" same calm level
# Still paused: the same click and ten steps, with other waves.
ten_steps() { # NAME
  xdotool key x; click; xdotool key --delay 40 period period period period period period period period period period
  shot "$1"
}
ten_steps usual; ten_steps again
check "the same click gives the same water" same usual again
xdotool key bracketright bracketright bracketright; ten_steps faster
check "] makes waves faster" differ usual faster
xdotool key bracketleft bracketleft bracketleft bracketleft bracketleft bracketleft; ten_steps slower
check "[ makes them slower" differ usual slower
xdotool key x bracketright bracketright bracketright
xdotool mousemove --window "$id" 110 210 mousedown 1
for x in 120 130 140 150 160 170; do xdotool mousemove --window "$id" $x 212; sleep 0.05; done
xdotool mouseup 1; xdotool key --delay 40 period period period; shot dragged
check "a drag leaves a wake" differ calm dragged
xdotool key x keydown shift mousemove --window "$id" 110 210 mousedown 1 mousemove --window "$id" 150 214 mouseup 1 keyup shift
xdotool key --delay 40 period period period; shot ball
check "with shift it pushes a ball" differ dragged ball
xdotool key equal equal equal equal equal equal; ten_steps damped
check "= damps them" differ usual damped
xdotool key x minus minus minus minus minus minus space p; sleep 1; shot rain
check "P rains" differ calm rain
xdotool key m; shot map
green() { convert "$out/$1.png" -fx 'g > r + 0.3' -format '%[fx:int(10000*mean)]' info:; }
check "M maps the cache, whose blocks are green" test "$(green map)" -gt "$(($(green rain) + 50))"
# The walls do not move with the water, and yet are drawn anew. Half a stop is 1.4 times in linear light, 1.17
# in display code; a third of that is asked for, as windows and paint are near white.
brightness() { convert "$out/$1.png" -crop 320x80+0+0 +repage -format '%[fx:int(10000*mean)]' info:; }
xdotool key m; shot dim; xdotool key F8; shot bright
check "F8 brightens what is matte while it rains" test "$(brightness bright)" -gt "$(($(brightness dim)*105/100))"
cat "$out/log" >&2
