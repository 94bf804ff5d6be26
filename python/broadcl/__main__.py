"""python -m broadcl: see --help."""

from __future__ import annotations

import argparse
import contextlib
import io
import sys
from pathlib import Path

from . import Error, __version__, _view, check, devices, select_device


def _devices(_: argparse.Namespace) -> int:
    found = devices()
    try:
        default = select_device().id
    except Error as error:
        if found:
            raise
        print(f"{error}\nThe algorithms of the host work without a device.")
        return 0
    for device in found:
        mark = "*" if device.id == default else " "
        print(f"{mark} {device.id}  {device.type}  {device}  {device.memory / 2**30:.1f} GiB  {device.driver_version}")
    print("* is the default.")
    return 0


def _check(arguments: argparse.Namespace) -> int:
    results = check(arguments.device)
    for algorithm, result in results.items():
        print(f"{algorithm:16} {result}")
    works = set(results.values()) == {"right"}
    print("BroadCL works here." if works else "BroadCL does not work here.")
    return 0 if works else 1


def _view_file(arguments: argparse.Namespace) -> int:
    file = Path(arguments.file)
    out = Path(arguments.out or f"{file.stem}.html")
    page = _view.view_file(file)
    try:
        page.save(out)
    except OSError as error:
        raise ValueError(f"cannot write '{out}': {error.strerror}") from error
    print(f"'{out}' ({len(page.html.encode()) / 1000:,.0f} kB); open it in a browser")
    return 0


def _write(text: str) -> None:
    try:
        if sys.stdout is None:
            raise ValueError("cannot write to standard output: it is closed")
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError as error:
        sys.stdout = None  # otherwise Python tries again when it ends
        raise ValueError(f"cannot write to standard output: {error.strerror}") from error


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m broadcl", description="Does BroadCL work here, and what do boxes look like?")
    parser.add_argument("--version", action="version", version=__version__)
    verbs = parser.add_subparsers(required=True, metavar="VERB")

    verb = verbs.add_parser("devices", help="list the OpenCL devices that can be used")
    verb.set_defaults(run=_devices)

    verb = verbs.add_parser("check", help="compare every algorithm on a device with the oracle")
    verb.add_argument("--device", help='"P:D", gpu, cpu, accelerator, or a part of the name')
    verb.set_defaults(run=_check)

    verb = verbs.add_parser("view", help="make a page in which boxes can be seen")
    verb.add_argument("file", metavar="FILE", help="boxes: .npy, .npz or .csv, or a recording: .aabbs")
    verb.add_argument("--out", metavar="PAGE", help="default: the name of FILE with .html, in this folder")
    verb.set_defaults(run=_view_file)

    arguments = parser.parse_args()
    try:
        output = io.StringIO()
        with contextlib.redirect_stdout(output):
            result = arguments.run(arguments)
        _write(output.getvalue())
        return result
    except (Error, ValueError, MemoryError) as error:
        print(f"broadcl: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
