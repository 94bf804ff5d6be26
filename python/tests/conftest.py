"""Boxes for hypothesis, and the oracle: the definitions of the documentation in NumPy."""

import os

import hypothesis
import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import strategies as st

hypothesis.settings.register_profile("default", deadline=None, max_examples=60, derandomize=True)
hypothesis.settings.register_profile("quick", deadline=None, max_examples=15, derandomize=True)
hypothesis.settings.register_profile("long", deadline=None, max_examples=2000)
hypothesis.settings.load_profile(os.environ.get("BROADCL_HYPOTHESIS", "default"))


def rounded(boxes: np.ndarray) -> np.ndarray:
    """(n, 6) float64 as float32, rounded outward, but not if that would fill an empty box."""
    boxes = np.asarray(boxes)
    if boxes.dtype == np.float32:
        return boxes
    with np.errstate(over="ignore", under="ignore"):
        nearest = boxes.astype(np.float32)
        down = np.where(nearest > boxes, np.nextafter(nearest, np.float32(-np.inf)), nearest)
        up = np.where(nearest < boxes, np.nextafter(nearest, np.float32(np.inf)), nearest)
    inverted = (boxes[:, :3] > boxes[:, 3:]).any(axis=1, keepdims=True)
    return np.where(inverted, np.hstack([up[:, :3], down[:, 3:]]), np.hstack([down[:, :3], up[:, 3:]]))


