#!/bin/bash
# Every command that README.md shows is run here, or its equal on something smaller that is there
# already. A command that is not known here fails: then say below what its equal is.
# usage: commands.sh (from the repository's root; the bakes of make check-bakes exist)
set -u
if [ "${1:-}" = inside ]; then # on the display of its own: shows, and is closed
  shift
  LIBGL_ALWAYS_SOFTWARE=1 "$@" & shown=$!
  for _ in $(seq 600); do
    id=$(xdotool search --onlyvisible --name . 2> /dev/null | head -n 1)
    if [ -n "$id" ] || ! kill -0 $shown 2> /dev/null; then break; fi
    sleep 0.1
  done
  sleep 1; xdotool windowfocus "$id" key Escape; wait $shown
  exit
fi
out=$PWD/build/tap/readme; rm -rf "$out"; mkdir -p "$out/scenes/mine"

# The lines between ``` that begin with a program, without comments, && apart; and those in the text.
commands() {
  { awk '/^```/ { on = !on; next } on && /^(make|build|tests)[\/ ]/ && !/-->/' README.md | sed 's/  *#.*//'
    tr '\n' ' ' < README.md | grep -oE '`make [^`]*`' | tr -d '`' | grep -E '^make [a-z]+( |$)'
  } | sed 's/ && /\n/g' | awk '!seen[$0]++'
}

# What is run in a command's place: less to bake, and nothing written but to $out.
equal() { # COMMAND
  case $1 in
  "make check") echo true ;; # this is it
  "make demo") echo "env -u DISPLAY -u WAYLAND_DISPLAY viewer/demo build/slfview build/check-pond-layers.slf 12 $out/demo" ;;
  "make bake" | "make bake SCENE=floor" | "make bake SCENE=floor QUALITY=paper") echo "make bake SCENE=floor NAME=check-floor DECLARE=Texels=144" ;;
  "make view SCENE=floor") echo "view make view SCENE=floor NAME=check-floor DECLARE=Texels=144" ;;
  "make bake SCENE=mine QUALITY=paper view") echo "view make bake SCENE=mine SCENES=$out/scenes NAME=readme-mine QUALITY=paper RAYS=1 view" ;;
  "make bench"* | "make report"*) echo "make -n ${1#make }" ;; # measured, not tested
  "make help" | "make build/"*) echo "$1" ;;
  build/slfview\ *--output* | tests/truth\ * | build/tests/images/compare\ *)
    sed -E "s#build/floor.slf#build/check-floor.slf#; s#(^| )([a-z]+\.png)#\1$out/\2#g; s# 240x180 10 # 240x180 1 #" <<< "$1" ;;
  "build/slfview --help" | "build/slf "*) sed -E "s#build/floor.slf#build/check-floor.slf#; s#( |^)([a-z]+\.(slf|png))#\1$out/\2#g" <<< "$1" ;;
  *) return 1 ;;
  esac
}
# Runs what opens a window, on a display of its own, until it shows, and closes it.
view() { timeout 100 xvfb-run -a -n 150 -s "-screen 0 1024x768x24" "$0" inside "$@"; }

# The scene of one's own, as it stands there, with a room to stand in and smaller numbers.
awk '/^```/ { on = !on; next } on' README.md | awk '/^#version/ { on = 1 } on' | sed '/^[a-z]* *[a-z]*\//,$d' |
  sed -E 's/<[0-9]+, [0-9]+>, <16, 16>/<16, 8>, <4, 4>/; s/<[0-9]+, [0-9]+>, Slf_Matte/<16, 8>, Slf_Matte/' > "$out/scenes/mine/mine.pov"
cat > "$out/scenes/mine/my_room.pov" <<'POV'
#version 3.7;
global_settings { assumed_gamma 1 }
light_source { <0, 3, 0> rgb 1 }
plane { y, 0 pigment { checker rgb 0.3 rgb 0.8 } finish { reflection 0.4 } }
plane { -z, -4 pigment { rgb <0.8, 0.5, 0.3> } }
sphere { <1, 1, 0>, 0.8 pigment { rgb 0.1 } finish { reflection 0.7 } }
camera { location <-3, 2, -3> look_at <1, 1, 0> }
POV
echo "start  -3 2 -3  1 1 0  60" > "$out/scenes/mine/views"

unset MAKEFLAGS MFLAGS MAKELEVEL # of the make that runs this
mapfile -t all < <(commands)
echo "1..$((${#all[@]} + 1))"
count=0
for command in "${all[@]}"; do
  count=$((count + 1))
  run=$(equal "$command") || { echo "not ok $count - $command: not known to tests/readme/commands.sh"; continue; }
  if eval "$run" > "$out/log" 2>&1; then echo "ok $count - $command"
  else echo "not ok $count - $command, as: $run"; tail -n 5 "$out/log" >&2; fi
done
rm -rf build/bake/readme-mine build/readme-mine.slf
[ "$(wc -l < README.md)" -le 140 ] && echo "ok $((count + 1)) - README.md has at most 140 lines" ||
  echo "not ok $((count + 1)) - README.md has $(wc -l < README.md) lines"
