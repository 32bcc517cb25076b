"""flicker.py FOLDER FRAMES - how much each pixel of a flight (flight.sh) flickers, over how much it does in POV-Ray's
pictures: root mean square, over the mask, of what a frame differs by from the mean of those before and after it. Prints a
flat JSON member. Runs in the report's venv."""
import sys

import numpy as np
from PIL import Image

folder, count = sys.argv[1], int(sys.argv[2])


def frame(name, number):
    return np.asarray(Image.open(f"{folder}/{name}-{number:04d}.png").convert("RGB"), dtype=np.float32)


def flicker(name):
    squares, samples = 0.0, 0
    for i in range(1, count - 1):
        seen = np.all([frame("mask", k)[..., 0] > 127 for k in (i - 1, i, i + 1)], axis=0)
        off = (frame(name, i) - 0.5 * (frame(name, i - 1) + frame(name, i + 1)))[seen]
        squares, samples = squares + float((off**2).sum()), samples + off.size
    return (squares / samples) ** 0.5


print(f'  "depth_flight_flicker_vs_truth": {flicker("ours") / flicker("truth"):.3f}')
