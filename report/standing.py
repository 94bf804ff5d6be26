"""Which broad phase is faster: broad phases ordered by the time of their runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from report.statistics import Ratio, ratio_of_medians
from report.study import Repeats, Series, Study


# A broad phase may do its work in either of the two, so only their sum is comparable.
SEARCH = "search"
COMPARED = {
    "total": "total time",
    SEARCH: "update and broad phase together",
    "update": "update alone",
    "broad_phase": "broad phase alone",
}


def run_times(repeats: Repeats, metric: str) -> np.ndarray:
    """The mean time per frame, ms, of each repeat: the time of the run divided by its frames."""
    if metric == SEARCH:
        return run_times(repeats, "update") + run_times(repeats, "broad_phase")
    return repeats.summary[f"{metric}_mean_ms"]


@dataclass(frozen=True)
class Standing:
    """One scenario with one number of objects, judged by one metric."""

    objects: int
    milliseconds: dict[Series, float]  # fastest first: median over the repeats
    over_first: dict[Series, Ratio]  # time over that of the fastest, for all others

    @property
    def first(self) -> Series:
        return next(iter(self.milliseconds))

    @property
    def ties(self) -> list[Series]:
        """The series that are not clearly slower than the first."""
        return [s for s, ratio in self.over_first.items() if not ratio.is_clear]

    @property
    def clearly_slower(self) -> list[Series]:
        return [s for s, ratio in self.over_first.items() if ratio.is_clear]


def standing(study: Study, scenario: str, objects: int, metric: str) -> Standing:
    """Orders the series that ran with one scenario and number of objects."""
    times = {s: run_times(r, metric) for s, r in study.cells_of(scenario, objects).items()}
    order = sorted(times, key=lambda s: float(np.median(times[s])))
    first = order[0]
    return Standing(
        objects,
        {s: float(np.median(times[s])) for s in order},
        {s: ratio_of_medians(times[s], times[first]) for s in order[1:]},
    )


def reference(study: Study, cells: dict[Series, Repeats]) -> Series:
    """The series that the others are compared with: btDbvtBroadphase, which Bullet's examples use.

    If it did not run, the first of Bullet's that did, otherwise the first of all.
    """
    by_preference = sorted(
        cells, key=lambda s: (s.broadphase != "bullet-bvh", not study.is_bullet(s))
    )
    return by_preference[0]


def ours_over_bullet(study: Study, place: Standing) -> tuple[Series, Series] | None:
    """The fastest of BroadCL's and the fastest of Bullet's, if both ran."""
    ours = [s for s in place.milliseconds if not study.is_bullet(s)]
    bullets = [s for s in place.milliseconds if study.is_bullet(s)]
    return (ours[0], bullets[0]) if ours and bullets else None
