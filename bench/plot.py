#!/usr/bin/env python3
"""bench/plot.py RESULT.json: prints the times of frames, of updates, or of proxies that come, move and go, as a Markdown
table. bench/plot.py OUT.svg UPDATES.json [UPDATES.json ...]: draws how the time of an update grows with the number of
boxes, one panel per device.

Drawing needs matplotlib (Debian, Ubuntu: apt install python3-matplotlib). The results come from `scripts/bench`.
"""
import json
import math
import sys

REFERENCE = "brute-force"  # of the proxies' table


def three_digits(x):
    return f"{x:,.0f}" if x >= 100 else f"{x:.3g}"


def of_repetitions(rows):
    """The medians of repeated benchmarks, and those that ran once, in the program's order (they may have run in random
    order)."""
    medians = [row for row in rows if row.get("aggregate_name", "median") == "median"]
    return sorted(medians, key=lambda row: row["family_index"])


def print_proxies(result):
    """One row per operation: times, in brackets as multiples of the reference, and pairs."""
    rows = {}
    for row in of_repetitions(result["benchmarks"]):
        _, operation, name, scene, count = row["run_name"].split("/")[:5]
        rows.setdefault((operation, f"{int(count):,} {scene}"), {})[name] = row
    names = list(dict.fromkeys(name for row in rows.values() for name in row))
    print(f"| {result['context']['device']}, ms | " + " | ".join(f"`{name}`" for name in names) + " | pairs |")
    print("| --- |" + " ---: |" * (len(names) + 1))
    for (operation, scene), row in rows.items():
        times = [row[name]["real_time"] for name in names]
        cells = [f"{three_digits(time)} ({three_digits(time / row[REFERENCE]['real_time'])})" for time in times]
        pairs = dict.fromkeys(f"{row[name]['overlapping']:,.0f}" for name in names)
        print(f"| {operation}, {scene} | " + " | ".join(cells) + f" | {' / '.join(pairs)} |")


def print_frames(result):
    """One row per scene and number of boxes."""
    rows = {}
    for row in of_repetitions(result["benchmarks"]):
        _, name, scene, count = row["run_name"].split("/")[:4]
        rows.setdefault(f"{int(count):,} {scene}", {})[name] = row["real_time"] / 1000
    names = list(dict.fromkeys(name for row in rows.values() for name in row))
    print(f"| {result['context']['device']}, ms | " + " | ".join(f"`{name}`" for name in names) + " |")
    print("| --- |" + " ---: |" * len(names))
    for scene, row in rows.items():
        print(f"| {scene} | " + " | ".join(three_digits(row[name]) if name in row else "" for name in names) + " |")


def print_updates(result):
    """One row per benchmark: mean, p95 and longest of its frames, and changes; for whole lists the mean and pairs; for
    kernels only the mean."""
    print(f"| {result['context']['device']}, microseconds | mean | p95 | longest | changes or pairs |")
    print("| --- |" + " ---: |" * 4)
    for row in of_repetitions(result["benchmarks"]):
        cells = [row["real_time"], row.get("p95_us"), row.get("max_us"), row.get("changes", row.get("overlapping"))]
        texts = ["" if cell is None else three_digits(cell) for cell in cells]
        print(f"| `{row['run_name'].split('/iterations')[0].removesuffix('/manual_time')}` | " + " | ".join(texts) + " |")


def growth_of(result):
    """Per scene the mean times of updates with tiles, as (boxes, microseconds)."""
    series = {}
    for row in result["benchmarks"]:
        parts = row["run_name"].split("/")
        if parts[:2] == ["update", "tiles"] and int(parts[3]) >= 16000:
            series.setdefault(parts[2], []).append((int(parts[3]), row["real_time"]))
    return series


def draw_growth(plt, results, out):
    """One panel per device: the time of an update per box, next to n log n."""
    figure, axes = plt.subplots(1, len(results), figsize=(5.5 * len(results), 3.8), squeeze=False)
    for result, panel in zip(results, axes[0]):
        for scene, points in growth_of(result).items():
            boxes, times = zip(*sorted(points))
            panel.plot(boxes, [1000 * t / n for n, t in zip(boxes, times)], marker="o", label=scene)
            first = 1000 * times[0] / boxes[0] / math.log(boxes[0])
            panel.plot(boxes, [first * math.log(n) for n in boxes], "--", color="grey", linewidth=1)
        panel.set(title=result["context"]["device"].split(" / ")[-1], xlabel="boxes, all moving", xscale="log")
        panel.set_ylim(bottom=0)
        panel.grid(alpha=0.3)
    axes[0][0].set_ylabel("one update, ns per box (dashed: n log n)")
    axes[0][0].legend()
    figure.tight_layout()
    figure.savefig(out, metadata={"Date": None})


def read(path):
    with open(path, encoding="utf-8") as file:
        return json.load(file)


UPDATES = ("update", "update-from-memory", "update-device", "update-enqueue", "worlds", "some-moving", "whole-list", "kernel")
PRINTERS = {"frame": print_frames, "proxies": print_proxies, **dict.fromkeys(UPDATES, print_updates)}


def main():
    if len(sys.argv) == 2 and sys.argv[1].endswith(".json"):
        result = read(sys.argv[1])
        kind = result["benchmarks"][0]["run_name"].split("/")[0]
        if kind not in PRINTERS:
            sys.exit(f"{sys.argv[1]}: no table is known for benchmarks named {kind}/...")
        return PRINTERS[kind](result)
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    import matplotlib  # for pictures only

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    draw_growth(plt, [read(path) for path in sys.argv[2:]], sys.argv[1])


if __name__ == "__main__":
    main()
