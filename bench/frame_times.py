#!/usr/bin/env python3
"""bench/frame_times.py OUT.svg TITLE=STUDY ...: draws the times of update and broad phase in `mixed-sizes`, as multiples
of those of `auto`, one panel per study. STUDY is a folder with the study.csv of
`scripts/study --scenarios mixed-sizes --objects 1250,3500,16000 --broadphases bullet-sap,bullet-bvh,gpu-bf,auto --out STUDY`.

It needs matplotlib (Debian, Ubuntu: apt install python3-matplotlib). docs/images/frame-times.svg is made by
`bench/frame_times.py frame-times.svg "with a GPU (NVIDIA H200)=bench/results/nvidia-h200/mixed-sizes"
"two cores, no GPU=bench/results/pocl-2-cores/mixed-sizes"`.
"""
import csv
import pathlib
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent))

SCENARIO = "mixed-sizes"
REFERENCE = "auto"
BROAD_PHASES = {
    "bullet-sap": "Bullet, sweep and prune (bullet-sap)",
    "bullet-bvh": "Bullet, trees (bullet-bvh)",
    "gpu-bf": "the paper's (gpu-bf)",
    "auto": "BroadCL's (auto)",
}
WIDTH = 0.2  # of a bar; groups are 1 apart
HIGHEST = 12  # multiple; higher bars end there and say how high they are


def times_of(folder):
    """Number of objects -> broad phase -> update and broad phase, ms: mean of the frames, median of the repeats. (The runs are
    expected to be of the same length.)"""
    runs = {}
    with open(pathlib.Path(folder) / "study.csv", encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            if row["scenario"] == SCENARIO and row["broadphase"] in BROAD_PHASES:
                times = runs.setdefault(int(row["objects"]), {}).setdefault(row["broadphase"], [])
                times.append(float(row["update_mean_ms"]) + float(row["broad_phase_mean_ms"]))
    return {n: {name: statistics.median(times) for name, times in by_name.items()} for n, by_name in sorted(runs.items())}


def milliseconds(time):
    return f"{time:,.0f}" if time >= 100 else f"{time:#.2g}".rstrip(".")


def highest(times):
    """The highest multiple that a bar shows."""
    return min(HIGHEST, max(max(row.values()) / row[REFERENCE] for row in times.values()))


def draw_panel(panel, title, times, styles):
    for group, by_name in enumerate(times.values()):
        for k, name in enumerate(BROAD_PHASES):
            if name not in by_name:
                continue
            multiple = by_name[name] / by_name[REFERENCE]
            x = group + (k - 1.5) * WIDTH
            height = min(multiple, HIGHEST)
            panel.bar(x, height, WIDTH * 0.9, color=styles[name].colour, label=BROAD_PHASES[name] if group == 0 else None)
            if multiple > HIGHEST:
                panel.plot([x - WIDTH / 2, x + WIDTH / 2], [height * 0.9, height * 0.94], color="white", linewidth=3)
                panel.text(x, height * 0.87, f"{multiple:.0f}×", color="white", weight="bold", rotation=90, ha="center", va="top")
            panel.annotate(milliseconds(by_name[name]), (x, height), (0, 2), textcoords="offset points", ha="center", va="bottom",
                           fontsize=8)
    panel.set(title=title, xticks=range(len(times)), xticklabels=[f"{n:,}" for n in times], xlabel="objects")
    panel.set(xlim=(-0.5, len(times) - 0.5))
    panel.axhline(1, color="#5b616d", linewidth=0.8, zorder=0)
    panel.yaxis.set_major_formatter("{x:g}×")
    panel.tick_params(axis="x", length=0)


def draw(plt, out, studies, styles):
    settings = {"font.family": "DejaVu Sans", "font.size": 9, "svg.hashsalt": "broadcl", "svg.fonttype": "none",
                "axes.titlelocation": "left", "axes.titlesize": 10, "axes.spines.top": False, "axes.spines.right": False,
                "legend.frameon": False}
    with plt.rc_context(settings):
        # About 830 pixels wide, in which 9 points are 12 pixels.
        figure, axes = plt.subplots(1, len(studies), figsize=(8.8, 4.1), sharey=True, squeeze=False)
        times = [times_of(folder) for _, folder in studies]
        for panel, (title, _), rows in zip(axes[0], studies, times):
            draw_panel(panel, title, rows, styles)
        axes[0][0].set_ylim(0, max(highest(rows) for rows in times) * 1.18)
        figure.suptitle("Update and broad phase, as a multiple of BroadCL's (auto); on the bars: ms per frame",
                        x=0.01, ha="left", fontsize=11, weight="bold")
        figure.tight_layout(rect=(0, 0.08, 1, 0.99))
        figure.legend(*axes[0][0].get_legend_handles_labels(), loc="lower center", ncol=4)
        figure.savefig(out, metadata={"Date": None, "Creator": None})


def main():
    if sys.argv[1:] in (["--help"], ["-h"]):
        return print(__doc__)
    studies = [argument.rsplit("=", 1) for argument in sys.argv[2:]]
    if not studies or any(len(study) != 2 for study in studies):
        sys.exit(__doc__)
    import matplotlib

    matplotlib.use("svg")
    import matplotlib.pyplot as plt

    from study.figures import STYLES

    draw(plt, sys.argv[1], studies, STYLES)


if __name__ == "__main__":
    main()
