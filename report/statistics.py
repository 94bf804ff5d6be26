"""Ratios of medians over the repeats, and their confidence intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SEED = 1
RESAMPLES = 10_000
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Ratio:
    """A ratio of two medians and its confidence interval; no interval if runs were not repeated."""

    value: float
    interval: tuple[float, float] | None

    @property
    def is_clear(self) -> bool:
        """Whether the interval excludes 1."""
        return self.interval is not None and not self.interval[0] <= 1 <= self.interval[1]


def ratio_of_medians(a: np.ndarray, b: np.ndarray) -> Ratio:
    """Median of a over median of b, one value per repeat each, with a percentile bootstrap over the repeats.

    Each call uses a generator of its own with the same seed, first for a, then for b, so that an interval
    depends only on its own runs.
    """
    value = float(np.median(a) / np.median(b))
    if min(len(a), len(b)) < 2:
        return Ratio(value, None)
    random = np.random.default_rng(SEED)
    top, bottom = (
        np.median(x[random.integers(0, len(x), (RESAMPLES, len(x)))], axis=1) for x in (a, b)
    )
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(top / bottom, (tail, 1 - tail))
    return Ratio(value, (float(low), float(high)))


def three_digits(x: float) -> str:
    """A number for people: three significant digits, but all digits before the point; no exponent."""
    if x == 0:
        return "0"
    magnitude = int(np.floor(np.log10(abs(float(f"{x:.2e}")))))
    return f"{x:,.{max(0, 2 - magnitude)}f}"


def ratio_digits(x: float) -> str:
    """A ratio for people: three digits, or four just above 1, to show on which side of 1 it is."""
    return f"{x:.3f}" if 1 <= x < 1.1 else three_digits(x)
