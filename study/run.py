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

from study.plan import ALL, BULLETS, RECORDINGS, Plan, Run, StudyError
from study.store import ELSEWHERE, FORMAT, load, locked, read_document, store, write_document

UNCHANGED = 1.05  # times the CPU time of a run alone: as many runs as stay below share the machine
TRIED_FRAMES = 64
RECORDED_FRAMES = 150
RECORDED_OBJECTS = 1250


def say(line: str, end: str = "\n") -> None:
    print(f"\r{line}\033[K" if sys.stderr.isatty() else line, end=end, file=sys.stderr, flush=True)


# Of the machine, for a run: processors as taskset takes them, and the number of an NVIDIA GPU; all if empty.
Share = tuple[str, str]


class Program:
    """The program `broadcl`."""

    def __init__(self, path: str) -> None:
        self.path = path
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._is_stopped = False

    def __call__(self, *arguments: str, share: Share = ("", "")) -> str:
        """What it prints; StudyError with its error."""
        processors, gpu = share
        bound = ["taskset", "-c", processors] if processors else []
        environment = {**os.environ, "CUDA_VISIBLE_DEVICES": gpu} if gpu else None
        pipe = subprocess.PIPE
        try:
            with self._lock:
                if self._is_stopped:
                    raise StudyError("interrupted")
                process = subprocess.Popen([*bound, self.path, *arguments], text=True, stdout=pipe, stderr=pipe, env=environment)
                self._running.add(process)
        except OSError as error:
            raise StudyError(f"cannot start '{self.path}': {error.strerror}; build it, or name it with --program") from None
        try:
            out, error = process.communicate()
        except BaseException:
            process.terminate()
            raise
        with self._lock:
            self._running.discard(process)
        if process.returncode == 0:
            return out
        lines = error.strip().splitlines() or [f"it ended with {process.returncode}"]
        raise StudyError(lines[-1].removeprefix("broadcl: "))

    def stop(self) -> None:
        """Ends what runs, from whatever thread it was started."""
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

    def simulate(self, run: Run, plan: Plan, share: Share = ("", "")) -> tuple[dict[str, Any], str]:
        """The summary and the frames of a run."""
        with tempfile.TemporaryDirectory(prefix="broadcl-") as folder:
            csv, summary = Path(folder) / "run.csv", Path(folder) / "run.json"
            self("simulate", *_scene(run.scenario, run.objects, run.frames, plan), "--broadphase", run.broadphase,
                 *(["--device", plan.device] if plan.device else []), "--csv", str(csv), "--json", str(summary),
                 share=share)  # fmt: skip
            return json.loads(summary.read_bytes()), csv.read_text()


def _scene(scenario: str, objects: int, frames: int, plan: Plan) -> list[str]:
    return ["--scenario", scenario, "--objects", str(objects), "--frames", str(frames), "--seed", str(plan.seed)]


def label_of(device: dict[str, Any] | None) -> str:
    """"platform / name" of a device; empty for the host."""
    return f"{device['platform']} / {device['name']}" if device else ""


def _here(program: Program, plan: Plan) -> dict[str, Any]:
    """The machine and the versions, which must stay the same throughout a study."""
    for broadphase in [*(b for b in ALL if b in plan.broadphases and b not in BULLETS), BULLETS[0]]:
        with contextlib.suppress(StudyError):  # unless it works
            facts, _ = program.simulate(Run("free-fall", 1, broadphase, 1, 1), plan)
            break
    else:
        raise StudyError(f"'{program.path}' cannot simulate; see '{program.path} check'")
    if "cpu_milliseconds" not in facts:
        raise StudyError(f"'{program.path}' is of an older version than this study; build it again")
    cpu = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.M)
    return {
        **{name: facts["versions"][name] for name in ("broadcl", "bullet")},
        "cpu": cpu[1] if cpu else platform.machine(),
        "threads": len(os.sched_getaffinity(0)),
        "system": platform.freedesktop_os_release().get("PRETTY_NAME", platform.system()),
        "device": label_of(facts["device"]),
        "driver": facts["device"]["driver_version"] if facts["device"] else "",
    }


