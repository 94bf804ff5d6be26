import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import broadcl
from conftest import oracle, uniform


def program(*arguments, **environment):
    return subprocess.run(
        [sys.executable, "-m", "broadcl", *map(str, arguments)],
        capture_output=True, text=True, env={**os.environ, **environment},
    )


def test_devices():
    run = program("devices")
    assert run.returncode == 0
    for device in broadcl.devices():
        assert f"{device.id}  {device.type}  {device}" in run.stdout
    assert run.stdout.count("* ") == 2


def test_check():
    run = program("check")
    assert run.returncode == 0, run.stdout
    assert run.stdout.count(" right\n") == len(broadcl.algorithms())


def test_pairs(tmp_path):
    values = uniform(100)
    np.save(tmp_path / "boxes.npy", values)
    run = program("pairs", tmp_path / "boxes.npy", "--out", tmp_path / "pairs.npy")
    assert run.returncode == 0
    assert np.array_equal(np.load(tmp_path / "pairs.npy"), oracle(values))
    assert run.stdout == f"{len(oracle(values))} overlapping pairs of 100 boxes\n"


def test_pairs_refuses_other_formats(tmp_path):
    np.save(tmp_path / "boxes.npy", uniform(9))
    run = program("pairs", tmp_path / "boxes.npy", "--out", tmp_path / "pairs.csv")
    assert run.returncode == 2 and "written as .npy, not as .csv" in run.stderr
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("output, reason", [(">/dev/full", "No space left on device"), (">&-", "it is closed")])
def test_output_that_cannot_be_written_is_an_error(output, reason):
    run = subprocess.run(
        ["sh", "-c", f'exec "$@" {output}', "sh", sys.executable, "-m", "broadcl", "devices"], capture_output=True, text=True
    )
    assert run.returncode == 2
    assert run.stderr == f"broadcl: cannot write to standard output: {reason}\n"


def npy(header):
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header


def test_pairs_keeps_links_and_modes(tmp_path):
    np.save(tmp_path / "boxes.npy", uniform(9))
    target = tmp_path / "target.npy"
    target.touch(mode=0o600)
    link = tmp_path / "link.npy"
    link.symlink_to(target)
    assert program("pairs", tmp_path / "boxes.npy", "--out", link).returncode == 0
    assert link.is_symlink() and np.load(target).shape[1] == 2
    assert target.stat().st_mode & 0o777 == 0o600
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.skipif(os.name != "posix", reason="needs a limit of the size of files")
def test_pairs_writes_all_or_nothing(tmp_path):
    np.save(tmp_path / "boxes.npy", np.tile(np.float32([0, 0, 0, 1, 1, 1]), (40, 1)))
    pairs = tmp_path / "pairs.npy"
    command = f"ulimit -f 4; '{sys.executable}' -m broadcl pairs '{tmp_path}/boxes.npy' --out '{pairs}'"
    run = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    assert run.returncode == 2 and run.stderr == f"broadcl: cannot write {pairs}: File too large\n"
    assert list(tmp_path.iterdir()) == [tmp_path / "boxes.npy"]


def test_pairs_refuses(tmp_path):
    def expect(reason, *arguments):
        run = program("pairs", *arguments)
        assert run.returncode == 2 and reason in run.stderr and run.stderr.count("\n") == 1

    boxes = tmp_path / "boxes.npy"
    np.save(boxes, uniform(3))
    before = boxes.read_bytes()
    expect("--out names the file of the boxes", boxes, "--out", boxes)
    assert boxes.read_bytes() == before
    expect("", boxes, "--out", "")
    expect("none", boxes, "--out", tmp_path / "none" / "pairs.npy")
    expect(f"cannot write {boxes}/pairs.npy", boxes, "--out", boxes / "pairs.npy")
    link = tmp_path / "link.npy"
    link.symlink_to(link)
    expect(f"cannot write {link}", boxes, "--out", link)
    assert link.is_symlink()
    link.unlink()
    expect("none.npy", tmp_path / "none.npy")
    header = b"{'descr': '<f4', 'fortran_order': False, 'shape': (%s, 6), }" % (b"9" * 30)
    for text, reason in (
        (b"", "magic bytes of .npy"), (b"0,0,0,1,1,1\n", "magic bytes of .npy"), (b"PK", "zip"), (before[:-1], "not fully written"),
        (before + before, "more data than its shape (3, 6)"), (npy(header), ""), (npy(b"(" * 9000), ""), (npy(b"(" * 20_000), ""),
    ):
        boxes.write_bytes(text)
        expect(reason, boxes)
        assert "pickle" not in program("pairs", boxes).stderr
    for arrays, reason in (
        ([uniform(3)] * 2, "it holds 2 arrays; give a file with one"), ([], "it holds 0 arrays"), ([np.array([{}])], "dtype is object"),
    ):
        with boxes.open("wb") as file:
            np.savez(file, *arrays)
        expect(reason, boxes)
    np.save(boxes, np.array([{}]), allow_pickle=True)
    expect("its dtype is object; float32 or float64 is needed", boxes)
    np.save(boxes, np.zeros(6))
    expect("shape (6,)", boxes)
    assert list(tmp_path.iterdir()) == [boxes]


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_pairs_of_an_archive(tmp_path, save):
    save(tmp_path / "boxes.npz", beams=uniform(100))
    run = program("pairs", tmp_path / "boxes.npz")
    assert run.stdout == f"{len(oracle(uniform(100)))} overlapping pairs of 100 boxes\n", run.stderr


