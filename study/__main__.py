"""The command line; see --help."""

from __future__ import annotations

import argparse
import asyncio
import shlex
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from study.plan import PRESETS, RECORDINGS, StudyError, plan_of
from study.run import Settings, run_study

UNDONE = 3  # exit status: the time was up before all runs were done
REPLACED = ("scenarios", "objects", "broadphases", "frames", "repeat")  # parts of a preset
ABOUT = """Installs what is missing, builds, simulates each combination of scenarios, numbers of objects and broad phases, stores
the times in a folder, and makes a page of them: DIR/index.html. Runs that are in the folder are not repeated: give the same
command, or just --out DIR, to continue a study."""
END = """
Other options replace what each part of the preset has. Exit status: 3 if --minutes were over before all runs were done.
Without the script: PYTHONPATH=SOURCES python3 -P -m study --program BROADCL."""


def _number(kind: Callable[[str], Any], least: float) -> Callable[[str], Any]:
    def parse(text: str) -> Any:
        try:
            number = kind(text)
        except ValueError:
            number = least - 1
        if not number >= least:
            raise argparse.ArgumentTypeError(f"'{text}' is not a number from {least}")
        return number

    return parse


def _list(parse: Callable[[str], Any]) -> Callable[[str], tuple[Any, ...]]:
    def parse_list(text: str) -> tuple[Any, ...]:
        values = [parse(element) if element else "" for element in text.split(",")]
        for value in values:
            if value == "" or values.count(value) > 1:
                raise argparse.ArgumentTypeError(f"'{value}' is given twice" if value else "an element of the list is empty")
        return tuple(values)

    return parse_list


def _parser() -> argparse.ArgumentParser:
    presets = "\n".join(f"  {name:10} {summary}" for name, (summary, _) in PRESETS.items())
    parser = argparse.ArgumentParser(prog="scripts/study", formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False,
                                     description=ABOUT, epilog=f"presets:\n{presets}\n{END}")  # fmt: skip
    whole = _number(int, 1)
    for name, metavar, kind, text in (
        ("out", "DIR", str, "the folder of the study"),
        ("preset", "NAME", str, "what to measure; see below; default: quick"),
        ("scenarios", "A,B", _list(str), "scenarios to simulate"),
        ("objects", "N,M", _list(whole), "numbers of objects"),
        ("broadphases", "A,B", _list(str), "broad phases to measure"),
        ("frames", "N", _number(int, 2), "frames per run"),
        ("repeat", "N", whole, "runs of each combination"),
        ("seed", "N", _number(int, 0), "of the simulations and their order; default: 1"),
        ("device", "D", str, "as for `broadcl simulate`; default: the best one, and for auto the host unless there is a GPU"),
        ("jobs", "N", whole, "runs at once, each with its share of the processors; default: 1"),
        ("gpus", "N", whole, "NVIDIA GPUs of a kind for these runs to use in turn; default: 1"),
        ("part", "NAME", str, f"only the runs of this part of the plan; {RECORDINGS}: only the recordings for the replay"),
        ("minutes", "M", _number(float, 0), "start no run after M minutes"),
        ("page", "DIR", str, "only make the page, of the study in DIR"),
        ("program", "FILE", str, "the program; default: what the script has built"),
    ):  # fmt: skip
        parser.add_argument(f"--{name}", metavar=metavar, type=kind, help=text)
    parser.add_argument("--no-page", action="store_true", help="make no page; needs only Python")
    return parser


def _settings(options: argparse.Namespace) -> Settings:
    given = {name: getattr(options, name) for name in ("preset", *REPLACED, "seed", "device")}
    texts = {name: ",".join(map(str, x)) if isinstance(x, tuple) else str(x) for name, x in given.items() if x is not None}
    plan = None
    if texts or not (Path(options.out) / "study.json").exists():
        texts = {"preset": "quick", **texts}
        replaced = {name: given[name] for name in REPLACED}
        plan = plan_of(texts["preset"], 1 if options.seed is None else options.seed, options.device or "", **replaced)
    command = " ".join(["scripts/study", *(f"--{name} {shlex.quote(text)}" for name, text in texts.items())])
    program = options.program or "broadcl"
    return Settings(Path(options.out), program, plan, options.jobs, options.gpus or 1, options.part, options.minutes, command)


def main() -> int:
    """Returns the exit status."""
    parser = _parser()
    options = parser.parse_args()
    if (options.out is None) == (options.page is None):
        parser.error("name the folder with --out, or one that is done with --page")
    try:
        is_done = options.page is not None or asyncio.run(run_study(_settings(options)))
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that files beside the page are removed
        if not options.no_page and options.part != RECORDINGS:
            from study.page import make  # needs more than Python

            print(make(Path(options.page or options.out)))
        return 0 if is_done else UNDONE
    except (StudyError, OSError) as error:
        print(f"study: {error}", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, asyncio.CancelledError):
        print("study: interrupted; give the same command to continue", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
