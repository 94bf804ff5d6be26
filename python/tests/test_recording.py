"""BROADCL_RECORD, which makes a program write its boxes."""

import struct

import numpy as np
import pytest

import broadcl
from conftest import uniform


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_boxes_of_each_update_are_written(dtype, tmp_path, monkeypatch):
    monkeypatch.setenv("BROADCL_RECORD", str(tmp_path / "run"))
    broad_phase = broadcl.BroadPhase(algorithm="sweep-and-prune", dtype=dtype)
    frames = [uniform(n).astype(dtype) for n in (10, 10, 7)]
    for boxes in frames:
        broad_phase.update(boxes)
    recording = (tmp_path / "run").read_bytes()
    assert struct.unpack_from("<8sIIdQ", recording) == (b"BroadCL\n", 1, 8 * dtype().itemsize, 0, 0)
    begin = 32
    for boxes in frames:
        magic, count, rest = struct.unpack_from("<4sIQ", recording, begin)
        assert (magic, count) == (b"FRAM", len(boxes))
        values = np.frombuffer(recording, dtype, boxes.size, begin + 16 + 4 * count)
        assert np.array_equal(values.reshape(boxes.shape), boxes)
        begin += 16 + rest
    assert begin == len(recording)
