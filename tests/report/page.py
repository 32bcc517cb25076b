#!/usr/bin/env python3
"""page.py - draws build/report/index.html and scenes.md from what measure.py measured.

Nothing is measured here, and no number is written here but the paper's own.
"""
import argparse
import base64
import html
import json
import pathlib

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import matplotlib.ticker
import numpy as np
from PIL import Image

OUT = pathlib.Path("build/report")
COLOURS = dict(directions="#0b6e99", texels="#8a4fbe", quality="#d9730d", dice="#448361", cache="#9f6b53",
               depth="#c14c8a", povray="#d44c47")
MARKERS = dict(directions="o", texels="s", quality="^", dice="D", cache="v", depth="P", povray="*")
NAMES = dict(directions="directions a side", texels="texels a side", quality="quality", dice="dice size, texels",
             cache="cache, blocks", depth="layers, read by depth", povray="POV-Ray, rays a pixel")

# Miller, Rubin, Ponceleon 1998: seconds, blocks decompressed by the frame, block decompressions.
PAPER_TABLES = {
    "bottle 32": {"uncompressed": (0.24, None, None), "all": (1.75, 0, 0), "all-1": (2.44, 10194, 10194),
                  "1000": (2.44, 10194, 10194), "100": (2.99, 10194, 1042), "10": (4.84, 10194, 47646),
                  "4": (8.15, 10194, 97646), "1": (16.18, 10194, 226088), "0": (17.59, 10194, 226332)},
    "bottle 16": {"uncompressed": (0.23, None, None), "all": (0.59, 0, 0), "all-1": (1.01, 6136, 6136),
                  "1000": (1.01, 6136, 6136), "100": (1.19, 6136, 9587), "10": (2.1, 6136, 25288),
                  "4": (4.6, 6136, 65876), "1": (12.7, 6136, 197274), "0": (13.8, 6136, 197320)},
}
PAPER_BLOCKS = {"bottle 32": 10194, "bottle 16": 6136}
PAPER_MOTION = {"0.01": (29, 8, 0, 0), "0.1": (148, 56, 0, 0), "0.2": (337, 90, 6, 0), "0.5": (583, 312, 237, 0),
                "1.0": (828, 800, 539, 256), "2.0": (847, 800, 796, 256), "5.0": (861, 798, 770, 512)}

plt.rcParams.update({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "axes.axisbelow": True,
                     "grid.color": "#e6e6e6", "figure.dpi": 110, "savefig.bbox": "tight",
                     "axes.titlesize": 10, "legend.frameon": False})


def save(figure, name):
    (OUT / "plots").mkdir(parents=True, exist_ok=True)
    path = OUT / "plots" / f"{name}.png"
    figure.savefig(path)
    plt.close(figure)
    return shown(path, "plot", name)


def shown(path, kind, name):
    """A picture inside the page, so that the page is one file."""
    png = base64.b64encode(pathlib.Path(path).read_bytes()).decode()
    return f'<img class="{kind}" src="data:image/png;base64,{png}" alt="{html.escape(name)}">'


def table(head, rows, caption=""):
    cells = "".join(f"<th>{h}</th>" for h in head)
    body = "".join("<tr>" + "".join(f"<td>{c}</td>" for c in row) + "</tr>" for row in rows)
    return (f"<table>{f'<caption>{caption}</caption>' if caption else ''}"
            f"<thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table>")


def mebibytes(nbytes):
    return f"{nbytes / 2 ** 20:.1f} MiB" if nbytes >= 2 ** 20 else f"{nbytes / 2 ** 10:.0f} KiB"


def seconds(s):
    return "-" if s is None else f"{s:.0f} s" if s < 120 else f"{s / 60:.0f} min"


# ---- The table of scenes -------------------------------------------------------------------------

SCENES_HEAD = ["scene", "directions", "texels", "raw", "size", "ratio", "PSNR", "FLIP", "frame", "bake"]


