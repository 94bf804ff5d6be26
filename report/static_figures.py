"""Figures 1 to 6 as SVG and PNG files. The same study gives the same bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from report.curves import figure_names, over_frames, over_objects, shown_objects
from report.key_frames import top_speed
from report.palette import styles_of
from report.recording import FRAME_SECONDS, Recording
from report.study import METRICS, Series, Study

DASHES = {"solid": "-", "dash": "--", "dot": ":", "dashdot": "-.", "longdash": (0, (8, 3))}
MARKERS = {"circle": "o", "square": "s", "diamond": "D", "triangle-up": "^", "cross": "P"}
TITLES = {"update": "update", "broad_phase": "broad phase", "total": "total"}
MOST_POINTS = 512  # per line in Figures 2 to 5
MARKS = 6  # per line in Figures 2 to 5
SETTINGS: dict[str, Any] = {
    "svg.hashsalt": "broadcl",
    "svg.fonttype": "none",
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#8b8f98",
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "grid.color": "#e3e5e9",
    "legend.frameon": False,
    "figure.dpi": 100,
}


def _line_style(study: Study, series: Series) -> dict[str, Any]:
    style = styles_of(study)[series]
    return {
        "color": style.colour,
        "linestyle": DASHES[style.dash],
        "marker": MARKERS[style.marker.removesuffix("-open")],
        "markersize": 4,
        "markerfacecolor": "white" if style.marker.endswith("-open") else None,
        "label": study.label(series),
    }


def _add_legend(figure: Figure, axes: Any) -> None:
    """One legend for all panels, below them, in two rows."""
    figure.tight_layout(rect=(0, 0.5 / figure.get_figheight(), 1, 1))
    entries: dict[str, Any] = {}
    for panel in np.ravel(axes):
        handles, labels = panel.get_legend_handles_labels()
        entries.update(zip(labels, handles))
    figure.legend(
        entries.values(),
        entries.keys(),
        loc="lower center",
        ncol=min(4, len(entries)),
    )


def _label_decades(panel: Any, digits: list[int]) -> None:
    """Ticks at these digits of each decade, without exponents."""
    panel.yaxis.set_major_locator(LogLocator(subs=digits))
    panel.yaxis.set_major_formatter("{x:g}")
    panel.yaxis.set_minor_formatter("")


def times_over_objects(study: Study) -> Figure:
    """Figure 6."""
    rows = (len(study.scenarios) + 1) // 2
    figure, axes = plt.subplots(rows, 2, figsize=(9, 0.6 + 3 * rows), squeeze=False)
    for panel, scenario in zip(axes.flat, study.scenarios):
        for series in study.series:
            line = over_objects(study, scenario, series, "total")
            if not line.objects:
                continue
            panel.errorbar(
                line.objects,
                line.median,
                yerr=(line.median - line.least, line.greatest - line.median),
                linewidth=1.4,
                elinewidth=0.8,
                **_line_style(study, series),
            )
        panel.set(title=scenario, yscale="log", xticks=study.objects(scenario))
        panel.set(xlabel="objects", ylabel="total time of a run, s")
        panel.xaxis.set_major_formatter("{x:,.0f}")
        _label_decades(panel, [1, 2, 5])
        panel.grid(True)
    for panel in axes.flat[len(study.scenarios) :]:
        panel.set_visible(False)
    _add_legend(figure, axes)
    return figure


def medians_of(times: np.ndarray, step: int) -> tuple[np.ndarray, np.ndarray]:
    """The middle frame number and the median of each block of `step` frames, without an incomplete one."""
    count = len(times) // step
    blocks = times[: count * step].reshape(count, step)
    return np.arange(count) * step + (step - 1) / 2, np.median(blocks, axis=1)


def times_over_frames(study: Study, scenario: str) -> Figure:
    """One of Figures 2 to 5."""
    objects = shown_objects(study, scenario)
    step = 1
    figure, axes = plt.subplots(len(METRICS), 1, figsize=(9, 9), sharex=True)
    for panel, metric in zip(axes, ("total", "update", "broad_phase")):
        for k, series in enumerate(study.cells_of(scenario, objects)):
            times = over_frames(study, scenario, objects, series)[:, METRICS.index(metric)]
            step = -(-len(times) // MOST_POINTS)
            frames, medians = medians_of(times, step)
            # The marks of the lines stand side by side.
            marks = (0.02 + 0.02 * k, 1 / MARKS)
            panel.plot(frames, medians, linewidth=1, markevery=marks, **_line_style(study, series))
        panel.set(title=TITLES[metric], yscale="log", ylabel="ms", xlim=(0, len(times) - 1))
        _label_decades(panel, [1])
        panel.grid(True)
    axes[-1].set_xlabel("frame" + (f" (medians of {step} frames)" if step > 1 else ""))
    figure.suptitle(f"{scenario}, {objects:,} objects", x=0.01, ha="left", fontsize=11)
    _add_legend(figure, axes)
    return figure


def key_frames(recordings: list[Recording], images: dict[str, list[np.ndarray]]) -> Figure:
    """Figure 1: one row per recorded scenario."""
    columns = len(next(iter(images.values())))
    size = (2.2 * columns, 2.45 * len(recordings))
    figure, axes = plt.subplots(len(recordings), columns, figsize=size, squeeze=False)
    for row, recording in zip(axes, recordings):
        drawn = zip(row, recording.key_frames, images[recording.scenario])
        for k, (panel, frame, image) in enumerate(drawn):
            panel.imshow(image, interpolation="antialiased")
            panel.set_title(f"\nframe {frame}, {frame * FRAME_SECONDS:.1f} s", fontsize=8)
            if k == 0:
                above = f"{recording.scenario}, {recording.objects:,} objects; speed"
                above += f" from 0 (violet) to {top_speed(recording):.3g} m/s (yellow)"
                # It reaches over the other columns.
                title = panel.annotate(
                    above, (0, 1), (0, 17), "axes fraction", "offset points", fontsize=8
                )
                title.set_in_layout(False)
            panel.set_axis_off()
    figure.tight_layout()
    return figure


def save(figure: Figure, folder: Path, name: str) -> None:
    """Saves a figure as NAME.svg and NAME.png."""
    figure.savefig(folder / f"{name}.svg", metadata={"Date": None, "Creator": None})
    figure.savefig(folder / f"{name}.png", dpi=150, metadata={"Software": None})
    plt.close(figure)


def save_all(
    study: Study, recordings: list[Recording], images: dict[str, list[np.ndarray]], folder: Path
) -> None:
    """Writes figure-1 to figure-6; without recordings there is no Figure 1."""
    matplotlib.use("Agg")
    with matplotlib.rc_context(SETTINGS):
        if recordings:
            save(key_frames(recordings, images), folder, "figure-1")
        for scenario, name in figure_names(study).items():
            if scenario in study.scenarios:
                save(times_over_frames(study, scenario), folder, name)
        save(times_over_objects(study), folder, "figure-6")
