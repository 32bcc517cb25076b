"""flip TRUTH.png PICTURE.png MASK.png - mean FLIP over the white of the mask. Runs in the report's venv."""
import sys

import flip_evaluator
import numpy as np
from PIL import Image


def picture(path):
    return np.asarray(Image.open(path).convert("RGB"), dtype=np.float32) / 255


truth, ours, mask = (picture(path) for path in sys.argv[1:4])
error, _, _ = flip_evaluator.evaluate(truth, ours, "LDR", applyMagma=False)
print(f"{float(np.asarray(error).reshape(mask.shape[:2] + (-1,))[..., 0][mask[..., 0] > 0.5].mean()):.4f}")
