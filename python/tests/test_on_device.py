"""Arrays and buffers of pyopencl."""

import gc
import os
import subprocess
import sys

import numpy as np
import pytest

import broadcl
from conftest import oracle, uniform

cl = pytest.importorskip("pyopencl")
cl_array = pytest.importorskip("pyopencl.array")


@pytest.fixture(scope="module")
def queue():
    """On the device that BroadCL would choose."""
    chosen = broadcl.select_device()
    devices = [device for platform in cl.get_platforms() for device in platform.get_devices()]
    device = next(device for device in devices if device.name.strip() == chosen.name.strip())
    return cl.CommandQueue(cl.Context([device]))


def to_device(queue, values):
    return cl_array.to_device(queue, np.ascontiguousarray(values))


def as_set(pairs):
    return {tuple(pair) for pair in pairs.tolist()}


def test_once(queue):
    values = uniform(1000)
    boxes = to_device(queue, values)
    pairs = broadcl.overlapping_pairs(boxes)
    assert isinstance(pairs, cl_array.Array) and pairs.dtype == np.uint32 and pairs.queue is queue
    assert pairs.shape == (len(oracle(values)), 2)
    assert np.array_equal(pairs.get(), oracle(values))
    buffer = cl.Buffer(queue.context, cl.mem_flags.COPY_HOST_PTR, hostbuf=values)
    assert np.array_equal(broadcl.overlapping_pairs(buffer, device=queue).get(), oracle(values))
    without_queue = boxes.with_queue(None)
    assert np.array_equal(broadcl.overlapping_pairs(without_queue, device=queue, algorithm="tiles").get(), oracle(values))


def test_shapes(queue):
    values = uniform(300)
    expected = oracle(values)
    corners = to_device(queue, values.reshape(-1, 2, 3))
    assert np.array_equal(broadcl.overlapping_pairs(corners).get(), expected)
    wide = to_device(queue, np.hstack([np.full((300, 2), np.nan, np.float32), values]))
    assert np.array_equal(broadcl.overlapping_pairs(wide[:, 2:]).get(), expected)
    rows = to_device(queue, np.repeat(values, 2, axis=0))
    assert np.array_equal(broadcl.overlapping_pairs(rows[100::2]).get(), oracle(values[50:]))
    empty = cl_array.empty(queue, (0, 6), np.float32)
    assert broadcl.overlapping_pairs(empty).shape == (0, 2)
    assert broadcl.overlapping_pairs(empty, corners).get().shape == (0, 2)


def test_two_sets(queue):
    a, b = uniform(400, seed=1), uniform(200, seed=2)
    first, second = to_device(queue, a), to_device(queue, b)
    assert np.array_equal(broadcl.overlapping_pairs(first, second).get(), oracle(a, b))
    broad_phase = broadcl.DeviceBroadPhase(queue)
    assert np.array_equal(broad_phase.update(first, second).added.get(), oracle(a, b))
    assert np.array_equal(broad_phase.pairs().get(), oracle(a, b))


def test_sets_without_boxes(queue):
    boxes, none = to_device(queue, uniform(300)), cl_array.empty(queue, (0, 6), np.float32)
    for a, b in (boxes, none), (none, boxes), (none, none):
        assert broadcl.overlapping_pairs(a, b).shape == (0, 2)
        assert broadcl.DeviceBroadPhase(queue).update(a, b).pair_count == 0
    broad_phase = broadcl.DeviceBroadPhase(queue)
    assert broad_phase.update(boxes, none).pair_count == 0
    other = uniform(200, seed=2)
    assert np.array_equal(broad_phase.update(boxes, to_device(queue, other)).added.get(), oracle(boxes.get(), other))
    assert broad_phase.update(boxes, none).pair_count == 0
    with pytest.raises(ValueError, match="second set"):
        broad_phase.update(boxes)


def test_changes_that_cannot_be_copied(queue, monkeypatch):
    values = uniform(300)
    boxes = to_device(queue, values)
    broad_phase = broadcl.DeviceBroadPhase(queue)
    with monkeypatch.context() as patch:
        patch.setattr(cl, "enqueue_copy", lambda *args, **named: (_ for _ in ()).throw(MemoryError()))
        with pytest.raises(MemoryError):
            broad_phase.update(boxes)
        with pytest.raises(MemoryError):
            broad_phase.finish()
    with pytest.raises(broadcl.Error, match="finish"):
        broad_phase.update(boxes)
    assert np.array_equal(broad_phase.finish().added.get(), oracle(values))
    assert broad_phase.update(boxes).added.shape == (0, 2)