def scenes_rows(points):
    return [[p["scene"], "{0}x{1}".format(*p["directions"]),
             "{0}x{1}".format(*p["texels"]) + (f" x {p['surfaces']}" if p["surfaces"] > 1 else ""),
             mebibytes(p["raw_nbytes"]), mebibytes(p["nbytes"]), f"{p['ratio']:.1f} : 1", f"{p['psnr']:.1f} dB",
             f"{p['flip']:.3f}", f"{p['moving_ms']:.1f} ms", seconds(p["bake_s"])] for p in points]


README = pathlib.Path("README.md")
BEGIN, END = "<!-- scenes: written by make report-scenes -->\n", "<!-- end of scenes -->"


def write_scenes(result):
    lines = ["| " + " | ".join(SCENES_HEAD) + " |", "|" + "---|" * len(SCENES_HEAD)]
    lines += ["| " + " | ".join(row) + " |" for row in scenes_rows(result["scenes"])]
    lines += ["", f"Shiny surfaces only, small bakes (`tests/bench/bakes`). Error: against POV-Ray over the pixels that",
              f"show them, {result['size']}, mean of views that nothing was tuned on. Frame: a moving camera, everything",
              f"drawn in software; frame and bake in processor time of one {result['machine']['processor']}.", ""]
    (OUT / "scenes.md").write_text("\n".join(lines))
    if result.get("only") == "scenes":
        text = README.read_text()
        before, _, rest = text.partition(BEGIN)
        _, _, after = rest.partition(END)
        if after:
            README.write_text(before + BEGIN + "\n" + "\n".join(lines) + END + after)


# ---- 1. Speed against error ------------------------------------------------------------------------

def annotate(axes, x, y, label, colour, where):
    axes.annotate(label, (x, y), textcoords="offset points", xytext=where, fontsize=7, color=colour)


def draw_tradeoff(name, data):
    figure, grid = plt.subplots(2, 3, figsize=(12, 6.4), sharey="row")
    across = [("still_ms", "a frame, ms of processor time"), ("nbytes", "light fields, bytes"),
              ("bake_s", "bake, s of processor time")]
    for row, (metric, label) in enumerate([("psnr", "PSNR, dB (up is better)"), ("flip", "FLIP (down is better)")]):
        for column, (key, title) in enumerate(across):
            axes = grid[row][column]
            for line, points in data["lines"].items():
                if (key == "bake_s" and line not in ("directions", "texels", "depth")) or \
                        (key == "nbytes" and line in ("dice", "cache")):
                    continue
                points = [p for p in points if p.get(key)]
                if not points:
                    continue
                x, y = [p[key] for p in points], [p[metric] for p in points]
                axes.plot(x, y, MARKERS[line] + "-", color=COLOURS[line], label=NAMES[line], markersize=4, lw=1.2)
                for p in {id(p): p for p in (points[0], points[-1])}.values():
                    annotate(axes, p[key], p[metric], p["label"], COLOURS[line], (3, 4))
            if key == "still_ms":
                x = [p[key] for p in data["pov"] if p[key] > 0]
                y = [p[metric] for p in data["pov"] if p[key] > 0]
                axes.plot(x, y, "*--", color=COLOURS["povray"], label=NAMES["povray"], lw=1)
                for p in data["pov"]:
                    if p[key] > 0:
                        annotate(axes, p[key], p[metric], str(p["rays"]), COLOURS["povray"], (3, 4))
            axes.set_xscale("log")
            axes.xaxis.set_minor_formatter(matplotlib.ticker.NullFormatter())
            if row == 1:
                axes.set_xlabel(title)
            if column == 0:
                axes.set_ylabel(label)
    handles, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, ncol=7, loc="upper center", bbox_to_anchor=(0.5, 0.97), fontsize=8)
    figure.suptitle(f"{name}: error against cost", y=1.0)
    return save(figure, f"tradeoff-{name}")


