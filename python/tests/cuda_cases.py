"""Tensors of CUDA. (test_tensors.py runs these tests.)"""

import contextlib
import gc
import os
import re
import resource
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import PurePath

import numpy as np
import pytest

import broadcl
from conftest import oracle, uniform
from cuda_tensors import (
    Consumer,
    DlpackTensor,
    ExchangeTensor,
    InterfaceTensor,
    Stream,
    Tensor,
    alive,
    copy_later,
    cuda,
    current,
    driver,
    new,
    read,
    wait_for,
)
from test_processes import run

cuda("cuInit", 0)
is_pretended = hasattr(driver, "pretended_cuda_live")
only_pretended = pytest.mark.skipif(not is_pretended, reason="counts or fails calls of CUDA")
two_devices = pytest.mark.skipif(new("cuDeviceGetCount") < 2, reason="needs two devices")


class NamelessTensor(InterfaceTensor):
    names_stream = False  # so it is that of the default stream


@pytest.fixture(autouse=True)
def nothing_is_left():
    def left():
        gc.collect()
        return is_pretended and (driver.pretended_cuda_live(), len(os.listdir("/proc/self/fd")))

    before = left()
    yield
    assert left() == before


def as_set(pairs):
    return {tuple(pair) for pair in pairs.tolist()}


def on(device, values):
    return DlpackTensor(np.ascontiguousarray(values), stream=Stream(device), device=device)


@pytest.mark.parametrize("kind", [DlpackTensor, ExchangeTensor, InterfaceTensor, NamelessTensor])
def test_shapes(kind):
    values = uniform(300)
    for view, expected in (
        (values, values),
        (values.reshape(-1, 2, 3), values),
        (np.hstack([np.full((300, 2), np.nan, np.float32), values])[:, 2:], values),
        (np.repeat(values, 3, axis=0)[150::3], values[50:]),
        (np.hstack([values, values]).reshape(-1, 4, 3)[7:, 2:], values[7:]),
        (values[:1], values[:1]),
        (values[:0], values[:0]),
        (values[:0].reshape(0, 2, 3), values[:0]),
    ):
        stream = None if kind is NamelessTensor else Stream()
        tensor = kind(view, stream=stream)
        assert np.array_equal(broadcl.overlapping_pairs(tensor).get(), oracle(expected))
        delta = broadcl.DeviceBroadPhase("cuda:0").update(kind(view, stream=stream))
        assert np.array_equal(delta.added.get(), oracle(expected)) and len(delta.removed) == 0


def test_two_sets():
    a, b = uniform(400, seed=1), uniform(200, seed=2)
    none = on(0, a[:0])
    broad_phase = broadcl.DeviceBroadPhase("cuda:0")
    assert broad_phase.update(on(0, a), none).pair_count == 0
    assert np.array_equal(broad_phase.update(on(0, a), on(0, b)).added.get(), oracle(a, b))
    assert np.array_equal(broad_phase.pairs().get(), oracle(a, b))
    assert np.array_equal(broad_phase.update(on(0, a), none).removed.get(), oracle(a, b))
    assert np.array_equal(broadcl.overlapping_pairs(on(0, a), on(0, b)).get(), oracle(a, b))
    rows = np.tile(np.array([1, -1, -1, 0], np.int32), (600, 1))
    tensors = [InterfaceTensor(values, stream=Stream()) for values in (a, b, rows)]  # each on a stream of its own
    broad_phase.update(tensors[0], tensors[1], filters=tensors[2])
    assert np.array_equal(broad_phase.pairs().get(), oracle(a, b))
    for first, second in (none, on(0, b)), (none, none):
        assert broadcl.overlapping_pairs(first, second).shape == (0, 2)


