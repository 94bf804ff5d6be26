"""The comparisons with other packages of PyPI, with few boxes: they fail if the pairs differ."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

BENCH = Path(__file__).parents[2] / "bench"


def output(*arguments, missing=0):
    run = subprocess.run([sys.executable, *map(str, arguments)], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stderr.count("is not installed") == missing, run.stderr
    return run.stdout


@pytest.mark.comparison
def test_python():
    table = output(BENCH / "python.py", "--most", 10_000, "--rounds", 1)
    packages = "rtree", "coal", "python-fcl", "trimesh", "ipctk LBVH", "ipctk SweepAndPrune", "shapely STRtree", "vesin"
    for method in packages:
        assert table.count(f"\n{method:22} ") == 2, table  # 1,000 and 10,000
    assert table.count(f"\n{'broadcl':22} ") == 6, table  # in three scenes


@pytest.mark.comparison
def test_a_broad_phase_of_ipctk():
    table = output(BENCH / "ipctk_cloth.py", "--faces", 10_000, "--rounds", 1)
    assert "10,082 faces" in table


def test_rivals_gpu_without_rivals():
    """Warp, Newton and PyTorch are too large to be installed for tests."""
    pytest.importorskip("pyopencl")
    missing = sum(importlib.util.find_spec(package) is None for package in ("warp", "newton", "torch"))
    table = output(BENCH / "rivals_gpu.py", "--device", "cpu", "--sizes", 500, "--frames", 3, "--warm-up", 0, missing=missing)
    assert table.count("\nBroadCL ") == table.count("\nBroadCL, on the device ") == 2, table
    assert "pairs missing" not in table
