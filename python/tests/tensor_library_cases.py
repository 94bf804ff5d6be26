"""Tensors of the libraries that are installed, on a GPU. (test_tensors.py runs these tests.)"""

import gc
import re
import subprocess
import sys

import numpy as np
import pytest

import broadcl
from conftest import oracle, uniform
from test_documentation import OF_TENSORS, ROOT, code


@pytest.fixture
def torch():
    return pytest.importorskip("torch")


@pytest.fixture(params=["torch", "cupy", "jax", "warp"])
def library(request):
    """What makes a tensor of an array of NumPy, what makes one of DLPack, and what makes the array again."""
    module = pytest.importorskip(request.param)
    if request.param == "torch":
        return lambda values: module.as_tensor(values, device="cuda"), module.from_dlpack, lambda tensor: tensor.cpu().numpy()
    if request.param == "cupy":
        return module.asarray, module.from_dlpack, module.asnumpy
    if request.param == "jax":
        return module.numpy.asarray, pytest.importorskip("jax.dlpack").from_dlpack, np.asarray
    return lambda values: module.array(values, dtype=float, device="cuda"), module.from_dlpack, lambda array: array.numpy()


def test_round_trip(library):
    to_tensor, from_dlpack, to_numpy = library
    boxes, other = to_tensor(uniform(1000)), to_tensor(uniform(1000, seed=1))
    broad_phase = broadcl.DeviceBroadPhase(boxes.device)
    added = from_dlpack(broad_phase.update(boxes).added)
    removed = from_dlpack(broad_phase.update(other).removed)
    pairs = from_dlpack(broad_phase.pairs())
    once = from_dlpack(broadcl.overlapping_pairs(boxes, other))
    del broad_phase
    gc.collect()
    broadcl.DeviceBroadPhase(boxes).update(other)
    assert np.array_equal(to_numpy(added), oracle(uniform(1000))) and str(added.dtype).count("int32") == 1
    assert np.array_equal(to_numpy(pairs), oracle(uniform(1000, seed=1)))
    assert np.array_equal(to_numpy(once), oracle(uniform(1000), uniform(1000, seed=1)))
    assert set(map(tuple, to_numpy(removed).tolist())) <= set(map(tuple, to_numpy(added).tolist()))


def test_views_and_slices(torch):
    values = uniform(1000)
    wide = torch.full((1000, 9), torch.nan, device="cuda")
    wide[:, 2:8] = torch.as_tensor(values)
    broad_phase = broadcl.DeviceBroadPhase("cuda")
    assert np.array_equal(broad_phase.update(wide[:, 2:8]).added.get(), oracle(values))
    assert broad_phase.update(torch.as_tensor(values, device="cuda").reshape(-1, 2, 3)).pair_count == len(oracle(values))
    assert np.array_equal(broadcl.overlapping_pairs(wide[300::3, 2:8]).get(), oracle(values[300::3]))
    with pytest.raises(ValueError, match="side by side"):
        broad_phase.update(torch.as_tensor(values.T.copy(), device="cuda").T)


def test_in_place(torch):
    broad_phase = broadcl.DeviceBroadPhase(torch.device("cuda", 0))
    boxes = torch.from_dlpack(broad_phase.boxes(1000))
    for seed in range(3):
        boxes.copy_(torch.as_tensor(uniform(1000, seed=seed)))
        broad_phase.update(boxes[7:])
        assert np.array_equal(broad_phase.pairs().get(), oracle(uniform(1000, seed=seed)[7:]))


def test_streams(torch):
    values = uniform(1000)
    boxes, source = torch.zeros(1000, 6, device="cuda"), torch.as_tensor(values, device="cuda")
    broad_phase = broadcl.DeviceBroadPhase(boxes)
    torch.cuda.synchronize()
    with torch.cuda.stream(torch.cuda.Stream()):
        torch.cuda._sleep(100_000_000)  # cycles
        boxes.copy_(source)
        added = torch.from_dlpack(broad_phase.update(boxes).added)
        boxes.zero_()
        torch.cuda._sleep(100_000_000)
        copy = added.clone()
        del added
        broad_phase.update(boxes)
        broad_phase.pairs()
    torch.cuda.synchronize()
    assert np.array_equal(copy.cpu().numpy(), oracle(values))


def test_indices(torch):
    boxes = torch.as_tensor(uniform(1000), device="cuda")
    result = broadcl.overlapping_pairs(boxes)
    pairs = torch.from_dlpack(result)
    assert pairs.dtype == torch.int32 and torch.from_dlpack(result.view(np.uint32)).dtype == torch.uint32
    a, b = boxes[pairs[:, 0]], boxes[pairs[:, 1]]
    assert len(pairs) and bool((a[:, :3] <= b[:, 3:]).all() and (b[:, :3] <= a[:, 3:]).all())


def test_gradients(torch):
    centres = torch.as_tensor(uniform(1000)[:, :3], device="cuda").requires_grad_()
    with pytest.raises(BufferError, match="grad"):
        broadcl.overlapping_pairs(torch.hstack([centres, centres + 1]))
    pairs = torch.from_dlpack(broadcl.overlapping_pairs(torch.hstack([centres, centres + 1]).detach()))
    ((centres[pairs[:, 0]] - centres[pairs[:, 1]]).norm(dim=1) - 1).square().sum().backward()
    expected = centres.detach().cpu().requires_grad_()
    first, second = torch.as_tensor(oracle(uniform(1000)).astype(np.int64)).T
    ((expected[first] - expected[second]).norm(dim=1) - 1).square().sum().backward()
    assert torch.allclose(centres.grad.cpu(), expected.grad, rtol=1e-3, atol=1e-4)


def test_what_is_refused(torch):
    boxes = torch.as_tensor(uniform(10), device="cuda")
    broad_phase = broadcl.DeviceBroadPhase("cuda")
    for tensor, message in (boxes.double(), "not float64"), (boxes.half(), "not float16"), (boxes.cpu(), "host memory"):
        with pytest.raises(TypeError, match=message):
            broad_phase.update(tensor)


def test_the_chapter_on_tensors(torch):
    names = {}
    exec(code((ROOT / "docs/python.md").read_text(), "py"), names)
    assert len(names["pairs"]) and torch.equal(names["pairs"], names["added"])
    on_host = broadcl.BroadPhase()
    on_host.add(names["boxes"].cpu().numpy(), world=names["environment"].cpu().numpy())
    assert np.array_equal(names["delta"].added.get(), on_host.update().added)


def test_the_example_of_tensors(torch):
    command = [sys.executable, OF_TENSORS, "--spheres", "5000", "--verify"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "the host found the same" in run.stdout
    energies = [float(energy) for energy in re.findall(r"energy +([\d.]+)", run.stdout)]
    assert 0 <= energies[-1] < energies[0] / 1000
