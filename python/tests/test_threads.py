import os
import subprocess
import sys
import sysconfig
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import broadcl
from conftest import oracle, uniform


def test_a_second_thread_gets_an_error_and_others_go_on():
    broad_phase = broadcl.BroadPhase(algorithm="oracle")  # slow
    broad_phase.add(uniform(30_000))
    results = []
    thread = threading.Thread(target=lambda: results.append(broad_phase.update()))
    refused = 0
    thread.start()
    while thread.is_alive():
        try:
            len(broad_phase)
        except RuntimeError as error:
            assert "another thread is using this object" in str(error)
            refused += 1
            for call in (broad_phase.update, broad_phase.pairs, lambda: broad_phase.map(3), lambda: broad_phase.remove(0)):
                with pytest.raises(RuntimeError, match="another thread") if thread.is_alive() else pytest.raises(Exception):
                    call()
                    break
            break
        time.sleep(0.001)
    thread.join()
    assert refused and len(results[0].added)
    assert len(broad_phase) == 30_000


def test_the_gil_is_released():
    values = uniform(20_000)
    done = threading.Event()

    def search():
        broadcl.overlapping_pairs(values, algorithm="oracle")
        done.set()

    thread = threading.Thread(target=search)
    thread.start()
    turns = 0
    while not done.is_set():
        turns += 1
        time.sleep(0.001)
    thread.join()
    assert turns > 10


def test_objects_of_many_threads():
    def work(seed):
        values = uniform(500, seed=seed)
        broad_phase = broadcl.BroadPhase()
        broad_phase.add(values)
        first = broad_phase.update().added
        return np.array_equal(first, oracle(values)) and np.array_equal(broadcl.overlapping_pairs(values), first)

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(work, range(64)))


def test_sub_interpreters_are_refused():
    code = """if True:
        try:
            import _interpreters as interpreters
        except ImportError:
            import _xxsubinterpreters as interpreters
        try:
            failure = interpreters.run_string(interpreters.create(), "import broadcl")
        except Exception as error:
            failure = error
        assert "ImportError" in str(failure), failure
    """
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


@pytest.mark.parametrize("searches", ["broadcl.overlapping_pairs(boxes)", "object.map(200_000)[:] = boxes; object.update()"])
def test_a_daemon_thread_may_search_when_the_program_ends(searches):
    program = f"""
import threading, time
import numpy as np
import broadcl
lower = np.random.default_rng(1).uniform(0, 100, (200_000, 3))
boxes = np.hstack([lower, lower + 1]).astype(np.float32)  # few pairs, so that a search ends before the program
object = broadcl.BroadPhase(algorithm="sweep-and-prune")
def work():
    while True:
        {searches}
threading.Thread(target=work, daemon=True).start()
time.sleep(0.1)
"""
    for _ in range(3 if os.environ.get("BROADCL_HYPOTHESIS") == "quick" else 10):
        run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
        assert run.returncode == 0, run.stderr


def test_a_free_threaded_interpreter_is_refused():
    compiler = sysconfig.get_config_var("CC").split()[0]
    folder = sysconfig.get_paths()["include"]
    header = Path(__file__).parents[1] / "src/gil.hpp"
    run = subprocess.run([compiler, "-E", "-x", "c++", "-DPy_GIL_DISABLED", f"-I{folder}", header], capture_output=True, text=True)
    assert run.returncode and "does not support free-threaded Python" in run.stderr
