#!/usr/bin/env python3
"""The extra time of a frame in the Python package compared with the same frame in C++, in microseconds:

    cmake --preset dev && cmake --build --preset dev --target broadcl_overhead
    pip install . && bench/overhead.py [--device cpu] [--algorithm tiles]

A few of the boxes move, or all of them, written in place. The fastest tenth of the frames, in rounds in which the two take
turns, each time in a new process, since it matters where the system puts a process and its memory. The last column is
the median of the rounds' ratios.
"""

import argparse
import multiprocessing
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

import broadcl

PROGRAM = Path(__file__).parents[1] / "build-dev/bench/broadcl_overhead"


def cubes(n: int) -> np.ndarray:
    lower = np.random.default_rng(1).uniform(0, (8 * n / 3) ** (1 / 3), (n, 3))
    return np.hstack([lower, lower + 1]).astype(np.float32)


def in_python(two: np.ndarray, moving: int, frames: int, algorithm: str, device: str) -> np.ndarray:
    n = len(two[0])
    broad_phase = broadcl.BroadPhase(algorithm=algorithm, device=device or None)
    ids = broad_phase.add(two[0])[:moving]
    few = two[:, :moving].copy()
    broad_phase.update()
    seconds = np.empty((frames, 2))
    for frame in range(1, frames + 1):
        start = time.perf_counter()
        if moving:
            broad_phase.move(ids, few[frame % 2])
        else:
            broad_phase.map(n)[:] = two[frame % 2]
        moved = time.perf_counter()
        broad_phase.update()
        end = time.perf_counter()
        seconds[frame - 1] = end - start, end - moved
    return seconds


def in_new_process(function, *arguments):
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(function, arguments)


def in_cpp(path: str, *arguments) -> np.ndarray:
    run = subprocess.run([PROGRAM, path, *map(str, arguments)], check=True, capture_output=True, text=True)
    return np.array(run.stdout.split(), float).reshape(-1, 2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="")
    parser.add_argument("--algorithm", default="auto")
    parser.add_argument("--rounds", type=int, default=7)
    arguments = parser.parse_args()
    where = broadcl.BroadPhase(algorithm=arguments.algorithm, device=arguments.device or None).device
    print(f"{arguments.algorithm} on {where or 'the host'}\n{'':32}{'C++':>10}{'Python':>10}{'more':>10}{'ratio':>8}")
    for n, moving, frames in ((1_000, 10, 2000), (64_000, 10, 300), (64_000, 640, 200), (64_000, 0, 60)):
        still = cubes(n)
        step = np.random.default_rng(2).uniform(-0.1, 0.1, (n, 3)).astype(np.float32)
        two = np.stack([still, still + np.hstack([step, step])])
        medians = []
        with tempfile.NamedTemporaryFile() as file:
            two.tofile(file.name)
            how = moving, frames, arguments.algorithm, arguments.device
            for _ in range(arguments.rounds):
                for times in (in_cpp(file.name, *how), in_new_process(in_python, two, *how)):
                    medians.append(np.quantile(times[frames // 5:], 0.1, axis=0) * 1e6)
        for column, name in enumerate(("frame", "update()")):
            cpp = [row[column] for row in medians[::2]]
            python = [row[column] for row in medians[1::2]]
            more = statistics.median(p - c for p, c in zip(python, cpp))
            ratio = statistics.median(p / c for p, c in zip(python, cpp))
            label = f"{n:,}, {moving or 'all'} move, {name}"
            print(f"{label:32}{statistics.median(cpp):10.1f}{statistics.median(python):10.1f}{more:10.1f}{ratio:8.3f}", flush=True)


if __name__ == "__main__":
    main()
