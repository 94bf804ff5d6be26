"""The types of the package, for mypy."""

import subprocess
import sys

import pytest

from test_documentation import ROOT, code

# stubtest expects Python's own classes, and finds nanobind's. The signature is that of the first overload.
# (What inspect.signature() finds is for no checker of types.)
OF_NANOBIND = r"""
broadcl\._core\.(BroadPhase|Device|DeviceArray|DeviceBroadPhase|DeviceDelta|State)
broadcl\._core\.(Device|DeviceArray|DeviceDelta|State)\.__init__
broadcl\._core\.squared_distances
broadcl\._core\.(BroadPhase|DeviceBroadPhase)\.__signature__
"""


def run_module(*arguments, folder):
    return subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True, cwd=folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("mypy")


def test_the_chapter(folder):
    text = code((ROOT / "docs/python.md").read_text())
    declared = "import numpy as np\nimport numpy.typing as npt\nbeams: npt.NDArray[np.float32]\nducts: npt.NDArray[np.float32]\n"
    (folder / "chapter.py").write_text(declared + text)
    run = run_module("mypy", "--strict", "chapter.py", folder=folder)
    assert run.returncode == 0, run.stdout + run.stderr


def test_ids_of_one_box_and_of_many(folder):
    (folder / "ids.py").write_text("""if True:
        import numpy as np
        import numpy.typing as npt
        import broadcl

        one: int = broadcl.BroadPhase().add([0, 0, 0, 1, 1, 1])
        two: int = broadcl.BroadPhase().add(([0, 0, 0], [1, 1, 1]), mask=np.uint32(1))
        many: npt.NDArray[np.uint32] = broadcl.BroadPhase().add(np.ones((2, 6)), mask=np.arange(2))
        lists: npt.NDArray[np.uint32] = broadcl.BroadPhase().add([[0, 0, 0, 1, 1, 1]], mask=[1])
        corners: npt.NDArray[np.uint32] = broadcl.BroadPhase().add((np.ones((2, 3)), np.ones((2, 3))))
        wrong: str = broadcl.BroadPhase().add([0, 0, 0, 1, 1, 1])
    """)
    run = run_module("mypy", "--strict", "ids.py", folder=folder)
    assert run.stdout.startswith("ids.py:11: error: Incompatible types in assignment (expression has type \"int\""), run.stdout
    assert "Found 1 error" in run.stdout


def test_the_stubs_are_those_of_the_module(folder):
    (folder / "allowed").write_text(OF_NANOBIND)
    run = run_module("mypy.stubtest", "broadcl", "--concise", "--allowlist", "allowed", folder=folder)
    assert run.returncode == 0, run.stdout + run.stderr