def _shares(jobs: int, gpus: int) -> list[Share]:
    """The share of each of so many runs at once; each of several GPUs is used in turn."""
    processors = sorted(os.sched_getaffinity(0))
    if jobs > len(processors):
        raise StudyError(f"--jobs {jobs}: there are only {len(processors)} processors")
    if jobs > 1 and shutil.which("taskset") is None:
        raise StudyError("--jobs needs taskset (Debian, Ubuntu: apt install util-linux)")
    ends = [len(processors) * k // jobs for k in range(jobs + 1)]
    lists = [",".join(map(str, processors[a:b])) for a, b in zip(ends, ends[1:])] if jobs > 1 else [""]
    return [(own, str(k % gpus) if gpus > 1 else "") for k, own in enumerate(lists)]


def _try_jobs(program: Program, plan: Plan, gpus: int) -> tuple[int, list[list[float]]]:
    """How many runs can share the machine, and what was measured: runs at once, and their thread's CPU time as a
    multiple of that of the same run alone, for the broad phase that suffers most."""
    names = [b for b in ("bullet-bvh", "gpu-bf", "auto") if b in plan.broadphases] or plan.broadphases[:1]
    objects = plan.objects[len(plan.objects) // 2]
    runs = [Run(plan.scenarios[-1], objects, name, 1, TRIED_FRAMES) for name in names]

    def cpu(run: Run, share: Share) -> float:
        return float(program.simulate(run, plan, share)[0]["cpu_milliseconds"]["total"]["mean"])

    found, jobs = [[1, 1.0]], max(2, gpus)
    while jobs <= len(os.sched_getaffinity(0)) and found[-1][1] <= UNCHANGED:
        shares = _shares(jobs, gpus)
        # Alone, but with as many processors as later.
        alone = {run: statistics.median(cpu(run, shares[0]) for _ in range(3)) for run in runs}
        together: dict[Run, list[float]] = {run: [] for run in runs}
        with ThreadPoolExecutor(jobs) as pool:
            for turn in range(len(runs)):  # so that each run was in each place
                at_once = [runs[(k + turn) % len(runs)] for k in range(jobs)]
                for run, milliseconds in zip(at_once, pool.map(cpu, at_once, shares)):
                    together[run].append(milliseconds)
        worst = max(statistics.median(times) / alone[run] for run, times in together.items())
        found.append([jobs, round(worst, 3)])
        say(f"{jobs} runs at once: CPU time of a run {worst:.3f} times that alone")
        jobs *= 2
    return int(max(jobs for jobs, ratio in found if ratio <= UNCHANGED)), found


@dataclass
class Settings:
    """What the command line says. None: as the study in the folder has it, otherwise the default."""

    out: Path
    program: str
    plan: Plan | None
    jobs: str | None  # a number, or "auto"
    gpus: int
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
    parts = [*(part.name for part in plan.parts), RECORDINGS]
    if settings.part not in (None, *parts):
        raise StudyError(f"no part is named '{settings.part}'; the parts of this study are: {', '.join(parts)}")
    if document and settings.part == RECORDINGS:  # which are the same everywhere
        return document
    tables = program.tables()
    without = [b.removesuffix("+culling") for b in plan.broadphases]
    for kind, key, names in (("scenario", "scenarios", plan.scenarios), ("broad phase", "broadphases", without)):
        known = tables[key]
        for name in names:
            if name not in known:
                raise StudyError(f"no {kind} is named '{name}'; the {kind}s are: {', '.join(known)}")
    here = _here(program, plan)
    if document:
        for key, value in document["here"].items():
            if value != here.get(key):
                raise StudyError(f"{holds}, with the {key} '{value}', but here it is '{here.get(key)}'; {ELSEWHERE}")
        return document
    gpus = settings.gpus
    jobs, tried = _try_jobs(program, plan, gpus) if settings.jobs == "auto" else (int(settings.jobs or 1), [])
    date = datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d %H:%M UTC")
    document = {"format": FORMAT, "command": settings.command, "date": date, "plan": plan, "jobs": jobs, "tried_jobs": tried}
    document |= {"shares": _shares(jobs, gpus), "here": here, "summaries": tables}
    write_document(settings.out, document)
    return document


def _measure(folder: Path, document: dict[str, Any], program: Program, deadline: float, runs: list[Run],
             done: int) -> tuple[int, list[str]]:  # fmt: skip
    """Does runs, as many at once as the study has shares of the processors. How many are done then, and a line per failure."""
    shares: queue.SimpleQueue[Share] = queue.SimpleQueue()
    for share in document["shares"]:
        shares.put(share)

    def measure_one(run: Run) -> bool:
        """Whether there was time for it."""
        if time.monotonic() > deadline:
            return False
        share = shares.get()
        try:
            facts, csv = program.simulate(run, document["plan"], share)
        finally:
            shares.put(share)
        store(folder, run, label_of(facts["device"]), csv)
        return True

    first, planned, begin, failed = done, done + len(runs), time.monotonic(), []
    with ThreadPoolExecutor(len(document["shares"])) as pool:
        try:
            futures = {pool.submit(measure_one, run): run for run in runs}
            for future in as_completed(futures):
                try:
                    if not future.result():
                        continue
                except StudyError as error:
                    failed.append(f"{futures[future].name}: {error}")
                    say(failed[-1])
                    continue
                done += 1
                minutes = (time.monotonic() - begin) / (done - first) * (planned - done) / 60
                if sys.stderr.isatty() or done * 10 // planned > (done - 1) * 10 // planned:
                    say(f"{done} of {planned} runs, about {minutes:.0f} min left", end="" if sys.stderr.isatty() else "\n")
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            program.stop()
            raise
    return done, failed


def _record(folder: Path, plan: Plan, program: Program) -> None:
    """One recording of each scenario for the replay. Pairs are found on the host, since each exact broad phase leads
    to the same run."""
    (folder / RECORDINGS).mkdir(exist_ok=True)
    objects = min(RECORDED_OBJECTS, plan.objects[len(plan.objects) // 2])
    frames = min(RECORDED_FRAMES, max(part.frames for part in plan.parts))
    for scenario in plan.scenarios:
        path = folder / RECORDINGS / f"{scenario}.npy"
        if not path.exists():
            program("simulate", *_scene(scenario, objects, frames, plan), "--broadphase", "sweep-and-prune", "--record", str(path))


def run_study(settings: Settings) -> bool:
    """Does the runs that are missing; whether all are done now."""
    deadline = time.monotonic() + 60 * (float("inf") if settings.minutes is None else settings.minutes)
    program = Program(settings.program)
    with locked(settings.out):
        document = _begin(settings, program)
        plan: Plan = document["plan"]
        runs = [] if settings.part == RECORDINGS else plan.in_order(plan.runs(settings.part))
        missing = []
        for run in runs:
            try:
                if load(settings.out, run) is None:
                    missing.append(run)
            except StudyError as error:
                say(f"{error}; the run is repeated")
                missing.append(run)
        done, failed = _measure(settings.out, document, program, deadline, missing, len(runs) - len(missing))
        if runs:
            say(f"{done} of {len(runs)} runs are done")
        if settings.part in (None, RECORDINGS) and not failed and time.monotonic() < deadline:
            _record(settings.out, plan, program)
    if failed:
        raise StudyError(f"{len(failed)} runs failed, the first of them {failed[0]}; give the same command to try them again")
    return done == len(runs)