@pytest.mark.parametrize("algorithm", ["auto", "brute-force", "tiles"])
def test_moving(queue, algorithm):
    broad_phase = broadcl.DeviceBroadPhase(queue, algorithm=algorithm)
    followed, deltas = set(), []
    for frame in range(6):
        values = uniform(500 + 100 * (frame % 3), seed=frame // 2)
        values[:50] += np.float32(0.25 * frame)
        boxes = to_device(queue, values)
        if frame % 2:
            broad_phase.begin(boxes)
            del boxes
            gc.collect()
            delta = broad_phase.finish()
        else:
            delta = broad_phase.update(boxes)
        added, removed = delta
        assert as_set(removed.get()) <= followed and not as_set(added.get()) & followed
        followed = (followed - as_set(removed.get())) | as_set(added.get())
        assert followed == as_set(oracle(values)) and delta.pair_count == len(followed)
        assert np.array_equal(broad_phase.pairs().get(), oracle(values))
        deltas.append((added, added.get()))
    for added, copy in deltas:  # they outlive the updates, and the object
        assert np.array_equal(added.get(), copy)
    pairs = broad_phase.pairs()
    del broad_phase
    gc.collect()
    assert np.array_equal(pairs.get(), oracle(values))
    assert "added=" in repr(delta)


def test_filters(queue):
    values = uniform(300)
    rows = np.tile(np.array([1, 2**32 - 1, broadcl.NO_BODY, 0], np.uint32), (300, 1))
    rows[:, 3] = np.arange(300) % 2
    broad_phase = broadcl.DeviceBroadPhase(queue)
    boxes = to_device(queue, values)
    added = broad_phase.update(boxes, filters=to_device(queue, rows), worlds=True).added.get()
    expected = oracle(values)
    assert np.array_equal(added, expected[(expected[:, 0] + expected[:, 1]) % 2 == 0])
    rows[:, 2:] = 7, 0
    assert broad_phase.update(boxes, filters=to_device(queue, rows)).pair_count == 0


def test_shrink(queue):
    values = uniform(300)
    boxes = to_device(queue, values)
    broad_phase = broadcl.DeviceBroadPhase(queue)
    broad_phase.update(to_device(queue, np.tile(np.float32([0, 0, 0, 1, 1, 1]), (2000, 1))))
    added = broad_phase.update(boxes).added
    most = broad_phase.memory["device"]
    broad_phase.shrink()
    assert np.array_equal(broad_phase.pairs().get(), oracle(values))
    delta = broad_phase.update(boxes)
    assert len(delta.added) == len(delta.removed) == 0 and len(added.get()) >= 0
    assert broad_phase.memory["device"] < most / 4
    broad_phase.begin(boxes)
    with pytest.raises(broadcl.Error, match="finish"):
        broad_phase.shrink()
    broad_phase.finish()


def test_memory_is_used_again(queue):
    here = to_device(queue, np.tile(np.float32([0, 0, 0, 1, 1, 1]), (200, 1)))
    apart = to_device(queue, np.repeat(np.arange(200, dtype=np.float32) * 2, 6).reshape(-1, 6))
    broad_phase = broadcl.DeviceBroadPhase(queue)
    buffers, kept = set(), []
    for frame in range(12):
        added, removed = broad_phase.update(here if frame % 2 == 0 else apart)
        changes = added if frame % 2 == 0 else removed
        assert changes.shape == (200 * 199 // 2, 2)
        buffers.add(changes.base_data.int_ptr)
        if frame == 3:
            kept = [(changes, changes.get())]
        del added, removed, changes
    assert len(buffers) <= 3, "that of the array that is kept is not used again"
    assert np.array_equal(kept[0][0].get(), kept[0][1])


def test_exclusions(queue):
    values = uniform(300)
    expected = oracle(values)
    boxes = to_device(queue, values)
    broad_phase = broadcl.DeviceBroadPhase(queue)
    broad_phase.update(boxes)
    broad_phase.set_exclusions(expected[::2, ::-1])
    assert np.array_equal(broad_phase.update(boxes).removed.get(), expected[::2])
    with pytest.raises(ValueError, match="row 1 of pairs has the id 2 twice"):
        broad_phase.set_exclusions([[0, 1], [2, 2]])
    assert np.array_equal(broad_phase.pairs().get(), expected[1::2])
    broad_phase.set_exclusions([])
    assert np.array_equal(broad_phase.update(boxes).added.get(), expected[::2])


def test_exclusions_of_one_search(queue):
    first, second = uniform(300), uniform(200, seed=3)
    a, b = to_device(queue, first), to_device(queue, second)
    expected = oracle(first)
    assert np.array_equal(broadcl.overlapping_pairs(a, exclusions=expected[::2, ::-1]).get(), expected[1::2])
    assert np.array_equal(broadcl.overlapping_pairs(a, exclusions=[]).get(), expected)
    expected = oracle(first, second)
    assert np.array_equal(broadcl.overlapping_pairs(a, b, exclusions=expected[::2]).get(), expected[1::2])
    with pytest.raises(ValueError, match=r"row 0 of exclusions is \(2, 200\), but there are 300 boxes in a and 200 in b"):
        broadcl.overlapping_pairs(a, b, exclusions=[[2, 200]])


def test_nan(queue):
    values = uniform(100)
    values[[17, 30], 4] = np.nan
    boxes = to_device(queue, values)
    with pytest.raises(ValueError, match="row 17 of boxes has a NaN"):
        broadcl.overlapping_pairs(boxes)
    with pytest.raises(ValueError, match="row 17 of b has a NaN"):
        broadcl.overlapping_pairs(to_device(queue, uniform(50)), boxes)
    delta = broadcl.DeviceBroadPhase(queue).update(boxes)
    assert delta.invalid_boxes == 2 and delta.first_invalid == 17
    proper = np.delete(np.arange(100), [17, 30])
    assert as_set(delta.added.get()) == {tuple(proper[pair]) for pair in oracle(values[proper])}


def test_what_is_refused(queue):
    values = uniform(20)
    boxes = to_device(queue, values)
    other = cl.CommandQueue(queue.context)
    broad_phase = broadcl.DeviceBroadPhase(queue)
    for kind, message, call in (
        (TypeError, "must be float32 on a device, not float64", lambda: broadcl.overlapping_pairs(boxes.astype(np.float64))),
        (ValueError, r"\(n, 6\) or \(n, 2, 3\).*not \(20, 5\)", lambda: broadcl.overlapping_pairs(boxes[:, :5])),
        (ValueError, "side by side", lambda: broadcl.overlapping_pairs(to_device(queue, values.T).T)),
        (ValueError, "give device=queue", lambda: broadcl.overlapping_pairs(boxes.with_queue(None))),
        (ValueError, "24 bytes for each box", lambda: broad_phase.update(cl.Buffer(queue.context, 0, 25))),
        (ValueError, "the same queue", lambda: broad_phase.update(boxes.with_queue(other))),
        (TypeError, "a pyopencl array or buffer, not ndarray", lambda: broad_phase.update(values)),
        (TypeError, "the second set must be a pyopencl array or buffer", lambda: broadcl.overlapping_pairs(boxes, values)),
        (TypeError, "b must be in host memory here", lambda: broadcl.overlapping_pairs(values, boxes)),
        (TypeError, "host memory", lambda: broadcl.BroadPhase().add(boxes)),
        (TypeError, "works only for arrays there", lambda: broadcl.overlapping_pairs(values, device=queue)),
        (ValueError, r"positive stride; not \(20, 6\) with strides \(-24, 4\)", lambda: broadcl.overlapping_pairs(boxes[::-1])),
        (TypeError, r"for boxes on a device, overlapping_pairs\(\) .* argument 'layout'", lambda: broadcl.overlapping_pairs(boxes, layout="axes")),
        (TypeError, r"update\(\) .* argument 'layout'", lambda: broad_phase.update(boxes, layout="axes")),
        (TypeError, "device must be a pyopencl.CommandQueue, or a CUDA device such as .*not str", lambda: broadcl.overlapping_pairs(boxes, device="cpu")),
        (TypeError, "CommandQueue.*not NoneType", lambda: broadcl.DeviceBroadPhase(None)),
        (ValueError, "no algorithm is named", lambda: broadcl.DeviceBroadPhase(queue, algorithm="magic")),
        (ValueError, "sweep-and-prune", lambda: broadcl.DeviceBroadPhase(queue, algorithm="sweep-and-prune")),
        (ValueError, r"uint32 of shape \(20, 4\)", lambda: broad_phase.update(boxes, filters=boxes)),
        (broadcl.Error, "without begin", broad_phase.finish),
    ):
        with pytest.raises(kind, match=message):
            call()
    assert np.array_equal(broad_phase.update(boxes).added.get(), oracle(values))
    elsewhere = cl.CommandQueue(cl.Context([queue.device]))
    with pytest.raises(ValueError, match="of another context"):
        broad_phase.update(cl.Buffer(elsewhere.context, 0, 24))


def test_what_it_says_of_itself(queue):
    measured = cl.CommandQueue(queue.context, properties=cl.command_queue_properties.PROFILING_ENABLE)
    broad_phase = broadcl.DeviceBroadPhase(measured, profile=True)
    broad_phase.update(to_device(measured, uniform(1000)))
    assert broad_phase.queue is measured and broad_phase.device.name.strip() == queue.device.name.strip()
    assert sum(times["device_seconds"] for times in broad_phase.profile().values()) > 0
    assert broad_phase.memory["device"] > 24_000


def test_pyopencl_is_optional():
    code = "import sys, broadcl; broadcl.overlapping_pairs([[0] * 6] * 2); assert 'pyopencl' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_without_the_loader_of_the_system(no_opencl):
    code = """if True:
        import broadcl, numpy, pyopencl, pyopencl.array
        queue = pyopencl.CommandQueue(pyopencl.create_some_context(interactive=False))
        try:
            broadcl.overlapping_pairs(pyopencl.array.zeros(queue, (3, 6), numpy.float32))
        except broadcl.Error as error:
            assert "install OpenCL's loader, libOpenCL.so.1" in str(error), error
        else:
            raise AssertionError
    """
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, **no_opencl})
    assert run.returncode == 0, run.stderr
