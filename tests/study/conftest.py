"""A stand-in for the program `broadcl`, and a small study with known times."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from study import store
from study.plan import Part, Plan, Run

# It logs each call, fails in scenarios that the variable FAILS names, only ends in those of ENDS, and waits in those of WAITS.
PROGRAM = """#!{python} -S
import json, os, sys, time
if "--help" in sys.argv:
    sys.exit(print("Scenarios:\\n  free-fall  falls\\n  mixed-sizes all\\nBroad phases:\\n  bullet-bvh trees\\n  tiles  tiles\\n"))
options = dict(zip(sys.argv[2::2], sys.argv[3::2]))
print(*sys.argv[1:], "on GPU", os.environ.get("CUDA_VISIBLE_DEVICES"), file=open({log!r}, "a"))
if options["--scenario"] in os.environ.get("FAILS", ""):
    sys.exit(print("broadcl: it fails", file=sys.stderr) or 2)
if options["--scenario"] in os.environ.get("ENDS", ""):
    sys.exit()
if options["--scenario"] in os.environ.get("WAITS", ""):
    time.sleep(60)
if "--record" in options:
    sys.exit(open(options["--record"], "w").close())
rows = [f"{{frame}},1.0,0.5,4.0,1.0,0.5,3.5,{{frame}}" for frame in range(int(options["--frames"]))]
print({columns!r}, *rows, sep="\\n", file=open(options["--csv"], "w"))
device = None if options["--broadphase"] == "bullet-bvh" else dict(platform="P", name="D", driver_version="1")
summary = dict(versions=dict(broadcl="1.2.3", bullet="3.24"), device=device, cpu_milliseconds=dict(total=dict(mean=3.5)))
json.dump(summary, open(options["--json"], "w"))
"""

SMALL = Plan("small", (
    Part("short", ("free-fall", "mixed-sizes"), (10, 20), ("bullet-bvh", "tiles", "auto"), 6, 5),
    Part("long", ("free-fall",), (20,), ("bullet-bvh", "tiles"), 9, 5),
    Part("never", ("free-fall",), (20,), ("gpu-bf",), 6, 5),
))  # fmt: skip
DEVICE = "Some <GPU>"
# CPU time, milliseconds per frame with 10 objects, twice as long with 20: update, broad phase, total. Outside of the first two, tiles
# take 1.5 and auto 1.65: they differ by 10 %. Tiles work on a device. By the wall clock, auto was disturbed.
TIMES = {"bullet-bvh": (2.0, 0.5, 4.0), "tiles": (0.1, 0.4, 2.0), "auto": (0.1, 0.38, 2.13)}
WALL = {"bullet-bvh": 1, "tiles": 1, "auto": 3}


@pytest.fixture
def program(tmp_path: Path) -> Path:
    path = tmp_path / "broadcl"
    path.write_text(PROGRAM.format(python=sys.executable, log=str(tmp_path / "log"), columns=store.COLUMNS))
    path.chmod(0o755)
    return path


def csv_of(run: Run) -> str:
    """Repeats differ by a thousandth."""
    cpu = np.array(TIMES[run.broadphase]) * run.objects / 10 * (1 + 0.001 * (run.repeat - 3))
    times = ",".join(f"{x:.6f}" for x in (*cpu * WALL[run.broadphase], *cpu))
    return "\n".join([store.COLUMNS, *(f"{k},{times},{k * run.objects}" for k in range(run.frames))]) + "\n"


@pytest.fixture
def small_study(tmp_path: Path) -> Path:
    """A folder with all runs of SMALL but those of gpu-bf, and one recording."""
    folder = tmp_path / "study"
    here = {"broadcl": "1.2.3", "bullet": "3.24", "cpu": "A <CPU>", "threads": 2, "system": "S", "device": DEVICE, "driver": "1"}
    summaries = {"scenarios": {"free-fall": "falls", "mixed-sizes": "mixed"}, "broadphases": {b: b for b in (*TIMES, "gpu-bf")}}
    document = {"format": store.FORMAT, "command": "scripts/study", "date": "2020-01-02", "plan": SMALL}
    document |= {"here": here, "summaries": summaries, "shares": [["0,1", "0"], ["2,3", "1"]]}
    store.write_document(folder, document)
    for run in SMALL.runs():
        if run.broadphase in TIMES:
            store.store(folder, run, DEVICE if run.broadphase == "tiles" else "", csv_of(run))
    low = np.random.default_rng(7).uniform(-3, 3, (6, 10, 3)).cumsum(axis=0)
    (folder / "recordings").mkdir()
    np.save(folder / "recordings" / "free-fall.npy", np.concatenate([low, low + 1], axis=2).astype(np.float32))
    return folder
