"""Boxes over time, as the viewer reads them: from arrays and from files."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

FILTER = ("group", "mask", "body", "world")
DEFAULT_FILTER = np.array([1, 0xFFFFFFFF, 0xFFFFFFFF, 0], np.uint32)


class Frame(NamedTuple):
    ids: np.ndarray  # (n,) uint32, ascending
    boxes: np.ndarray  # (n, 6) float32 or float64
    filters: np.ndarray  # (n, 4) uint32
    reaches: np.ndarray  # (n,)
    gone: np.ndarray  # ids of objects that were removed since the last frame; those in `ids`, too, are new objects
    exclusions: np.ndarray  # (e, 2) uint32


class Frames(NamedTuple):
    read: Callable[[], Iterator[Frame]]  # from the first one on, each time
    dtype: type  # of the boxes
    distance: float = 0  # of BroadPhase


def plain_frame(boxes: np.ndarray, ids: np.ndarray | None = None, filters: np.ndarray = DEFAULT_FILTER) -> Frame:
    """A frame of (n, 6) boxes, with one filter, or one for each. Without ids, they are 0 .. n-1."""
    if ids is None:
        ids = np.arange(len(boxes), dtype=np.uint32)
    is_wrong = np.isnan(boxes).any(axis=1)
    if is_wrong.any():
        raise ValueError(f"the box of object {ids[is_wrong][0]} has a NaN; give it bounds")
    filters = np.broadcast_to(filters, (len(boxes), 4)).copy()
    return Frame(ids, boxes, filters, np.zeros(len(boxes)), np.empty(0, np.uint32), np.empty((0, 2), np.uint32))


def from_boxes(boxes: Any, distance: float = 0, **filters: Any) -> Frames:
    """Of boxes in an array, of frames in one, or of a list or an iterator of frames. Filters are those of `BroadPhase.add`."""
    if isinstance(boxes, Iterator) or (isinstance(boxes, list) and boxes and all(np.ndim(frame) > 1 for frame in boxes)):
        arrays = [_array(frame) for frame in boxes]
    else:
        array = _array(boxes)
        arrays = list(array) if array.ndim == 3 else [array]
    if any(array.ndim != 2 for array in arrays):
        raise ValueError("a frame is not (n, 6); boxes are (n, 6), or (frames, n, 6), or a list of (n, 6)")
    most = max(map(len, arrays), default=0)
    of_objects = _filters(most, **filters)
    dtype = np.result_type(np.float32, *{array.dtype for array in arrays}).type

    def read() -> Iterator[Frame]:
        for number, array in enumerate(arrays):
            try:
                yield plain_frame(array, filters=of_objects[: len(array)])
            except ValueError as error:
                raise ValueError(f"frame {number}: {error}") from None

    return Frames(read, dtype, distance)


def _array(boxes: Any) -> np.ndarray:
    """As (..., 6) float32 or float64, without a copy if it is that."""
    if np.ma.is_masked(boxes):
        raise ValueError("there are masked values; give them bounds")
    array = np.concatenate(boxes, axis=-1) if isinstance(boxes, tuple) and len(boxes) == 2 else np.asarray(boxes)
    if array.dtype.kind not in "fiu" or array.dtype.itemsize > 8:
        raise TypeError(f"boxes are float32, float64 or integers, not {array.dtype}")
    if array.dtype.kind in "iu" and np.any((array > 2**53) | (array < -(2**53))):
        raise ValueError("there is an integer beyond 2^53, which float64 does not have")
    if array.dtype.type is not np.float32:
        array = array.astype(np.float64, copy=False)
    if array.size == 0 and array.ndim < 2:
        array = array.reshape(0, 6)
    if array.ndim == 1:
        array = array[None]
    if array.ndim > 2 and array.shape[-2:] == (2, 3):
        array = array.reshape(*array.shape[:-2], 6)
    if array.shape[-1] == 4:
        array = np.insert(array, (2, 4), 0, axis=-1)
    if array.shape[-1] != 6:
        raise ValueError(f"the shape is {array.shape}; (n, 6) is needed, or (n, 4) in two dimensions, or (frames, n, 6)")
    return array


def _filters(count: int, **filters: Any) -> np.ndarray:
    """(count, 4) of whole numbers, one for each object or one for all."""
    result = np.tile(DEFAULT_FILTER, (count, 1))
    for name, values in filters.items():
        result[:, FILTER.index(name)] = _words(name, values, -(2**31)).astype(np.uint32)
    return result


def _words(name: str, values: Any, least: int) -> np.ndarray:
    """Whole numbers below 2^32, as int64."""
    values = np.asarray(values)
    if values.dtype.kind not in "fiu" or np.any((values < least) | (values >= 2**32) | (values != np.floor(values))):
        raise ValueError(f"{name}: whole numbers of 32 bits are needed")
    return values.astype(np.int64)


def from_file(path: Path) -> Frames:
    """Of a .npy, .npz, .csv or .aabbs."""
    from . import _recording

    readers = {".npy": _read_npy, ".npz": _read_npz, ".csv": _read_csv, ".aabbs": _recording.read}
    if path.suffix not in readers:
        raise ValueError(f"its name ends in none of {', '.join(readers)}")
    return readers[path.suffix](path)


def _read_npy(path: Path) -> Frames:
    return from_boxes(np.load(path, mmap_mode="r", allow_pickle=False))


def _read_npz(path: Path) -> Frames:
    with np.load(path, allow_pickle=False) as arrays:
        others = [name for name in arrays.files if name not in FILTER]
        if "boxes" not in others and len(others) != 1:
            raise ValueError(f"it has {len(others)} arrays, none of them called boxes; save it with numpy.savez(file, boxes=...)")
        filters = {name: arrays[name] for name in FILTER if name in arrays.files}
        return from_boxes(arrays["boxes" if "boxes" in others else others[0]], **filters)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_csv(path: Path) -> Frames:
    lines = path.read_text(encoding="utf-8").splitlines()
    first = lines[0] if lines else ""
    separator = next((mark for mark in ",;" if mark in first), None)
    names = [name.strip("# \t").lower() for name in first.split(separator)]
    has_heading = not any(_is_number(name) for name in names)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that there are no rows
        table = np.loadtxt([line.replace(",", " ").replace(";", " ") for line in lines[has_heading:]], np.float64, ndmin=2)
    if not has_heading or len(names) != table.shape[1]:
        names = [""] * table.shape[1]
    column = {name: table[:, k] for k, name in enumerate(names) if name in ("frame", "id", *FILTER)}
    bounds = [k for k, name in enumerate(names) if name not in column]
    boxes = _array(table[:, bounds])
    filters = _filters(len(table), **{name: column[name] for name in FILTER if name in column})
    frame = column.get("frame", np.zeros(len(table)))
    order = np.lexsort((column.get("id", np.arange(len(table))), frame))
    parts = np.split(order, np.flatnonzero(np.diff(frame[order])) + 1)
    ids = [_words("id", column["id"][part], 0).astype(np.uint32) if "id" in column else None for part in parts]
    if any(some is not None and np.any(some[1:] == some[:-1]) for some in ids):
        raise ValueError("an id is there twice in a frame")
    return Frames(lambda: (plain_frame(boxes[p], some, filters[p]) for p, some in zip(parts, ids)), np.float64)
