"""What the tables of a report must show, from study.csv alone: written without report/, from what the page says."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

RESAMPLES = 10_000
SEED = 1

Key = tuple[Any, ...]  # scenario, objects, broad phase, device


class Expected:
    """Reads study.csv: each configuration's columns, a value a repeat."""

    def __init__(self, folder: Path) -> None:
        with (folder / "study.csv").open(encoding="utf-8", newline="") as file:
            rows = sorted(csv.DictReader(file), key=lambda row: int(row["repeat"]))
        self.columns: dict[Key, dict[str, np.ndarray]] = {}
        gathered: dict[Key, dict[str, list[float]]] = {}
        for row in rows:
            key: Key = (row["scenario"], int(row["objects"]), row["broadphase"], row["device"])
            for column, text in row.items():
                if column not in ("scenario", "broadphase", "device"):
                    gathered.setdefault(key, {}).setdefault(column, []).append(float(text))
        for key, columns in gathered.items():
            self.columns[key] = {name: np.array(values) for name, values in columns.items()}
            both = columns["update_mean_ms"], columns["broad_phase_mean_ms"]
            self.columns[key]["search_mean_ms"] = np.add(*both)

    def rivals(self, scenario: str, objects: int) -> list[Key]:
        """All that ran with a scenario and a number of objects."""
        return [key for key in self.columns if key[:2] == (scenario, objects)]

    def most_objects(self, scenario: str) -> int:
        return max(key[1] for key in self.columns if key[0] == scenario)

    def first(self, scenario: str, objects: int, metric: str) -> Key:
        """The one with the least time."""
        column = f"{metric}_mean_ms"
        rivals = self.rivals(scenario, objects)
        return min(rivals, key=lambda key: float(np.median(self.columns[key][column])))

    def ratio(self, key: Key, base: Key, metric: str) -> tuple[float, float, float]:
        """Over the base: the ratio of medians, and the ends of its interval."""
        a, b = (self.columns[k][f"{metric}_mean_ms"] for k in (key, base))
        value = np.median(a) / np.median(b)
        if len(a) < 2 or len(b) < 2:
            return value, np.nan, np.nan
        random = np.random.default_rng(SEED)
        again = [x[random.integers(0, len(x), (RESAMPLES, len(x)))] for x in (a, b)]
        ratios = np.median(again[0], axis=1) / np.median(again[1], axis=1)
        low, high = np.percentile(ratios, [2.5, 97.5])
        return value, low, high

    def cells(self, key: Key, table: str, base: Key | None) -> dict[str, str]:
        """A row of a table: column to text. A row of the base itself has no ratio."""
        columns = self.columns[key]
        if table == "pairs":
            return {
                "pairs_mean": f"{np.median(columns['pairs_mean']):,.1f}",
                "pairs_last": f"{np.median(columns['pairs_last']):,.0f}",
                "total_sum_ms": significant(np.median(columns["total_sum_ms"])),
                "first_frame_total_ms": significant(np.median(columns["first_frame_total_ms"])),
            }
        kinds = ("mean",) if table == "search" else ("mean", "median", "p95")
        names = [f"{table}_{kind}_ms" for kind in kinds]
        result = {name: significant(np.median(columns[name])) for name in names}
        if base is not None and key != base:
            for column, number in zip(
                ("ratio", "ratio_low", "ratio_high"), self.ratio(key, base, table)
            ):
                result[column] = f"{number:.3f}" if 1 <= number < 1.1 else significant(number)
        return result


def significant(number: float) -> str:
    """Three significant digits, or all before the point; thousands apart."""
    if np.isnan(number):
        return "–"
    if number == 0:
        return "0"
    if number >= 1000:
        return f"{number:,.0f}"
    rounded = float(f"{number:.3g}")
    before = len(str(int(rounded)))
    if rounded >= 1:
        return f"{rounded:,.{max(0, 3 - before)}f}"
    zeros = 0
    while rounded * 10 ** (zeros + 1) < 1 - 1e-9:
        zeros += 1
    return f"{rounded:.{zeros + 3}f}"
