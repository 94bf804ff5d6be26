"""The comparisons with other packages of PyPI, with few boxes: they fail if the pairs differ."""

import subprocess
import sys
from pathlib import Path

BENCH = Path(__file__).parents[2] / "bench"


def output(*arguments):
    run = subprocess.run([sys.executable, *map(str, arguments)], capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    assert "is not installed" not in run.stderr
    return run.stdout


def test_rtree_coal_fcl_trimesh_and_ipctk():
    table = output(BENCH / "python.py", "--most", 10_000, "--rounds", 1)
    for method in ("rtree", "coal", "python-fcl", "trimesh", "ipctk LBVH", "ipctk SweepAndPrune"):
        assert table.count("\n" + method + " ") == 2, table  # 1,000 and 10,000 boxes


def test_a_broad_phase_of_ipctk():
    table = output(BENCH / "ipctk_cloth.py", "--faces", 10_000, "--rounds", 1)
    assert "10,082 faces" in table
