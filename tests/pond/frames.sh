#!/bin/bash
# slfview's ripple scripts: frames and stills agree, the cache does not show, mistakes are named.
# usage: frames.sh (from the repository's root; build/check-pond.slf and build/check-pond-layers.slf exist)
set -u
file=build/check-pond.slf
out=build/tap/pond-frames; rm -rf "$out"; mkdir -p "$out"
count=0
check() { # WHAT COMMAND...
  count=$((count + 1)) what=$1; shift
  if "$@"; then echo "ok $count - $what"; else echo "not ok $count - $what"; fi
}
draw() { build/slfview $file --size 96x72 --backend osmesa "$@"; }
differ() { ! cmp -s "$@"; }
refused() { # CODE WORDS ARGUMENTS: one line on stderr that holds the words
  code=$1 words=$2; shift 2
  message=$(draw "$@" 2>&1 > /dev/null); [ $? = "$code" ] && [ "$(wc -l <<< "$message")" = 1 ] && grep -qF -- "$words" <<< "$message"
}
script() { printf '%s\n' "$@" > "$out/script.ripples"; echo "$out/script.ripples"; }

echo "1..14"
drops=$(script '0 drop 0.3 0.4 0.4 -0.3' '0.2 stroke 0.2 0.2 0.6 0.3 0.3 0.1 0.4')
draw --ripple-script "$drops" --frames 4 --fps 5 --output "$out/%02d.png"
check "--frames writes that many" test "$(cd "$out" && echo ??.png)" = "00.png 01.png 02.png 03.png"
draw --output "$out/flat.png"
check "frame 0 is flat water" cmp -s "$out/00.png" "$out/flat.png"
cp "$drops" "$out/stop.ripples"; echo '0.6 stop' >> "$out/stop.ripples"
draw --ripple-script "$out/stop.ripples" --output "$out/still.png"
check "frame 3 at 5 a second is the still at 0.6 s" cmp -s "$out/03.png" "$out/still.png"
check "which is not flat" differ "$out/still.png" "$out/flat.png"
draw --ripple-script "$out/stop.ripples" --cache 0 --output "$out/cacheless.png"
check "the cache does not show" cmp -s "$out/still.png" "$out/cacheless.png"
draw --ripple-script "$out/stop.ripples" --frames 6 --fps 5 --output "$out/s%d.png"
check "nothing moves after stop" cmp -s "$out/s3.png" "$out/s5.png"
# What is matte is kept while only water moves: at rest for three frames, then elsewhere.
rest='0 1.4 -3.6 0 0.5 1 60' elsewhere='1 1.6 -3.2 0 0.5 1 60'
printf '%s\n' "0 $rest" "0.4 $rest" "0.6 $elsewhere" > "$out/path"
draw --ripple-script "$drops" --path "$out/path" --fps 5 --output "$out/p%d.png"
draw --ripple-script "$out/stop.ripples" --camera "${elsewhere// /,}" --output "$out/elsewhere.png"
check "a frame after the camera moved is the still of its place" cmp -s "$out/p3.png" "$out/elsewhere.png"
draw --ripple-script "$out/stop.ripples" --fresnel --output "$out/fresnel.png"
brightness() { convert "$out/$1.png" -format '%[fx:int(1000*mean)]' info:; }
check "Fresnel's water is darker" test "$(brightness fresnel)" -lt "$(brightness still)"
check "a name without %d is a usage error" refused 2 "--output" --frames 3 --output "$out/x.png"
check "a name with more than a number is a usage error" refused 2 "--output" --frames 3 --output "$out/%s%n.png"
check "a script's mistake is named by line" refused 1 "script.ripples:2:" \
  --ripple-script "$(script '# one' '0 drop 1 2')" --output "$out/x.png"
check "what the pond refuses is named by line" refused 1 "script.ripples:1:" \
  --ripple-script "$(script '0 drop 0.5 0.5 -1 1')" --output "$out/x.png"
check "a missing script is named" refused 1 "none.ripples" --ripple-script "$out/none.ripples" --output "$out/x.png"
# Mixed by depth, a frame begins with what the one before found. Small differences are left where slices
# disagree (39 dB); holes were 29 dB.
file=build/check-pond-layers.slf
{ grep -v stop viewer/demo.ripples; echo "1.3333 stop"; } > "$out/demo.ripples"
draw --ripple-script "$out/demo.ripples" --output "$out/depth.png"
draw --ripple-script viewer/demo.ripples --frames 41 --output "$out/d%02d.png"
agreement() { idiff "$out/$1.png" "$out/$2.png" | awk '/Peak SNR/ { print int($4) }'; }
check "with layers a frame of many is the still of its moment" test "$(agreement depth d40)" -ge 33
