"""Runs the simulations of a plan, each in a process of its own, and stores them. Needs nothing but Python."""

from __future__ import annotations

import contextlib
import datetime
import json
import os
import platform
import queue
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from study.errors import StudyError
from study.plan import RECORDINGS, Plan, Run
from study.store import ELSEWHERE, FORMAT, load, locked, read_document, store, write_document

UNCHANGED = 1.05  # times the CPU time of a run alone: as many runs at once as stay below share the machine
TRIED_FRAMES = 64
RECORDED_FRAMES = 300
RECORDED_OBJECTS = 3500
ON_DEVICE = ("gpu-bf", "brute-force", "tiles", "auto", "auto+culling")


class Program:
    """The program `broadcl`. Its runs end if stop() is called."""

    def __init__(self, path: str) -> None:
        self.path = path
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._is_stopped = False

    def __call__(self, *arguments: str, processors: str = "") -> str:
        """What it prints; StudyError with its error.

        processors: a list as taskset takes it, to which the process is bound; all if empty.
        """
        bound = ["taskset", "-c", processors] if processors else []
        pipe = subprocess.PIPE
        try:
            with self._lock:
                if self._is_stopped:
                    raise StudyError("interrupted")
                process = subprocess.Popen([*bound, self.path, *arguments], text=True, stdout=pipe, stderr=pipe)
                self._running.add(process)
        except OSError as error:
            raise StudyError(f"cannot start '{self.path}': {error.strerror}; build it, or name it with --program") from None
        out, error = process.communicate()
        with self._lock:
            self._running.discard(process)
        if process.returncode == 0:
            return out
        lines = error.strip().splitlines() or [f"it ended with {process.returncode}"]
        raise StudyError(lines[-1].removeprefix("broadcl: "))

    def stop(self) -> None:
        with self._lock:
            self._is_stopped = True
            for process in self._running:
                process.terminate()

    def tables(self) -> dict[str, dict[str, str]]:
        """Scenarios and broad phases: what its help says of each."""
        text = self("simulate", "--help")
        tables = {}
        for key, title in (("scenarios", "Scenarios"), ("broadphases", "Broad phases")):
            rows = re.search(rf"^{title}:\n((?:  .*\n)+)", text, re.M)
            if not rows:
                raise StudyError(f"'{self.path}' cannot simulate; it must be built with Bullet")
            tables[key] = dict(re.findall(r"^  (\S+) +(.*)$", rows[1], re.M))
        return tables

    def simulate(self, run: Run, plan: Plan, processors: str = "") -> tuple[dict[str, Any], str]:
        """The summary and the frames of a run."""
        with tempfile.TemporaryDirectory(prefix="broadcl-") as folder:
            csv, summary = Path(folder) / "run.csv", Path(folder) / "run.json"
            arguments = ["--scenario", run.scenario, "--objects", str(run.objects), "--frames", str(run.frames)]
            arguments += ["--seed", str(plan.seed), "--broadphase", run.broadphase]
            if plan.device:
                arguments += ["--device", plan.device]
            self("simulate", *arguments, "--csv", str(csv), "--json", str(summary), processors=processors)
            return json.loads(summary.read_bytes()), csv.read_text()


def label_of(device: dict[str, Any] | None) -> str:
    """"platform / name" of a device; empty for the host."""
    return f"{device['platform']} / {device['name']}" if device else ""


def _here(program: Program, plan: Plan) -> dict[str, Any]:
    """The machine and the versions, which must stay the same throughout a study."""
    probed = [b for b in ON_DEVICE if b in plan.broadphases] + ["bullet-bvh"]
    for broadphase in probed:  # the first that works
        with contextlib.suppress(StudyError):
            facts, _ = program.simulate(Run("free-fall", 1, broadphase, 1, 1), plan)
            break
    else:
        raise StudyError(f"'{program.path}' cannot simulate; see '{program.path} check'")
    if "cpu_milliseconds" not in facts:
        raise StudyError(f"'{program.path}' is of an older version than this study; build it again")
    cpu = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.M)
    device = facts["device"] or {}
    return {
        "broadcl": facts["versions"]["broadcl"],
        "bullet": facts["versions"]["bullet"],
        "cpu": cpu[1] if cpu else platform.machine(),
        "threads": len(os.sched_getaffinity(0)),
        "system": platform.freedesktop_os_release().get("PRETTY_NAME", platform.system()),
        "device": label_of(device),
        "driver": device.get("driver_version", ""),
    }