def draw_where(all_scenes):
    names = list(all_scenes)
    figure, grid = plt.subplots(1, len(names), figsize=(2.6 * len(names), 2.4), squeeze=False)
    short = ["all of it", "directions", "texels", "codec", "resampling"]
    colours = ["#37352f", COLOURS["directions"], COLOURS["texels"], COLOURS["quality"], COLOURS["dice"]]
    for axes, name in zip(grid[0], names):
        values = list(all_scenes[name]["where"].values())
        axes.barh(short, values, color=colours)
        axes.invert_yaxis()
        axes.set_title(name)
        axes.grid(axis="y", visible=False)
        for i, v in enumerate(values):
            axes.text(v, i, f" {v:.1f}", va="center", fontsize=7)
        if axes is not grid[0][0]:
            axes.set_yticklabels([])
    grid[0][0].set_xlabel("RMSE, display codes")
    return save(figure, "where")


def section_tradeoff(result):
    data = result["speed_against_error"]
    parts = ["<h2>1. Speed against error</h2>",
             "<p>Each line moves one thing and holds the others where the scene has them. Errors are against POV-Ray at "
             f"the scene's views, over the pixels that show shiny surfaces ({result['size']}, {result['samples']}x"
             f"{result['samples']} samples a pixel). Frames are drawn in software, all of them, with everything in "
             "the scene; POV-Ray's frame is its own processor time without reading the scene. Processor time is what "
             "is plotted, so other work on the machine does not count.</p>"]
    parts += [draw_tradeoff(name, scene) for name, scene in data.items()]
    parts += ["<h3>Where the error comes from</h3>",
              "<p>Differences between pictures that differ in one thing only, and against POV-Ray for all of it. A "
              "step of a factor of two says what the next factor would change at most.</p>", draw_where(data)]
    rows = [[name, key, f"{value:.2f}"] for name, scene in data.items() for key, value in scene["where"].items()]
    parts.append("<details><summary>the figures</summary>" + table(["scene", "between", "RMSE, codes"], rows) + "</details>")
    return "".join(parts)


# ---- 2. The paper ----------------------------------------------------------------------------------

def section_tables(result):
    parts = ["<h2>2. The paper's tables and figures</h2>"]
    for number, name in ((1, "bottle 32"), (2, "bottle 16")):
        paper, ours = PAPER_TABLES[name], result["tables"][name]
        blocks, warm = ours["counts"]["blocks"], ours["bench"]["warm_vs_uncompressed"]
        base = paper["uncompressed"][0]
        rows = [["uncompressed", "1.00", "", "1.00", "", ""]]
        for size, (s, _, decompressions) in list(paper.items())[1:]:
            mine = ours["counts"]["cache"][size]
            sic = " (sic)" if decompressions and decompressions < PAPER_BLOCKS[name] else ""
            rows.append([size.replace("all", "all blocks").replace("-1", " - 1"), f"{s / base:.2f}", f"{decompressions:,}{sic}",
                         f"{mine['time_vs_warm'] * warm:.2f}", f"{mine['decompressions']:,}",
                         f"{mine['decompressions'] / blocks:.2f} / {decompressions / PAPER_BLOCKS[name]:.2f}"])
        parts.append(table(
            ["cache, blocks", "paper: time", "paper: decompressions", "ours: time", "ours: decompressions",
             "decompressions a block: ours / paper"], rows,
            f"Table {number}. A static camera and the silver bottle, {name.split()[1]}x{name.split()[1]} directions. "
            f"Times are ratios to uncompressed. Blocks of the frame: paper {PAPER_BLOCKS[name]:,} (256x256 texels), ours "
            f"{blocks:,} ({ours['texels'][0]}x{ours['texels'][1]} texels)."))
    parts.append("<p>The paper samples triangle after triangle, so a small cache decompresses a block again and again. "
                 "Ours mixes 8x8 texels at a time: each block once a frame at most, whatever the cache; and the blocks "
                 "of the two latest fetches are held beside the N of the cache.</p>")
    rows = []
    for offset, paper in PAPER_MOTION.items():
        row = [offset]
        for directions, p in zip(("64", "32", "16", "4"), paper):
            row += [f"{p:,}", f"{result['tables']['motion'][directions]['offsets'][offset]:,}"]
        rows.append(row)
    rows.append(["blocks of the first frame"] + [c for n in ("64", "32", "16", "4")
                                                 for c in ("", f"{result['tables']['motion'][n]['blocks']:,}")])
    head = ["offset"] + [c for n in ("64x64", "32x32", "16x16", "4x4") for c in (f"{n} paper", "ours")]
    parts.append(table(head, rows, "Table 3. New blocks after the camera moved across its line of sight from 5 units "
                       "away; the glass cube, a very large cache."))
    return "".join(parts)


