"""Figures 2 to 6, drawn with matplotlib. The same study gives the same bytes."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from study.data import METRICS, Study
from study.plan import PAPER, PAPER_OBJECTS

INK = "#5b616e"  # of text and axes in files; the page has its own
POINTS = 200  # per line in Figures 2 to 5; fewer in those that a reader has to open
FEW_POINTS = 50
MARKS = 6  # per line in Figures 2 to 5
PANELS = ("search", "total", "update", "broad_phase", "pairs")


class Style(NamedTuple):
    """Of a broad phase, the same in every figure. The colours differ in lightness too, for readers with a colour vision
    deficiency; Bullet's own are not solid."""

    colour: str
    dash: tuple[float, ...]  # points of line and gap
    marker: str
    filled: bool = True


STYLES = {
    "bullet-bf": Style("#6d7280", (1, 1.5), "o", False),
    "bullet-sap": Style("#d9a400", (4, 2), "s", False),
    "bullet-bvh": Style("#a8401c", (5, 2, 1, 2), "D", False),
    "gpu-bf": Style("#0e8f63", (), "^"),
    "brute-force": Style("#1f57dd", (), "s"),
    "tiles": Style("#a77af0", (), "D"),
    "auto": Style("#ee2a96", (), "o"),
    "auto+culling": Style("#1cb2dc", (), "o", False),
}
OTHERS = ("#7d8f1d", "#5f7fa3", "#a86b4c", "#3a9fb0")
INKED = ("axes.edgecolor", "axes.labelcolor", "axes.titlecolor", "grid.color", "text.color", "xtick.color", "ytick.color")
SETTINGS: dict[str, Any] = {
    **dict.fromkeys(INKED, INK), "svg.hashsalt": "broadcl", "svg.fonttype": "none", "font.family": "DejaVu Sans", "font.size": 9,
    "axes.spines.top": False, "axes.spines.right": False, "axes.titlesize": 10, "axes.titlelocation": "left", "axes.grid": True,
    "grid.alpha": 0.2, "axes.facecolor": "none", "legend.frameon": False, "xtick.bottom": False, "ytick.left": False,
}  # fmt: skip


def style_of(broadphase: str) -> Style:
    return STYLES.get(broadphase, Style(OTHERS[sum(map(ord, broadphase)) % len(OTHERS)], (), "P"))


def number_of(scenario: str) -> int:
    """The paper's figure of a scenario, from 2 to 5; 7 for one that the paper does not have."""
    return PAPER.index(scenario) + 2 if scenario in PAPER else 7


def shown_objects(study: Study, scenario: str) -> int:
    """The number of objects that Figures 2 to 5 show: the paper's if it ran, otherwise the largest."""
    objects = [cell.objects for cell in study.cells(scenario)]
    return PAPER_OBJECTS if PAPER_OBJECTS in objects else max(objects)


def _line(broadphase: str) -> dict[str, Any]:
    style = style_of(broadphase)
    look = {"color": style.colour, "linestyle": (0, style.dash) if style.dash else "-", "marker": style.marker}
    return {**look, "markerfacecolor": style.colour if style.filled else "white", "markersize": 4, "label": broadphase}


def _label_decades(panel: Any, digits: list[int]) -> None:
    """A logarithmic axis with ticks at these digits of each decade, without exponents."""
    panel.set_yscale("log")
    panel.yaxis.set_major_locator(LogLocator(subs=digits))
    panel.yaxis.set_major_formatter("{x:,g}")
    panel.yaxis.set_minor_formatter("")