def squared_distances(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(n, m) of the type of the boxes; infinite for empty ones."""
    squares = []
    with np.errstate(over="ignore", invalid="ignore"):
        for axis in range(3):
            lower, upper = first[:, None, axis], first[:, None, axis + 3]
            other_lower, other_upper = second[None, :, axis], second[None, :, axis + 3]
            gap = np.where(upper < other_lower, other_lower - upper, np.where(other_upper < lower, lower - other_upper, 0))
            squares.append(np.square(np.where(gap < 2.0**-63, 0, gap).astype(first.dtype)))
        result = (squares[0] + squares[1]) + squares[2]
    empty = (first[:, :3] > first[:, 3:]).any(axis=1)[:, None] | (second[:, :3] > second[:, 3:]).any(axis=1)[None, :]
    return np.where(empty, first.dtype.type(np.inf), result)


def near(first: np.ndarray, second: np.ndarray, reach=0) -> np.ndarray:
    """(n, m) bool: which (n, 6) boxes overlap, or are within the sum of their reaches, for instance (n, m)."""
    overlap = np.ones((len(first), len(second)), bool)
    for axis in range(3):
        overlap &= first[:, None, axis] <= second[None, :, axis + 3]
        overlap &= second[None, :, axis] <= first[:, None, axis + 3]
    overlap &= (first[:, :3] <= first[:, 3:]).all(axis=1)[:, None]
    overlap &= (second[:, :3] <= second[:, 3:]).all(axis=1)[None, :]
    if not np.any(reach):
        return overlap
    reach = np.asarray(reach, first.dtype)
    return np.where(reach < 2.0**-63, overlap, squared_distances(first, second) <= np.square(reach))


def proper(boxes: np.ndarray) -> np.ndarray:
    """(n,) bool: which (n, 6) boxes are not empty."""
    return (boxes[:, :3] <= boxes[:, 3:]).all(axis=1)


def times(starts: np.ndarray, directions: np.ndarray, lengths: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """(n, m) of the type of the boxes: when (n, 6) that move first meet others; NaN if they do not."""
    begin = np.zeros((len(starts), len(boxes)), boxes.dtype)
    end = begin + lengths.astype(boxes.dtype)[:, None]
    meets = proper(starts)[:, None] & proper(boxes)[None, :]
    with np.errstate(all="ignore"):
        reciprocals = boxes.dtype.type(1) / directions.astype(boxes.dtype)
        for axis in range(3):
            reciprocal = reciprocals[:, axis, None]
            to_lower = boxes[None, :, axis] - starts[:, axis + 3, None]
            to_upper = boxes[None, :, axis + 3] - starts[:, axis, None]
            moves = np.isfinite(reciprocal)
            meets &= moves | ((to_lower <= 0) & (to_upper >= 0))
            enters = np.where(reciprocal > 0, to_lower, to_upper) * reciprocal
            leaves = np.where(reciprocal > 0, to_upper, to_lower) * reciprocal
            begin = np.where(moves & (enters > begin), enters, begin)
            end = np.where(moves & (leaves < end), leaves, end)
    return np.where(meets & (begin <= end), begin, np.nan)


def hits(finds: np.ndarray, ids, keys: np.ndarray | None = None, limit: int | None = None) -> tuple[list, ...]:
    """Offsets, ids and keys of what queries find, (n, m) bool: in the order of the keys (n, m), then of the ids, which ascend."""
    offsets, found, found_keys = [0], [], []
    for k, row in enumerate(finds):
        columns = np.flatnonzero(row)
        if keys is not None:
            columns = columns[np.argsort(keys[k, columns], kind="stable")]
        columns = columns[:limit]
        offsets.append(offsets[-1] + len(columns))
        found += np.asarray(ids)[columns].tolist()
        if keys is not None:
            found_keys += keys[k, columns].tolist()
    return (offsets, found) if keys is None else (offsets, found, found_keys)


def as_lists(found: tuple[np.ndarray, ...]) -> tuple[list, ...]:
    """Hits as they are returned, whose types it checks."""
    assert [array.dtype for array in found] == [np.uint64, np.uint32, np.float64][: len(found)]
    return tuple(array.tolist() for array in found)


def oracle(a: np.ndarray, b: np.ndarray | None = None, reach=0) -> np.ndarray:
    """All pairs of (n, 6) boxes of float32 or float64 that are near each other, in canonical order."""
    first = np.asarray(a)
    second = first if b is None else np.asarray(b)
    overlap = near(first, second, reach)
    if b is None:
        overlap &= np.triu(np.ones_like(overlap), 1)
    column, row = np.nonzero(overlap.T)
    return np.stack([row, column], axis=1).astype(np.uint32)


def boxes(dtype=np.float32, most=40) -> st.SearchStrategy[np.ndarray]:
    """(n, 6), some of them touching, infinite, huge, denormal or empty."""
    bits = np.dtype(dtype).itemsize * 8
    bound = st.one_of(
        st.integers(-4, 4).map(float),
        st.floats(width=bits, allow_nan=False),
    )
    rows = hnp.arrays(dtype, st.tuples(st.integers(0, most), st.just(6)), elements=bound)

    def mostly_proper(array: np.ndarray) -> np.ndarray:
        array = array.copy()
        proper = np.arange(len(array)) % 5 != 4
        corners = np.sort(array.reshape(-1, 2, 3), axis=1)
        array[proper] = corners.reshape(-1, 6)[proper]
        return array

    return rows.map(mostly_proper)


def ways() -> st.SearchStrategy[np.ndarray]:
    """(7, 4): directions, some of whose components are 0, tiny or huge, and lengths, some of which are 0 or infinite."""
    component = st.sampled_from([0, 1, -1, 0.5, -3, 0.1, 1e-40, -1e38]) | st.floats(-2, 2)
    length = st.sampled_from([0, 1, 2.5, np.inf]) | st.floats(0, 9)
    return st.tuples(*[st.tuples(component, component, component, length)] * 7).map(np.array)


def finite(boxes: np.ndarray) -> np.ndarray:
    """The same, of which those with an infinite bound are empty."""
    return np.where(np.isfinite(boxes).all(axis=1)[:, None], boxes, np.array([1, 0, 0, 0, 0, 0], boxes.dtype))


def uniform(n: int, overlaps: float = 3, seed: int = 0) -> np.ndarray:
    """n cubes of size 1, each of which overlaps about so many."""
    random = np.random.default_rng(seed)
    lower = random.uniform(0, (8 * n / overlaps) ** (1 / 3), (n, 3))
    return np.hstack([lower, lower + 1]).astype(np.float32)


class OnlyDlpack:
    """What nothing but DLPack can read."""

    def __init__(self, values):
        self._values = values

    def __dlpack__(self, **arguments):
        return self._values.__dlpack__(**arguments)

    def __dlpack_device__(self):
        return self._values.__dlpack_device__()


@pytest.fixture
def no_opencl(tmp_path):
    (tmp_path / "libOpenCL.so.1").touch()  # found first, and no library
    return {"LD_LIBRARY_PATH": str(tmp_path), "BROADCL_DEVICE": ""}