def strip(pictures, name):
    """Pictures side by side, each with a title, differences from the first below (8 times, about grey)."""
    first = np.asarray(Image.open(pictures[0][1]).convert("RGB")).astype(float)
    figure, grid = plt.subplots(2, len(pictures), figsize=(12, 12 / len(pictures) * 1.65), squeeze=False)
    for column, (title, path) in enumerate(pictures):
        picture = np.asarray(Image.open(path).convert("RGB"))
        grid[0][column].imshow(picture)
        grid[0][column].set_title(title, fontsize=8)
        difference = np.clip(128 + 8 * (picture - first), 0, 255).astype(np.uint8)
        grid[1][column].imshow(difference)
        for row in (0, 1):
            grid[row][column].axis("off")
    figure.subplots_adjust(wspace=0.02, hspace=0.02)
    return save(figure, name)


def section_figures(result):
    four, six, seven, eight = (result[f"figure_{n}"] for n in (4, 6, 7, 8))
    parts = ["<h3>Figure 4: the floor at 11:1, 24:1 and 36:1</h3>",
             "<p>Independent blocks as in the paper, and beside them the layered scheme at the same ratios. Below: eight "
             "times the difference from the file as baked, about grey.</p>"]
    for angular in ("none", "layered"):
        pictures = [("as baked", four["reference"])]
        pictures += [(f"{p['angular']} {p['ratio']:.0f} : 1, {p['psnr']:.1f} dB", p["picture"])
                     for p in four["pictures"] if p["angular"] == angular]
        parts.append(strip(pictures, f"figure-4-{angular}"))
    parts += ["<h3>Figure 6: the box, identical blocks left out</h3>", "<p>The paper: 17:1 with independent blocks, 30:1 "
              f"with identical-block elimination, a gain of 1.76. Ours, all at quality {six['quality']:g}:</p>",
              table(["scheme", "ratio", "gain over independent", "PSNR against POV-Ray"],
                    [[s["angular"], f"{s['ratio']:.1f} : 1", f"{s['ratio'] / six['schemes'][0]['ratio']:.2f}",
                      f"{s['psnr']:.2f} dB"] for s in six["schemes"]]),
              strip([(f"{s['angular']} {s['ratio']:.0f}:1", s["picture"]) for s in six["schemes"]], "figure-6")]
    parts += ["<h3>Figure 7: the pond</h3>",
              f"<p>The same ripples by POV-Ray and by the viewer: {seven['psnr']:.1f} dB over the water with four taps of "
              f"32x32 directions, {seven['psnr_sharp']:.1f} dB with 8x8 directions read by depth; flat water in their place "
              f"has {seven['psnr_flat']:.1f} dB.</p>",
              strip([("POV-Ray", seven["truth"]), ("four taps", seven["drawn"]), ("by depth", seven["sharp"]),
                     ("flat water", seven["flat"])], "figure-7"),
              "<h3>Figure 8: the cache map</h3>", "<p>A box for each (S,T), a pixel for each block of 8x8 texels; green: "
              "cached, red: decompressed in this frame. Above flat water, below the rippled pond: "
              f"{eight['rippled_fresh']:,} of {eight['resident']:,} cached blocks are new "
              f"({100 * eight['rippled_fresh'] / max(eight['resident'], 1):.0f} %; the paper: about a quarter), flat "
              f"{eight['flat_fresh']:,}.</p>",
              shown(eight["picture"], "map", "cache map")]
    return "".join(parts)


