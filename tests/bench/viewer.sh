#!/bin/bash
# What the viewer costs, as one flat object of named numbers: build/bench/viewer.json.
# usage: viewer.sh [FILE.slf...], from the repository's root. Without files it makes rooms of mirrors
# in closed form, 256x256 texels, 8 to 64 directions. Files are named SCENE_DIRECTIONS.slf; the keys
# without a scene's name are the worst over the scenes.
set -eu
out=build/bench; mkdir -p "$out"
files=("$@")
if [ $# -eq 0 ]; then
  for directions in 8 16 32 64; do
    file=$out/room_$directions.slf
    # A file of an older format is made again.
    build/slf verify "$file" > /dev/null 2>&1 || build/bench/room 256 $directions 1 80 "$file"
    files+=("$file")
  done
fi
build/bench/viewer "${files[@]}" > "$out/viewer_cache.json"
largest=$(ls -S "${files[@]}" | head -1)
for size in 640x480 1280x720; do
  for filter in trilinear anisotropic; do
    build/slfview "$largest" --bench 40 --size $size --filter $filter > "$out/viewer_frame_${size}_$filter.json"
  done
done
python3 - "$out" "$largest" <<'PYTHON'
import json, os, subprocess, sys, time
out, largest = sys.argv[1:]
keys = json.load(open(f"{out}/viewer_cache.json"))
worst = {}
for key, value in list(keys.items()):
    what, _, directions = key.rpartition("_")
    what = what.rpartition("_")[0]
    if directions.isdigit() and "vs" in what or what.startswith("decompressions_per_block"):
        name = f"{what}_{directions}"
        worst[name] = max(worst.get(name, 0), value)
keys.update(worst)
for size in ("640x480", "1280x720"):
    for texture_filter in ("trilinear", "anisotropic"):
        frame = json.load(open(f"{out}/viewer_frame_{size}_{texture_filter}.json"))
        for part in ("frames_per_s", "frame_ms", "resample_ms", "upload_ms", "driver_ms"):
            keys[f"{part}_{size}_{texture_filter}"] = frame[part]
# Opening: one frame of 16x16 pixels, a small file against the largest; resident memory at its end.
for name, path in (("largest", largest),):
    start = time.time()
    child = subprocess.Popen(["build/bench/open", path], stdout=subprocess.PIPE, text=True)
    keys.update({f"{k}_{name}": v for k, v in json.loads(child.communicate()[0]).items()})
    keys[f"file_mb_{name}"] = os.path.getsize(path) / 1e6
json.dump(keys, open(f"{out}/viewer.json.part", "w"), indent=2)
os.rename(f"{out}/viewer.json.part", f"{out}/viewer.json")
PYTHON
cat "$out/viewer.json"
