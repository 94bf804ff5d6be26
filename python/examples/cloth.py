"""Which faces of a cloth may touch between two frames: candidates for continuous collision detection.

python cloth.py [PICTURE]
"""

import sys

import matplotlib
import numpy as np

import broadcl

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from mpl_toolkits.mplot3d.art3d import Poly3DCollection


def cloth(size: int, opening: float) -> np.ndarray:
    """(size**2, 3) vertices of a sheet folded over, with ripples; its halves are about so far apart."""
    u, v = np.meshgrid(np.linspace(-1.3, 1.3, size), np.linspace(0, 2, size), indexing="ij")
    fold = np.pi / 4 * opening  # half the length of the bend, a half-circle
    turn = np.clip(u / fold, -1, 1) * np.pi / 2
    beyond = np.clip(np.abs(u) - fold, 0, None)
    ripples = 0.15 * np.sin(4 * v + 5 * u) * np.clip(2 * beyond, 0, 1)
    return np.stack([opening / 2 * np.cos(turn) - beyond, v, opening / 2 * np.sin(turn) + ripples], axis=-1).reshape(-1, 3)


def triangles(size: int) -> np.ndarray:
    """(m, 3) vertices of each face."""
    corner = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).reshape(-1, 1)
    return np.vstack([corner + [0, 1, size], corner + [1, size + 1, size]])


size = 90
faces = triangles(size)
before, after = cloth(size, opening=0.31), cloth(size, opening=0.28)

# The bounds of what each face sweeps over, as float64: their pairs are exact.
swept = np.concatenate([before[faces], after[faces]], axis=1)  # (m, 6, 3)
pairs = broadcl.overlapping_pairs((swept.min(axis=1), swept.max(axis=1)))

# Faces that are close in the sheet itself always are; in the picture count those that are not.
flat = np.stack(np.unravel_index(np.arange(size**2), (size, size)), axis=1)[faces].mean(axis=1)
far = np.abs(flat[pairs[:, 0]] - flat[pairs[:, 1]]).max(axis=1) > 6
candidates = pairs[far]
print(f"{len(faces):,} faces, {len(pairs):,} pairs of boxes, {len(candidates):,} of faces that are not close in the sheet")

count = np.bincount(candidates.reshape(-1), minlength=len(faces))
figure = plt.figure(figsize=(7.5, 4.6))
axes = figure.add_axes((0, -0.3, 0.85, 1.35), projection="3d")
colours = plt.get_cmap("YlOrRd")(count / max(count.max(), 1))
colours[count == 0] = (0.8, 0.84, 0.9, 1)
axes.add_collection3d(Poly3DCollection(after[faces], facecolors=colours, edgecolors=colours, linewidths=0.2, shade=True))
axes.set(xlim=(-1.1, 0.2), ylim=(0, 2), zlim=(-0.3, 0.3))
axes.view_init(elev=35, azim=-50)
axes.set_box_aspect((1.3, 2, 0.6), zoom=0.85)
axes.set_axis_off()
figure.suptitle(f"Where a folded cloth of {len(faces):,} triangles may hit itself between two frames.\n"
                "Coloured: triangles whose swept boxes overlap those of others that are not near them\n"
                f"in the sheet. These {len(candidates):,} pairs need an exact test.", fontsize=11, x=0.02, ha="left")
scale = plt.cm.ScalarMappable(cmap="YlOrRd", norm=plt.Normalize(0, count.max()))
figure.colorbar(scale, cax=figure.add_axes((0.87, 0.15, 0.02, 0.6)), label="triangles that each one may hit")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "cloth.png", dpi=110)
