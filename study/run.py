"""Runs the simulations of a plan, each in a process of its own, and stores them. Needs nothing but Python."""

from __future__ import annotations

import asyncio
import contextlib
import datetime
import json
import os
import platform
import re
import signal
import sys
import tempfile
import time
from asyncio.subprocess import PIPE
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from study.plan import ALL, BULLETS, RECORDINGS, Plan, Run, StudyError
from study.store import ELSEWHERE, FORMAT, load, locked, read_document, store, write_document

RECORDED_FRAMES = 150
RECORDED_OBJECTS = 1250


def say(line: str, end: str = "\n") -> None:
    print(f"\r{line}\033[K" if sys.stderr.isatty() else line, end=end, file=sys.stderr, flush=True)


# The part of the machine that a run uses: processors as taskset takes them, and the number of an NVIDIA GPU; empty means all.
Share = tuple[str, str]


class Program:
    """The program `broadcl`."""

    def __init__(self, path: str) -> None:
        self.path = path

    async def __call__(self, *arguments: str, share: Share = ("", "")) -> str:
        """What it prints; StudyError with its error."""
        processors, gpu = share
        command = [*(["taskset", "-c", processors] if processors else []), self.path, *arguments]
        environment = {**os.environ, "CUDA_VISIBLE_DEVICES": gpu} if gpu else None
        try:
            process = await asyncio.create_subprocess_exec(*command, stdout=PIPE, stderr=PIPE, env=environment)
        except OSError as error:
            raise StudyError(f"cannot start '{command[0]}': {error.strerror}; build it, or name it with --program") from None
        try:
            out, errors = await process.communicate()
        finally:
            if process.returncode is None:  # cancelled
                process.terminate()
                await process.wait()
        if process.returncode == 0:
            return out.decode()
        lines = errors.decode(errors="replace").strip().splitlines() or [f"it ended with {process.returncode}"]
        raise StudyError(lines[-1].removeprefix("broadcl: "))

    async def tables(self) -> dict[str, dict[str, str]]:
        """Scenarios and broad phases: what its help says of each."""
        text = await self("simulate", "--help")
        tables = {}
        for key, title in (("scenarios", "Scenarios"), ("broadphases", "Broad phases")):
            rows = re.search(rf"^{title}:\n((?:  .*\n)+)", text, re.MULTILINE)
            if not rows:
                raise StudyError(f"'{self.path}' cannot simulate; it must be built with Bullet")
            tables[key] = dict(re.findall(r"^  (\S+) +(.*)$", rows[1], re.MULTILINE))
        return tables

    async def simulate(self, run: Run, plan: Plan, share: Share = ("", "")) -> tuple[dict[str, Any], str]:
        """The summary and the frames of a run."""
        with tempfile.TemporaryDirectory(prefix="broadcl-") as folder:
            csv, summary = Path(folder) / "run.csv", Path(folder) / "run.json"
            await self("simulate", *_scene(run.scenario, run.objects, run.frames, plan), "--broadphase", run.broadphase,
                       *(["--device", plan.device] if plan.device else []), "--csv", str(csv), "--json", str(summary),
                       share=share)  # fmt: skip
            return json.loads(summary.read_bytes()), csv.read_text()


def _scene(scenario: str, objects: int, frames: int, plan: Plan) -> list[str]:
    return ["--scenario", scenario, "--objects", str(objects), "--frames", str(frames), "--seed", str(plan.seed)]


def label_of(device: dict[str, Any] | None) -> str:
    """"platform / name" of a device; empty for the host."""
    return f"{device['platform']} / {device['name']}" if device else ""