def over_objects(study: Study, metric: str) -> Figure:
    """Figure 6, of one metric: medians of the runs, with bars from the fastest to the slowest of them."""
    rows = (len(study.scenarios) + 1) // 2
    figure, axes = plt.subplots(rows, 2, figsize=(9, 0.5 + 2.6 * rows), squeeze=False)
    for panel, scenario in zip(axes.flat, study.scenarios):
        cells = study.over_objects(scenario)
        times = {cell: study.times(cell, f"{metric}_mean_ms") for cell in cells}
        for broadphase in study.broadphases:
            # Whole runs; frame 0 does not count.
            seconds = {c.objects: t[broadphase] * (c.frames - 1) / 1000 for c, t in times.items() if broadphase in t}
            if not seconds:
                continue
            middle = np.array([np.median(s) for s in seconds.values()])
            ends = [middle - [s.min() for s in seconds.values()], [s.max() for s in seconds.values()] - middle]
            drawn = panel.errorbar(list(seconds), middle, yerr=ends, linewidth=1.4, elinewidth=0.8, **_line(broadphase))
            for k, piece in enumerate((drawn[0], *drawn[2])):
                piece.set_gid(f"figure-6-{metric}-{scenario}-{k}--{broadphase}")
        panel.set(title=f"{scenario}, {cells[0].frames:,} frames", xlabel="objects", ylabel="s per run")
        panel.set_xticks([cell.objects for cell in cells])
        panel.xaxis.set_major_formatter("{x:,.0f}")
        _label_decades(panel, [1, 2, 5])
    for panel in axes.flat[len(study.scenarios) :]:
        panel.remove()
    return figure


def medians_of(times: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    """The middle frame number and the median of each block of `step` frames, without an incomplete one."""
    count = len(times) // step
    blocks = times[: count * step].reshape(count, step)
    return np.arange(count) * step + (step - 1) / 2, np.median(blocks, axis=1)


def over_frames(study: Study, scenario: str, objects: int, points: int = POINTS) -> Figure:
    """One of Figures 2 to 5, with at most so many points per line."""
    figure, axes = plt.subplots(len(PANELS), 1, figsize=(9, 10), sharex=True)
    by_frame = study.medians_by_frame(scenario, objects)
    longest = max(map(len, by_frame.values()))
    step = -(-longest // points)
    for panel, metric in zip(axes, PANELS):
        for k, (broadphase, frames) in enumerate(by_frame.items()):
            x, y = medians_of(frames[metric if metric == "pairs" else f"{metric}_ms"].to_numpy(), step)
            marks = (0.02 + 0.02 * k, 1 / MARKS)  # side by side
            gid = f"frames-{scenario}-{objects}-{metric}--{broadphase}"
            panel.plot(x, y, linewidth=1, markevery=marks, gid=gid, **_line(broadphase))
        panel.set(title=METRICS.get(metric, metric), ylabel="" if metric == "pairs" else "ms", xlim=(0, longest - 1))
        _label_decades(panel, [1])
    axes[-1].set_xlabel("frame" + (f" (medians of {step} frames)" if step > 1 else ""))
    return figure


def _svg(figure: Figure) -> str:
    """With one decimal, which is a tenth of a point."""
    text = io.StringIO()
    figure.savefig(text, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    return re.sub(r' (d|x|y)="[^"]*"', lambda place: re.sub(r"(\.\d)\d+|\s*\n", r"\1", place[0]), text.getvalue())


def inline(figure: Figure) -> str:
    """For the page: without a legend, in the page's colours. Lines of broad phase X have ids that end in --X."""
    figure.tight_layout()
    svg = _svg(figure)
    plt.close(figure)
    return svg[svg.index("<svg") :].replace(INK, "currentColor")


def save(figure: Figure, path: Path, title: str) -> None:
    """As an SVG file, with a title and a legend of all panels."""
    pairs = [panel.get_legend_handles_labels() for panel in figure.axes]
    entries = {label: handle for handles, labels in pairs for handle, label in zip(handles, labels)}
    height = figure.get_figheight()
    figure.tight_layout(rect=(0, 0.5 / height, 1, 1 - 0.25 / height))
    figure.legend(entries.values(), entries.keys(), loc="lower center", ncol=4)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    path.write_text(_svg(figure), encoding="utf-8")
    plt.close(figure)


def save_all(study: Study, folder: Path) -> list[str]:
    """Writes figure-2 to figure-6, and figure-6 of update and broad phase together; returns the names of the files."""
    names = []
    for scenario in study.scenarios:
        objects = shown_objects(study, scenario)
        names.append(f"figure-{number_of(scenario)}.svg")
        save(over_frames(study, scenario, objects), folder / names[-1], f"{scenario}, {objects:,} objects")
    for name, metric in (("figure-6-search.svg", "search"), ("figure-6.svg", "total")):
        save(over_objects(study, metric), folder / name, METRICS[metric])
        names.append(name)
    return names
