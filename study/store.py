"""The folder of a study: study.json, one file in runs/ per run that is done, recordings/. Needs nothing but Python.

Every file appears whole or not at all, so that a study may be interrupted at any moment and continued later.
"""

from __future__ import annotations

import contextlib
import fcntl
import gzip
import json
import os
import re
import zlib
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from study.plan import Plan, Run, StudyError

FORMAT = 2
KEYS = ("command", "date", "shares", "here", "summaries")
# Milliseconds by the wall clock, and of the CPU of the thread that simulates; as `broadcl simulate --csv` writes them.
COLUMNS = "frame,update_ms,broad_phase_ms,total_ms,update_cpu_ms,broad_phase_cpu_ms,total_cpu_ms,pairs"
ELSEWHERE = "name another folder with --out"


def write(path: Path, data: bytes) -> None:
    """Writes a file under another name, and renames it."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        beside.write_bytes(data)
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise StudyError(f"cannot write '{path}': {error.strerror}") from None


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Makes the folder, and keeps other studies out of it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise StudyError(f"cannot make the folder '{folder}': {error.strerror}") from None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError:
        raise StudyError(f"another study is running in '{folder}'; wait for its end, or {ELSEWHERE}") from None
    finally:
        os.close(descriptor)


def read_document(folder: Path) -> dict[str, Any] | None:
    """study.json, with a Plan in "plan"; None if the study has not begun."""
    path = folder / "study.json"
    try:
        document = json.loads(path.read_bytes())
        if document["format"] != FORMAT:
            raise StudyError(f"'{path}' was written by another version; {ELSEWHERE}")
        return {key: document[key] for key in ("format", *KEYS)} | {"plan": Plan.from_json(document["plan"])}
    except FileNotFoundError:
        if (folder / "runs").exists():
            raise StudyError(f"'{folder}' has runs but no study.json; {ELSEWHERE}") from None
        return None
    except OSError as error:
        raise StudyError(f"cannot read '{path}': {error.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise StudyError(f"'{path}' is damaged; {ELSEWHERE}") from None


def write_document(folder: Path, document: dict[str, Any]) -> None:
    data = {**document, "plan": asdict(document["plan"])}
    write(folder / "study.json", (json.dumps(data, indent=2, ensure_ascii=False) + "\n").encode())


def store(folder: Path, run: Run, device: str, csv: str) -> None:
    """Stores a run: a line with the device, then what `broadcl simulate --csv` has written, with five digits of each time."""
    csv = re.sub(r"\d+\.\d+", lambda time: f"{float(time[0]):.5g}", csv)
    if problem := _problem(run, csv):
        raise StudyError(f"the program's times cannot be used: {problem}")
    write(folder / "runs" / f"{run.name}.csv.gz", gzip.compress(f"{json.dumps(device)}\n{csv}".encode(), mtime=0))


def load(folder: Path, run: Run) -> tuple[str, str] | None:
    """The device (empty for the host) and the CSV of a run; None if it is not done. StudyError if its file is damaged."""
    path = folder / "runs" / f"{run.name}.csv.gz"
    try:
        first, _, csv = gzip.decompress(path.read_bytes()).decode().partition("\n")
        device, problem = str(json.loads(first)), _problem(run, csv)
    except FileNotFoundError:
        return None
    except (OSError, EOFError, ValueError, zlib.error):
        problem = "it is not a file of a run"
    if problem:
        raise StudyError(f"'{path}' is damaged: {problem}")
    return device, csv


def _problem(run: Run, csv: str) -> str | None:
    """What is wrong with the frames of a run."""
    head, *lines = csv.splitlines() or [""]
    if head != COLUMNS:
        return f"its columns are not '{COLUMNS}'"
    if not csv.endswith("\n") or len(lines) != run.frames:
        return f"it has not {run.frames} frames"
    row = re.compile(r"(\d+)" + r",\d+(?:\.\d+)?(?:e[-+]\d+)?" * COLUMNS.count(","))
    for frame, line in enumerate(lines):
        match = row.fullmatch(line)
        if not match or int(match[1]) != frame:
            return f"frame {frame} is malformed"
    return None
