#!/usr/bin/env python3
"""BroadCL as a broad phase of ipctk, next to its own: pip install . ipctk, then bench/ipctk_cloth.py

Candidates for continuous collision detection between two frames of a folded cloth, from vertices to ipctk's Candidates, in ms:
medians of rounds in which the methods take turns. BroadCL's candidates must contain those of each of ipctk's methods, and be the
same after a test of the float64 boxes. "search" is BroadCL's share without the lists of Python objects that ipctk
requires: it accepts nothing else from a class in Python, and making each object takes a call.
"""

import argparse
import statistics
import sys
import time

import ipctk
import numpy as np

import broadcl


def cloth(size: int, opening: float) -> np.ndarray:
    """(size**2, 3) vertices of a folded sheet with ripples, where its halves come near each other."""
    u, v = np.meshgrid(np.linspace(-1.3, 1.3, size), np.linspace(0, 2, size), indexing="ij")
    fold = np.pi / 4 * opening
    turn = np.clip(u / fold, -1, 1) * np.pi / 2
    beyond = np.clip(np.abs(u) - fold, 0, None)
    ripples = 0.15 * np.sin(4 * v + 5 * u) * np.clip(2 * beyond, 0, 1)
    vertices = [opening / 2 * np.cos(turn) - beyond, v, opening / 2 * np.sin(turn) + ripples]
    return np.asfortranarray(np.stack(vertices, axis=-1).reshape(-1, 3))


def triangles(size: int) -> np.ndarray:
    corner = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).reshape(-1, 1)
    return np.vstack([corner + [0, 1, size], corner + [1, size + 1, size]]).astype(np.int32)


class BroadPhase(ipctk.BroadPhase):
    """Finds edge-edge and face-vertex candidates with BroadCL."""

    def name(self):
        return "BroadCL"

    def build(self, *arguments):
        *frames, edges, faces, radius = arguments
        lower, upper = np.minimum.reduce(frames), np.maximum.reduce(frames)
        # As ipctk does: by the radius, and outward at least to the next number.
        self.lower = np.nextafter(lower - radius, -np.inf)
        self.upper = np.nextafter(upper + radius, np.inf)
        self.edges, self.faces = edges, faces
        self.search_seconds = 0.0

    def clear(self):
        pass

    def bounds(self, elements):
        return self.lower[elements].min(axis=1), self.upper[elements].max(axis=1)

    def pairs(self, first, second=None):
        """Pairs of elements that have no vertex in common; an element is a row of vertices."""
        start = time.perf_counter()
        other = first if second is None else second
        pairs = broadcl.overlapping_pairs(self.bounds(first), None if second is None else self.bounds(second))
        a, b = first[pairs[:, 0]], other[pairs[:, 1]]
        common = np.zeros(len(pairs), bool)
        for column in range(a.shape[1]):
            for row in range(b.shape[1]):
                common |= a[:, column] == b[:, row]
        pairs = pairs[~common]
        self.search_seconds += time.perf_counter() - start
        return pairs

    def exact(self, pairs, first, second):
        """Those whose float64 boxes overlap."""
        (lower, upper), (lower_2, upper_2) = self.bounds(first), self.bounds(second)
        a, b = pairs.T
        return pairs[((lower[a] <= upper_2[b]) & (lower_2[b] <= upper[a])).all(axis=1)]

    def detect_edge_edge_candidates(self):
        return list(map(ipctk.EdgeEdgeCandidate, *self.pairs(self.edges).T.tolist()))

    def detect_face_vertex_candidates(self):
        vertices = np.arange(len(self.lower))[:, None]
        return list(map(ipctk.FaceVertexCandidate, *self.pairs(self.faces, vertices).T.tolist()))

    def detect_vertex_vertex_candidates(self):
        raise NotImplementedError("candidates of a mesh in three dimensions only")

    detect_edge_vertex_candidates = detect_edge_face_candidates = detect_vertex_vertex_candidates
    detect_face_face_candidates = detect_vertex_vertex_candidates


def as_arrays(candidates: ipctk.Candidates) -> tuple[np.ndarray, np.ndarray]:
    edges = [sorted((c.edge0_id, c.edge1_id)) for c in candidates.ee_candidates]
    faces = [(c.face_id, c.vertex_id) for c in candidates.fv_candidates]
    return tuple(np.unique(np.array(rows, np.int64).reshape(-1, 2), axis=0) for rows in (edges, faces))


def contains(all_rows: np.ndarray, rows: np.ndarray) -> bool:
    return len(np.unique(np.vstack([all_rows, rows]), axis=0)) == len(all_rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faces", type=int, nargs="+", default=[10_000, 50_000, 200_000])
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    print(f"broadcl {broadcl.__version__}, ipctk {ipctk.__version__}, {ipctk.get_num_threads()} threads")
    for count in arguments.faces:
        size = round((count / 2) ** 0.5) + 1
        before, after, faces = cloth(size, 0.31), cloth(size, 0.28), triangles(size)
        mesh = ipctk.CollisionMesh(before, ipctk.edges(faces), faces)
        methods = {"broadcl": BroadPhase(), "LBVH": ipctk.LBVH(), "HashGrid": ipctk.HashGrid(),
                   "SweepAndPrune": ipctk.SweepAndPrune(), "SpatialHash": ipctk.SpatialHash()}
        seconds = {name: [] for name in [*methods, "search"]}
        found = {}
        for _ in range(arguments.rounds):
            for name, method in methods.items():
                candidates = ipctk.Candidates()
                start = time.perf_counter()
                candidates.build(mesh, before, after, 0.0, method)
                seconds[name].append(time.perf_counter() - start)
                found[name] = candidates
            seconds["search"].append(methods["broadcl"].search_seconds)
        mine = methods["broadcl"]
        pairs = as_arrays(found.pop("broadcl"))
        mine.build(before, after, mesh.edges, mesh.faces, 0.0)
        vertices = np.arange(len(before))[:, None]
        exact = mine.exact(pairs[0], mine.edges, mine.edges), mine.exact(pairs[1], mine.faces, vertices)
        for name, candidates in found.items():
            for kind, all_rows, exact_rows, rows in zip(("edges", "faces"), pairs, exact, as_arrays(candidates)):
                if not contains(all_rows, rows):
                    sys.exit(f"{name}, {count} faces: BroadCL lacks candidates of {kind}")
                if not np.array_equal(exact_rows, rows):
                    sys.exit(f"{name}, {count} faces: {len(rows)} candidates of {kind}, BroadCL {len(exact_rows)} exact ones")
        print(f"\n{len(faces):,} faces: {len(pairs[0]):,} edge-edge and {len(pairs[1]):,} face-vertex candidates, "
              f"{sum(map(len, exact)):,} by float64")
        for name, times in seconds.items():
            print(f"{name:16}{statistics.median(times) * 1e3:10.1f} ms", flush=True)


if __name__ == "__main__":
    main()
