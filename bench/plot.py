#!/usr/bin/env python3
"""bench/plot.py OUT.svg RESULT.json [RESULT.json ...]: draws frame times over the number of boxes, a panel a device,
and prints them as tables in Markdown; with results of updates, draws how these grow. bench/plot.py UPDATES.json or
PROXIES.json prints the times of updates, or those of proxies that come, move and go, as a table.

A picture needs matplotlib (Debian, Ubuntu: apt install python3-matplotlib). The results are those of `scripts/bench`.
"""
import json
import math
import sys

SCENE = "mixed"
REFERENCE = "brute-force"  # of the proxies' table
STYLES = {"bullet-bf": ":", "bullet-sap": "-.", "bullet-bvh": "--"}


def read(path):
    """The device's label, and for each broad phase its medians as (boxes, microseconds)."""
    with open(path, encoding="utf-8") as file:
        result = json.load(file)
    series = {}
    for row in result["benchmarks"]:
        parts = row["run_name"].split("/")
        if parts[0] == "frame" and parts[2] == SCENE and row.get("aggregate_name") == "median":
            series.setdefault(parts[1], []).append((int(parts[3]), row["real_time"]))
    return result["context"]["device"], series


def print_table(device, series):
    sizes = sorted({boxes for points in series.values() for boxes, _ in points})
    print(f"| {device}, {SCENE} sizes, ms | " + " | ".join(f"{n:,}" for n in sizes) + " |")
    print("| --- |" + " ---: |" * len(sizes))
    for name, points in series.items():
        times = dict(points)
        print(f"| `{name}` | " + " | ".join(f"{times[n] / 1000:.3g}" if n in times else "" for n in sizes) + " |")
    print()


def three_digits(x):
    return f"{x:,.0f}" if x >= 100 else f"{x:.3g}"


def print_proxies(result):
    """A row an operation: medians, in brackets how many times that of the reference they are, and pairs."""
    rows = {}
    # Not in the order in which they ran, which may be random, but in that of the program.
    for row in sorted(result["benchmarks"], key=lambda row: row["family_index"]):
        _, operation, name, scene, count = row["run_name"].split("/")[:5]
        if row.get("aggregate_name") == "median":
            rows.setdefault((operation, f"{int(count):,} {scene}"), {})[name] = row
    names = list(dict.fromkeys(name for row in rows.values() for name in row))
    print(f"| {result['context']['device']}, ms | " + " | ".join(f"`{name}`" for name in names) + " | pairs |")
    print("| --- |" + " ---: |" * (len(names) + 1))
    for (operation, scene), row in rows.items():
        times = [row[name]["real_time"] for name in names]
        cells = [f"{three_digits(time)} ({three_digits(time / row[REFERENCE]['real_time'])})" for time in times]
        pairs = dict.fromkeys(f"{row[name]['overlapping']:,.0f}" for name in names)
        print(f"| {operation}, {scene} | " + " | ".join(cells) + f" | {' / '.join(pairs)} |")


def print_updates(result):
    """A row a benchmark: mean, p95 and longest of its frames, and the mean from ordinary memory."""
    rows = {row["run_name"].split("/iterations")[0]: row for row in result["benchmarks"]}
    print(f"| {result['context']['device']}, microseconds | mean | p95 | longest | from ordinary memory | changes |")
    print("| --- |" + " ---: |" * 5)
    for name, row in rows.items():
        if name.startswith("update-from-memory/"):
            continue
        other = rows.get(name.replace("update/", "update-from-memory/", 1)) if name.startswith("update/") else None
        cells = [row["real_time"], row["p95_us"], row["max_us"], other["real_time"] if other else None, row["changes"]]
        print(f"| `{name}` | " + " | ".join("" if cell is None else f"{cell:,.4g}" for cell in cells) + " |")


def growth_of(result):
    """For each scene the mean times of updates by tiles, as (boxes, microseconds)."""
    series = {}
    for row in result["benchmarks"]:
        parts = row["run_name"].split("/")
        if parts[:2] == ["update", "tiles"] and int(parts[3]) >= 16000:
            series.setdefault(parts[2], []).append((int(parts[3]), row["real_time"]))
    return series


def draw_growth(plt, results, out):
    """A panel a device: the time of an update for each box, beside what grows as n log n."""
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
    axes[0][0].set_ylabel("one update, ns a box (dashed: n log n)")
    axes[0][0].legend()
    figure.tight_layout()
    figure.savefig(out, metadata={"Date": None})


def main():
    if len(sys.argv) == 2 and sys.argv[1].endswith(".json"):
        with open(sys.argv[1], encoding="utf-8") as file:
            result = json.load(file)
        is_proxies = result["benchmarks"][0]["run_name"].startswith("proxies/")
        return print_proxies(result) if is_proxies else print_updates(result)
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    import matplotlib  # for pictures only

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    with open(sys.argv[2], encoding="utf-8") as file:
        is_updates = json.load(file)["benchmarks"][0]["run_name"].startswith("update")
    if is_updates:
        return draw_growth(plt, [json.load(open(path, encoding="utf-8")) for path in sys.argv[2:]], sys.argv[1])
    results = [read(path) for path in sys.argv[2:]]
    figure, axes = plt.subplots(1, len(results), figsize=(5.5 * len(results), 3.8), sharey=True, squeeze=False)
    names = sorted({name for _, series in results for name in series})
    for (device, series), panel in zip(results, axes[0]):
        print_table(device, series)
        for name, points in series.items():
            boxes, times = zip(*sorted(points))
            panel.plot(boxes, [t / 1000 for t in times], STYLES.get(name, "-"), marker="o", markersize=3, label=name,
                       color=f"C{names.index(name)}",
                       linewidth=1.5 if name in STYLES else 2.5)
        panel.set(title=device.split(" / ")[-1], xlabel="boxes, all moving, mixed sizes", xscale="log", yscale="log")
        panel.grid(alpha=0.3)
    axes[0][0].set_ylabel("one frame, ms")
    max(zip(results, axes[0]), key=lambda pair: len(pair[0][1]))[1].legend()
    figure.tight_layout()
    figure.savefig(sys.argv[1], metadata={"Date": None})


if __name__ == "__main__":
    main()
