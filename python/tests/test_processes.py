"""Objects in several processes."""

import gc
import multiprocessing

import numpy as np
import pytest

import broadcl
from conftest import oracle, uniform

pytestmark = pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")  # there are threads of OpenCL

on_device = None


def search(algorithm):
    values = uniform(500)
    broad_phase = broadcl.BroadPhase(algorithm=algorithm)
    broad_phase.add(values)
    assert np.array_equal(broad_phase.update().added, oracle(values))


def use_inherited():
    global on_device
    for call in (broadcl.devices, broadcl.select_device, on_device[0].update, lambda: search("tiles")):
        with pytest.raises(broadcl.Error, match="after a fork.*spawn"):
            call()
    search("auto")
    search("sweep-and-prune")
    on_device = None  # with arrays of the device's memory
    gc.collect()


def run(method, target, *arguments):
    process = multiprocessing.get_context(method).Process(target=target, args=arguments)
    process.start()
    process.join(120)
    if process.exitcode is None:
        process.kill()
    assert process.exitcode == 0


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="there is no fork")
def test_a_forked_process_stays_on_the_host():
    global on_device
    broad_phase = broadcl.BroadPhase(algorithm="tiles")
    view = broad_phase.map(500)
    view[:] = uniform(500)
    on_device = broad_phase, view, broad_phase.update()
    run("fork", use_inherited)
    assert np.array_equal(on_device[0].pairs(), oracle(uniform(500)))
    on_device = None


def test_functions_can_be_sent_to_processes():
    values = [uniform(60, seed=seed) for seed in range(3)]
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        found = pool.map(broadcl.overlapping_pairs, values)
    assert all(np.array_equal(pairs, oracle(boxes)) for pairs, boxes in zip(found, values))


def test_a_spawned_process_uses_devices():
    search("tiles")
    run("spawn", search, "tiles")
