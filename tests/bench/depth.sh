#!/bin/bash
# What reading slices where they see the same point is worth: the mirror floor against POV-Ray at the
# scene's views, baked the paper's way and as layers, and what it costs a texel. Writes the flat
# build/bench/depth.json. Run from the repository's root; bakes what is missing (5 min on two cores).
set -eu
size=480x360
out=build/bench/depth-floor
mkdir -p "$out"
MAKEFLAGS='' make --no-print-directory all build/tests/images/compare build/bench/depth >&2
bake() { MAKEFLAGS='' make --no-print-directory bake SCENE=floor QUALITY=paper "$@" >&2; }
bake NAME=bench-floor-four-tap RAYS=9 DECLARE="Mirror=1 Directions=16"
bake NAME=bench-floor-depth-8 RAYS=1 DECLARE="Mirror=1 Texels=128 Directions=8 Slf_Layers=8"
bake NAME=bench-floor-depth-256-16 RAYS=1 DECLARE="Mirror=1 Texels=256 Directions=16 Slf_Layers=8"

floor_nbytes() { # FILE: of the floor's layers, in MB
  build/slf info "$1" | awk '/^surface/ { on = $3 == "floor" } on && $2 == "MB" { sum += $1 } END { print sum }'
}
psnr() { # FILE: mean over the views
  for view in $(awk '$1 !~ /^#/ && NF { print $1 }' scenes/floor/views); do
    [ -f "$out/$view-truth.png" ] || tests/truth floor "$view" $size 3 "$out/$view-truth.png" Declare=Mirror=1
    build/slfview "$1" --view "$view" --size $size --samples 3 --backend osmesa --output "$out/$view.png"
    build/slfview "$1" --view "$view" --size $size --backend osmesa --mask floor --output "$out/$view-mask.png"
    build/tests/images/compare "$out/$view-truth.png" "$out/$view.png" "$out/$view-mask.png"
  done | awk '{ sum += $1 } END { printf "%.2f", sum / NR }'
}
paper=build/bench-floor-four-tap.slf depth=build/bench-floor-depth-8.slf best=build/bench-floor-depth-256-16.slf
paper_psnr=$(psnr $paper) depth_psnr=$(psnr $depth) best_psnr=$(psnr $best)
{
  awk -v p="$paper_psnr" -v d="$depth_psnr" -v b="$best_psnr" -v pn="$(floor_nbytes $paper)" -v dn="$(floor_nbytes $depth)" 'BEGIN {
    printf "{\n  \"depth_gain_db_floor\": %.2f,\n  \"depth_gain_db_floor_bytes_ratio\": %.3f,\n", d - p, dn / pn
    printf "  \"depth_psnr_floor_four_tap\": %.2f,\n  \"depth_psnr_floor\": %.2f,\n", p, d
    printf "  \"depth_psnr_floor_256_16_coded\": %.2f,\n", b }'
  build/bench/depth $best | tail -n +2
} > build/bench/depth.json.part
mv build/bench/depth.json.part build/bench/depth.json
cat build/bench/depth.json
