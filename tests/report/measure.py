#!/usr/bin/env python3
"""measure.py - makes every number of the report and keeps it in build/report/QUALITY/measured.

A measurement is one JSON file, made again when a file it was made from is newer: a run that was
stopped goes on where it was. The light fields are those of tests/bench/bakes, which the benches
measure too. All times are processor time, so that others on the machine do not count; ratios are of
times in one run.
"""
import argparse
import concurrent.futures
import json
import os
import pathlib
import platform
import re
import subprocess
import sys
import tempfile
import time

import flip_evaluator
import numpy as np
from PIL import Image

SIZE = "240x180"  # of the pictures that are compared
SAMPLES = 3  # squared, in a pixel of the viewer's pictures
BUILD = pathlib.Path("build")

# Bakes are bench-NAME-DIRECTIONS.slf. `directions` is what the other axes of the plots are held at,
# `scan` the line of directions, to which a quick report adds 64 only where it is baked, `depth` the bake as
# layers that are read by depth. Rays a pixel of the truth, squared: the facets of the dull floor are noise.
SCENES = {
    "dull": dict(scene="floor", declare="Mirror=0", surfaces=["floor"], directions=16, scan=[4, 8, 16, 32], truth=10),
    "floor": dict(scene="floor", declare="Mirror=1", surfaces=["floor"], directions=32, scan=[4, 8, 16, 32],
                  depth="depth-floor-8", truth=7),
    "bottle": dict(scene="bottle", declare="", surfaces=["bottle"], directions=32, scan=[4, 8, 16, 32, 64],
                   depth="depth-bottle-6", truth=7),
    "box": dict(scene="box", declare="", surfaces=None, directions=16, scan=[4, 8, 16, 32], truth=7),
    "cube": dict(scene="cube", declare="", surfaces=None, directions=32, scan=[4, 8, 16, 32, 64],
                 depth="depth-cube-12", truth=7),
    "pond": dict(scene="pond", declare="", surfaces=["water"], directions=32, scan=[4, 8, 16, 32],
                 depth="depth-pond-8", truth=7),
}
VIEWS = dict(preview=2, paper=6)
DICE_PX = [2, 8, 16, 32, 64]
CACHES = [0, 10, 100, 1000, 65536]
PAPER_CACHES = ["all", "all-1", "1000", "100", "10", "4", "1", "0"]
PAPER_OFFSETS = ["0.01", "0.1", "0.2", "0.5", "1.0", "2.0", "5.0"]
QUALITIES = [30, 60, 85]
POV_RAYS = [1, 2, 5]  # squared, a pixel
PEERS = ["bottle-16", "box_128_texels-16"]  # bakes on which other codecs are measured
SHINY = {"box": "box_", "cube": "cube_"}  # surfaces with a name that begins so


