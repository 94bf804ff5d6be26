"""The numbers behind Figures 2 to 6, both on the page and in files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from report.palette import style_json, styles_of
from report.standing import COMPARED, run_times
from report.study import METRICS, Series, Study
from report.verdict import enumerated

PAPER_OBJECTS = 1250  # in Figures 2 to 5
DIGITS = 4  # significant digits of the times on the page


@dataclass(frozen=True)
class OverObjects:
    """One line of Figure 6: seconds per run; median, minimum and maximum of the repeats."""

    objects: list[int]
    median: np.ndarray
    least: np.ndarray
    greatest: np.ndarray


def figure_names(study: Study) -> dict[str, str]:
    """The figure of each scenario: 2 to 5 in the order of the study, as in the paper, then from 7 on."""
    return {s: f"figure-{k + (2 if k < 4 else 3)}" for k, s in enumerate(study.info["scenarios"])}


def shown_objects(study: Study, scenario: str) -> int:
    """The number of objects that Figures 2 to 5 show first: the paper's if it ran, otherwise the largest."""
    objects = study.objects(scenario)
    return PAPER_OBJECTS if PAPER_OBJECTS in objects else objects[-1]


def over_objects(study: Study, scenario: str, series: Series, metric: str) -> OverObjects:
    """Whole runs of one series against the number of objects, without frame 0, as everywhere."""
    sizes = [n for n in study.objects(scenario) if series in study.cells_of(scenario, n)]
    seconds = []
    for n in sizes:
        repeats = study.cells_of(scenario, n)[series]
        counted = repeats.frames.shape[1] - study.info["warm_up_frames"]
        seconds.append(run_times(repeats, metric) * counted / 1000)
    return OverObjects(
        sizes,
        np.array([np.median(s) for s in seconds]),
        np.array([s.min() for s in seconds]),
        np.array([s.max() for s in seconds]),
    )


def over_frames(study: Study, scenario: str, objects: int, series: Series) -> np.ndarray:
    """(frames, 4): update, broad phase, total in ms and pairs; median over the repeats."""
    return np.median(study.cells_of(scenario, objects)[series].frames, axis=0)


def _rounded(values: np.ndarray) -> list[float]:
    numbers = (float(f"{x:.{DIGITS}g}") for x in values)
    return [int(x) if x.is_integer() else x for x in numbers]


def page_data(study: Study) -> dict[str, Any]:
    """All data that the page's figures show."""
    styles = styles_of(study)
    series = [{"label": study.label(s), **style_json(styles[s])} for s in study.series]
    totals: dict[str, Any] = {}
    frames: dict[str, Any] = {}
    for scenario in study.scenarios:
        totals[scenario] = {metric: [] for metric in COMPARED}
        for metric in COMPARED:
            for s in study.series:
                line = over_objects(study, scenario, s, metric)
                totals[scenario][metric].append(
                    {
                        "x": line.objects,
                        "y": _rounded(line.median),
                        "less": _rounded(line.median - line.least),
                        "more": _rounded(line.greatest - line.median),
                    }
                )
        frames[scenario] = {}
        for n in study.objects(scenario):
            lines: dict[str, Any] = {}
            for s in study.cells_of(scenario, n):
                columns = over_frames(study, scenario, n, s).T
                named = dict(zip((*METRICS, "pairs"), columns))
                lines[study.label(s)] = {name: _rounded(y) for name, y in named.items()}
            frames[scenario][str(n)] = lines
    return {
        "series": series,
        "totals": totals,
        "frames": frames,
        "shown": {s: shown_objects(study, s) for s in study.scenarios},
        "names": {s: name for s, name in figure_names(study).items() if s in study.scenarios},
        "compared": COMPARED,
    }


def frames_counted(study: Study) -> str:
    """The numbers of frames of the runs, as text."""
    counts = sorted({r.frames.shape[1] for r in study.cells.values()})
    return enumerated([f"{n:,}" for n in counts])
