"""Which differences are more than noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
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
        if self.interval is None or self.interval[0] <= 1 <= self.interval[1]:
            return False
        return max(self.value, 1 / self.value) > 1 + self.noise


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


@lru_cache(maxsize=None)
def rest_of(study: Study, cell: Cell, clock: str = "") -> list[float]:
    """Total time without update and broad phase, ms per frame, of algorithms that play the same simulation to the last bit, for
    which it should be equal: medians over the runs, ascending. By the wall clock, or of the thread's CPU ("_cpu"). Empty if
    fewer than two such algorithms ran."""
    own = [[b for b in group if b not in BULLETS and "+" not in b] for group in study.same_pairs(cell)]
    names = max(own, key=len, default=[])
    times = study.times(cell, f"rest{clock}_mean_ms")
    return sorted(float(np.median(times[b])) for b in names) if len(names) > 1 else []


def difference(rest: list[float]) -> float:
    """The longest over the shortest, minus 1."""
    return rest[-1] / rest[0] - 1


@lru_cache(maxsize=None)
def noise_of(study: Study, cell: Cell) -> float:
    """How much times of a cell differ that should be equal; if it does not tell, the most of all cells."""
    rests = [rest_of(study, each) for each in ([cell] if rest_of(study, cell) else study.cells())]
    return max((difference(rest) for rest in rests if rest), default=0)


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
    def is_judged(self) -> bool:
        """Whether anything can be called clear."""
        return any(ratio.interval for ratio in self.over_first.values())

    @property
    def ties(self) -> list[str]:
        """Those that are not clearly slower than the first."""
        return [b for b, ratio in self.over_first.items() if not ratio.is_clear]


@lru_cache(maxsize=None)
def standing(study: Study, cell: Cell, metric: str) -> Standing:
    times = study.times(cell, f"{metric}_mean_ms")
    medians = {b: float(np.median(t)) for b, t in times.items()}
    order = sorted(medians, key=lambda b: medians[b])

    def over(a: str, b: str) -> Ratio:
        return ratio_of_medians(times[a], times[b], noise_of(study, cell))

    fastest = [next((b for b in order if (b in BULLETS) == is_bullet), None) for is_bullet in (False, True)]
    rivals = (*fastest, over(*fastest)) if all(fastest) else None
    return Standing(cell, {b: medians[b] for b in order}, {b: over(b, order[0]) for b in order[1:]}, rivals)


def three_digits(x: float) -> str:
    """A number for people: three significant digits, but all digits before the point; no exponent."""
    magnitude = int(np.floor(np.log10(abs(float(f"{x:.2e}"))))) if x else 2
    return f"{x:,.{max(0, 2 - magnitude)}f}"


def ratio_digits(x: float) -> str:
    """A ratio for people: three digits, or four just above 1, to show on which side of 1 it is."""
    return f"{x:.3f}" if 1 <= x < 1.1 else three_digits(x)
