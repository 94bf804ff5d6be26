"""The command line; see --help."""

from __future__ import annotations

import argparse
import shlex
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from study.errors import StudyError
from study.plan import PRESETS, plan_of
from study.run import Settings, run_study

UNDONE = 3  # exit status: the time was up before all runs were done


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
        elements = [element.strip() for element in text.split(",")]
        if "" in elements:
            raise argparse.ArgumentTypeError("an element of the list is empty")
        values = [parse(element) for element in elements]
        for value in values:
            if values.count(value) > 1:
                raise argparse.ArgumentTypeError(f"'{value}' is given twice")
        return tuple(values)

    return parse_list


def _jobs(text: str) -> str:
    return text if text == "auto" else str(_number(int, 1)(text))


def _parser() -> argparse.ArgumentParser:
    summaries = "".join(f"  {name:10} {summary}\n" for name, (summary, _) in PRESETS.items())
    parser = argparse.ArgumentParser(
        prog="scripts/study",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
        description="Installs what is missing, builds, simulates each combination of scenarios, numbers of objects and "
        "broad\nphases, stores the times in a folder, and makes a page of them: DIR/index.html. Runs that are in the\n"
        "folder are not repeated: give the same command, or just --out DIR, to continue a study.",
        epilog=f"presets:\n{summaries}\nOther options replace what each part of the preset has. Exit status: 3 if --minutes "
        "were over before all\nruns were done. Without the script: PYTHONPATH=SOURCES python3 -P -m study.",
    )
    whole, least_two = _number(int, 1), _number(int, 2)
    parser.add_argument("--out", metavar="DIR", help="the folder of the study")
    parser.add_argument("--preset", metavar="NAME", help="what to measure; see below; default: quick")
    parser.add_argument("--scenarios", metavar="A,B", type=_list(str), help="scenarios to simulate")
    parser.add_argument("--objects", metavar="N,M", type=_list(whole), help="numbers of objects")
    parser.add_argument("--broadphases", metavar="A,B", type=_list(str), help="broad phases to measure")
    parser.add_argument("--frames", metavar="N", type=least_two, help="frames per run")
    parser.add_argument("--repeat", metavar="N", type=whole, help="runs of each combination")
    parser.add_argument("--seed", metavar="N", type=_number(int, 0), help="of simulations and their order; default: 1")
    parser.add_argument("--device", metavar="D", help="as for `broadcl simulate`; default: the best one, and for auto the host "
                        "unless there is a GPU")
    parser.add_argument("--jobs", metavar="N", type=_jobs, help="runs at once, each with its share of the processors; auto: as many "
                        "as leave CPU times unchanged within 5 %%, which is measured first; default: 1")
    parser.add_argument("--part", metavar="NAME", help="only the runs of this part of the plan; `recordings`: only the recordings "
                        "for the replay")
    parser.add_argument("--minutes", metavar="M", type=_number(float, 0), help="start no run after M minutes")
    parser.add_argument("--no-page", action="store_true", help="make no page; needs only Python")
    parser.add_argument("--page", metavar="DIR", help="only make the page, of the study in DIR")
    parser.add_argument("--program", metavar="FILE", default="broadcl", help="the program; default: what the script has built")
    return parser


def _settings(options: argparse.Namespace) -> Settings:
    given = {k: getattr(options, k) for k in ("scenarios", "objects", "broadphases", "frames", "repeat")}
    words = [f"--preset {options.preset or 'quick'}"]
    for name, value in (*given.items(), ("seed", options.seed), ("device", options.device)):
        if value is not None:
            words.append(f"--{name} {shlex.quote(','.join(map(str, value)) if isinstance(value, tuple) else str(value))}")
    plan = None
    if options.preset is not None or len(words) > 1 or not (Path(options.out) / "study.json").exists():
        seed = 1 if options.seed is None else options.seed
        plan = plan_of(options.preset or "quick", seed, options.device or "", **given)
    command = " ".join(["scripts/study", *words])
    return Settings(Path(options.out), options.program, plan, options.jobs, options.part, options.minutes, command)


def _run(options: argparse.Namespace) -> int:
    folder = Path(options.page or options.out)
    is_done = True
    if options.page is None:
        is_done = run_study(_settings(options))
    if not options.no_page and options.part != "recordings":
        from study.page import make  # needs more than Python

        print(make(folder))
    return 0 if is_done else UNDONE


def main() -> int:
    """Returns the exit status."""
    parser = _parser()
    options = parser.parse_args()
    if (options.out is None) == (options.page is None):
        parser.error("name the folder with --out, or one that is done with --page")
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return _run(options)
    except (StudyError, OSError) as error:
        print(f"study: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("study: interrupted; give the same command to continue", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
