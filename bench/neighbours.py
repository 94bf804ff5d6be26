#!/usr/bin/env python3
"""All pairs of atoms within 3.5 A, and the squares of their distances, by BroadCL and by scipy's cKDTree:

    pip install . scipy MDAnalysisTests
    bench/neighbours.py [--cutoff 3.5] [--rounds 15]

From a float64 array of the 47,681 positions in adk_oplsaa.gro of MDAnalysisTests, everything built anew, on one thread: medians of
CPU times of rounds in which the ways take turns. The periodic box is ignored. All ways must find the same pairs.

    bench/neighbours.py --points 100000 [--rounds 3]

All points within a distance of each of so many random ones, about 8.7, in a tree that is there: BroadCL returns ids, cKDTree counts.

    bench/neighbours.py --points 100000 --nearest 8 [--rounds 3]

The 8 points that are nearest to each of them, with their distances; on one thread, too, medians of CPU times of rounds in turn.
"""

import argparse
import importlib.metadata
import importlib.util
import pathlib
import statistics
import sys
import time

import numpy as np

import broadcl


def positions() -> np.ndarray:
    """(n, 3) float64, in A."""
    package = importlib.util.find_spec("MDAnalysisTests")  # without its dependencies
    if package is None or package.origin is None:
        sys.exit("MDAnalysisTests, which has the atoms, is not installed: pip install --no-deps MDAnalysisTests")
    lines = (pathlib.Path(package.origin).parent / "data/adk_oplsaa.gro").read_text().splitlines()
    return np.array([[float(line[begin : begin + 8]) for begin in (20, 28, 36)] for line in lines[2 : 2 + int(lines[1])]]) * 10


def by_broadcl(points, cutoff):
    pairs = broadcl.overlapping_pairs(points, distance=cutoff, layout="points", threads=1)
    return pairs, broadcl.squared_distances(points, pairs, layout="points")


def by_query_pairs(points, cutoff):
    pairs = cKDTree(points).query_pairs(cutoff, output_type="ndarray")
    apart = points[pairs[:, 0]] - points[pairs[:, 1]]
    return pairs, np.einsum("ij,ij->i", apart, apart)


def by_distance_matrix(points, cutoff):
    tree = cKDTree(points)
    entries = tree.sparse_distance_matrix(tree, cutoff, output_type="ndarray")
    entries = entries[entries["i"] < entries["j"]]
    return np.stack([entries["i"], entries["j"]], axis=1), np.square(entries["v"])


def compare_queries(n, nearest, rounds):
    # Multiples of 1/1024, none of them exactly so far from another, so neither has to round, but for cKDTree's roots.
    radius = 1 + 1 / 2048
    side = (n * 4 / 3 * np.pi * radius**3 / 8.7) ** (1 / 3)
    points = np.round(np.random.default_rng(1).uniform(0, side, (n, 3)) * 1024) / 1024
    broad_phase = broadcl.BroadPhase(algorithm="sweep-and-prune", threads=1)
    broad_phase.update(points, layout="points")
    tree = cKDTree(points)
    if nearest:
        ours = lambda: broad_phase.nearest(points, limit=nearest, layout="points")
        theirs = lambda: tree.query(points, nearest)
        are_same = lambda hits, other: np.array_equal(np.round(np.square(other[0].ravel()) * 2**20), hits[2] * 2**20)
    else:
        ours = lambda: broad_phase.overlapping(points, within=radius, layout="points")
        theirs = lambda: tree.query_ball_point(points, radius, return_length=True)
        are_same = lambda hits, counts: np.array_equal(np.diff(hits[0]), counts)
    times = {"broadcl": [], "cKDTree": []}
    for _ in range(rounds):
        start = time.process_time()
        hits = ours()
        middle = time.process_time()
        others = theirs()
        times["broadcl"].append(1e3 * (middle - start))
        times["cKDTree"].append(1e3 * (time.process_time() - middle))
        assert are_same(hits, others), "they find others"
    broadcl_ms, tree_ms = (statistics.median(times[name]) for name in times)
    print(f"{n} points, {len(hits[1])} ids: broadcl {broadcl_ms:.1f} ms, cKDTree {tree_ms:.1f} ms, {broadcl_ms / tree_ms:.3f}")


def in_order(pairs, squares):
    order = np.lexsort(pairs.T)
    return pairs[order], squares[order]


parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--cutoff", type=float, default=3.5, metavar="A")
parser.add_argument("--rounds", type=int, default=15)
parser.add_argument("--points", type=int, metavar="N")
parser.add_argument("--nearest", type=int, metavar="K")
arguments = parser.parse_args()
try:
    from scipy.spatial import cKDTree
except ImportError:
    sys.exit("scipy, with which this compares, is not installed: pip install scipy")

if arguments.points:
    compare_queries(arguments.points, arguments.nearest, arguments.rounds)
    sys.exit()

atoms = positions()
ways = {"broadcl": by_broadcl, "cKDTree.query_pairs": by_query_pairs, "cKDTree.sparse_distance_matrix": by_distance_matrix}
expected, expected_squares = in_order(*by_broadcl(atoms, arguments.cutoff))
times = {name: [] for name in ways}
for _ in range(arguments.rounds):
    for name, way in ways.items():
        start = time.process_time()
        found = way(atoms, arguments.cutoff)
        times[name].append(1e3 * (time.process_time() - start))
        pairs, squares = in_order(*found)
        assert np.array_equal(pairs, expected), f"{name} finds other pairs"
        assert np.allclose(squares, expected_squares, rtol=1e-12), f"{name} finds other distances"
medians = {name: statistics.median(of) for name, of in times.items()}
versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in ("numpy", "scipy", "MDAnalysisTests"))
print(f"{len(atoms)} atoms, {len(expected)} pairs; broadcl {broadcl.__version__}, {versions}")
for name, median in medians.items():
    print(f"{name:32} {median:7.1f} ms   {median / medians['broadcl']:.2f}")
fastest = min(median for name, median in medians.items() if name != "broadcl")
print(f"broadcl takes {medians['broadcl'] / fastest:.2f} of cKDTree's faster way")
