#!/bin/bash
# What automatic directions choose to bake as layers, that this is baked as if it had been declared so, and
# that fogs leave radiosity and photons alone.
set -u
log=$(mktemp)
fogged=$(mktemp -d)
trap 'rm -rf "$log" "$log".* "$fogged"' EXIT
count=0
check() {
  count=$((count + 1))
  if eval "$2"; then echo "ok $count - $1"; else echo "not ok $count - $1"; sed 's/^/# /' "$log"; fi
}
bake() { rm -rf "build/bake/$1" "build/$1.slf"; make --no-print-directory bake "SCENES=${scenes:-tests/bake}" SCENE=layers "NAME=$1" "DECLARE=$2" QUALITY=paper RAYS="$3" > "$log" 2>&1; }
# choose NAME SCENE SURFACE DECLARE: only what is chosen for a surface, without a bake
choose() {
  rm -rf "build/bake/$1"; mkdir "build/bake/$1"
  printf 'BAKE_SCENE := %s\nBAKE_DECLARE := %s\nBAKE_SCALE := 1\nBAKE_RAYS := 1\n' "$2" "$4" > "build/bake/$1/options.mk"
  make --no-print-directory "BAKE=$1" "build/bake/$1/$3/choice.made" > "$log" 2>&1
}
choice() { head -n 1 "build/bake/$1/$2/choice"; }
# slice NAME CHUNK ROWS K: the K-th image of so many rows of a chunk of the table, into a file of that name.
slice() { oiiotool "build/bake/$1/table/0000.exr" --cut "16x16+0+$((16*$2))" -o "$log.$3.exr"; }
echo 1..17

bake layers-chosen "" 9
echo "# figure: $(sed -n 's/^bake: surface //p' "$log" | grep layers | tr '\n' ';')"
read -r directions _ far < <(choice layers-chosen mirror)
read -r bent_directions _ bent_far < <(choice layers-chosen mirror_bent)
check "a mirror is found to be worth layers" '[ "$directions" = 8 ] && awk "BEGIN { exit !($far > 0.5 && $far < 8) }"'
check "a curved mirror is, too" '[ "$bent_directions" = 8 ] && awk "BEGIN { exit !($bent_far > 0.5 && $bent_far < 8) }"'
check "plastic is not" '[ "$(choice layers-chosen plastic | cut -d " " -f 3)" = 0 ]'

# The same chunks as of layers that were declared, though tables of 9 rays a texel were made before the choice.
cp build/bake/layers-chosen/mirror/0000.exr "$log.mirror.exr"
cp build/bake/layers-chosen/mirror_bent/0000.exr "$log.bent.exr"
bake layers-declared "Directions=8 Far=$far Bent_Far=$bent_far" 9
check "a mirror's layers are those that it has when they are declared" 'cmp "$log.mirror.exr" build/bake/layers-declared/mirror/0000.exr'
check "so are a curved mirror's" 'cmp "$log.bent.exr" build/bake/layers-declared/mirror_bent/0000.exr'
choose layers-never tests/bake/layers mirror "Slf_Layers=0"
check "none where the scene says so" '[ "$(choice layers-never mirror | cut -d " " -f 2,3)" = "64 0" ]'

# Glass: what is seen through a block has a place once it is known that it is one.
choose layers-slab tests/bake/slab pane ""
slab_error=$(sed -n 's/^error.* as layers //p' build/bake/layers-slab/pane/choice)
check "a face of a block of glass is worth layers" '[ "$(choice layers-slab pane | cut -d " " -f 1)" = 8 ]'
choose layers-glass tests/bake/slab pane Named=0
glass_error=$(sed -n 's/^error.* as layers //p' build/bake/layers-glass/pane/choice)
echo "# figure: error of glass as layers: $slab_error where it is known for a block, $glass_error where not"
# 0.095 and 0.129 when this was written: a third more.
check "where that is not known the error is a fifth higher at least" 'awk "BEGIN { exit !(${slab_error:-9} * 1.2 < ${glass_error:-0}) }"'

