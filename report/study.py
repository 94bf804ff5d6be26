"""Reads the folder that `broadcl study` writes, and refuses it if it is incomplete or damaged."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

METRICS = ("update", "broad_phase", "total")
RUN_HEADER = "frame,update_ms,broad_phase_ms,total_ms,pairs"
SUMMARY_COLUMNS = (
    *(f"{metric}_{kind}_ms" for metric in METRICS for kind in ("mean", "median", "p95")),
    "total_sum_ms",
    "pairs_mean",
    "pairs_last",
    "first_frame_total_ms",
)


class StudyError(Exception):
    """One line that says what is wrong with a study."""


@dataclass(frozen=True)
class Series:
    """A broad phase on a device: one line of a figure."""

    broadphase: str
    device: str  # the device's label; empty for the host


@dataclass(frozen=True)
class Cell:
    """All repeats of one configuration."""

    scenario: str
    objects: int
    series: Series


@dataclass(frozen=True)
class Repeats:
    """The measurements of a cell."""

    summary: dict[str, np.ndarray]  # columns of study.csv, with one value per repeat
    frames: np.ndarray  # (repeats, frames, 4): update, broad phase and total in ms, pairs


@dataclass(frozen=True)
class Study:
    folder: Path
    info: dict[str, Any]  # study.json
    cells: dict[Cell, Repeats]

    @property
    def scenarios(self) -> list[str]:
        """The scenarios that have runs, in the order of the study."""
        return [s for s in self.info["scenarios"] if any(c.scenario == s for c in self.cells)]

    @property
    def series(self) -> list[Series]:
        """The series that have runs, by broad phase in the order of the study, then by device."""
        names = [b["name"] for b in self.info["broadphases"]]
        found = {cell.series for cell in self.cells}
        return sorted(found, key=lambda s: (names.index(s.broadphase), s.device))

    def objects(self, scenario: str) -> list[int]:
        """The numbers of objects of a scenario that have runs, ascending."""
        return sorted({cell.objects for cell in self.cells if cell.scenario == scenario})

    def cells_of(self, scenario: str, objects: int) -> dict[Series, Repeats]:
        """The series that ran with one scenario and number of objects, in the order of `series`."""
        cells = {s: self.cells.get(Cell(scenario, objects, s)) for s in self.series}
        return {s: repeats for s, repeats in cells.items() if repeats is not None}

    def label(self, series: Series) -> str:
        """The broad phase, and its device if the study has it on several."""
        devices = {s.device for s in self.series if s.broadphase == series.broadphase}
        return f"{series.broadphase} · {series.device}" if len(devices) > 1 else series.broadphase

    def is_bullet(self, series: Series) -> bool:
        """Whether it is one of Bullet's own."""
        rows = {b["name"]: b for b in self.info["broadphases"]}
        return bool(rows[series.broadphase]["bullet"])


def read_study(folder: Path) -> Study:
    """Reads a study; throws StudyError."""
    info = _read_info(folder / "study.json")
    rows = _read_summary(folder / "study.csv", info)
    files = set((folder / "runs").glob("*.csv"))
    runs: dict[Cell, list[tuple[int, dict[str, float], np.ndarray]]] = {}
    for row in rows:
        path = _run_file(folder / "runs", row)
        if path not in files:
            raise StudyError(f"{path} is missing, or listed twice in study.csv")
        files.remove(path)
        frames = _read_run(path)
        if len(frames) != int(row["frames"]):
            raise StudyError(f"{path}: {len(frames)} frames, but {row['frames']} in study.csv")
        cell = Cell(row["scenario"], int(row["objects"]), Series(row["broadphase"], row["device"]))
        summary = {column: float(row[column]) for column in SUMMARY_COLUMNS}
        runs.setdefault(cell, []).append((int(row["repeat"]), summary, frames))
    if files:
        raise StudyError(f"{min(files)} is not in study.csv: run the study again to finish it")
    return Study(folder, info, {cell: _merge(cell, repeats) for cell, repeats in runs.items()})