# ---- 3. Peers --------------------------------------------------------------------------------------

CODECS = dict(none="slf, independent blocks", layered="slf, layered", jpeg="JPEG", jxl="JPEG XL", avif="AVIF",
              zfp="zfp", astc="ASTC", vq="VQ of 1996")


def labels(bench, prefix):
    """The light fields of which a bench has figures: floor_16 of ratio_none_floor_16."""
    names = [key.removeprefix(prefix) for key in bench if key.startswith(prefix) and key[-1].isdigit()]
    return [name for name in names if not name.startswith("vs_")]


def grouped_bars(axes, rows, series, value):
    """A group of bars a row, a bar a series where value(row, series) is known."""
    width = 0.8 / len(series)
    for number, (key, label) in enumerate(series.items()):
        known = [(i, value(row, key)) for i, row in enumerate(rows) if value(row, key) is not None]
        axes.bar([i + (number + 0.5) * width - 0.4 for i, _ in known], [v for _, v in known], width * 0.9, label=label,
                 color=plt.cm.tab10(number))
    axes.set_xticks(range(len(rows)), rows)
    axes.grid(axis="x", visible=False)
    axes.legend(fontsize=7, ncol=4, loc="upper center", bbox_to_anchor=(0.5, -0.1))


def draw_rate_distortion(result):
    scenes = result["rate_distortion"]
    bench = result["bench"]
    figure, grid = plt.subplots(1, len(scenes), figsize=(2.6 * len(scenes), 2.8), squeeze=False)
    for axes, (name, schemes) in zip(grid[0], scenes.items()):
        for angular, points in schemes.items():
            axes.plot([p["ratio"] for p in points], [p["coded_psnr"] for p in points], "o-", markersize=3, lw=1,
                      color=plt.cm.tab10(list(CODECS).index(angular)), label=CODECS[angular])
        axes.set_xscale("log")
        axes.xaxis.set_minor_formatter(matplotlib.ticker.NullFormatter())
        axes.set_title(name)
        axes.set_xlabel("ratio")
    grid[0][0].set_ylabel("PSNR of the slices, dB")
    grid[0][0].legend(fontsize=7)
    return save(figure, "rate-distortion")


def section_peers(result):
    bench = {k: v for k, v in result["bench"].items() if isinstance(v, (int, float))}
    parts = ["<h2>3. Peers</h2><h3>Rate and distortion</h3><p>The light fields of this page coded again at qualities "
             "of 30, 60 and 85, against what they decode to.</p>", draw_rate_distortion(result),
             "<p>Other codecs on some of them; <code>make bench-codec</code> measures more, which the next report shows.</p>"]
    fields = labels(bench, "ratio_none_")
    figure, axes = plt.subplots(figsize=(11, 3.4))
    grouped_bars(axes, fields, CODECS, lambda field, codec: bench.get(f"ratio_{codec}_{field}"))
    axes.set_yscale("log")
    axes.set_title("Ratio to 24 bits a texel, at the PSNR of the layered scheme or, where a peer cannot reach it, its own")
    parts.append(save(figure, "peers-ratio"))
    own = [[field, CODECS[codec], f"{bench[f'psnr_{codec}_{field}']:.1f} dB"] for field in fields for codec in CODECS
           if f"psnr_{codec}_{field}" in bench and codec not in ("none", "layered", "jpeg")]
    if own:
        parts.append("<details><summary>peers at a PSNR of their own</summary>" + table(["light field", "peer", "PSNR"], own)
                     + "</details>")
    figure, axes = plt.subplots(figsize=(11, 3.2))
    grouped_bars(axes, fields, {"": "all blocks in order", "random": "lone blocks at random", "random_quads": "four at a time at random",
                                "layered": "layered, in order", "layered_random": "layered, lone blocks",
                                "layered_random_quads": "layered, four at a time"},
                 lambda field, how: bench.get("decode_" + (how and how + "_") + f"vs_libjpeg_{field}"))
    axes.axhline(1, color="#d44c47", lw=1)
    axes.set_title("Decoding a block: our time over libjpeg-turbo's for whole slices (below 1: ours is faster)")
    parts.append(save(figure, "peers-decode"))
    access = [("frames: time over uncompressed (below 1: ours is faster)", [k for k in bench if k.startswith(("warm_vs_", "cold_vs_", "moving_vs_"))]),
              ("water: frames a second over uncompressed (above 1: ours is faster)", [k for k in bench if k.startswith("pond_") and k.endswith("_uncompressed_fps")]),
              ("depth: time a texel, ns", [k for k in bench if k.startswith("depth_") and k.endswith("ns_per_texel")])]
    parts.append("<h3>What access costs</h3>")
    for number, (title, keys) in enumerate(access):
        if not keys:
            continue
        figure, axes = plt.subplots(figsize=(9, 0.5 + 0.22 * len(keys)))
        axes.barh(keys, [bench[k] for k in keys], color="#0b6e99")
        axes.axvline(1, color="#d44c47", lw=1)
        axes.invert_yaxis()
        axes.set_title(title)
        axes.tick_params(axis="y", labelsize=7)
        for i, k in enumerate(keys):
            axes.text(bench[k], i, f" {bench[k]:.3g}", va="center", fontsize=7)
        parts.append(save(figure, f"peers-access-{number}"))
    return "".join(parts)