# A scene's own fog: nobody chooses layers; who asks for them is told.
mkdir "$fogged/layers"
{ cat tests/bake/layers/layers.pov; echo 'fog { fog_type 1 distance 20 rgb 0.5 }'; } > "$fogged/layers/layers.pov"
choose layers-fog "$fogged/layers" mirror ""
check "none in a fog" '[ "$(choice layers-fog mirror | cut -d " " -f 2,3)" = "64 0" ]'
scenes=$fogged bake layers-fog "Directions=8 Slf_Layers=4" 1
check "layers in a fog are refused" 'grep -q "^slf: .* cannot be baked as layers: the scene has a fog" "$log"'

# How much of a texel shows lower things: under a plate that ends at x = 0.1 two fifths of the ninth row of texels,
# 0 to 0.25, whose middles see the ceiling; where it ends at 0.2 their middles see it, and a fifth the ceiling.
# 25 rays stand in five even columns.
# row NAME ROW [PART]: the least and the most of a row of the middle slice's coverage, or of another part
row() { oiiotool "build/bake/$1/mirror/0000.exr" --ch R --cut "16x1+0+$((16*(4*4 + ${3:-3}) + $2))" --printstats | awk '/Min:/ { a = $3 } /Max:/ { print a, $3 }'; }
edge() { rm -rf "build/bake/$1"; make --no-print-directory bake SCENES=tests/bake SCENE=edge "NAME=$1" "DECLARE=$2" QUALITY=paper RAYS=25 > "$log" 2>&1; }
edge edge-flat "Edge=0.1 Border=1.1"
check "two fifths of a texel under a plate are found" '[ "$(row edge-flat 8 | tr " " "\n" | awk "\$1 > 0.399 && \$1 < 0.401" | wc -l)" = 2 ]'
check "and nothing beside it" '[ "$(row edge-flat 7) $(row edge-flat 9)" = "0.000000 0.000000 0.000000 0.000000" ]'
edge edge-bent "Edge=0.2 Border=1.1 Bent=1"
check "so is a fifth that is not, by rays out of a table" '[ "$(row edge-bent 8 | tr " " "\n" | awk "\$1 > -0.201 && \$1 < -0.199" | wc -l)" = 2 ]'

# Where a colour ends on what is reflected, at x = 1.1, two fifths of the thirteenth row of texels on, the rays of a
# texel are weighed by a tent (bake/sample.h): by 2 (2/5)^2 = 0.32 in the mean of all such samples; one's columns lie
# anywhere in their fifths, so their tents are off by 0.2/sqrt(12) * 2 each and the sum of two of five by 0.03 (rms).
# One ray, the middle one, sees nothing of it, and rays that count alike 0.4. Where the mirror's own colour changes, too, one
# ray tells both.
# border NAME: how bright the row is between the next ones
border() { echo "$(row "$1" 11 1) $(row "$1" 12 1) $(row "$1" 13 1)" | awk '{ printf "%.3f %.3f\n", ($3 - $5)/($1 - $5), ($4 - $6)/($2 - $6) }'; }
smooth() { border "$1" | awk '{ exit !($1 > 0.23 && $2 < 0.39 && $1 > $2 - 1e-3) }'; }
echo "# figure: where a colour ends $(border edge-flat) of it"
check "colours end in proportion" 'smooth edge-flat'
check "so do they by rays out of a table" 'smooth edge-bent'
edge edge-own "Border=1.1 Own=1.1"
check "one ray tells light where own radiance changes" 'border edge-own | awk "{ exit !(\$1 < 0.01 && \$1 > -0.01) }"'

# What a table that reflects a little sends out itself, as fogs tell, is what it sends out when it reflects
# nothing: fogs must not have changed the radiosity and the caustic that it is lit by, some 0.2 each in the
# mean. Two light passes differ by 0.01 to 0.02.
bake layers-lit "Light=1 Directions=2 Slf_Layers=0" 1
slice layers-lit 5 plain
bake layers-lit "Light=1 Directions=2 Slf_Layers=4 Shine=0.1" 1
slice layers-lit 15 own
oiiotool "$log.plain.exr" "$log.own.exr" --absdiff -o "$log.diff.exr"
mean=$(oiiotool --stats "$log.diff.exr" | awk '/Avg:/ { print ($3 + $4 + $5)/3 }')
echo "# figure: a lit table's own radiance differs from that of one that reflects nothing by ${mean:-nothing} in the mean"
check "radiosity and photons are the same through fogs" 'awk "BEGIN { exit !(${mean:-1} < 0.04) }"'
