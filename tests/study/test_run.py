"""Running a plan, with a stand-in for the program."""

from __future__ import annotations

import gzip
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from study import store

TINY = "--out s --scenarios free-fall,mixed-sizes --objects 5,6 --broadphases bullet-bvh,tiles --frames 3 --repeat 2"


class Runner:
    """The command line, in a folder of its own."""

    def __init__(self, folder: Path, program: Path) -> None:
        self.folder, self.program, self.out = folder, program, folder / "s"

    def start(self, arguments: str, **environment: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "study", "--program", str(self.program), "--no-page", *arguments.split()]
        # A shell makes what it starts in the background ignore SIGINT.
        return subprocess.Popen(command, cwd=self.folder, text=True, stderr=subprocess.PIPE,
                                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
                                env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), **environment})  # fmt: skip

    def __call__(self, arguments: str = TINY, status: int = 0, **environment: str) -> str:
        """What it says on stderr."""
        process = self.start(arguments, **environment)
        error = process.communicate()[1]
        assert process.returncode == status and "Traceback" not in error, error
        return error

    @property
    def files(self) -> dict[str, tuple[int, bytes]]:
        return {path.name: (path.stat().st_mtime_ns, path.read_bytes()) for path in self.out.glob("runs/*")}

    @property
    def calls(self) -> list[str]:
        """Of the program."""
        return (self.folder / "log").read_text().splitlines()


@pytest.fixture
def run(tmp_path: Path, program: Path) -> Runner:
    (tmp_path / "log").touch()
    return Runner(tmp_path, program)


def test_stores_each_run_and_continues_with_nothing(run: Runner) -> None:
    assert "16 of 16 runs are done" in (said := run()) and "recording mixed-sizes" in said
    document = store.read_document(run.out)
    assert document and document["here"]["device"] == "P / D" and document["shares"] == [["", ""]]
    assert set(run.files) == {f"{r.name}.csv.gz" for r in document["plan"].runs()}
    device, csv = store.load(run.out, document["plan"].runs()[-1]) or ("", "")
    assert device == "P / D" and csv.splitlines()[-1] == "2,1,0.5,4,1,0.5,3.5,2"
    assert sorted(path.name for path in (run.out / "recordings").iterdir()) == ["free-fall.npy", "mixed-sizes.npy"]
    before, calls = run.files, len(run.calls)
    run()
    run("--out s")
    assert run.files == before and len(run.calls) == calls + 2  # which look at the machine


def test_continues_after_an_interruption(run: Runner) -> None:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        (run.folder / "log").write_text("")
        process = run.start(f"{TINY} --jobs {min(2, len(os.sched_getaffinity(0)))}", WAITS="mixed-sizes")
        while not any("mixed" in call for call in run.calls):
            time.sleep(0.01)
        process.send_signal(number)
        error = process.communicate(timeout=30)[1]
        assert "Traceback" not in error and ("interrupted" in error) == (number != signal.SIGKILL)
        commands = subprocess.run(["ps", "-eo", "args"], text=True, stdout=subprocess.PIPE, check=True).stdout
        assert number == signal.SIGKILL or str(run.program) not in commands
    before = run.files
    assert before.keys() == {name for name in before if name.startswith("free-fall")}
    run("--out s")
    after = run.files
    assert len(after) == 16 and {name: after[name] for name in before} == before


def test_repeats_damaged_runs_and_no_others(run: Runner) -> None:
    run()
    before, name = run.files, "free-fall-5-tiles-1.csv.gz"
    for spoiled in (b"", before[name][1][:-9], gzip.compress(b'""\nframe\n')):
        (run.out / "runs" / name).write_bytes(spoiled)
        assert f"{name}' is damaged" in (error := run()) and "the run is repeated" in error
    assert {n for n, file in run.files.items() if file != before[n]} == {name}


def test_refuses_another_plan_machine_version_and_a_second_study(run: Runner) -> None:
    run()
    before, path = run.files, run.out / "study.json"
    text = path.read_text()
    assert "holds the study 'scripts/study --preset quick" in run("--out s --preset paper", 2)
    assert "of 1 runs at once; leave --jobs out" in run("--out s --jobs 2", 2)
    for key, here in (("broadcl", "1.2.3"), ("driver", "1")):
        document = json.loads(text)
        document["here"][key] = "0.1"
        path.write_text(json.dumps(document))
        assert f"with the {key} '0.1', but here it is '{here}'; name another folder" in run("--out s", 2)
    for spoiled, message in ((text.replace('"format": 2', '"format": 1'), "another version"), (text[:100], "is damaged")):
        path.write_text(spoiled)
        assert message in run("--out s", 2)
    path.unlink()
    assert "has runs but no study.json" in run("--out s", 2)
    path.write_text(text)
    with store.locked(run.out):
        assert "another study is running in 's'" in run("--out s", 2)
    assert run.files == before


@pytest.mark.parametrize(("how", "message"), [("FAILS", "it fails"), ("ENDS", "No such file")])
def test_goes_on_with_the_others_if_a_run_fails(run: Runner, how: str, message: str) -> None:
    error = run(status=2, **{how: "mixed-sizes"})
    assert "8 of 16 runs are done" in error and "8 runs failed" in error and message in error and len(run.files) == 8
    assert "16 of 16" in run()


def test_parts_minutes_and_jobs(run: Runner) -> None:
    assert "0 of 16 runs are done" in run(f"{TINY} --minutes 0", 3)
    run("--out s --part recordings")
    assert not run.files and (run.out / "recordings" / "free-fall.npy").exists()
    assert "no part is named 'x'; the parts of this study are: all, recordings" in run("--out s --part x", 2)
    (run.folder / "log").write_text("")
    jobs = min(2, threads := len(os.sched_getaffinity(0)))
    run(f"{TINY} --out t --jobs {jobs} --gpus 2")
    shares = json.loads((run.folder / "t" / "study.json").read_text())["shares"]
    processors = [p for share, _ in shares for p in share.split(",") if p]
    assert len(shares) == jobs and len(set(processors)) == len(processors) == threads * (jobs > 1)
    gpus = set("01"[:jobs])
    assert {gpu for _, gpu in shares} == gpus
    assert {call[-1] for call in run.calls if "free-fall --objects 5" in call} <= gpus


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--out s --preset slow", "no preset is named 'slow'; the presets are: quick, paper"),
        ("--out s --scenarios free-fall,x", "no scenario is named 'x'; the scenarios are: free-fall, mixed-sizes"),
        ("--out s --scenarios free-fall --broadphases x", "no broad phase is named 'x'"),
        ("--out s --objects 5,5", "'5' is given twice"),
        ("--out s --objects 5,", "an element of the list is empty"),
        ("--out s --frames 1", "'1' is not a number from 2"),
        ("--out s --jobs 1000000", "there are only"),
        ("--out s --program ./none", "cannot start './none'"),
        ("--out log/s", "cannot make the folder 'log/s'"),
        ("", "name the folder with --out"),
    ],
)
def test_bad_arguments_get_one_line_and_leave_nothing(run: Runner, arguments: str, message: str) -> None:
    options = "" if "--scenarios" in arguments else " --scenarios free-fall --broadphases tiles"
    assert message in run(arguments + options, 2).splitlines()[-1] and not (run.out / "study.json").exists()
