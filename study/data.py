"""The results of a study as tables of pandas."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from study.plan import BULLETS, PAPER, Plan, Run, StudyError
from study.store import load, read_document

# A broad phase may do its work in the update or after it, so only the sum of both is comparable: it comes first.
METRICS = {
    "search": "update and broad phase together",
    "total": "total time",
    "update": "update alone",
    "broad_phase": "broad phase alone",
}
INEXACT = BULLETS[1:]  # their boxes have margins
CELL = ["scenario", "objects", "frames"]


class Cell(NamedTuple):
    """What is compared: runs of one scenario and number of objects, over their first `frames` frames. If some runs are
    longer than others, there is a cell of each length, with all runs that are at least as long."""

    scenario: str
    objects: int
    frames: int

    def __str__(self) -> str:
        return f"{self.objects:,} objects, {self.frames:,} frames"


@dataclass(frozen=True, eq=False)
class Study:
    folder: Path
    document: dict[str, Any]  # study.json
    frames: dict[Run, pd.DataFrame]  # one row per frame: milliseconds, and `pairs`
    # One row per run and cell. X_mean_ms is by the wall clock, X_cpu_mean_ms of the thread that simulates. X is `search`,
    # `total`, `update`, `broad_phase`, or `rest`: what is not update and broad phase. X_judged is by `clock`: "_cpu", or "" for what
    # works on a device in some run, since the thread waits for that.
    runs: pd.DataFrame

    @property
    def plan(self) -> Plan:
        return self.document["plan"]

    @property
    def scenarios(self) -> list[str]:
        """Those that have runs, the paper's first, in its order."""
        found = set(self.runs.scenario)
        return [s for s in (*PAPER, *sorted(set(self.plan.scenarios) - set(PAPER))) if s in found]

    @property
    def broadphases(self) -> list[str]:
        """Those that have runs."""
        return [b for b in self.plan.broadphases if b in set(self.runs.broadphase)]

    def cells(self, scenario: str | None = None) -> list[Cell]:
        """Those that have runs; by scenario, objects and frames."""
        found = {Cell(*key) for key in self.runs[CELL].itertuples(index=False)}
        order = self.scenarios
        return sorted((c for c in found if scenario in (None, c.scenario)), key=lambda c: (order.index(c.scenario), *c[1:]))

    def largest(self, scenario: str) -> Cell:
        """The cell with the most objects, and of these the one with the most frames."""
        return max(self.cells(scenario), key=lambda c: (c.objects, c.frames))

    def over_objects(self, scenario: str) -> list[Cell]:
        """Cells of the same number of frames: of the one that exists for the most numbers of objects."""
        counts = pd.Series([c.frames for c in self.cells(scenario)]).value_counts()
        frames = max(counts[counts == counts.max()].index)
        return [c for c in self.cells(scenario) if c.frames == frames]

    def times(self, cell: Cell, column: str = "search_mean_ms") -> dict[str, np.ndarray]:
        """For each broad phase of a cell, a value per repeat."""
        rows = self.runs[(self.runs[CELL] == list(cell)).all(axis=1)]
        groups = dict(list(rows.groupby("broadphase")[column]))
        return {b: groups[b].to_numpy() for b in self.broadphases if b in groups}

    def frames_of(self, scenario: str, objects: int, broadphase: str, least: int = 0) -> list[pd.DataFrame]:
        """Of the runs that have at least so many frames."""
        key = (scenario, objects, broadphase)
        return [f for r, f in self.frames.items() if (r.scenario, r.objects, r.broadphase) == key and r.frames >= least]

    def medians_by_frame(self, scenario: str, objects: int) -> dict[str, pd.DataFrame]:
        """For each broad phase, its frames: medians over the repeats."""
        runs = {b: self.frames_of(scenario, objects, b) for b in self.broadphases}
        return {b: pd.concat(frames).groupby(level="frame").median() for b, frames in runs.items() if frames}

    def same_pairs(self, cell: Cell) -> list[list[str]]:
        """Groups of exact broad phases that had the same number of pairs in each frame of each repeat."""
        groups: dict[bytes, list[str]] = {}
        for broadphase in self.broadphases:
            runs = self.frames_of(cell.scenario, cell.objects, broadphase, cell.frames)
            pairs = {f.pairs.to_numpy()[: cell.frames].tobytes() for f in runs}
            if pairs and broadphase not in INEXACT:
                groups.setdefault(pairs.pop() if len(pairs) == 1 else broadphase.encode(), []).append(broadphase)
        return list(groups.values())


def _read_frames(csv: str) -> pd.DataFrame:
    frames = pd.read_csv(io.StringIO(csv), index_col="frame")
    for clock in ("_ms", "_cpu_ms"):
        frames[f"search{clock}"] = frames[f"update{clock}"] + frames[f"broad_phase{clock}"]
        frames[f"rest{clock}"] = frames[f"total{clock}"] - frames[f"search{clock}"]
    return frames


def _summary(run: Run, device: str, frames: pd.DataFrame) -> dict[str, Any]:
    """The row of a run; frame 0 is the warm-up."""
    row = {**run._asdict(), "frames": len(frames), "device": device}
    counted = frames.iloc[1:]
    for name in (*METRICS, "rest"):
        times = counted[f"{name}_ms"]
        row[f"{name}_mean_ms"], row[f"{name}_median_ms"] = times.mean(), times.median()
        row[f"{name}_p95_ms"], row[f"{name}_cpu_mean_ms"] = times.quantile(0.95), counted[f"{name}_cpu_ms"].mean()
    row |= {"pairs_mean": counted.pairs.mean(), "pairs_last": int(counted.pairs.iloc[-1])}
    return row | {"total_sum_ms": counted.total_ms.sum(), "first_frame_total_ms": frames.total_ms.iloc[0]}


def read_study(folder: Path) -> Study:
    """Reads what is done of a study; StudyError if something is damaged, or nothing is done."""
    document = read_document(folder)
    if document is None:
        raise StudyError(f"'{folder}' is not the folder of a study: it has no study.json")
    frames: dict[Run, pd.DataFrame] = {}
    devices: dict[Run, str] = {}
    for run in document["plan"].runs():
        loaded = load(folder, run)
        if loaded is not None:
            devices[run], frames[run] = loaded[0], _read_frames(loaded[1])
    if not frames:
        raise StudyError(f"'{folder}' has no run that is done; run the study")
    lengths: dict[tuple[str, int], set[int]] = {}
    for run in frames:
        lengths.setdefault((run.scenario, run.objects), set()).add(run.frames)
    rows = [
        _summary(run, devices[run], times.iloc[:length])
        for run, times in frames.items()
        for length in sorted(lengths[run.scenario, run.objects])
        if length <= run.frames
    ]
    runs = pd.DataFrame(rows)
    waits = runs.groupby("broadphase").device.transform("any")
    runs["clock"] = np.where(waits, "", "_cpu")
    for metric in METRICS:
        runs[f"{metric}_judged"] = runs[f"{metric}_mean_ms"].where(waits, runs[f"{metric}_cpu_mean_ms"])
    return Study(folder, document, frames, runs)