@pytest.mark.parametrize("algorithm", ["auto", "brute-force", "tiles"])
def test_moving(algorithm):
    broad_phase = broadcl.DeviceBroadPhase("cuda:0", algorithm=algorithm)
    followed, results = set(), []
    for frame in range(6):
        values = uniform(500 + 100 * (frame % 3), seed=frame // 2)
        values[:50] += np.float32(0.25 * frame)
        if frame % 2:
            broad_phase.begin(on(0, values))
            gc.collect()
            delta = broad_phase.finish()
        else:
            delta = broad_phase.update(on(0, values))
        added, removed = delta
        assert as_set(removed.get()) <= followed and not as_set(added.get()) & followed
        followed = (followed - as_set(removed.get())) | as_set(added.get())
        assert followed == as_set(oracle(values)) and delta.pair_count == len(followed)
        for array in (*delta, broad_phase.pairs()):
            results += [(array, array.get()), (Consumer(array), array.get())]
        assert np.array_equal(broad_phase.pairs().get(), oracle(values))
    shown = broad_phase.boxes(10)
    del broad_phase, delta, added, removed, array
    gc.collect()
    del shown
    for array, copy in results:  # they outlive the updates, and the object
        assert np.array_equal(array.get(), copy)


@pytest.mark.parametrize("dtype", [np.int32, np.uint32])
def test_filters(dtype):
    values = uniform(300)
    rows = np.tile(np.array([1, -1, -1, 0, 9], np.int32), (300, 1))
    rows[:, 3] = np.arange(300) % 2
    broad_phase = broadcl.DeviceBroadPhase("cuda:0")
    filters = DlpackTensor(rows.view(dtype)[:, :4], stream=Stream())
    added = broad_phase.update(on(0, values), filters=filters, worlds=True).added.get()
    expected = oracle(values)
    assert np.array_equal(added, expected[(expected[:, 0] + expected[:, 1]) % 2 == 0])
    rows[:, 3] = -1  # every world
    rows[:200, 2] = 7  # one body
    broad_phase.update(on(0, values), filters=on(0, rows[:, :4].astype(dtype)))
    assert np.array_equal(broad_phase.pairs().get(), expected[expected[:, 1] >= 200])
    rows[:, 0] = 0  # no group
    assert broad_phase.update(on(0, values), filters=on(0, rows[:, :4].astype(dtype))).pair_count == 0


def test_streams():
    stream = Stream()
    values, other = uniform(300), uniform(300, seed=1)
    writer, broad_phase = Stream(), broadcl.DeviceBroadPhase("cuda:0")
    tensor = DlpackTensor(other, stream=stream)
    wait_for(0, stream.handle, writer.handle)
    copy_later(0, tensor.memory, values.ctypes.data, values.nbytes, writer.handle)
    wait_for(0, writer.handle, stream.handle)
    broad_phase.begin(tensor)
    tensor.write(other)  # as soon as begin() has returned
    read(tensor.memory, values.shape, values.dtype, stream=stream.handle)
    assert np.array_equal(broad_phase.finish().added.get(), oracle(values))
    broad_phase.update(tensor)
    tensor.write(np.zeros_like(values))
    assert np.array_equal(broad_phase.pairs().get(), oracle(other))
    assert broad_phase.update(tensor).pair_count == 300 * 299 // 2


def test_in_place():
    stream = Stream()
    values, other = uniform(500), uniform(500, seed=1)
    broad_phase = broadcl.DeviceBroadPhase("cuda:0")
    boxes = broad_phase.boxes(500)
    assert boxes.shape == (500, 6) and boxes.dtype == np.float32
    shown = Consumer(boxes)
    copies = driver.pretended_cuda_copies() if is_pretended else 0
    for frame, sent in enumerate((values, other, values)):
        broad_phase.update(DlpackTensor(sent, inside=shown, stream=stream))
        assert np.array_equal(broad_phase.pairs().get(), oracle(sent)), frame
    for kind in DlpackTensor, InterfaceTensor:
        broad_phase.update(kind(other[:399], inside=shown, row=101, stream=stream))
        assert np.array_equal(broad_phase.pairs().get(), oracle(other[:399]))
        broad_phase.update(kind(np.repeat(other[:200], 2, axis=0)[1::2], inside=shown, row=3, stream=stream))
        assert np.array_equal(broad_phase.pairs().get(), oracle(other[:200]))
    copy_later(0, shown.address, values.ctypes.data, values.nbytes, stream.handle)
    broad_phase.update(boxes)  # which waits for all streams
    assert np.array_equal(broad_phase.pairs().get(), oracle(values))
    assert not is_pretended or driver.pretended_cuda_copies() == copies


def test_memory_is_used_again():
    here = on(0, np.tile(np.float32([0, 0, 0, 1, 1, 1]), (200, 1)))
    apart = on(0, np.repeat(np.arange(200, dtype=np.float32) * 2, 6).reshape(-1, 6))
    broad_phase = broadcl.DeviceBroadPhase("cuda:0")
    addresses, kept = set(), None
    for frame in range(12):
        added, removed = broad_phase.update(here if frame % 2 == 0 else apart)
        changes = added if frame % 2 == 0 else removed
        assert changes.shape == (200 * 199 // 2, 2)
        addresses.add(Consumer(changes).address)
        if frame == 3:
            kept = Consumer(changes), changes.get()
        del added, removed, changes
    assert len(addresses) <= 3, "that of the array that is kept is not used again"
    assert np.array_equal(kept[0].get(), kept[1])


def test_what_reads_a_result_may_lag_behind_on_the_stream_of_the_boxes():
    stream = Stream()
    first, second = (uniform(300, seed=seed) for seed in range(2))
    broad_phase = broadcl.DeviceBroadPhase("cuda:0")
    broad_phase.update(DlpackTensor(first, stream=stream))
    copies = []
    for changes in broad_phase.update(DlpackTensor(second, stream=stream)):
        copies.append((Tensor(np.zeros(changes.shape, np.int32), stream=stream), changes.get()))
        shown = Consumer(changes)
        copy_later(0, copies[-1][0].memory, shown.address, shown.size, stream.handle)
    del changes, shown
    assert np.array_equal(broad_phase.pairs().get(), oracle(second))  # elsewhere
    for seed in range(2, 5):
        broad_phase.update(DlpackTensor(uniform(300, seed=seed), stream=stream))
    for copy, expected in copies:
        assert len(expected) and np.array_equal(read(copy.memory, copy.shape, copy.dtype, stream=stream.handle), expected)


def test_arrays():
    values = uniform(300)
    expected = oracle(values)
    broad_phase = broadcl.DeviceBroadPhase("cuda:0")
    delta = broad_phase.update(on(0, values))
    assert isinstance(delta, broadcl.DeviceDelta) and broad_phase.queue is None
    for array, dtype, shape in (
        (delta.added, np.int32, expected.shape), (delta.removed, np.int32, (0, 2)), (broad_phase.pairs(), np.int32, expected.shape),
        (delta.added.view(np.uint32), np.uint32, expected.shape), (broad_phase.boxes(3), np.float32, (3, 6)),
        (broadcl.overlapping_pairs(on(0, values)), np.int32, expected.shape),
    ):
        assert isinstance(array, broadcl.DeviceArray) and f"shape={shape}" in repr(array)
        assert (array.shape, array.dtype, len(array)) == (shape, dtype, shape[0])
        assert array.get().shape == shape and array.get().dtype == dtype and array.__dlpack_device__() == (2, 0)
        for arguments in {}, {"stream": 1, "max_version": (1, 0), "dl_device": (2, 0), "copy": False}:
            shown = Consumer(array, **arguments)
            assert (shown.shape, shown.dtype, shown.device) == (shape, dtype, (2, 0))
            assert shape != expected.shape or np.array_equal(shown.get(), expected)
        interface = array.__cuda_array_interface__
        assert (interface["shape"], interface["typestr"]) == (shape, np.dtype(dtype).str)
        assert interface["data"] == (shown.address, False) and interface.get("strides") is None and interface["version"] >= 2
        array.__dlpack__()  # and nobody takes it
        for arguments in {"copy": True}, {"dl_device": (1, 0)}, {"dl_device": (2, 5)}:
            with pytest.raises(BufferError):
                array.__dlpack__(**arguments)
    with pytest.raises(TypeError, match="int32 or uint32"):
        delta.added.view(np.float32)


def test_devices():
    boxes = on(0, uniform(100))
    for device in "cuda", "cuda:0", (2, 0), PurePath("cuda:0"), boxes, boxes.__dlpack_device__(), InterfaceTensor(uniform(5)):
        broad_phase = broadcl.DeviceBroadPhase(device, profile=True)
        assert np.array_equal(broad_phase.update(boxes).added.get(), oracle(uniform(100)))
        assert sum(times["device_seconds"] for times in broad_phase.profile().values()) > 0
        assert broad_phase.device.name and broad_phase.memory["device"] > 0
        assert np.array_equal(broadcl.overlapping_pairs(boxes, device=device).get(), oracle(uniform(100)))


@two_devices
def test_two_devices():
    values = uniform(100)
    here, there = on(0, values), on(1, values)
    elsewhere = InterfaceTensor(values, stream=Stream(1), device=1)
    broad_phase, other = broadcl.DeviceBroadPhase("cuda:0"), broadcl.DeviceBroadPhase(there)
    assert broad_phase.device != other.device
    for tensor in there, elsewhere:
        for sets in (tensor,), (here, tensor):
            with pytest.raises(ValueError, match="must be on the CUDA device 0, not 1"):
                broad_phase.update(*sets)
        added = other.update(tensor).added
        assert added.__dlpack_device__() == (2, 1) == Consumer(added).device
        assert broadcl.overlapping_pairs(tensor).__dlpack_device__() == (2, 1)
        other = broadcl.DeviceBroadPhase("cuda:1")
    with current(1):
        assert broadcl.DeviceBroadPhase("cuda").boxes(1).__dlpack_device__() == (2, 1)
    assert np.array_equal(broad_phase.update(here).added.get(), oracle(values))


@pytest.mark.parametrize("context", ["none", "the same", pytest.param("another", marks=two_devices)])
def test_the_context_stays_current(context):
    stream = Stream()
    tensor, wrong = DlpackTensor(uniform(100), stream=stream), DlpackTensor(np.zeros((3, 6)))
    own = new("cuCtxGetCurrent")
    with contextlib.nullcontext() if context == "none" else current(context == "another"):
        before = new("cuCtxGetCurrent")
        assert (before == own) == (context == "none")
        broad_phase = broadcl.DeviceBroadPhase("cuda:0")
        delta = broad_phase.update(tensor)
        for call in (
            lambda: broad_phase.begin(tensor), broad_phase.finish, lambda: broad_phase.update(wrong), broad_phase.pairs,
            lambda: broad_phase.boxes(10), delta.added.get, delta.added.__dlpack__, broad_phase.shrink,
            lambda: broad_phase.set_exclusions([[0, 1]]), lambda: broadcl.overlapping_pairs(tensor),
            lambda: broadcl.overlapping_pairs(wrong), lambda: broadcl.DeviceBroadPhase("cuda:99"),
        ):
            try:
                call()
            except (TypeError, ValueError) as error:
                assert re.search("float64|CUDA device 99", str(error))
            assert new("cuCtxGetCurrent") == before
        broad_phase = delta = call = None
        gc.collect()
        assert new("cuCtxGetCurrent") == before


def test_threads():
    def work(seed):
        broad_phase = broadcl.DeviceBroadPhase("cuda:0")
        for values in uniform(300, seed=seed), uniform(400, seed=seed + 1):
            broad_phase.update(on(0, values))
            if not np.array_equal(broad_phase.pairs().get(), oracle(values)):
                return False
        return True

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(work, range(16)))


def test_shrink():
    values = np.tile(np.float32([0, 0, 0, 1, 1, 1]), (2000, 1))
    broad_phase = broadcl.DeviceBroadPhase("cuda:0")
    broad_phase.update(on(0, values))
    for _ in range(20):
        broad_phase.boxes(300_000)
    kept = broad_phase.update(on(0, values[:300])).removed
    copy, most = kept.get(), (broad_phase.memory["device"], driver.pretended_cuda_live() if is_pretended else 99)
    broad_phase.shrink()
    assert not is_pretended or driver.pretended_cuda_live() < most[1] / 2 < 20
    assert np.array_equal(broad_phase.update(on(0, values[:299])).removed.get()[:, 1], np.full(299, 299))
    assert broad_phase.memory["device"] < most[0] / 4
    assert np.array_equal(kept.get(), copy)


class Lender(DlpackTensor):
    """Nothing but what it returns keeps the memory."""

    def __dlpack__(self, **arguments):
        return on(0, read(self.memory, self.shape, self.dtype, stream=self.handle)).__dlpack__(**arguments)


def test_a_tensor_that_only_its_capsule_keeps():
    broad_phase = broadcl.DeviceBroadPhase("cuda:0")
    first, second = uniform(300), uniform(200, seed=1)
    assert np.array_equal(broad_phase.update(Lender(first), Lender(second)).added.get(), oracle(first, second))
    assert not alive


class Meddler(DlpackTensor):
    """Does something, in another thread, while it is read."""

    def __dlpack__(self, **arguments):
        with ThreadPoolExecutor(1) as pool:
            pool.submit(self.act).result()
        return super().__dlpack__(**arguments)


def test_calls_while_a_tensor_is_read():
    tensor, broad_phase = Meddler(uniform(300)), broadcl.DeviceBroadPhase("cuda:0")
    for act in broad_phase.pairs, broad_phase.finish, broad_phase.shrink, lambda: broad_phase.boxes(3), lambda: broad_phase.update(tensor):
        tensor.act = act
        with pytest.raises(RuntimeError, match="another thread"):
            broad_phase.update(tensor)
    tensor.act = lambda: {}[7]
    with pytest.raises(KeyError, match="7"):
        broad_phase.update(tensor)
    tensor.act = lambda: broadcl.overlapping_pairs(on(0, uniform(20)))
    assert np.array_equal(broad_phase.update(tensor).added.get(), oracle(uniform(300)))
    del tensor.act


inherited = None


def use_inherited():
    global inherited
    broad_phase, delta, tensor = inherited
    for call in (
        lambda: broad_phase.update(tensor), broad_phase.pairs, delta.added.get, lambda: broadcl.DeviceBroadPhase("cuda:0"),
        lambda: broad_phase.boxes(100_000), broad_phase.shrink, lambda: broadcl.overlapping_pairs(tensor),
    ):
        with pytest.raises(broadcl.Error, match="after a fork.*spawn"):
            call()
    before = driver.pretended_cuda_calls_after_fork() if is_pretended else 0
    inherited = broad_phase = delta = call = None
    gc.collect()
    assert not is_pretended or driver.pretended_cuda_calls_after_fork() == before == 0


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process():
    stream = Stream()
    global inherited
    tensor = DlpackTensor(uniform(300), stream=stream)
    broad_phase = broadcl.DeviceBroadPhase("cuda:0")
    inherited = broad_phase, broad_phase.update(tensor), tensor
    run("fork", use_inherited)
    assert np.array_equal(inherited[1].added.get(), oracle(uniform(300)))
    assert broad_phase.update(tensor).pair_count == len(oracle(uniform(300)))
    inherited = None


def test_what_is_refused():
    values = uniform(20)
    boxes = on(0, values)
    elsewhere = on(0, values)
    elsewhere.kind = 10  # kDLROCM
    invalid = values.copy()
    invalid[3, 4] = np.nan
    rows = np.zeros((20, 4), np.int32)
    broad_phase = broadcl.DeviceBroadPhase("cuda:0")
    for kind, message, call in (
        (TypeError, "boxes must be float32 on a device, not float64", lambda: broad_phase.update(on(0, values.astype("f8")))),
        (TypeError, "not float16", lambda: broadcl.overlapping_pairs(on(0, values.astype("f2")))),
        (TypeError, "not int32", lambda: broad_phase.update(InterfaceTensor(values.astype("i4")))),
        (TypeError, "boxes must be on a CUDA device, not in host memory.*BroadPhase", lambda: broad_phase.update(values)),
        (TypeError, "the second set must be on a CUDA device, not in host memory", lambda: broad_phase.update(boxes, values)),
        (TypeError, "(b|the second set) must be on a CUDA device, not in host", lambda: broadcl.overlapping_pairs(boxes, values)),
        (TypeError, "filters must be on a CUDA device, not in host memory", lambda: broad_phase.update(boxes, filters=rows)),
        (TypeError, "host memory", lambda: broadcl.BroadPhase().add(boxes)),
        (TypeError, "host memory", lambda: broadcl.overlapping_pairs(values, boxes)),
        (TypeError, "of the kind 10 of DLPack", lambda: broad_phase.update(elsewhere)),
        (TypeError, "of the kind 10 of DLPack", lambda: broadcl.overlapping_pairs(elsewhere)),
        (TypeError, "not list", lambda: broad_phase.update(values.tolist())),
        (ValueError, r"\(n, 6\) or \(n, 2, 3\).*not \(20, 5\)", lambda: broad_phase.update(on(0, values[:, :5]))),
        (ValueError, r"not \(120,\)", lambda: broad_phase.update(on(0, values.reshape(-1)))),
        (ValueError, "side by side", lambda: broad_phase.update(DlpackTensor(np.ascontiguousarray(values.T).T))),
        (ValueError, r"positive stride; not \(20, 6\) with strides \(-24, 4\)", lambda: broad_phase.update(DlpackTensor(values[::-1]))),
        (ValueError, r"uint32 of shape \(20, 4\)", lambda: broad_phase.update(boxes, filters=boxes)),
        (ValueError, r"uint32 of shape \(20, 4\)", lambda: broad_phase.update(boxes, filters=on(0, rows[1:]))),
        (ValueError, "row 3 of boxes has a NaN", lambda: broadcl.overlapping_pairs(on(0, invalid))),
        (ValueError, "no algorithm is named", lambda: broadcl.DeviceBroadPhase("cuda:0", algorithm="magic")),
        (ValueError, "there is no CUDA device 99", lambda: broadcl.DeviceBroadPhase("cuda:99")),
        (TypeError, "device must be .* not str", lambda: broadcl.DeviceBroadPhase("cpu")),
        (TypeError, "device must be .* not str", lambda: broadcl.DeviceBroadPhase("cuda:x")),
        (TypeError, "of the kind 10 of DLPack", lambda: broadcl.DeviceBroadPhase((10, 0))),
        (broadcl.Error, "without begin", broad_phase.finish),
    ):
        with pytest.raises(kind, match=message):
            call()
    assert np.array_equal(broad_phase.update(boxes).added.get(), oracle(values))
    broad_phase.begin(on(0, invalid))
    for call in lambda: broad_phase.begin(boxes), broad_phase.pairs, broad_phase.shrink:
        with pytest.raises(broadcl.Error, match="finish"):
            call()
    delta = broad_phase.finish()
    assert delta.invalid_boxes == 1 and delta.first_invalid == 3 and len(delta.added) == 0


@only_pretended
@pytest.mark.parametrize("fault, message", [
    ("no-memory", r"cuMemCreate failed: out of memory \(2\)"), ("no-export", "cuMemExportToShareableHandle failed"),
    ("no-import", "clCreateBufferWithProperties"),
])
def test_memory_that_cannot_be_shared(fault, message, monkeypatch):
    values = uniform(300)
    tensor = on(0, values)
    broad_phase = broadcl.DeviceBroadPhase("cuda:0")
    with monkeypatch.context() as patch:
        patch.setenv("PRETENDED_CUDA", fault)
        for call in lambda: broad_phase.update(tensor), lambda: broad_phase.boxes(9), lambda: broadcl.overlapping_pairs(tensor):
            with pytest.raises(broadcl.Error, match=message):
                call()
    broad_phase.begin(tensor)
    with monkeypatch.context() as patch:
        patch.setenv("PRETENDED_CUDA", fault)
        for call in broad_phase.finish, broad_phase.finish:
            with pytest.raises(broadcl.Error, match=message):
                call()
    assert np.array_equal(broad_phase.finish().added.get(), oracle(values))
    assert np.array_equal(broad_phase.pairs().get(), oracle(values))


def prints(code, **environment):
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **environment}, cwd=os.path.dirname(__file__))
    assert run.returncode == 0 and run.stderr == ""
    return run.stdout


