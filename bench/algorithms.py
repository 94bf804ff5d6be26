#!/usr/bin/env python3
"""bench/algorithms.py FOLDER: draws tiles.svg and triangle.svg, the pictures of docs/algorithms.md, into a folder (docs/images).

It needs matplotlib (Debian, Ubuntu: apt install python3-matplotlib).
"""
import pathlib
import random
import re
import sys

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot
from matplotlib.patches import Rectangle

TILE = 32  # boxes
WIDTH = 4  # pairs of a word
INK = "#5b616e"
COLOURS = ("#1f57dd", "#0e8f63", "#d9a400", "#ee2a96", "#a77af0", "#1cb2dc", "#a8401c", "#7d8f1d")


def hilbert(point, bits=10):
    """The index of a point of the unit square along a Hilbert curve."""
    (x, y), index = (int(bound * 2**bits) for bound in point), 0
    for bit in reversed(range(bits)):
        right, upper = x >> bit & 1, y >> bit & 1
        index = 4 * index + (3 * right ^ upper)
        if not upper:
            x, y = (~y, ~x) if right else (y, x)
    return index


def outline(panel, low, high, **look):
    panel.add_patch(Rectangle(low, high[0] - low[0], high[1] - low[1], **look))


def meets(s, t):
    return all(s[0][k] <= t[1][k] and t[0][k] <= s[1][k] for k in (0, 1))


def draw_tiles(path):
    """Boxes along the curve with the bounds of their tiles, and what one tile is compared with."""
    pick, edge, chosen = random.Random(4), 0.026, 5
    points = sorted(((pick.random(), pick.random()) for _ in range(16 * TILE)), key=hilbert)
    tiles = [points[k : k + TILE] for k in range(0, len(points), TILE)]
    bounds = [[[end(p[k] for p in tile) + way * edge / 2 for k in (0, 1)] for end, way in ((min, -1), (max, 1))] for tile in tiles]
    figure, panels = pyplot.subplots(1, 2, figsize=(9, 4.6))
    panels[0].plot(*zip(*points), linewidth=0.9, color=INK)
    for k, (low, high) in enumerate(bounds):
        outline(panels[0], low, high, facecolor=COLOURS[k % 8] + "30", edgecolor=COLOURS[k % 8])
        is_compared = k > chosen and meets(bounds[k], bounds[chosen])
        colour = COLOURS[0] if k == chosen else COLOURS[3] if is_compared else INK
        outline(panels[1], low, high, facecolor="none", edgecolor=colour, linewidth=2 if k == chosen else 1)
        for x, y in tiles[k]:
            box = [[x - edge / 2, y - edge / 2], [x + edge / 2, y + edge / 2]]
            is_filled = k == chosen or is_compared and meets(box, bounds[chosen])
            outline(panels[1], *box, facecolor=colour if is_filled else "none", edgecolor=INK, linewidth=0.3)
    for panel in panels:
        panel.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02), aspect="equal")
        panel.axis("off")
    save(figure, path)


def draw_triangle(path):
    """The bytes of all pairs, in words; those of one work-item are filled."""
    rows = 20
    figure, panel = pyplot.subplots(figsize=(9, 4.6))
    for b in range(1, rows):
        for a in range(b):
            row = b * (b - 1) // 2
            word = (row + a) // WIDTH
            is_seam = word * WIDTH < row or word * WIDTH + WIDTH > row + b
            is_own = b % (2 * WIDTH) == 3 and word == (row + 1) // WIDTH
            colour = "#c4c8d0" if is_seam else COLOURS[0] if is_own else "#b5cdfb" if word % 2 else "#dbe7ff"
            outline(panel, (a, -b), (a + 1, 1 - b), facecolor=colour, edgecolor="white", linewidth=1)
    panel.set(xlim=(0, rows), ylim=(1 - rows, 1), yticks=[0.5 - b for b in range(1, rows)], yticklabels=range(1, rows),
              xticks=[a + 0.5 for a in range(rows - 1)], xticklabels=range(rows - 1), xlabel="a", ylabel="b", aspect="equal")
    panel.spines[:].set_visible(False)
    save(figure, path)


def save(figure, path):
    figure.tight_layout()
    figure.savefig(path, transparent=True, metadata={"Date": None, "Creator": None})
    text = re.sub(r"(\.\d)\d+", r"\1", path.read_text())  # a tenth of a point
    path.write_text(re.sub(r"\s*\n\s*(?![\s<])", " ", text))  # one line per element


folder = pathlib.Path(sys.argv[1])
inked = dict.fromkeys(("axes.labelcolor", "xtick.color", "ytick.color"), INK)
with matplotlib.rc_context({**inked, "svg.hashsalt": "broadcl", "svg.fonttype": "none", "font.family": "DejaVu Sans"}):
    draw_tiles(folder / "tiles.svg")
    draw_triangle(folder / "triangle.svg")