class Report:
    def __init__(self, quality, only):
        self.quality = quality
        self.only = only
        self.folder = BUILD / "report" / quality
        (self.folder / "measured").mkdir(parents=True, exist_ok=True)
        (self.folder / "pictures").mkdir(exist_ok=True)

    # ---- What was measured is kept ---------------------------------------------------------------

    def kept(self, key, make, *sources):
        """The measurement `key`, made by make() unless it is there and no source is newer."""
        path = self.folder / "measured" / (key + ".json")
        if path.exists() and all(path.stat().st_mtime >= os.stat(s).st_mtime for s in sources):
            return json.loads(path.read_text())
        print(f"report: {key}", flush=True)
        value = make()
        part = path.with_suffix(".part")
        part.write_text(json.dumps(value, indent=1))
        part.rename(path)
        return value

    # ---- Files -------------------------------------------------------------------------------------

    def bake(self, name, directions=None):
        return self.baked_file(f"{name}-{directions or SCENES[name]['directions']}")

    def bake_ahead(self, bakes):
        """A quick report takes the bakes that are there; one of the paper's sizes has make see that they are those."""
        missing = [b for b in bakes if self.quality == "paper" or not readable(BUILD / f"bench-{b}.slf")]
        if missing:
            print(f"report: bakes {' '.join(missing)}", flush=True)
            subprocess.run(["tests/bench/bakes.sh", *missing], env={**os.environ, "QUALITY": self.quality}, check=True)

    def baked_file(self, bake):
        """A bake of a scene: (file, seconds of processor time or None where that is not known)."""
        path = BUILD / f"bench-{bake}.slf"
        cpu_s = path.with_suffix(".cpu_s")
        return path, float(cpu_s.read_text()) if cpu_s.exists() else None

    def forget(self, key):
        (self.folder / "measured" / (key + ".json")).unlink(missing_ok=True)

    def recode(self, file, angular, quality, *halved):
        out = self.folder / ("-".join([file.stem, angular, f"{quality:g}", *halved]) + ".slf")
        key = f"recode-{out.stem}"
        if not out.exists():
            self.forget(key)
        made = self.kept(key, lambda: dict(cpu_s=run(
            [BUILD / "report/recode", file, angular, f"{quality:g}", out, *halved])), file)
        return out, made["cpu_s"]

    def scan(self, name):
        return [n for n in SCENES[name]["scan"]
                if n < 64 or self.quality == "paper" or readable(BUILD / f"bench-{name}-{n}.slf")]

    def halved(self, name, file):
        """With half the texels each way, each the mean of four: what a bake of that many would hold."""
        return self.recode(file, "layered", 90, "half")[0]

    def info(self, file):
        return self.kept(f"info-{file.stem}",
                         lambda: json.loads(output([BUILD / "report/frame", "info", file])), file)

    def shiny(self, file):
        """The layers with directions of a file: bytes, raw bytes, slices."""
        surfaces = [[layer for layer in surface["layers"] if layer["slices"] > 1]
                    for surface in self.info(file)["surfaces"]]
        layers = [layer for surface in surfaces for layer in surface]
        raw = sum(layer["raw_nbytes"] for layer in layers)
        nbytes = sum(layer["payload_nbytes"] + layer["index_nbytes"] for layer in layers)
        # Over all of them, by their raw bytes: what the encoder measured against what it was given.
        mse = sum(255 ** 2 / 10 ** (layer["psnr"] / 10) * layer["raw_nbytes"] for layer in layers) / raw
        return dict(raw_nbytes=raw, coded_psnr=psnr(mse), nbytes=nbytes, ratio=raw / nbytes, directions=layers[0]["directions"],
                    texels=layers[0]["texels"], surfaces=sum(bool(surface) for surface in surfaces))

    # ---- Pictures ----------------------------------------------------------------------------------

    def picture(self, key):
        return self.folder / "pictures" / (key + ".png")

    def truth(self, name, view, rays, declare=None):
        """POV-Ray's picture with rays x rays a pixel: (file, milliseconds of processor time)."""
        out = self.picture(f"truth-{name}-{view}-{rays}")
        scene = SCENES[name]

        def make():
            times = out.with_suffix(".times")
            run(["tests/truth", scene["scene"], view, SIZE, str(rays), out, *self.declares(name)], times=str(times))
            return dict(ms=1e3 * float(times.read_text().split()[1]))

        if not out.exists():
            self.forget(f"truth-{name}-{view}-{rays}")
        return out, self.kept(f"truth-{name}-{view}-{rays}", make,
                              f"scenes/{scene['scene']}/{scene['scene']}.pov")["ms"]

    def declares(self, name):
        return [f"Declare={x}" for x in SCENES[name]["declare"].split()]

    def drawn(self, file, view, *options):
        """The viewer's picture."""
        key = "-".join([file.stem, view, *(str(o).strip("-") for o in options)])
        out = self.picture(f"view-{key}".replace("/", "_"))
        if not out.exists() or out.stat().st_mtime < file.stat().st_mtime:
            run([BUILD / "slfview", file, "--view", view, "--size", SIZE, "--samples", SAMPLES,
                 "--backend", "osmesa", "--output", out, *options])
        return out

    def mask(self, name, file, view):
        """Where a shiny surface is seen."""
        out = self.picture(f"mask-{name}-{view}")
        if not out.exists():
            wanted = SCENES[name]["surfaces"] or [
                s["name"] for s in self.info(file)["surfaces"] if s["name"].startswith(SHINY[name])]
            union = None
            for surface in wanted:
                run([BUILD / "slfview", file, "--view", view, "--size", SIZE, "--backend", "osmesa",
                     "--mask", surface, "--output", out])
                seen = np.asarray(Image.open(out).convert("L")) > 127
                union = seen if union is None else union | seen
            Image.fromarray((union * 255).astype(np.uint8)).save(out)
        return out

    def views(self, name):
        lines = pathlib.Path(f"scenes/{SCENES[name]['scene']}/views").read_text().splitlines()
        names = [line.split()[0] for line in lines if line.split("#")[0].strip()]
        return names[:VIEWS[self.quality]]

    def difference(self, name, a_of_view, b_of_view, base):
        """Mean over the views of how pictures differ where shiny surfaces are seen."""
        squares, flips = [], []
        for view in self.views(name):
            mask = np.asarray(Image.open(self.mask(name, base, view)).convert("L")) > 127
            mask = eroded(mask)
            a, b = pixels(a_of_view(view)), pixels(b_of_view(view))
            squares.append(np.mean((a - b)[mask] ** 2))
            flips.append(flip_map(a, b)[mask].mean())
        mse = float(np.mean(squares))
        return dict(rmse=mse ** 0.5, psnr=psnr(mse), flip=float(np.mean(flips)))

    def error(self, name, file, base, *options):
        """Against POV-Ray."""
        rays = SCENES[name]["truth"]
        key = "-".join(["error", file.stem, *(str(o).strip("-") for o in options)])
        return self.kept(key, lambda: self.difference(
            name, lambda view: self.truth(name, view, rays)[0],
            lambda view: self.drawn(file, view, *options), base), file)

    def frame_time(self, file, dice_px=8, cache=65536):
        return self.kept(f"time-{file.stem}-{dice_px}-{cache}", lambda: json.loads(output(
            [BUILD / "report/frame", "time", file, SIZE, dice_px, cache])), file)

    def point(self, name, file, bake_s, base, label, dice_px=8, cache=65536):
        options = [] if dice_px == 8 else ["--dice", dice_px]
        clock = self.frame_time(file, dice_px, cache)
        return dict(label=str(label), bake_s=bake_s, **self.error(name, file, base, *options),
                    **self.shiny(file), file_nbytes=self.info(file)["file_nbytes"],
                    still_ms=clock["still_ms"], moving_ms=clock["moving_ms"])

    # ---- 1. Speed against error ----------------------------------------------------------------------

    def base(self, name):
        return self.bake(name)

    def scene_points(self):
        table = []
        for name in SCENES:
            file, bake_s = self.base(name)
            table.append(dict(scene=name, **self.point(name, file, bake_s, file, name)))
            if "depth" in SCENES[name]:
                table.append(dict(scene=name + ", by depth", **self.by_depth(name, file)))
        return table

    def by_depth(self, name, base):
        file, bake_s = self.baked_file(SCENES[name]["depth"])
        return self.point(name, file, bake_s, base, self.shiny(file)["directions"][0])

    def draw_ahead(self):
        """The files and pictures that errors are told from, made side by side: the viewer's frames are timed later,
        and POV-Ray's by the processor."""
        views = [(name, view) for name in SCENES for view in self.views(name)]
        base = {name: self.base(name)[0] for name in SCENES}
        with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
            masks = [pool.submit(self.mask, name, base[name], view) for name, view in views]
            truths = [pool.submit(self.truth, name, view, rays) for name, view in views
                      for rays in [SCENES[name]["truth"], *POV_RAYS]]
            coded = {name: [pool.submit(self.recode, base[name], angular, quality)
                            for angular in ("layered", "none") for quality in QUALITIES] for name in SCENES}
            halves = {name: pool.submit(self.halved, name, base[name]) for name in SCENES}
            drawn = []
            for name, view in views:
                files = [self.bake(name, n)[0] for n in self.scan(name)] + [halves[name].result()]
                files += [c.result()[0] for c in coded[name][:len(QUALITIES)]]
                drawn += [pool.submit(self.drawn, file, view) for file in files]
                drawn += [pool.submit(self.drawn, base[name], view, "--dice", dice) for dice in [1] + DICE_PX]
            for job in masks + truths + drawn + [job for jobs in coded.values() for job in jobs]:
                job.result()

    def speed_against_error(self, name):
        file, bake_s = self.base(name)
        texels = self.shiny(file)["texels"][0]
        lines = {"directions": [], "texels": [], "quality": [], "dice": [], "cache": []}
        for directions in self.scan(name):
            other, other_s = self.bake(name, directions)
            lines["directions"].append(self.point(name, other, other_s, file, directions))
        lines["texels"] = [self.point(name, self.halved(name, file), None, file, texels // 2),
                           self.point(name, file, bake_s, file, texels)]
        for quality in QUALITIES:
            other, _ = self.recode(file, "layered", quality)
            lines["quality"].append(self.point(name, other, bake_s, file, quality))
        for dice_px in DICE_PX:
            lines["dice"].append(self.point(name, file, bake_s, file, dice_px, dice_px=dice_px))
        for cache in CACHES:
            lines["cache"].append(self.point(name, file, bake_s, file, cache, cache=cache))
        if "depth" in SCENES[name]:
            lines["depth"] = [self.by_depth(name, file)]
        pov = []
        for rays in POV_RAYS:
            ms = [self.truth(name, view, rays)[1] for view in self.views(name)]
            error = self.kept(f"error-pov-{name}-{rays}", lambda: self.difference(
                name, lambda view: self.truth(name, view, SCENES[name]["truth"])[0],
                lambda view: self.truth(name, view, rays)[0], file), file)
            pov.append(dict(label=f"POV-Ray, {rays * rays} a pixel", still_ms=float(np.mean(ms)),
                            rays=rays * rays, **error))
        return dict(lines=lines, pov=pov, where=self.where_from(name, file))

    def where_from(self, name, file):
        """RMSE in codes between pictures that differ in one thing only; and against the truth."""
        directions, texels = SCENES[name]["directions"], self.shiny(file)["texels"][0]
        fewer, _ = self.bake(name, directions // 2)
        coarser = self.halved(name, file)
        smaller, _ = self.recode(file, "layered", 60)

        def between(key, other, options_a=(), options_b=()):
            return self.kept(f"where-{key}-{file.stem}", lambda: self.difference(
                name, lambda view: self.drawn(file, view, *options_a),
                lambda view: self.drawn(other, view, *options_b), file), file, other)["rmse"]

        return {
            "all of it: against POV-Ray": self.error(name, file, file)["rmse"],
            f"angular resolution: {directions} or {directions // 2} directions": between("directions", fewer),
            f"texels: {texels} or {texels // 2}": between("texels", coarser),
            "codec: quality 90 or 60": between("codec", smaller),
            "resampling: diced to 8 or to 1": between("dice", file, (), ("--dice", 1)),
        }

    # ---- 2. The paper --------------------------------------------------------------------------------

    def tables(self):
        result = {}
        for directions in (32, 16):
            file, _ = self.bake("bottle", directions)
            counts = self.kept(f"counts-{file.stem}", lambda: json.loads(output(
                [BUILD / "report/frame", "counts", file, *PAPER_CACHES])), file)
            bench = self.kept(f"bench-{file.stem}", lambda: self.bench(file), file)
            result[f"bottle {directions}"] = dict(
                counts=counts, bench=bench, **self.shiny(file))
        cube, _ = self.base("cube")
        result["motion"] = {str(n): self.kept(f"motion-{cube.stem}-{n}", lambda: json.loads(output(
            [BUILD / "report/frame", "motion", cube, n, *PAPER_OFFSETS])), cube) for n in (64, 32, 16, 4)}
        return result

    def bench(self, file):
        """What tests/bench/viewer says of a file, without the file's name in the keys."""
        values = json.loads(output([BUILD / "bench/viewer", file]))
        return {key.removesuffix("_" + file.stem): value for key, value in values.items()}

    def quality_for_ratio(self, file, angular, ratio):
        """The file of this ratio, to 2 %, and its quality: between two qualities the ratio goes about as a power."""
        def ratio_at(quality):
            return self.shiny(self.recode(file, angular, quality)[0])["ratio"]

        low, middle, high = QUALITIES
        for _ in range(6):
            if ratio_at(high) > ratio:
                low, high = high, min(100, high + 10)
            elif ratio_at(low) < ratio:
                low, high = max(1, low - 20), low
            else:
                part = np.log(ratio_at(low) / ratio) / np.log(ratio_at(low) / ratio_at(high))
                middle = round(low + (high - low) * float(part), 1)
                if abs(ratio_at(middle) / ratio - 1) < 0.02 or middle in (low, high):
                    break
                low, high = (middle, high) if ratio_at(middle) > ratio else (low, middle)
        return self.recode(file, angular, middle)[0], middle

    def figure_4(self):
        file, _ = self.base("dull")
        view = self.views("dull")[0]
        flat = self.drawn(file, view)
        result = dict(reference=str(flat), pictures=[])
        for ratio in (11, 24, 36):
            for angular in ("none", "layered"):
                other, quality = self.quality_for_ratio(file, angular, ratio)
                result["pictures"].append(dict(
                    wanted=ratio, angular=angular, quality=quality, ratio=self.shiny(other)["ratio"],
                    picture=str(self.drawn(other, view)),
                    **self.kept(f"figure4-{other.stem}", lambda: self.difference(
                        "dull", lambda v: self.drawn(file, v), lambda v: self.drawn(other, v), file), other)))
        return result

    def figure_6(self):
        """The box at the quality where blocks by themselves are 17:1, and without identical ones."""
        file, _ = self.baked_file("box_128_texels-16")
        view = self.views("box")[0]
        alone, quality = self.quality_for_ratio(file, "none", 17)
        schemes = []
        for angular in ("none", "identical", "motion", "layered"):
            other, _ = self.recode(file, angular, quality)
            schemes.append(dict(angular=angular, ratio=self.shiny(other)["ratio"],
                                picture=str(self.drawn(other, view)), **self.error("box", other, file)))
        return dict(quality=quality, schemes=schemes)

    def figure_7(self):
        file, _ = self.bake("pond", 32)
        view, script = self.views("pond")[0], "tests/pond/gentle.ripples"
        mesh, out = self.folder / "water.inc", self.picture("truth-ripples")
        if not out.exists():
            run(["make", "-s", "build/tests/pond/water_mesh"])
            run([BUILD / "tests/pond/water_mesh", file, "water", script, mesh])
            also = (f'#include "{mesh.resolve()}"\nobject {{ Water_Mesh translate 0.002*y pigment {{ rgb 0 }} '
                    "finish { ambient 0 diffuse 0 reflection rgb <0.84, 0.92, 0.95> } }")
            run(["tests/truth", "pond", view, SIZE, "3", out], also=also)
        drawn = self.drawn(file, view, "--ripple-script", script)
        sharp = self.drawn(self.baked_file(SCENES["pond"]["depth"])[0], view, "--ripple-script", script)
        flat = self.drawn(file, view)
        mask = eroded(np.asarray(Image.open(self.mask("pond", file, view)).convert("L")) > 127)

        def against(other):
            return psnr(float(np.mean((pixels(out) - pixels(other))[mask] ** 2)))

        return dict(truth=str(out), drawn=str(drawn), sharp=str(sharp), flat=str(flat), psnr=against(drawn),
                    psnr_sharp=against(sharp), psnr_flat=against(flat))

    def figure_8(self):
        file, _ = self.bake("pond", 32)
        out = self.folder / "pictures" / "cache-map.ppm"
        counts = self.kept("figure8", lambda: json.loads(output(
            [BUILD / "report/frame", "map", file, "tests/pond/strong.ripples", out])), file)
        Image.open(out).save(self.picture("cache-map"))
        return dict(picture=str(self.picture("cache-map")), **counts)

    # ---- 3. Peers ------------------------------------------------------------------------------------

    def peers(self):
        """What the codec's bench says of PEERS, and of its other light fields where it was run."""
        parts = BUILD / "bench/codec.parts"
        missing = [p for p in PEERS if not (parts / f"{p}.json").exists()
                   or (parts / f"{p}.json").stat().st_mtime < self.baked_file(p)[0].stat().st_mtime]
        if missing:
            print(f"report: peers on {' '.join(missing)}", flush=True)
            run(["tests/bench/codec.sh", *missing], QUALITY=self.quality)
        numbers = {}
        for part in sorted(parts.glob("*.json")):
            numbers.update(json.loads(part.read_text()))
        return numbers

    def rate_distortion(self):
        """Ratio and PSNR of what the slices decode to, for independent blocks and layered ones."""
        return {name: {angular: [self.shiny(self.recode(self.base(name)[0], angular, quality)[0])
                                 for quality in QUALITIES] for angular in ("none", "layered")}
                for name in SCENES}

    # ---- 4. Growth -----------------------------------------------------------------------------------

    def growth(self):
        """A room in closed form: light fields of any size without a ray tracer."""
        lines = {"directions": [], "texels": [], "surfaces": []}
        more = self.quality == "paper"
        wanted = [("directions", n, 32, n, 1) for n in (4, 8, 16, 32, *([64] * more))]
        wanted += [("texels", n, n, 8, 1) for n in (16, 32, 64, 128, *([256] * more))]
        wanted += [("surfaces", n * n, 128, 8, n) for n in (1, 2, 4, 8)]
        for line, x, texels, directions, tiles in wanted:
            file = self.folder / f"room-{texels}-{directions}-{tiles}.slf"
            if not file.exists() or not readable(file):
                self.forget(f"make-{file.stem}")
            made = self.kept(f"make-{file.stem}", lambda: dict(cpu_s=run(
                [BUILD / "bench/room", texels, directions, 1, 85, file, 32, tiles])), BUILD / "bench/room")
            clock = self.frame_time(file)
            lines[line].append(dict(x=x, make_s=made["cpu_s"], **clock, **self.shiny(file),
                                    file_nbytes=self.info(file)["file_nbytes"]))
        files = [self.bake(name, n)[0] for name in SCENES for n in self.scan(name)]
        lines["file"] = sorted((dict(x=self.info(f)["file_nbytes"], **self.frame_time(f)) for f in files),
                               key=lambda p: p["x"])
        return lines

    # ---- All of it -----------------------------------------------------------------------------------

    def stability(self):
        """What the suites of tests/stability print for plots."""
        suites = sorted(p.stem for p in pathlib.Path("tests/stability").glob("*.c"))
        run(["make", "-s", *(f"build/tests/stability/{s}" for s in suites)])
        figures = {}
        for suite in suites:
            text = output([BUILD / "tests/stability" / suite], CMOCKA_MESSAGE_OUTPUT="TAP")
            for name, x, y in re.findall(r"^# figure: (\S+) (\S+) (\S+)$", text, re.M):
                figures.setdefault(name, []).append([float(x), float(y)])
        return figures

    def everything(self):
        result = dict(machine=machine(), quality=self.quality, size=SIZE, samples=SAMPLES)
        self.bake_ahead([f"{name}-{n}" for name, s in SCENES.items()
                         for n in ([s["directions"]] if self.only == "scenes" else self.scan(name))]
                        + [s["depth"] for s in SCENES.values() if "depth" in s] + (PEERS if not self.only else []))
        if not self.only:
            self.draw_ahead()
        result["scenes"] = self.scene_points()
        if self.only == "scenes":
            return dict(only="scenes", **result)
        result["stability"] = self.kept("stability", self.stability,
                                        *pathlib.Path("tests/stability").glob("*.c"))
        result["tables"] = self.tables()
        result["figure_4"] = self.figure_4()
        result["figure_6"] = self.figure_6()
        result["figure_7"] = self.figure_7()
        result["figure_8"] = self.figure_8()
        result["growth"] = self.growth()
        result["rate_distortion"] = self.rate_distortion()
        result["bench"] = self.peers()
        for field, table in result["tables"].items():
            result["bench"].update({f"{key}_{field.replace(' ', '_')}": n for key, n in table.get("bench", {}).items()})
        for part in sorted((BUILD / "bench").glob("*.json")):  # what make bench has measured so far
            if part.stem in ("viewer", "pond", "bake", "depth"):
                result["bench"].update(json.loads(part.read_text()))
        result["speed_against_error"] = {name: self.speed_against_error(name) for name in SCENES}
        return result


# ---- Programs --------------------------------------------------------------------------------------

def run(command, **environment):
    """Runs it and returns its processor time in seconds, children and all; its messages are shown if it fails."""
    clean = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    with tempfile.TemporaryFile("w+") as said:
        child = subprocess.Popen([str(c) for c in command], env={**clean, **environment}, stdout=said, stderr=said)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode != 0:
            said.seek(0)
            sys.exit(f"report: {' '.join(str(c) for c in command)}: exit {child.returncode}\n{said.read()}")
    return usage.ru_utime + usage.ru_stime


def readable(file):
    return file.exists() and subprocess.run([BUILD / "slf", "info", file], stdout=subprocess.DEVNULL,
                                            stderr=subprocess.DEVNULL).returncode == 0


def output(command, **environment):
    done = subprocess.run([str(c) for c in command], env={**os.environ, **environment}, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    if done.returncode != 0:
        sys.exit(f"report: {' '.join(str(c) for c in command)}: exit {done.returncode}\n{done.stderr}")
    return done.stdout


# ---- Pictures --------------------------------------------------------------------------------------

def pixels(path):
    return np.asarray(Image.open(path).convert("RGB")).astype(np.float64)


def psnr(mse):
    return float(10 * np.log10(255 ** 2 / max(mse, 1e-6)))


def eroded(mask):
    """Without the pixels at its edge, which mix two surfaces."""
    inner = mask.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            inner &= np.roll(mask, step, axis)
    inner[[0, -1], :] = inner[:, [0, -1]] = False
    return inner


def flip_map(a, b):
    map_, _, _ = flip_evaluator.evaluate((a / 255).astype(np.float32), (b / 255).astype(np.float32), "LDR",
                                         applyMagma=False, computeMeanError=False)
    return np.asarray(map_)[..., 0]


# ---- Machine ---------------------------------------------------------------------------------------

def line_with(words, *command):
    """The first line with these words that a program prints about itself."""
    try:
        done = subprocess.run(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    except OSError:
        return "not found"
    return next((line.strip() for line in done.stdout.splitlines() if words in line), "not found")


def first_line(*command):
    return line_with("", *command)


def machine():
    cpu = re.search(r"model name\s*: (.*)", pathlib.Path("/proc/cpuinfo").read_text())
    return dict(date=time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime()),
                processor=cpu.group(1) if cpu else platform.processor(), cores=os.cpu_count(),
                system=platform.platform(), commit=first_line("git", "rev-parse", "--short", "HEAD"),
                compiler=first_line("gcc", "--version"),
                povray=line_with("POV-Ray 3", "povray", "--version"),
                mesa=first_line("dpkg-query", "-W", "libosmesa6"),
                python=platform.python_version(), numpy=np.__version__)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quality", choices=["preview", "paper"], default="preview")
    parser.add_argument("--only", choices=["scenes"])
    arguments = parser.parse_args()
    report = Report(arguments.quality, arguments.only)
    result = report.everything()
    name = "scenes.json" if arguments.only else "report.json"
    part = BUILD / "report" / (name + ".part")
    part.write_text(json.dumps(result, indent=1))
    part.rename(BUILD / "report" / name)


if __name__ == "__main__":
    main()