def test_the_end_of_a_program():
    assert prints("""if True:
        import numpy, broadcl, cuda_cases
        broad_phase = broadcl.DeviceBroadPhase("cuda:0")
        delta = broad_phase.update(cuda_cases.on(0, numpy.zeros((300, 6), numpy.float32)))
        objects = broad_phase.boxes(9), delta.added.__dlpack__(), cuda_cases.Consumer(delta.added)
        broad_phase.begin(objects[0])
        print(delta.pair_count)
    """) == "44850\n"


make_one = """if True:
    import broadcl
    try:
        print(broadcl.DeviceBroadPhase("cuda:0").device.id)
    except broadcl.Error as error:
        print("Error:", error)
"""


def test_without_a_driver(tmp_path):
    (tmp_path / "libcuda.so.1").touch()  # found first, and no library
    assert re.match("Error: there is no libcuda.so.1.*BroadPhase", prints(make_one, LD_LIBRARY_PATH=str(tmp_path)))


@only_pretended
@pytest.mark.parametrize("fault, message", [
    ("no-device", "Error: CUDA: cuInit failed: no CUDA-capable device is detected"), ("no-uuid", "0:0\n"),
    ("other-uuid", "Error: no OpenCL device is the CUDA device 0 .*BroadPhase"),
    ("no-extension", "Error: .* has no cl_khr_external_memory_opaque_fd.*BroadPhase"),
])
def test_drivers(fault, message):
    assert re.match(message, prints(make_one, PRETENDED_CUDA=fault))


@only_pretended
def test_many_objects_and_too_few_descriptors():
    boxes, kept = on(0, uniform(20)), []
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir("/proc/self/fd")) + 40, limits[1]))
    try:
        with pytest.raises(broadcl.Error, match="ulimit -n"):
            for _ in range(40):
                kept.append(broadcl.DeviceBroadPhase("cuda"))
                kept[-1].update(boxes)
        kept.pop()
        assert len(kept) > 5
        assert all(broad_phase.update(boxes).pair_count == len(oracle(uniform(20))) for broad_phase in kept)
        del kept[-5:]
        assert broadcl.DeviceBroadPhase("cuda").update(boxes).pair_count == len(oracle(uniform(20)))
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
