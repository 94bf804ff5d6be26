"""python -m broadcl: see --help."""

from __future__ import annotations

import argparse
import contextlib
import io
import math
import os
import pathlib
import shutil
import sys
import zipfile
from typing import IO

import numpy as np

import broadcl


def _devices(_: argparse.Namespace) -> int:
    found = broadcl.devices()
    try:
        default = broadcl.select_device().id
    except broadcl.Error as error:
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
                file.write(pairs.data)
            if os.path.lexists(target):
                shutil.copymode(target, temporary)  # refuses a link to itself
            temporary.replace(target)
        except BaseException:
            temporary.unlink()
            raise
    except OSError as error:
        raise ValueError(f"cannot write {name}: {error.strerror or error}") from error


def _array(file: IO[bytes]) -> np.ndarray:
    if file.read(len(np.lib.format.MAGIC_PREFIX)) != np.lib.format.MAGIC_PREFIX:
        raise ValueError("it is not a NumPy array: the magic bytes of .npy are missing")
    file.seek(0)
    array = np.lib.format.read_array(file)
    if file.read(1):
        raise ValueError(f"it has more data than its shape {array.shape} needs")
    return array


def _load(name: str) -> np.ndarray:
    """The array in a .npy file, or the only one in a .npz archive."""
    try:
        with open(name, "rb") as file:
            is_archive = file.read(2) == b"PK"
            file.seek(0)
            if not is_archive:
                return _array(file)
            with zipfile.ZipFile(file) as archive:
                members = archive.namelist()
                if len(members) != 1:
                    raise ValueError(f"it holds {_counted(len(members), 'array')}; give a file with one")
                with archive.open(members[0]) as member:
                    return _array(member)
    except (OSError, MemoryError):
        raise
    except Exception as error:  # NumPy and zipfile raise many kinds for damaged files
        reason = str(error).partition("\n")[0]
        if "allow_pickle" in reason:
            reason = "its dtype is object; float32 or float64 is needed"
        raise ValueError(f"cannot read {name}: {reason}") from error


def _counted(count: int, noun: str) -> str:
    """"1 box", "2 boxes", "3 pairs"."""
    ending = "" if count == 1 else "es" if noun.endswith("x") else "s"
    return f"{count} {noun}{ending}"


def _inverted(boxes: np.ndarray) -> int:
    """How many boxes have a lower bound above the upper one."""
    lower, upper = np.split(boxes.reshape(len(boxes), math.prod(boxes.shape[1:])), 2, axis=1)
    return int(np.count_nonzero((lower > upper).any(axis=1)))


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
    print(f"{_counted(len(pairs), 'overlapping pair')} of {_counted(len(boxes), 'box')}")
    if inverted := _inverted(boxes):
        axes = "x, y" if boxes.shape[-1] == 4 else "x, y, z"
        print(
            f"{_counted(inverted, 'box')} {'is' if inverted == 1 else 'are'} inverted (min > max) and ignored; "
            f"are the columns min {axes}, max {axes}?"
        )
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
    verb.add_argument("file", metavar="FILE", help=".npy, or .npz with one array: (n, 6), (n, 2, 3) or (n, 4), float32 or float64")
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