def _merge(cell: Cell, repeats: list[tuple[int, dict[str, float], np.ndarray]]) -> Repeats:
    repeats.sort(key=lambda repeat: repeat[0])
    if len({len(frames) for _, _, frames in repeats}) > 1:
        raise StudyError(f"runs of {cell} have different numbers of frames")
    summary = {c: np.array([s[c] for _, s, _ in repeats]) for c in SUMMARY_COLUMNS}
    return Repeats(summary, np.stack([frames for _, _, frames in repeats]))


def _read_info(path: Path) -> dict[str, Any]:
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise StudyError(f"{path} is missing: this is not a folder of `broadcl study`") from None
    except ValueError as error:
        raise StudyError(f"{path} is not JSON: {error}") from None
    if not isinstance(info, dict) or info.get("format") != 1:
        raise StudyError(f"{path} does not have format 1")
    needed = "preset command date versions host seed repeat frames scenarios objects broadphases"
    needed += " scenario_summaries"
    for key in (*needed.split(), "devices", "cut"):
        if key not in info:
            raise StudyError(f"{path} has no '{key}'")
    for name in info["scenarios"]:  # becomes part of paths
        if not isinstance(name, str) or not re.fullmatch("[a-z0-9-]+", name):
            raise StudyError(f"{path}: '{name}' is not the name of a scenario")
    return info


def _read_summary(path: Path, info: dict[str, Any]) -> list[dict[str, str]]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file)
            rows = list(reader)
    except FileNotFoundError:
        raise StudyError(f"{path} is missing: no run has finished") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise StudyError(f"{path} is not CSV: {error}") from None
    if not rows:
        raise StudyError(f"{path} has no rows: no run has finished")
    keys = ("scenario", "objects", "frames", "repeat", "broadphase", "device")
    for column in (*keys, *SUMMARY_COLUMNS):
        if column not in (reader.fieldnames or ()):
            raise StudyError(f"{path} has no column '{column}'")
    broadphases = {b["name"] for b in info["broadphases"]}
    for line, row in enumerate(rows, start=2):
        if row["scenario"] not in info["scenarios"] or row["broadphase"] not in broadphases:
            raise StudyError(f"{path}, row {line}: not part of this study: {', '.join(map(str, row.values()))}")
        try:
            numbers = [float(int(row[c])) for c in ("objects", "frames", "repeat")]
            numbers += [float(row[c]) for c in SUMMARY_COLUMNS]
        except (TypeError, ValueError):
            raise StudyError(f"{path}, row {line}: a number is missing or malformed") from None
        if not np.all(np.isfinite(numbers)) or min(numbers) < 0:
            raise StudyError(f"{path}, row {line}: a number is negative or not finite")
        if min(float(row[f"{metric}_mean_ms"]) for metric in METRICS) == 0:
            raise StudyError(f"{path}, row {line}: a time is zero")
    return rows


def slug(text: str) -> str:
    """A device's label as part of a file name."""
    return re.sub("[^a-z0-9]+", "-", text.lower()).strip("-") or "device"


def _run_file(folder: Path, row: dict[str, str]) -> Path:
    device = f"-{slug(row['device'])}" if row["device"] else ""
    name = f"{row['scenario']}-{row['objects']}-{row['broadphase']}{device}-{row['repeat']}.csv"
    return folder / name


def _read_run(path: Path) -> np.ndarray:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        raise StudyError(f"{path} is not text") from None
    if not lines or lines[0] != RUN_HEADER:
        raise StudyError(f"{path}: the first line is not '{RUN_HEADER}'")
    try:
        frames = np.array([[float(x) for x in line.split(",")] for line in lines[1:]], ndmin=2)
    except ValueError:
        raise StudyError(f"{path}: a row has too few or too many numbers, or something else") from None
    if frames.shape[1] != 5 or len(frames) < 2:
        raise StudyError(f"{path}: rows of 5 columns are needed, for at least two frames")
    if not np.all(np.isfinite(frames)) or frames.min() < 0:
        raise StudyError(f"{path}: a number is negative or not finite")
    if not np.array_equal(frames[:, 0], np.arange(len(frames))):
        raise StudyError(f"{path}: the frames are not numbered from 0")
    return frames[:, 1:]
