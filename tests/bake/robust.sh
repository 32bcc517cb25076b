#!/bin/bash
# A bake that is killed, or meets a full disk or a broken POV-Ray, leaves nothing half-written under a
# final name, says what happened in one line, and goes on the next time to the same bytes.
set -u
root=$(mktemp -d build/robust.XXXXXX)
trap 'rm -rf "$root" build/bake/robust build/bake/robust-* build/robust.slf build/robust-*.slf' EXIT
mkdir "$root/scenes" "$root/bin"
cp -r tests/bake/tiny "$root/scenes/robust"
scene=$root/scenes/robust/robust.pov
mv "$root/scenes/robust/tiny.pov" "$scene"

bake() { make --no-print-directory bake SCENES="$root/scenes" SCENE=robust QUALITY=paper RAYS=9 "$@"; }
count=0
ok() { count=$((count + 1)); echo "ok $count - $1"; }
not_ok() { count=$((count + 1)); echo "not ok $count - $1"; [ ! -s "$root/log" ] || sed 's/^/# /' "$root/log"; }
check() { if eval "$2"; then ok "$1"; else not_ok "$1"; fi; }
chunks() { find build/bake/robust -name '0*.exr' | sort; }
echo 1..15

# The undisturbed bake.
start=$(date +%s%N)
bake > "$root/log" 2>&1
took_ms=$((($(date +%s%N) - start)/1000000))
check "an undisturbed bake" '[ -s build/robust.slf ]'
cp build/robust.slf "$root/undisturbed.slf"

bake NAME=robust-asan CONFIG=asan > "$root/log" 2>&1
check "the same under the sanitizers" 'cmp build/robust-asan.slf "$root/undisturbed.slf"'

# Killed again and again at random moments of its time, until 20 kills have hit; whenever a run gets
# through before its kill, the next begins from nothing.
RANDOM=1 # bash's generator: the same moments every time, as far as the machine's load allows
hit=0 whole=0
rm -rf build/bake/robust build/robust.slf
while [ $hit -lt 20 ]; do
  setsid make --no-print-directory bake SCENES="$root/scenes" SCENE=robust QUALITY=paper RAYS=9 \
    > "$root/log" 2>&1 &
  leader=$!
  sleep "$(awk -v r=$RANDOM -v t=$took_ms 'BEGIN { print r/32768*t*0.6/1000 }')"
  # Whoever gets through every time was timed on a busier machine.
  if kill -9 -- -$leader 2> /dev/null; then hit=$((hit + 1)); else whole=$((whole + 1)) took_ms=$((took_ms*3/4)); fi
  wait $leader 2> /dev/null
  if [ -e build/robust.slf ]; then
    cmp -s build/robust.slf "$root/undisturbed.slf" || break
    rm -rf build/bake/robust build/robust.slf
  fi
done
bake > "$root/log" 2>&1
echo "# figure: bake killed $hit times; $whole runs were through before"
check "killed 20 times, then the same bytes" '[ $hit -eq 20 ] && cmp build/robust.slf "$root/undisturbed.slf"'

# Nothing changed: nothing is baked.
touch "$root/before"; sleep 0.05
bake > "$root/log" 2>&1
check "nothing changed, nothing is baked" '[ -z "$(find build/bake/robust build/robust.slf -name "*.exr" -newer "$root/before")" ] && [ build/robust.slf -ot "$root/before" ]'

# Nothing that rays could see changed: a comment, a template (slf.inc), a view. The file is packed at most.
baked_since() { find build/bake/robust -name '0*.exr' -newer "$root/before"; }
sed -i -e '1s|^|// another\n\n|' -e 's|^camera.*|&   // a remark|' "$scene"
bake > "$root/log" 2>&1
touch -r bake/slf.inc "$root/inc"; touch bake/slf.inc
bake >> "$root/log" 2>&1
touch -r "$root/inc" bake/slf.inc
check "a comment or a template that says the same: nothing is baked" '[ -z "$(baked_since)" ] && cmp build/robust.slf "$root/undisturbed.slf"'
echo "another 0 2 -5  0 0.5 0  40" >> "$root/scenes/robust/views"
bake > "$root/log" 2>&1
check "a view more: packed, not baked" '[ -z "$(baked_since)" ] && build/slf info build/robust.slf | grep -q another'

