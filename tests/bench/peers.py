#!/usr/bin/env python3
"""Other codecs on the light fields of codec.c: how much smaller the layered scheme is at equal PSNR.

usage: peers.py CODEC CODEC.json LABEL BAKE_DIR SURFACE RAYS

CODEC is the C program, CODEC.json what it measured there: the layered scheme's PSNR and ratio. Adds
the peers' numbers to that file. PSNR is of all R G B codes, ratios are against 24 bits a
texel. Peers that code image by image take SLICES slices, spread over all directions.
"""
import json
import os
import subprocess
import sys
import tempfile
import time

import imagecodecs
import numpy as np

SLICES = 24
ASTC_BLOCKS = ["4x4", "5x4", "5x5", "6x5", "6x6", "8x5", "8x6", "10x5", "10x6", "8x8", "10x8", "10x10", "12x10", "12x12"]


def psnr(a, b):
    return 10 * np.log10(255**2 / np.mean((a.astype(float) - b.astype(float)) ** 2))


def read_field(codec, bake):
    """Codes [t, s, v, u, 3], and [t, s]: which slices exist."""
    with tempfile.NamedTemporaryFile() as file:
        subprocess.run([codec, "--export", file.name, *bake], check=True)
        head = np.fromfile(file.name, "<u4", 4)
        u, v, s, t = (int(n) for n in head)
        codes = np.fromfile(file.name, np.uint8, offset=16)
    exists, codes = codes[: s * t].reshape(t, s) > 0, codes[s * t :]
    return codes.reshape(t, s, v, u, 3), exists


def at_psnr(points, target):
    """The ratio at a PSNR, log-linear between the (PSNR, ratio) on both sides of it; None outside."""
    points = sorted(points)
    for (low, more), (high, less) in zip(points, points[1:]):
        if low <= target <= high:
            f = (target - low) / (high - low) if high > low else 0
            return float(np.exp(np.log(more) * (1 - f) + np.log(less) * f))
    return None


def search(measure, low, high, target, steps=7):
    """Halves the interval of a parameter along which PSNR rises; the points that it met."""
    points = [measure(low), measure(high)]
    for _ in range(steps):
        middle = (low + high) / 2
        points.append(measure(middle))
        if points[-1][0] < target:
            low = middle
        else:
            high = middle
    return points


def slice_by_slice(slices, encode, decode, nbytes=len):
    """Measures a codec of images at a parameter."""

    def measure(parameter):
        coded = [encode(image, parameter) for image in slices]
        decoded = np.stack([decode(c) for c in coded])
        return psnr(slices, decoded), slices.size / sum(nbytes(c) for c in coded)

    return measure


def jxl(slices, target):
    """JPEG XL at effort 7; -distance is the parameter."""
    encode = lambda image, p: imagecodecs.jpegxl_encode(image, distance=-p, effort=7)
    return search(slice_by_slice(slices, encode, imagecodecs.jpegxl_decode), -12.0, -0.05, target)


def mdat_nbytes(coded):
    """An AVIF's coded image: a set of them could keep its boxes once, so they are given away."""
    at = 0
    while at < len(coded):
        size = int.from_bytes(coded[at : at + 4], "big")
        if coded[at + 4 : at + 8] == b"mdat":
            return (size or len(coded) - at) - 8
        at += size
    raise ValueError("an AVIF without mdat")


def avif(slices, target):
    """AVIF 4:4:4 at speed 6."""
    encode = lambda image, p: imagecodecs.avif_encode(image, level=round(p), speed=6, pixelformat="444")
    return search(slice_by_slice(slices, encode, imagecodecs.avif_decode, mdat_nbytes), 5, 99, target)


