#!/usr/bin/env python3
"""bench/plot.py MACHINE.csv SET: prints the times of frames, of updates, or of proxies that come, move and go, as a Markdown
table. bench/plot.py OUT.svg MACHINE.csv: draws how the time of an update grows with the number of boxes, from the set `growth`.

Drawing needs matplotlib (Debian, Ubuntu: apt install python3-matplotlib). The tables of machines are those of bench/results.
"""
import csv
import math
import sys

REFERENCE = "brute-force"  # of the proxies' table


def three_digits(x):
    return f"{x:,.0f}" if x >= 100 else f"{x:.3g}"


def read(path, group):
    """For each benchmark of a set, its figures by name; the time of the benchmark itself is that of ""."""
    rows = {}
    with open(path, encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if row["set"] == group:
                name, _, kind = row["name"].partition(" ")
                rows.setdefault(name, {})[kind] = float(row["median"])
    return rows


def print_proxies(result):
    """One row per operation: times, in brackets as multiples of the reference, and pairs."""
    rows = {}
    for run, row in result.items():
        _, operation, name, scene, count = run.split("/")[:5]
        rows.setdefault((operation, f"{int(count):,} {scene}"), {})[name] = row
    names = list(dict.fromkeys(name for row in rows.values() for name in row))
    print("| ms | " + " | ".join(f"`{name}`" for name in names) + " | pairs |")
    print("| --- |" + " ---: |" * (len(names) + 1))
    for (operation, scene), row in rows.items():
        times = [row[name][""] for name in names]
        cells = [f"{three_digits(time)} ({three_digits(time / row[REFERENCE][''])})" for time in times]
        pairs = dict.fromkeys(f"{row[name]['overlapping']:,.0f}" for name in names)
        print(f"| {operation}, {scene} | " + " | ".join(cells) + f" | {' / '.join(pairs)} |")


def print_frames(result):
    """One row per scene and number of boxes."""
    rows = {}
    for run, row in result.items():
        kind, name, scene, count = run.split("/")[:4]
        label = f"{int(count):,} {scene}" if kind == "frame" else f"{int(count):,}, of which {scene} move"
        rows.setdefault(label, {})[name] = row[""] / 1000
    names = list(dict.fromkeys(name for row in rows.values() for name in row))
    print("| ms | " + " | ".join(f"`{name}`" for name in names) + " |")
    print("| --- |" + " ---: |" * len(names))
    for scene, row in rows.items():
        print(f"| {scene} | " + " | ".join(three_digits(row[name]) if name in row else "" for name in names) + " |")


def print_updates(result):
    """One row per benchmark: mean, p95 and longest of its frames, and changes; for whole lists the mean and pairs; for
    kernels only the mean."""
    print("| microseconds | mean | p95 | longest | changes or pairs |")
    print("| --- |" + " ---: |" * 4)
    for run, row in result.items():
        cells = [row[""], row.get("p95"), row.get("max"), row.get("changes", row.get("overlapping"))]
        texts = ["" if cell is None else three_digits(cell) for cell in cells]
        print(f"| `{run}` | " + " | ".join(texts) + " |")


def growth_of(result):
    """Per scene the mean times of updates with tiles, as (boxes, microseconds)."""
    series = {}
    for run, row in result.items():
        parts = run.split("/")
        if parts[:2] == ["update", "tiles"] and int(parts[3]) >= 16000:
            series.setdefault(parts[2], []).append((int(parts[3]), row[""]))
    return series


def draw_growth(plt, result, out):
    """The time of an update per box, next to n log n."""
    figure, panel = plt.subplots(figsize=(5.5, 3.8))
    for scene, points in growth_of(result).items():
        boxes, times = zip(*sorted(points))
        panel.plot(boxes, [1000 * t / n for n, t in zip(boxes, times)], marker="o", label=scene)
        first = 1000 * times[0] / boxes[0] / math.log(boxes[0])
        panel.plot(boxes, [first * math.log(n) for n in boxes], "--", color="grey", linewidth=1)
    panel.set(xlabel="boxes, all moving", ylabel="one update, ns per box (dashed: n log n)", xscale="log")
    panel.set_ylim(bottom=0)
    panel.grid(alpha=0.3)
    panel.legend()
    figure.tight_layout()
    figure.savefig(out, metadata={"Date": None, "Creator": None})


UPDATES = ("update", "update-from-memory", "update-device", "update-enqueue", "worlds", "some-moving", "whole-list", "kernel")
FRAMES = ("frame", "frame-some-moving")
PRINTERS = {"proxies": print_proxies, **dict.fromkeys(FRAMES, print_frames), **dict.fromkeys(UPDATES, print_updates)}


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    if not sys.argv[1].endswith(".svg"):
        table, group = sys.argv[1:]
        result = read(table, group)
        kind = next(iter(result), "nothing").split("/")[0]
        if kind not in PRINTERS:
            sys.exit(f"{table}: no table is known for the set '{group}', which begins with {kind}")
        return PRINTERS[kind](result)
    import matplotlib  # for pictures only

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    with plt.rc_context({"svg.hashsalt": "broadcl", "svg.fonttype": "none", "font.family": "DejaVu Sans"}):
        draw_growth(plt, read(sys.argv[2], "growth"), sys.argv[1])


if __name__ == "__main__":
    main()
