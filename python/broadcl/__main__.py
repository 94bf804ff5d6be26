"""python -m broadcl: see --help."""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import pathlib
import shutil
import sys

import numpy as np

import broadcl


def _devices(_: argparse.Namespace) -> int:
    found = broadcl.devices()
    if not found:
        print("No OpenCL device: the algorithms of the host work without one.")
        return 0
    default = broadcl.select_device().id
    for device in found:
        mark = "*" if device.id == default else " "
        print(f"{mark} {device.id}  {device.type}  {device}  {device.memory / 2**30:.1f} GiB  {device.driver_version}")
    print("* is the default.")
    return 0


def _check(arguments: argparse.Namespace) -> int:
    results = broadcl.check(arguments.device)
    for algorithm, result in results.items():
        print(f"{algorithm:16} {result}")
    works = set(results.values()) == {"right"}
    print("BroadCL works here." if works else "BroadCL does not work here.")
    return 0 if works else 1


def _save(name: str, pairs: np.ndarray) -> None:
    """Replaces the file when all is written, unless it is a pipe or the like. Links stay."""
    target = pathlib.Path(os.path.realpath(name))
    if target.exists() and not target.is_file():
        with target.open("wb") as file:
            np.save(file, pairs)
        return
    temporary = target.with_name(f".broadcl.{os.getpid()}.tmp")
    try:
        file = temporary.open("xb")
        try:
            with file:  # np.save() would overlook a full disk
                np.lib.format.write_array_header_1_0(file, np.lib.format.header_data_from_array_1_0(pairs))
                file.write(pairs)
            if os.path.lexists(target):
                shutil.copymode(target, temporary)  # refuses a link to itself
            temporary.replace(target)
        except BaseException:
            temporary.unlink()
            raise
    except OSError as error:
        raise ValueError(f"cannot write {name}: {error.strerror or error}") from error


def _load(name: str) -> np.ndarray:
    try:
        boxes = np.load(name)
    except (OSError, MemoryError):
        raise
    except Exception as error:  # NumPy raises many kinds for damaged files
        reason = str(error).partition("\n")[0]
        raise ValueError(f"cannot read {name}: {reason}") from error
    if not isinstance(boxes, np.ndarray):
        raise ValueError(f"{name} holds several arrays; give a .npy file")
    return boxes


def _pairs(arguments: argparse.Namespace) -> int:
    suffix = pathlib.Path(arguments.out or "").suffix
    if suffix not in ("", ".npy"):
        raise ValueError(f"--out: pairs are written as .npy, not as {suffix}: {arguments.out}")
    if arguments.out is not None and os.path.exists(arguments.out) and os.path.samefile(arguments.file, arguments.out):
        raise ValueError("--out names the file of the boxes itself; name another")
    boxes = _load(arguments.file)
    if boxes.ndim < 2 or boxes.shape == (2, 3):
        raise ValueError(f"{arguments.file} is of shape {boxes.shape}; give an array of boxes, for instance (n, 6)")
    pairs = broadcl.overlapping_pairs(boxes, device=arguments.device, algorithm=arguments.algorithm)
    if arguments.out is not None:
        _save(arguments.out, pairs)
    print(f"{len(pairs)} overlapping pairs of {len(boxes)} boxes")
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
    parser = argparse.ArgumentParser(prog="python -m broadcl", description="Overlapping pairs of boxes.")
    parser.add_argument("--version", action="version", version=broadcl.__version__)
    verbs = parser.add_subparsers(required=True, metavar="VERB")
    device = '"P:D", gpu, cpu, accelerator, or a part of the name'

    verb = verbs.add_parser("devices", help="list the OpenCL devices that can be used")
    verb.set_defaults(run=_devices)

    verb = verbs.add_parser("check", help="compare every algorithm on a device with the oracle")
    verb.add_argument("--device", help=device)
    verb.set_defaults(run=_check)

    verb = verbs.add_parser("pairs", help="find all overlapping pairs of an array of boxes")
    verb.add_argument("file", metavar="FILE", help=".npy: (n, 6), (n, 2, 3) or (n, 4), float32 or float64")
    verb.add_argument("--out", metavar="FILE", help="write the pairs here: .npy, (m, 2) uint32")
    verb.add_argument("--device", help=device)
    verb.add_argument("--algorithm", default="auto", help=", ".join(broadcl.algorithms()))
    verb.set_defaults(run=_pairs)

    arguments = parser.parse_args()
    try:
        output = io.StringIO()
        with contextlib.redirect_stdout(output):
            result = arguments.run(arguments)
        _write(output.getvalue())
        return result
    except (broadcl.Error, OSError, TypeError, ValueError, MemoryError) as error:
        print(f"broadcl: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