def astc(slices, target):
    """astcenc -medium: 128 bits a block, the side of which is the parameter."""
    count, v, u, _ = slices.shape
    column = slices.reshape(count * v, u, 3)

    def measure(index):
        block = ASTC_BLOCKS[index]
        bu, bv = (int(n) for n in block.split("x"))
        with tempfile.TemporaryDirectory() as folder:
            before, after = os.path.join(folder, "a.png"), os.path.join(folder, "b.png")
            with open(before, "wb") as file:
                file.write(imagecodecs.png_encode(column))
            command = ["astcenc", "-tl", before, after, block, "-medium", "-silent"]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            with open(after, "rb") as file:
                decoded = imagecodecs.png_decode(file.read())[..., :3]
        nbytes = 16 * count * -(-u // bu) * -(-v // bv)
        return psnr(column, decoded), column.size / nbytes

    low, high = 0, len(ASTC_BLOCKS) - 1
    points = {low: measure(low), high: measure(high)}
    while high - low > 1 and points[low][0] > target > points[high][0]:
        middle = (low + high) // 2
        points[middle] = measure(middle)
        if points[middle][0] >= target:
            low = middle
        else:
            high = middle
    return list(points.values())


def to_ycc(rgb):
    m = np.array([[0.299, 0.587, 0.114], [-0.168736, -0.331264, 0.5], [0.5, -0.418688, -0.081312]], np.float32)
    return rgb.astype(np.float32) @ m.T


def to_rgb(ycc):
    m = np.array([[1, 0, 1.402], [1, -0.344136, -0.714136], [1, 1.772, 0]], np.float32)
    return np.clip(np.rint(ycc @ m.T), 0, 255).astype(np.uint8)


def zfp(codes, target):
    """zfp's fixed rate, the one with random access, on 4x4x4x4 of u v s t; chroma at half the rate of luma. Of
    the directions a square inside the circle."""
    t, s = codes.shape[:2]
    side = max(4, int(s / np.sqrt(2)) // 4 * 4)
    begin = (s - side) // 2
    square = np.ascontiguousarray(codes[begin : begin + side, begin : begin + side, :64, :64])
    ycc = to_ycc(square)

    def measure(rate):
        bits, planes = 0, []
        for channel, scale in enumerate((1, 0.5, 0.5)):
            plane = np.ascontiguousarray(ycc[..., channel])
            coded = imagecodecs.zfp_encode(plane, level=rate * scale, mode="r")
            bits += 8 * len(coded)
            planes.append(imagecodecs.zfp_decode(coded))
        return psnr(square, to_rgb(np.stack(planes, -1))), square.size * 8 / bits

    return search(measure, 0.25, 16, target)


def vq(codes, exists, turns=3):
    """Vector quantisation as in 1996 (Levoy and Hanrahan: 2x2x2x2, at most 16384 words, a tree for the search),
    trained on the light field itself: of a small one with fewer words, 16 tiles for each, as they count too."""
    t, s, v, u, _ = codes.shape
    tiles = codes[: t // 2 * 2, : s // 2 * 2, : v // 2 * 2, : u // 2 * 2]
    tiles = tiles.reshape(t // 2, 2, s // 2, 2, v // 2, 2, u // 2, 2, 3).transpose(0, 2, 4, 6, 1, 3, 5, 7, 8)
    whole = exists[: t // 2 * 2, : s // 2 * 2].reshape(t // 2, 2, s // 2, 2).all((1, 3))
    vectors = tiles[whole].reshape(-1, 48)
    tile_count = len(vectors)
    if tile_count > 1 << 19:
        vectors = vectors[np.random.default_rng(1).choice(len(vectors), 1 << 19, replace=False)]
    vectors = vectors.astype(np.float32)
    word_bits = max(4, min(14, int(np.log2(tile_count / 16))))
    nodes = np.zeros(len(vectors), np.int64)

    def means(groups, count):
        weight = np.maximum(np.bincount(groups, minlength=count), 1)
        sums = [np.bincount(groups, vectors[:, k], count) for k in range(48)]
        return (np.stack(sums, 1) / weight[:, None]).astype(np.float32)

    for level in range(word_bits):
        centres = means(nodes, 1 << level)
        # Each word splits along its widest component, then both halves settle.
        spread = np.stack([np.bincount(nodes, (vectors[:, k] - centres[nodes, k]) ** 2, 1 << level) for k in range(48)], 1)
        widest = spread.argmax(1)[nodes]
        rows = np.arange(len(vectors))
        children = 2 * nodes + (vectors[rows, widest] > centres[nodes, widest])
        for _ in range(turns):
            words = means(children, 2 << level)
            left = ((vectors - words[2 * nodes]) ** 2).sum(1)
            right = ((vectors - words[2 * nodes + 1]) ** 2).sum(1)
            children = 2 * nodes + (right < left)
        nodes = children
    words = np.rint(means(nodes, 1 << word_bits))
    nbytes = tile_count * word_bits / 8 + 48 * (1 << word_bits)
    return [(psnr(vectors, words[nodes]), 48 * tile_count / nbytes)]


def ours_at(codec, bake, target):
    """The layered scheme's PSNR and ratio nearest a PSNR."""
    done = subprocess.run([codec, "--layered", str(target), *bake], check=True, stdout=subprocess.PIPE, text=True)
    return tuple(float(n) for n in done.stdout.split())


def main():
    codec, path, label, *bake = sys.argv[1:]
    with open(path) as file:
        numbers = json.load(file)
    target, ours = numbers["psnr_layered_" + label], numbers["ratio_layered_" + label]
    codes, exists = read_field(codec, bake)
    which = np.argwhere(exists)
    which = which[np.linspace(0, len(which) - 1, min(SLICES, len(which))).astype(int)]
    slices = np.ascontiguousarray(codes[which[:, 0], which[:, 1]])
    peers = {"jxl": lambda: jxl(slices, target), "avif": lambda: avif(slices, target), "zfp": lambda: zfp(codes, target),
             "astc": lambda: astc(slices, target), "vq": lambda: vq(codes, exists)}
    for name, measure in peers.items():
        begin = time.monotonic()
        points = measure()
        ratio, mine = at_psnr(points, target), ours
        if ratio is None:  # what cannot reach the PSNR is met at its own
            at, ratio = min(points, key=lambda p: abs(p[0] - target))
            _, mine = ours_at(codec, bake, at)
            numbers[f"psnr_{name}_{label}"] = round(at, 2)
        numbers[f"ratio_{name}_{label}"] = round(ratio, 3)
        gain = numbers[f"ratio_layered_vs_{name}_{label}"] = round(mine / ratio, 3)
        print(f"{label} {name}: {ratio:.2f}:1, layered {gain:.2f} times smaller; {time.monotonic() - begin:.0f} s", file=sys.stderr)
    with open(path + ".part", "w") as file:
        json.dump(numbers, file, indent=1)
        file.write("\n")
    os.replace(path + ".part", path)


main()
