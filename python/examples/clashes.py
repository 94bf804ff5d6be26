"""Clashes between two sets: the beams of a building, and the ducts that should pass between them.

python clashes.py [PICTURE]
"""

import sys

import matplotlib
import numpy as np

import broadcl

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from mpl_toolkits.mplot3d.art3d import Poly3DCollection


def beams(bays: int, storeys: int) -> np.ndarray:
    """(n, 6): beams in both directions under each floor, 6 m apart, 0.3 m wide and 0.5 m high; and columns."""
    length, height = 6.0 * bays, 3.5
    rows = []
    for storey in range(storeys):
        top = height * (storey + 1)
        for line in 6.0 * np.arange(bays + 1):
            rows.append([0, line - 0.15, top - 0.5, length, line + 0.15, top])
            rows.append([line - 0.15, 0, top - 0.5, line + 0.15, length, top])
            for other in 6.0 * np.arange(bays + 1):
                rows.append([line - 0.2, other - 0.2, top - height, line + 0.2, other + 0.2, top])
    return np.array(rows)


def ducts(count: int, bays: int, storeys: int) -> np.ndarray:
    """(count, 6): some of them too high up."""
    random = np.random.default_rng(3)
    corner = random.uniform(0, 6.0 * bays - 4, (count, 2))
    top = 3.5 * random.integers(1, storeys + 1, count) - random.uniform(0.45, 1.2, count)
    along = random.random(count) < 0.5
    reach = random.uniform(2, 4, count)
    x, y = np.where(along, reach, 0.4), np.where(along, 0.4, reach)
    return np.column_stack([corner, top - 0.3, corner[:, 0] + x, corner[:, 1] + y, top])


def faces(boxes: np.ndarray) -> np.ndarray:
    """(6 n, 4, 3): the sides of each box."""
    sides = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
    corners = np.stack([boxes[:, [3 * (k & 1), 1 + 3 * (k >> 1 & 1), 2 + 3 * (k >> 2)]] for k in range(8)], axis=1)
    return corners[:, sides].reshape(-1, 4, 3)


structure, pipes = beams(bays=4, storeys=3), ducts(count=90, bays=4, storeys=3)
pairs = broadcl.overlapping_pairs(structure, pipes)  # (index of a beam, index of a duct)
clashing = np.unique(pairs[:, 1])
print(f"{len(structure)} beams and columns, {len(pipes)} ducts: {len(pairs)} clashes of {len(clashing)} ducts")
for beam, duct in pairs[:3]:
    size = np.minimum(structure[beam, 3:], pipes[duct, 3:]) - np.maximum(structure[beam, :3], pipes[duct, :3])
    print(f"  duct {duct} in beam {beam}: " + " x ".join(f"{side:.2f}" for side in size) + " m")

figure = plt.figure(figsize=(7, 5), layout="constrained")
axes = figure.add_subplot(projection="3d")
good = np.setdiff1d(np.arange(len(pipes)), clashing)
for boxes, colour, opacity, label in (
    (structure, "0.6", 0.12, "beams and columns"),
    (pipes[good], "tab:blue", 0.7, "ducts"),
    (pipes[clashing], "tab:red", 0.9, "ducts that clash"),
):
    axes.add_collection3d(Poly3DCollection(faces(boxes), facecolors=colour, alpha=opacity, edgecolors="0.3", linewidths=0.1))
    axes.plot([], [], "s", color=colour, label=label)
axes.set(xlim=(0, 24), ylim=(0, 24), zlim=(0, 11), box_aspect=(2, 2, 1))
axes.set_axis_off()
axes.legend(loc="upper left")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "clashes.png", dpi=110)
