#!/usr/bin/env python3
"""bench/algorithms.py FOLDER: draws pictures into a folder (docs/images): tiles.svg and triangle.svg for docs/algorithms.md,
queries.svg, distances.svg and rays.svg for the pages of these names.

It needs matplotlib (Debian, Ubuntu: apt install python3-matplotlib).
"""
import math
import pathlib
import random
import re
import sys

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

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


def gap(s, t):
    return math.hypot(*(max(s[0][k] - t[1][k], t[0][k] - s[1][k], 0) for k in (0, 1)))


def two_panels(path, draw_left, draw_right):
    figure, panels = pyplot.subplots(1, 2, figsize=(9, 4.6))
    for panel, draw in zip(panels, (draw_left, draw_right)):
        draw(panel)
        panel.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02), aspect="equal")
        panel.axis("off")
    save(figure, path)


def draw_queries(path):
    """Boxes, and those that a box, a point, and a box with a reach find."""
    pick, reach = random.Random(7), 0.13
    corners = [(pick.uniform(0, 0.9), pick.uniform(0, 0.9)) for _ in range(60)]
    boxes = [(low, [bound + pick.uniform(0.03, 0.12) for bound in low]) for low in corners]
    box, point, near = ([0.12, 0.5], [0.45, 0.85]), ([0.78, 0.32], [0.78, 0.32]), ([0.4, 0.42], [0.62, 0.6])

    def draw_overlapping(panel):
        for s in boxes:
            colour = COLOURS[0] if meets(s, box) else COLOURS[1] if meets(s, point) else None
            outline(panel, *s, facecolor=colour + "50" if colour else "none", edgecolor=colour or INK)
        outline(panel, *box, facecolor="none", edgecolor=COLOURS[3], linewidth=2, linestyle="--")
        panel.plot(*point[0], marker="o", color=COLOURS[3])

    def draw_within(panel):
        for s in boxes:
            colour = COLOURS[0] if meets(s, near) else COLOURS[5] if gap(s, near) <= reach else None
            outline(panel, *s, facecolor=colour + "50" if colour else "none", edgecolor=colour or INK)
        outline(panel, *near, facecolor="none", edgecolor=COLOURS[3], linewidth=2, linestyle="--")
        size = [near[1][k] - near[0][k] for k in (0, 1)]
        panel.add_patch(FancyBboxPatch(near[0], *size, boxstyle=f"round,pad={reach}", facecolor="none", edgecolor=COLOURS[3]))

    two_panels(path, draw_overlapping, draw_within)


def draw_distances(path):
    """Points with the pairs within a distance, and spheres with those that meet."""
    pick, distance = random.Random(12), 0.13
    points = [(pick.random(), pick.random()) for _ in range(70)]
    spheres = [((pick.uniform(0.1, 0.9), pick.uniform(0.1, 0.9)), pick.choice((0.02, 0.03, 0.05, 0.09))) for _ in range(34)]
    chosen = min(points, key=lambda point: math.dist(point, (0.5, 0.5)))

    def join(panel, s, t, colour):
        panel.plot(*zip(s, t), color=colour, linewidth=1.2)

    def draw_points(panel):
        for b, t in enumerate(points):
            for s in points[:b]:
                if math.dist(s, t) <= distance:
                    join(panel, s, t, COLOURS[3] if chosen in (s, t) else COLOURS[0])
        panel.add_patch(Circle(chosen, distance, facecolor=COLOURS[3] + "20", edgecolor=COLOURS[3], linestyle="--"))
        panel.plot(*zip(*points), linestyle="none", marker="o", markersize=4, color=INK)

    def draw_spheres(panel):
        for b, (t, reach) in enumerate(spheres):
            partners = [s for s, other in spheres[:b] if math.dist(s, t) <= reach + other]
            for s in partners:
                join(panel, s, t, COLOURS[0])
            meets_any = any(math.dist(s, t) <= reach + other for s, other in spheres if s != t)
            colour = COLOURS[0] if meets_any else INK
            panel.add_patch(Circle(t, reach, facecolor=colour + "30" if meets_any else "none", edgecolor=colour))
        panel.plot(*zip(*(s for s, _ in spheres)), linestyle="none", marker="o", markersize=3, color=INK)

    two_panels(path, draw_points, draw_spheres)