def _shares(jobs: int) -> list[str]:
    """The processors of each of so many runs at once."""
    if jobs == 1:
        return [""]
    if shutil.which("taskset") is None:
        raise StudyError("--jobs needs taskset (Debian, Ubuntu: apt install util-linux)")
    all_of_them = sorted(os.sched_getaffinity(0))
    ends = [len(all_of_them) * k // jobs for k in range(jobs + 1)]
    return [",".join(map(str, all_of_them[a:b])) for a, b in zip(ends, ends[1:])]


def _try_jobs(program: Program, plan: Plan) -> tuple[int, list[list[float]]]:
    """How many runs can share the machine, and what was measured: runs at once, and their thread's CPU time as a
    multiple of that of the same run alone, for the broad phase that suffers most."""
    names = [b for b in ("bullet-bvh", "gpu-bf", "auto") if b in plan.broadphases] or plan.broadphases[:1]
    objects = plan.objects[len(plan.objects) // 2]
    runs = [Run(plan.scenarios[-1], objects, name, 1, TRIED_FRAMES) for name in names]

    def cpu(run: Run, processors: str) -> float:
        return float(program.simulate(run, plan, processors)[0]["cpu_milliseconds"]["total"]["mean"])

    # Alone, but with as many processors as they get later.
    found = [[1, 1.0]]
    most = len(os.sched_getaffinity(0))
    jobs = 2
    while jobs <= most:
        shares = _shares(jobs)
        alone = {run: statistics.median(cpu(run, shares[0]) for _ in range(3)) for run in runs}
        together: dict[Run, list[float]] = {run: [] for run in runs}
        with ThreadPoolExecutor(jobs) as pool:
            for turn in range(len(runs)):  # so that each run was in each place
                at_once = [runs[(k + turn) % len(runs)] for k in range(jobs)]
                for run, time_of_run in zip(at_once, pool.map(cpu, at_once, shares)):
                    together[run].append(time_of_run)
        worst = max(statistics.median(times) / alone[run] for run, times in together.items())
        found.append([jobs, round(worst, 3)])
        say(f"{jobs} runs at once: CPU time of a run {worst:.3f} times that alone")
        if worst > UNCHANGED:
            break
        jobs *= 2
    return int(max(jobs for jobs, ratio in found if ratio <= UNCHANGED)), found


@dataclass
class Settings:
    """What the command line says. None: as the study in the folder has it, otherwise the default."""

    out: Path
    program: str
    plan: Plan | None
    jobs: str | None  # a number, or "auto"
    part: str | None
    minutes: float | None  # after which no run is started
    command: str


def _begin(settings: Settings, program: Program) -> dict[str, Any]:
    """study.json: as it is, if this continues it; otherwise new, and written."""
    document = read_document(settings.out)
    holds = f"'{settings.out}' holds the study '{document['command']}'" if document else ""
    if document and settings.plan not in (None, document["plan"]):
        raise StudyError(f"{holds}; give its options or none to continue it, or {ELSEWHERE}")
    if document and settings.jobs not in (None, "auto", str(document["jobs"])):
        raise StudyError(f"{holds}, of {document['jobs']} runs at once; leave --jobs out, or {ELSEWHERE}")
    plan = document["plan"] if document else settings.plan
    if settings.part not in (None, RECORDINGS, *(part.name for part in plan.parts)):
        names = ", ".join([*(part.name for part in plan.parts), RECORDINGS])
        raise StudyError(f"no part is named '{settings.part}'; the parts of this study are: {names}")
    if document and settings.part == RECORDINGS:  # which are the same everywhere
        return document
    tables = program.tables()
    for kind, names in (("scenario", plan.scenarios), ("broad phase", [b.removesuffix("+culling") for b in plan.broadphases])):
        known = tables[kind.replace(" ", "") + "s"]
        for name in names:
            if name not in known:
                raise StudyError(f"no {kind} is named '{name}'; the {kind}s are: {', '.join(known)}")
    here = _here(program, plan)
    if document:
        for key, value in document["here"].items():
            if value != here.get(key):
                raise StudyError(f"{holds}, with the {key} '{value}', but here it is '{here.get(key)}'; {ELSEWHERE}")
        return document
    tried: list[list[float]] = []
    if settings.jobs == "auto":
        jobs, tried = _try_jobs(program, plan)
    else:
        jobs = int(settings.jobs or 1)
    document = {
        "format": FORMAT,
        "command": settings.command,
        "date": _now(),
        "plan": plan,
        "jobs": jobs,
        "tried_jobs": tried,
        "shares": _shares(jobs),
        "here": here,
        "summaries": tables,
    }
    write_document(settings.out, document)
    return document


def _now() -> str:
    return datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d %H:%M UTC")


def say(line: str, end: str = "\n") -> None:
    print(f"\r{line}\033[K" if sys.stderr.isatty() else line, end=end, file=sys.stderr, flush=True)


class Progress:
    """Says how many runs are done: always on a terminal, otherwise after each tenth of them."""

    def __init__(self, done: int, all_runs: int) -> None:
        self.done, self.all_runs = done, all_runs
        self._first, self._begin = done, time.monotonic()

    def advance(self) -> None:
        self.done += 1
        left = (time.monotonic() - self._begin) / (self.done - self._first) * (self.all_runs - self.done) / 60
        line = f"{self.done} of {self.all_runs} runs, about {left:.0f} min left"
        if sys.stderr.isatty():
            say(line, end="")
        elif self.done * 10 // self.all_runs > (self.done - 1) * 10 // self.all_runs:
            say(line)


class _Measurement:
    """Does runs, as many at once as the study has shares of the processors."""

    def __init__(self, folder: Path, document: dict[str, Any], program: Program, deadline: float | None) -> None:
        self.folder, self.document, self.program, self.deadline = folder, document, program, deadline
        self.shares: queue.SimpleQueue[str] = queue.SimpleQueue()
        for share in document["shares"]:
            self.shares.put(share)

    def measure(self, runs: list[Run], progress: Progress) -> list[str]:
        """Returns one line per run that failed."""
        failed = []
        with ThreadPoolExecutor(len(self.document["shares"])) as pool:
            futures = {pool.submit(self._one, run): run for run in runs}
            try:
                for future in as_completed(futures):
                    try:
                        if future.result():
                            progress.advance()
                    except StudyError as error:
                        failed.append(f"{futures[future].name}: {error}")
                        say(failed[-1])
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                self.program.stop()
                raise
        return failed

    def _one(self, run: Run) -> bool:
        """Whether there was time for it."""
        if self.deadline is not None and time.monotonic() > self.deadline:
            return False
        share = self.shares.get()
        try:
            facts, csv = self.program.simulate(run, self.document["plan"], share)
        finally:
            self.shares.put(share)
        device, versions, here = facts["device"], facts["versions"], self.document["here"]
        if versions["broadcl"] != here["broadcl"] or (device and label_of(device) != here["device"]):
            raise StudyError("the program or the device is another one than at the start of the study")
        store(self.folder, run, {"device": label_of(device), "date": _now()}, csv)
        return True


def _record(folder: Path, plan: Plan, program: Program) -> None:
    """One recording of each scenario for the replay. Pairs are found on the host, since each exact broad phase leads
    to the same run."""
    recordings = folder / RECORDINGS
    recordings.mkdir(exist_ok=True)
    objects = str(min(RECORDED_OBJECTS, plan.objects[len(plan.objects) // 2]))
    frames = str(min(RECORDED_FRAMES, max(part.frames for part in plan.parts)))
    for scenario in plan.scenarios:
        path = recordings / f"{scenario}.npy"
        if not path.exists():
            program("simulate", "--scenario", scenario, "--objects", objects, "--frames", frames, "--seed", str(plan.seed),
                    "--broadphase", "sweep-and-prune", "--record", str(path))


def run_study(settings: Settings) -> bool:
    """Does the runs that are missing; whether all are done now."""
    deadline = None if settings.minutes is None else time.monotonic() + 60 * settings.minutes
    program = Program(settings.program)
    with locked(settings.out):
        document = _begin(settings, program)
        plan: Plan = document["plan"]
        missing = []
        runs = [] if settings.part == RECORDINGS else plan.in_order(plan.runs(settings.part))
        for run in runs:
            try:
                if load(settings.out, run) is None:
                    missing.append(run)
            except StudyError as error:
                say(f"{error}; the run is repeated")
                missing.append(run)
        progress = Progress(len(runs) - len(missing), len(runs))
        failed = _Measurement(settings.out, document, program, deadline).measure(missing, progress)
        if runs:
            say(f"{progress.done} of {len(runs)} runs are done")
        if settings.part in (None, RECORDINGS) and not failed and (deadline is None or time.monotonic() < deadline):
            _record(settings.out, plan, program)
    if failed:
        raise StudyError(f"{len(failed)} runs failed, the first of them {failed[0]}; give the same command to try them again")
    return progress.done == len(runs)