@pytest.mark.parametrize("form", ["(n, 6)", "(n, 2, 3)", "(n, 4)"])
def test_pairs_counts_inverted_boxes(tmp_path, form):
    values = np.tile(np.float64([0, 0, 0, 1, 1, 1]), (4, 1))
    values[2:, 4] = -1e-300
    axes = "x, y, z"
    if form == "(n, 4)":
        values, axes = values[:, [0, 1, 3, 4]], "x, y"
    question = f"inverted (min > max) and ignored; are the columns min {axes}, max {axes}?\n"
    for count, text in ((4, f"2 boxes are {question}"), (3, f"1 box is {question}"), (2, "")):
        boxes = values[:count].reshape((-1, 2, 3) if form == "(n, 2, 3)" else (count, -1))
        np.save(tmp_path / "boxes.npy", boxes)
        assert program("pairs", tmp_path / "boxes.npy").stdout == f"1 overlapping pair of {count} boxes\n" + text


def test_pairs_counts_one_in_the_singular(tmp_path):
    np.save(tmp_path / "boxes.npy", uniform(1))
    assert program("pairs", tmp_path / "boxes.npy").stdout == "0 overlapping pairs of 1 box\n"


@pytest.mark.parametrize("shape", [(0, 6), (0, 2, 3), (0, 4)])
def test_pairs_of_no_boxes(tmp_path, shape):
    np.save(tmp_path / "boxes.npy", np.empty(shape))
    run = program("pairs", tmp_path / "boxes.npy", "--out", tmp_path / "pairs.npy")
    assert run.stdout == "0 overlapping pairs of 0 boxes\n", run.stderr
    assert np.load(tmp_path / "pairs.npy").shape == (0, 2)


def test_without_opencl(no_opencl):
    code = """if True:
        import broadcl
        assert broadcl.devices() == []
        assert broadcl.overlapping_pairs([[0, 0, 0, 1, 1, 1]] * 2).tolist() == [[0, 1]]
        broad_phase = broadcl.BroadPhase()
        broad_phase.add([[0, 0, 0, 1, 1, 1]] * 2)
        assert broad_phase.update().added.tolist() == [[0, 1]]
        assert set(broadcl.check()) == {"auto", "sweep-and-prune", "oracle"}
        for call in (broadcl.select_device, lambda: broadcl.BroadPhase(device="gpu"),
                     lambda: broadcl.BroadPhase(algorithm="tiles")):
            try:
                call()
            except broadcl.Error as error:
                assert "install the driver of your GPU" in str(error), error
            else:
                raise AssertionError
    """
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, **no_opencl})
    assert run.returncode == 0, run.stderr
    assert "no OpenCL device found" in program("devices", **no_opencl).stdout
    assert "works here" in program("check", **no_opencl).stdout


def test_the_module_links_no_opencl():
    from broadcl import _core

    module = Path(_core.__file__).read_bytes()
    assert module.count(b"\0libOpenCL.so.1\0") == 1  # the name that it opens


def test_types():
    package = Path(broadcl.__file__).parent
    assert (package / "py.typed").exists()
    stub = (package / "_core.pyi").read_text()
    for name in broadcl.__all__:
        if name not in ("check", "__version__"):
            assert re.search(rf"^(class|def) {name}\b|^{name}\b", stub, re.MULTILINE), name
    assert "nanobind" not in stub
    undocumented = [
        f"{name}.{member}" for name in ("BroadPhase", "Delta") for member, value in vars(getattr(broadcl, name)).items()
        if not member.startswith("_") and not value.__doc__
    ]
    assert undocumented == []
