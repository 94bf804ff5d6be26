"""Which differences are more than noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from study.data import Cell, Study
from study.plan import BULLETS

SEED = 1
RESAMPLES = 10_000
FEWEST = 5  # runs of each side; with fewer, an interval spans little more than the runs themselves


class Ratio(NamedTuple):
    """A ratio of two medians, its 95 % interval (none if there are too few runs), and how much times differ that should be
    equal."""

    value: float
    interval: tuple[float, float] | None
    noise: float

    @property
    def is_clear(self) -> bool:
        """Whether the interval excludes 1, and the difference exceeds the noise."""
        return self.interval is not None and not self.is_tie

    @property
    def is_tie(self) -> bool:
        """Whether that is not so; without an interval, whether the difference is within the noise."""
        low, high = self.interval or (self.value, self.value)
        return low <= 1 <= high or max(self.value, 1 / self.value) <= 1 + self.noise


def ratio_of_medians(a: np.ndarray, b: np.ndarray, noise: float = 0) -> Ratio:
    """Median of a over median of b, one value per run each, with a percentile bootstrap over the runs.

    Each call has a generator of its own with the same seed, so that an interval depends only on its own runs.
    """
    value = float(np.median(a) / np.median(b))
    if min(len(a), len(b)) < FEWEST:
        return Ratio(value, None, noise)
    random = np.random.default_rng(SEED)
    top, bottom = (np.median(x[random.integers(0, len(x), (RESAMPLES, len(x)))], axis=1) for x in (a, b))
    low, high = np.quantile(top / bottom, (0.025, 0.975))
    return Ratio(value, (float(low), float(high)), noise)


@cache
def rest_of(study: Study, cell: Cell, clock: str) -> list[float]:
    """Total time without update and broad phase, ms per frame, of algorithms that play the same simulation to the last bit, for
    which it should be equal: medians over the runs, ascending. By the wall clock, or of the thread's CPU ("_cpu"). Empty if
    fewer than two such algorithms ran."""
    own = [[b for b in group if b not in BULLETS and "+" not in b] for group in study.same_pairs(cell)]
    names = max(own, key=len, default=[])
    times = study.times(cell, f"rest{clock}_mean_ms")
    return sorted(float(np.median(times[b])) for b in names) if len(names) > 1 else []


@cache
def noise_of(study: Study, cell: Cell, clock: str) -> float:
    """How much times of a cell differ that should be equal; if it does not tell, the most of all cells."""
    rests = [rest_of(study, each, clock) for each in ([cell] if rest_of(study, cell, clock) else study.cells())]
    return max((rest[-1] / rest[0] - 1 for rest in rests if rest), default=0)


def compare(study: Study, cell: Cell, metric: str, a: str, b: str) -> Ratio:
    """The time of a broad phase over that of another, by the clocks that judge them."""
    times, clocks = study.times(cell, f"{metric}_judged"), study.times(cell, "clock")
    return ratio_of_medians(times[a], times[b], max(noise_of(study, cell, clocks[each][0]) for each in (a, b)))


@dataclass(frozen=True)
class Standing:
    """A cell, judged by one metric."""

    cell: Cell
    milliseconds: dict[str, float]  # fastest first: median over the runs of the mean per frame
    over_first: dict[str, Ratio]  # time over that of the fastest, for all others
    rivals: tuple[str, str, Ratio] | None  # the fastest of BroadCL's, over the fastest of Bullet's

    @property
    def first(self) -> str:
        return next(iter(self.milliseconds))

    @property
    def ties(self) -> list[str]:
        """Those that are as fast as the first, as far as one can tell."""
        return [b for b, ratio in self.over_first.items() if ratio.is_tie]


@cache
def standing(study: Study, cell: Cell, metric: str) -> Standing:
    times = study.times(cell, f"{metric}_judged")
    medians = {b: float(np.median(times[b])) for b in sorted(times, key=lambda b: np.median(times[b]))}
    fastest = [next((b for b in medians if (b in BULLETS) == is_bullet), None) for is_bullet in (False, True)]
    rivals = (*fastest, compare(study, cell, metric, *fastest)) if all(fastest) else None
    return Standing(cell, medians, {b: compare(study, cell, metric, b, next(iter(medians))) for b in [*medians][1:]}, rivals)


def three_digits(x: float) -> str:
    """A number for people: three significant digits, but all digits before the point; no exponent."""
    magnitude = int(np.floor(np.log10(abs(float(f"{x:.2e}"))))) if x else 2
    return f"{x:,.{max(0, 2 - magnitude)}f}"


def ratio_digits(x: float) -> str:
    """A ratio for people: three digits, or four just above 1, to show on which side of 1 it is."""
    return f"{x:.3f}" if 1 <= x < 1.1 else three_digits(x)
