"""Recordings (.aabbs): those of BROADCL_RECORD, and those of Broadmark, whose objects are the same in every frame."""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ._frames import Frame, Frames, plain_frame

_MAGIC = b"BroadCL\n"
_BROADMARK_HEADER = 304


def read(path: Path) -> Frames:
    """A recording of either form."""
    if path.stat().st_size < 32:
        raise ValueError("it ends within its header")
    data = np.memmap(path, np.uint8, "r")
    return _read_own(data, str(path)) if data[:8].tobytes() == _MAGIC else _read_broadmark(data)


def _read_broadmark(data: np.ndarray) -> Frames:
    if len(data) < _BROADMARK_HEADER:
        raise ValueError(f"it ends within its header of {_BROADMARK_HEADER} bytes")
    objects, frames, *zeros = data[256:272].view("<i4").tolist()
    if zeros != [0, 0] or objects < 1 or frames < 1:
        raise ValueError("it is neither a recording of BroadCL nor of Broadmark")
    blocks = data[_BROADMARK_HEADER:]
    if len(blocks) != (frames + 1) * objects * 32:
        raise ValueError(f"it has {len(blocks)} bytes of boxes; {frames + 1} times {objects} boxes of 32 bytes are needed")
    boxes = blocks.view("<f4").reshape(frames + 1, objects, 2, 4)[..., :3].reshape(frames + 1, objects, 6)
    return Frames(lambda: (plain_frame(frame) for frame in boxes), np.float32)


def _read_own(data: np.ndarray, name: str) -> Frames:
    version, precision, distance = struct.unpack("<IId", data[8:24].tobytes())
    if version != 1 or precision not in (32, 64) or not 0 <= distance < np.inf or data[24:32].any():
        raise ValueError("its header is not one of this version of BroadCL")
    dtype = np.float32 if precision == 32 else np.float64
    begins: list[int] = []
    at = 32
    while at + 16 <= len(data):
        mark, _, size = struct.unpack("<4sIQ", data[at : at + 16].tobytes())
        if mark != b"FRAM":
            raise ValueError(f"frame {len(begins)} does not begin where the one before ends")
        if size > len(data) - at - 16:
            break
        begins.append(at)
        at += 16 + size
    if at < len(data):
        print(f"broadcl: '{name}' ends within frame {len(begins)}, which is left out", file=sys.stderr)
    if not begins:
        raise ValueError("it has no complete frame")
    return Frames(lambda: _frames(data, begins, dtype), dtype, distance)


class _Cursor:
    """Takes arrays of what is left of a frame."""

    def __init__(self, data: np.ndarray) -> None:
        self._data = data

    def take(self, count: int, dtype: np.dtype) -> np.ndarray:
        size = count * dtype.itemsize
        if size > len(self._data):
            raise ValueError("it has fewer bytes than its numbers need")
        taken, self._data = self._data[:size].view(dtype), self._data[size:]
        return taken

    def take_list(self, dtype: np.dtype) -> np.ndarray:
        """A number of elements, then these."""
        return self.take(int(self.take(1, np.dtype("<u4"))[0]), dtype)

    def end(self) -> None:
        if len(self._data):
            raise ValueError("it has bytes after its last part")


def _frames(data: np.ndarray, begins: list[int], dtype: type) -> Iterator[Frame]:
    last = None
    for number, begin in enumerate(begins):
        try:
            last = _frame(data, begin, np.dtype(dtype).newbyteorder("<"), last)
        except ValueError as error:
            raise ValueError(f"frame {number}: {error}") from None
        yield last


def _frame(data: np.ndarray, begin: int, real: np.dtype, last: Frame | None) -> Frame:
    word = np.dtype("<u4")
    count, size = struct.unpack("<IQ", data[begin + 4 : begin + 16].tobytes())
    rest = _Cursor(data[begin + 16 : begin + 16 + size])
    ids = rest.take(count, word)
    if np.any(ids[1:] <= ids[:-1]):
        raise ValueError("its ids do not ascend")
    frame = plain_frame(rest.take(6 * count, real).reshape(count, 6), ids)
    filters = rest.take_list(np.dtype([("id", word), ("filter", word, 4)]))
    reaches = rest.take_list(np.dtype([("id", word), ("reach", real)]))
    gone = rest.take_list(word)
    exclusions = frame.exclusions if last is None else last.exclusions
    if rest.take(1, word)[0]:
        exclusions = rest.take_list(np.dtype([("pair", word, 2)]))["pair"]
    rest.end()
    frame = frame._replace(gone=gone, exclusions=exclusions)
    if last is not None:
        stays = np.isin(ids, last.ids) & ~np.isin(ids, gone)
        before = np.searchsorted(last.ids, ids[stays])
        frame.filters[stays] = last.filters[before]
        frame.reaches[stays] = last.reaches[before]
    frame.filters[_rows(ids, filters["id"])] = filters["filter"]
    frame.reaches[_rows(ids, reaches["id"])] = reaches["reach"]
    if not np.all((frame.reaches >= 0) & (frame.reaches <= 2**62)):
        raise ValueError("a reach is negative, NaN or greater than 2^62")
    return frame


def _rows(ids: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    if not np.isin(wanted, ids).all():
        raise ValueError("it sets what belongs to an object that it does not have")
    return np.searchsorted(ids, wanted)