# ---- 4. Growth -------------------------------------------------------------------------------------

def section_growth(result):
    lines = [("directions", NAMES["directions"]), ("texels", NAMES["texels"]), ("surfaces", "surfaces"),
             ("file", "file, bytes")]
    wanted = [("still_ms", "frame, camera still, ms"), ("moving_ms", "frame, camera moving, ms"),
              ("open_ms", "opening, shaders too, ms"), ("resident_nbytes", "memory, bytes"), ("nbytes", "light fields, bytes"),
              ("make_s", "making it, s")]
    figure, grid = plt.subplots(len(wanted), len(lines), figsize=(12, 11))
    for column, (line, across) in enumerate(lines):
        points = result["growth"][line]
        for row, (key, title) in enumerate(wanted):
            axes = grid[row][column]
            if key not in points[0]:
                axes.axis("off")
                continue
            axes.plot([p["x"] for p in points], [p[key] for p in points], MARKERS.get(line, "o") + ("" if line == "file" else "-"),
                      color=COLOURS.get(line, "#37352f"), markersize=4)
            axes.set_xscale("log", base=10 if line == "file" else 2)
            values = [p[key] for p in points]
            if max(values) > 8 * min(values):
                axes.set_yscale("log")
                axes.yaxis.set_minor_formatter(matplotlib.ticker.NullFormatter())
            else:
                axes.set_ylim(0, 1.15 * max(values))
            axes.set_xlabel(across)
            if column == 0:
                axes.set_ylabel(title)
    figure.tight_layout()
    bakes = [p for scene in result["speed_against_error"].values() for p in scene["lines"]["directions"] if p["bake_s"]]
    second, axes = plt.subplots(figsize=(6, 3))
    for name, scene in result["speed_against_error"].items():
        points = [p for p in scene["lines"]["directions"] if p["bake_s"]]
        axes.plot([p["raw_nbytes"] for p in points], [p["bake_s"] for p in points], "o-", label=name, markersize=4)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("light fields before compression, bytes")
    axes.set_ylabel("bake, s of processor time")
    axes.legend(fontsize=7)
    return ("<h2>4. Growth</h2><p>A room in closed form with a mirror floor and a mirror ball: light fields of any size "
            "without a ray tracer; and, last, the baked files of this page. What a frame costs follows the texels that "
            "are seen, not the directions that are stored; what a file's opening and memory cost follows its index.</p>" + save(figure, "growth") + (save(second, "growth-bake") if bakes else ""))


# ---- 5. Hard cases ---------------------------------------------------------------------------------