# A surface's own line changed: only that surface is baked.
sed -i 's/0.6, <16, 16>, Slf_Matte/0.6, <24, 16>, Slf_Matte/' "$scene"
bake > "$root/log" 2>&1
check "a surface's line changed: only its chunks are baked" '[ "$(baked_since)" = build/bake/robust/ball/0000.exr ]'

# The scene changed: everything is.
touch "$root/before"; sleep 0.05
sed -i 's/rgb 0.1 }/rgb 0.11 }/' "$scene"
bake > "$root/log" 2>&1
check "the scene changed: all chunks are baked" '[ -z "$(find build/bake/robust -name "0*.exr" ! -newer "$root/before")" ]'

# A file cannot grow: what a full disk does. SIGXFSZ is ignored, so that writing fails instead.
rm -rf build/bake/robust build/robust.slf
(trap "" XFSZ; ulimit -f 24; bake) > "$root/log" 2>&1
status=$?
check "no room: a failure, a line, and no file" '[ $status -ne 0 ] && grep -q "^slf: " "$root/log" && [ ! -e build/robust.slf ]'

# POV-Ray says that all is well and has written no image; POV-Ray crashes. Frames only: not describe.
cat > "$root/bin/povray" <<'FAKE'
#!/bin/sh
case " $* " in *frame.exr*) [ "$FAKE" = crash ] && kill -ABRT $$; exit 0 ;; esac
exec /usr/bin/env PATH="$REAL_PATH" povray "$@"
FAKE
chmod +x "$root/bin/povray"
REAL_PATH=$PATH; export REAL_PATH
rm -rf build/bake/robust
FAKE=silent PATH="$PWD/$root/bin:$PATH" bake > "$root/log" 2>&1
status=$?
check "exit 0 with no image: said in a line" '[ $status -ne 0 ] && grep -q "^slf: .*POV-Ray wrote no image" "$root/log" && [ -z "$(chunks)" ]'
FAKE=crash PATH="$PWD/$root/bin:$PATH" bake > "$root/log" 2>&1
status=$?
check "POV-Ray crashes: said in a line" '[ $status -ne 0 ] && grep -qE "^slf: .*POV-Ray: (ended with status 134|Aborted)" "$root/log" && [ -z "$(chunks)" ]'
bake > "$root/log" 2>&1
check "and the next run goes on" '[ -s build/robust.slf ]'

# Radiance that is no number: surface, slice and texel are named. 1e30 is infinite as a half.
bake NAME=robust-inf DECLARE=Glow=1e30 > "$root/log" 2>&1
status=$?
check "infinite radiance: surface, slice and texel named" '[ $status -ne 0 ] && grep -qE "^slf: .*surface .(floor|ball|wall)., slice [0-9]+,[0-9]+, texel [0-9]+,[0-9]+: radiance is" "$root/log" && [ ! -e build/robust-inf.slf ]'

# Glass that is no block of glass: which surface, and what was expected. Nothing is rendered.
cp "$scene" "$root/whole.pov"
refused=0
while read -r slab said; do
  { cat "$root/whole.pov"; echo "Slf_Slab($slab)"; } > "$scene"
  bake NAME=robust-slab > "$root/log" 2>&1 || { grep -q "^slf: .*Slf_Slab: $said" "$root/log" && refused=$((refused + 1)); }
done <<'SLABS'
"ball",1,1.5 no flat surface is called 'ball'
"pane",1,1.5 no flat surface is called 'pane'
"floor",0,1.5 'floor': expected a thickness above 0
"floor",-1,1.5 'floor': expected a thickness above 0
"floor",1,1 'floor': expected a thickness above 0 and an index of refraction above 1
SLABS
check "a slab that is none: 5 refusals in a line" '[ $refused -eq 5 ] && [ ! -e build/robust-slab.slf ]'
cp "$root/whole.pov" "$scene"

# A mistake in the scene: POV-Ray's own line.
sed -i 's/^plane { -z/plane -z/' "$scene"
bake > "$root/log" 2>&1
status=$?
check "a mistake in the scene: POV-Ray's own line" '[ $status -ne 0 ] && grep -qE "^slf: .*robust.pov.* line [0-9]+: Parse Error" "$root/log"'