async def _here(program: Program, plan: Plan) -> dict[str, Any]:
    """The machine and the versions, which must stay the same throughout a study."""
    for broadphase in [*(b for b in ALL if b in plan.broadphases and b not in BULLETS), BULLETS[0]]:
        with contextlib.suppress(StudyError):  # unless it works
            facts, _ = await program.simulate(Run("free-fall", 1, broadphase, 1, 1), plan)
            break
    else:
        raise StudyError(f"'{program.path}' cannot simulate; see '{program.path} check'")
    cpu = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
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
    ends = [len(processors) * k // jobs for k in range(jobs + 1)]
    lists = [",".join(map(str, processors[a:b])) for a, b in pairwise(ends)] if jobs > 1 else [""]
    return [(own, str(k % gpus) if gpus > 1 else "") for k, own in enumerate(lists)]


@dataclass
class Settings:
    """What the command line says. None: as the study in the folder has it, otherwise the default."""

    out: Path
    program: str
    plan: Plan | None
    jobs: int | None
    gpus: int
    part: str | None
    minutes: float | None  # after which no run is started
    command: str


async def _begin(settings: Settings, program: Program) -> dict[str, Any]:
    """study.json: as it is, if this continues it; otherwise new, and written."""
    document = read_document(settings.out)
    holds = f"'{settings.out}' holds the study '{document['command']}'" if document else ""
    if document and settings.plan not in (None, document["plan"]):
        raise StudyError(f"{holds}; give its options or none to continue it, or {ELSEWHERE}")
    if document and settings.jobs not in (None, len(document["shares"])):
        raise StudyError(f"{holds}, of {len(document['shares'])} runs at once; leave --jobs out, or {ELSEWHERE}")
    plan = document["plan"] if document else settings.plan
    parts = [*(part.name for part in plan.parts), RECORDINGS]
    if settings.part not in (None, *parts):
        raise StudyError(f"no part is named '{settings.part}'; the parts of this study are: {', '.join(parts)}")
    if document and settings.part == RECORDINGS:  # which are the same everywhere
        return document
    tables = await program.tables()
    without = [b.removesuffix("+culling") for b in plan.broadphases]
    for kind, key, names in (("scenario", "scenarios", plan.scenarios), ("broad phase", "broadphases", without)):
        if unknown := [name for name in names if name not in tables[key]]:
            raise StudyError(f"no {kind} is named '{unknown[0]}'; the {kind}s are: {', '.join(tables[key])}")
    here = await _here(program, plan)
    if document:
        for key, value in document["here"].items():
            if value != here.get(key):
                raise StudyError(f"{holds}, with the {key} '{value}', but here it is '{here.get(key)}'; {ELSEWHERE}")
        return document
    date = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    document = {"format": FORMAT, "command": settings.command, "date": date, "plan": plan}
    document |= {"shares": _shares(settings.jobs or 1, settings.gpus), "here": here, "summaries": tables}
    write_document(settings.out, document)
    return document


async def _measure(folder: Path, document: dict[str, Any], program: Program, deadline: float, runs: list[Run],
                   done: int) -> tuple[int, list[str]]:  # fmt: skip
    """Does runs, as many at once as the study has shares of the processors. How many are done then, and a line per failure."""
    shares: asyncio.Queue[Share] = asyncio.Queue()
    for share in document["shares"]:
        shares.put_nowait(share)
    first, planned, begin, failed = done, done + len(runs), time.monotonic(), []

    async def measure_one(run: Run) -> None:
        nonlocal done
        share = await shares.get()
        try:
            if time.monotonic() > deadline:
                return
            facts, csv = await program.simulate(run, document["plan"], share)
            store(folder, run, label_of(facts["device"]), csv)
        except (StudyError, OSError, ValueError) as error:
            failed.append(f"{run.name}: {error}")
            say(failed[-1])
            return
        finally:
            shares.put_nowait(share)
        done += 1
        minutes = (time.monotonic() - begin) / (done - first) * (planned - done) / 60
        if sys.stderr.isatty() or done * 10 // planned > (done - 1) * 10 // planned:
            say(f"{done} of {planned} runs, about {minutes:.0f} min left", end="" if sys.stderr.isatty() else "\n")

    async with asyncio.TaskGroup() as group:
        for run in runs:
            group.create_task(measure_one(run))
    return done, failed


async def _record(folder: Path, plan: Plan, program: Program) -> None:
    """One recording of each scenario for the replay. Pairs are found on the host, since each exact broad phase leads
    to the same run."""
    (folder / RECORDINGS).mkdir(exist_ok=True)
    objects = min(RECORDED_OBJECTS, plan.objects[len(plan.objects) // 2])
    frames = min(RECORDED_FRAMES, max(part.frames for part in plan.parts))
    for scenario in plan.scenarios:
        path = folder / RECORDINGS / f"{scenario}.npy"
        if not path.exists():
            say(f"recording {scenario} for the replay")
            scene = _scene(scenario, objects, frames, plan)
            await program("simulate", *scene, "--broadphase", "sweep-and-prune", "--record", str(path))


async def run_study(settings: Settings) -> bool:
    """Does the runs that are missing; whether all are done now."""
    deadline = time.monotonic() + 60 * (float("inf") if settings.minutes is None else settings.minutes)
    program = Program(settings.program)
    if task := asyncio.current_task():
        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    with locked(settings.out):
        document = await _begin(settings, program)
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
        done, failed = await _measure(settings.out, document, program, deadline, missing, len(runs) - len(missing))
        if runs:
            say(f"{done} of {len(runs)} runs are done")
        if settings.part in (None, RECORDINGS) and not failed and time.monotonic() < deadline:
            await _record(settings.out, plan, program)
    if failed:
        raise StudyError(f"{len(failed)} runs failed, the first of them {failed[0]}; give the same command to try them again")
    return done == len(runs)