def section_stability(result):
    figures = result["stability"]
    columns = 4
    rows = (len(figures) + columns - 1) // columns
    figure, grid = plt.subplots(rows, columns, figsize=(12, 2.3 * rows), squeeze=False)
    for axes in grid.flat[len(figures):]:
        axes.axis("off")
    for axes, (name, points) in zip(grid.flat, figures.items()):
        x, y = np.array(points).T
        axes.plot(x, y, "o-", color="#0b6e99", markersize=3, lw=1)
        positive = x[x > 0]
        if len(positive) and positive.max() / positive.min() > 30:
            axes.set_xscale("symlog", linthresh=positive.min())
            axes.set_xticks([t for t in axes.get_xticks()][::max(1, len(axes.get_xticks()) // 4)])
        axes.set_ylim(0, 1.1 * y.max())
        axes.set_title(name.replace("_", " "), fontsize=8)
        axes.tick_params(labelsize=7)
    figure.tight_layout()
    return ("<h2>5. Hard cases</h2><p>From <code>tests/stability</code>, where each point has a bound that the test "
            "states and holds it to. Along: what makes the case hard. Up: error against an analytic truth, in linear "
            "radiance unless the name says codes, direction, speed or energy. The names say where: <i>grazing n</i> is the "
            "cosine to the normal; <i>height</i> and <i>distance</i> are in units of the surface's side; <i>courant</i> is "
            "the water's step over the grid (explicit schemes end at 0.71).</p>" + save(figure, "stability"))


# ---- The page --------------------------------------------------------------------------------------

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #37352f; max-width: 1180px; margin: 2em auto; padding: 0 1em; }
h1 { margin-bottom: 0; } h2 { margin-top: 2em; border-bottom: 1px solid #ddd; } p { max-width: 50em; }
table { border-collapse: collapse; margin: 1em 0; font-size: 13px; font-variant-numeric: tabular-nums; }
caption { text-align: left; padding: .3em 0; max-width: 60em; } th { text-align: right; border-bottom: 2px solid #37352f; }
td { text-align: right; border-bottom: 1px solid #eee; } th, td { padding: .2em .8em; }
th:first-child, td:first-child { text-align: left; } img.plot { max-width: 100%; display: block; margin: 1em 0; }
img.map { image-rendering: pixelated; width: 600px; } code, pre { background: #f6f6f4; padding: .1em .3em; }
pre { padding: .8em; } .machine { color: #777; }
"""


def section_made(result):
    rows = [[k, html.escape(str(v))] for k, v in result["machine"].items()]
    commands = ("make report                  # this page; small bakes\nmake report QUALITY=paper    # the paper's sizes\n"
                "make report-scenes           # the table of scenes alone\nmake bench                   # peers: build/bench.json\n"
                "make check                   # the hard cases, and everything else")
    return "<h2>6. How it was made</h2>" + table(["", ""], rows) + f"<pre>{commands}</pre>"


def write_page(result):
    machine = result["machine"]
    parts = ["<!doctype html><html lang=en><meta charset=utf-8><title>slf: speed against error</title>",
             f"<style>{STYLE}</style><h1>Surface light fields: speed against error</h1>",
             f"<p class=machine>{html.escape(machine['date'])}, {html.escape(machine['processor'])}, {machine['cores']} cores, "
             f"commit {machine['commit']}, quality {result['quality']}. Every number here was measured by "
             "<code>make report</code>; all of them are in <a href=report.json>report.json</a>.</p>",
             table(SCENES_HEAD, scenes_rows(result["scenes"])),
             section_tradeoff(result), section_tables(result), section_figures(result), section_peers(result),
             section_growth(result), section_stability(result), section_made(result), "</html>"]
    part = OUT / "index.html.part"
    part.write_text("\n".join(parts))
    part.rename(OUT / "index.html")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=["scenes"])
    arguments = parser.parse_args()
    result = json.loads((OUT / ("scenes.json" if arguments.only else "report.json")).read_text())
    write_scenes(result)
    if not arguments.only:
        write_page(result)
        print(f"report: {OUT / 'index.html'}")


if __name__ == "__main__":
    main()
