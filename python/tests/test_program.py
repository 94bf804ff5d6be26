import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import broadcl


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


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("output, reason", [(">/dev/full", "No space left on device"), (">&-", "it is closed")])
def test_output_that_cannot_be_written_is_an_error(output, reason):
    run = subprocess.run(
        ["sh", "-c", f'exec "$@" {output}', "sh", sys.executable, "-m", "broadcl", "devices"], capture_output=True, text=True
    )
    assert run.returncode == 2
    assert run.stderr == f"broadcl: cannot write to standard output: {reason}\n"


def test_bad_input_is_one_line():
    run = program("check", "--device", "frobnicate")
    assert run.returncode == 2 and run.stdout == "" and re.fullmatch("broadcl: .*'frobnicate'.*\n", run.stderr)


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


def in_a_copy(folder, code):
    """Runs code in which a copy of the package is app.vendored."""
    shutil.copytree(Path(broadcl.__file__).parent, folder / "app" / "vendored")
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=folder)


def test_a_vendored_copy(tmp_path):
    code = """if True:
        import sys
        sys.modules["broadcl"] = None  # which nothing can import
        import app.vendored as vendored
        assert vendored.overlapping_pairs([[0, 0, 0, 1, 1, 1]] * 2).tolist() == [[0, 1]]
        assert set(vendored.check().values()) == {"right"}
        import app.vendored.__main__
    """
    run = in_a_copy(tmp_path, code)
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("again", [
    "import app.vendored", "for name in list(sys.modules):\n    if name.startswith('broadcl'): del sys.modules[name]\nimport broadcl",
])
def test_a_second_copy_says_that_there_can_be_one(tmp_path, again):
    run = in_a_copy(tmp_path, f"import sys, broadcl\n{again}")
    assert run.returncode == 1
    assert run.stderr.splitlines()[-1] == (
        "ImportError: BroadCL is in this process already, as broadcl, and can be there only once: import that one, "
        "and leave it in sys.modules"
    )
    assert "Warning" not in run.stderr


def test_the_module_links_no_opencl():
    from broadcl import _core

    module = Path(_core.__file__).read_bytes()
    assert module.count(b"\0libOpenCL.so.1\0") == 1  # the name that it opens


def test_types():
    package = Path(broadcl.__file__).parent
    assert (package / "py.typed").exists()
    stub = (package / "_core.pyi").read_text()
    for name in broadcl.__all__:
        if name not in ("Page", "check", "view", "__version__"):
            assert re.search(rf"^(class|def) {name}\b|^{name}\b", stub, re.MULTILINE), name
    assert "nanobind" not in stub
    undocumented = [
        f"{name}.{member}" for name in ("BroadPhase", "Delta") for member, value in vars(getattr(broadcl, name)).items()
        if not member.startswith("_") and not value.__doc__
    ]
    assert undocumented == []