def time_of_meeting(start, direction, box):
    """When a box that moves meets another one, in multiples of the direction, none of whose components is 0; no later than 1."""
    begin, end = 0, 1
    for k in (0, 1):
        times = sorted(((box[0][k] - start[1][k]) / direction[k], (box[1][k] - start[0][k]) / direction[k]))
        begin, end = max(begin, times[0]), min(end, times[1])
    return begin if begin <= end else None


def draw_rays(path):
    """Boxes in the order of their distance from a point, and in that in which a ray and a moving box meet them."""
    pick, query = random.Random(3), ([0.5, 0.5], [0.5, 0.5])

    def some(count):
        boxes = []
        for _ in range(count):
            low = [pick.randrange(900) / 1024, pick.randrange(900) / 1024]
            s = (low, [bound + pick.randrange(45, 100) / 1024 for bound in low])
            if not any(meets(s, t) for t in boxes):
                boxes.append(s)
        return boxes

    def in_order(found):
        return sorted(found, key=lambda hit: hit[0])

    def number(panel, found, colour):
        for k, (_, s) in enumerate(found):
            outline(panel, *s, facecolor=colour + "50", edgecolor=colour)
            panel.text(*((low + high) / 2 for low, high in zip(*s)), k + 1, ha="center", va="center", color=INK)

    # Whatever is left of the point is there mirrored, too, at the same distance.
    left = [s for s in some(100) if s[1][0] < 0.46]
    around = [*left, *(([1 - high[0], low[1]], [1 - low[0], high[1]]) for low, high in left)]
    nearest = in_order((gap(s, query), s) for s in around)[:7]
    along, ray, moving, direction = some(70), ([0.03, 0.36], [0.03, 0.36]), ([0.04, 0.02], [0.14, 0.1]), (0.8, 0.56)

    def draw_nearest(panel):
        for s in around:
            outline(panel, *s, facecolor="none", edgecolor=INK)
        number(panel, nearest, COLOURS[0])
        for _, s in nearest:
            ends = zip(query[0], (min(max(0.5, s[0][k]), s[1][k]) for k in (0, 1)))
            panel.plot(*ends, color=COLOURS[3], linewidth=0.8)
        panel.add_patch(Circle(query[0], nearest[-1][0], facecolor="none", edgecolor=COLOURS[3], linestyle="--"))
        panel.plot(*query[0], marker="o", color=COLOURS[3])

    def draw_along(panel):
        for s in along:
            outline(panel, *s, facecolor="none", edgecolor=INK)
        for start, colour in ((moving, COLOURS[1]), (ray, COLOURS[0])):
            times = ((time_of_meeting(start, direction, s), s) for s in along)
            number(panel, in_order(hit for hit in times if hit[0] is not None), colour)
            outline(panel, *start, facecolor="none", edgecolor=COLOURS[3], linewidth=2, linestyle="--")
            end = [[bound + part for bound, part in zip(corner, direction)] for corner in start]
            outline(panel, *end, facecolor="none", edgecolor=COLOURS[3], linestyle="--")
            for corner in {(start[0][0], start[1][1]), (start[1][0], start[0][1])}:
                way = dict(zip(("dx", "dy"), direction))
                panel.arrow(*corner, **way, color=COLOURS[3], head_width=0.02, linewidth=1, length_includes_head=True)
        panel.plot(*ray[0], marker="o", color=COLOURS[3])

    two_panels(path, draw_nearest, draw_along)


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
    draw_queries(folder / "queries.svg")
    draw_distances(folder / "distances.svg")
    draw_rays(folder / "rays.svg")
