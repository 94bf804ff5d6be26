"""How many boxes each box overlaps."""

from __future__ import annotations

import numpy as np


def count_overlaps(boxes: np.ndarray) -> np.ndarray:
    """The number of other boxes that each of (n, 6) boxes touches or overlaps, by a sweep along one axis.

    Exact: coordinates are compared unrounded, and boxes are closed, as in the broad phases.
    """
    low, high = boxes[:, :3], boxes[:, 3:]
    axis = int(np.argmax(np.var(low, axis=0)))
    order = np.argsort(low[:, axis], kind="stable")
    low, high = low[order], high[order]
    # Each box is followed by the boxes that begin before it ends.
    ends = np.searchsorted(low[:, axis], high[:, axis], side="right")
    behind = ends - np.arange(len(boxes)) - 1
    first = np.repeat(np.arange(len(boxes)), behind)
    start_of_run = np.cumsum(behind) - behind
    second = np.arange(len(first)) - start_of_run[first] + first + 1
    for other in range(3):
        if other != axis:
            overlap = low[first, other] <= high[second, other]
            overlap &= low[second, other] <= high[first, other]
            first, second = first[overlap], second[overlap]
    counts = np.bincount(first, minlength=len(boxes)) + np.bincount(second, minlength=len(boxes))
    result = np.empty(len(boxes), dtype=np.int64)
    result[order] = counts
    return result
