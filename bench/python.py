#!/usr/bin/env python3
"""All overlapping pairs by BroadCL and by other packages of PyPI, which need not all be installed:

    pip install . python-fcl rtree trimesh ipctk coal shapely vesin scipy
    bench/python.py [--most 1000000] [--scene cubes] [--json FILE]

From a NumPy array to pairs, in ms: medians of rounds in which the packages take turns. "still" is a search from scratch, "moving" a
frame in which everything moves. There are three scenes:

    cubes      (n, 6) boxes in three dimensions
    squares    (n, 4) boxes in two
    points     (n, 3) points; pairs are those within a distance

What is done once is left out: objects of coal and python-fcl, meshes of ipctk and trimesh, geometries of shapely that do not move.
In a moving frame, "broadcl" gives the changes; all others give all pairs. Each list of pairs is compared with BroadCL's. A package is
left out of the larger sizes once it would take more than --budget seconds.
"""

import argparse
import importlib.metadata
import json
import os
import statistics
import sys
import time

import numpy as np

import broadcl


def random_points(n: int, dimensions: int, volume: float) -> np.ndarray:
    """n points, one per volume on average. Multiples of 1/1024, so that no package has to round."""
    points = np.random.default_rng(1).uniform(0, (volume * n) ** (1 / dimensions), (n, dimensions))
    return (np.round(points * 1024) / 1024).astype(np.float32)


def cubes(n: int) -> np.ndarray:
    """n cubes of size 1, each of which overlaps about three."""
    lower = random_points(n, 3, 8 / 3)
    return np.hstack([lower, lower + 1])


def squares(n: int) -> np.ndarray:
    """n squares of size 1, each of which overlaps about ten, as in rectangles.cpp."""
    lower = random_points(n, 2, 4 / 10)
    return np.hstack([lower, lower + 1])


# Points are at no multiple of 1/1024 from each other that is exactly this far.
CUTOFF = 1 + 1 / 2048


def points(n: int) -> np.ndarray:
    """n points, each of which has about 30 within the cut-off."""
    return random_points(n, 3, 4 / 3 * np.pi * CUTOFF**3 / 30)


def moved(things: np.ndarray, frame: int) -> np.ndarray:
    n, columns = things.shape
    dimensions = columns // 2 if columns % 2 == 0 else columns
    step = np.random.default_rng(frame).integers(-102, 103, (n, dimensions)) / 1024
    return things + np.tile(step, columns // dimensions).astype(np.float32)


class BroadCL:
    package = "broadcl"

    def __init__(self, boxes, **config):
        self.config = config
        self.broad_phase = broadcl.BroadPhase(**config)
        self.moving(boxes)

    def still(self, boxes):
        return broadcl.overlapping_pairs(boxes, **self.config)

    def moving(self, boxes):
        return self.broad_phase.update(boxes)

    def all_pairs(self, _):
        return self.broad_phase.pairs()


class Points(BroadCL):
    def __init__(self, points, **config):
        super().__init__(points, distance=CUTOFF, **config)

    def still(self, points):
        return broadcl.overlapping_pairs(points, layout="points", **self.config)

    def moving(self, points):
        return self.broad_phase.update(points, layout="points")


class CKDTree:
    package = "scipy"

    def __init__(self, points):
        from scipy.spatial import cKDTree

        self.tree = cKDTree

    def still(self, points):
        return self.tree(points).query_pairs(CUTOFF, output_type="ndarray")

    moving = still  # it is built anew


class Shapely:
    """Its STRtree reports each pair twice, and each box with itself."""

    package = "shapely"

    def __init__(self, boxes):
        import shapely

        self.shapely = shapely
        self.geometries = shapely.box(*boxes.T)

    def find(self, geometries):
        pairs = self.shapely.STRtree(geometries).query(geometries)
        return pairs[:, pairs[0] < pairs[1]].T

    def still(self, boxes):
        return self.find(self.geometries)

    def moving(self, boxes):
        return self.find(self.shapely.box(*boxes.T))


class Vesin:
    package = "vesin"
    threads = 0  # all

    def __init__(self, points):
        import vesin

        self.make = lambda: vesin.NeighborList(cutoff=CUTOFF, full_list=False, n_threads=self.threads)
        self.list = self.make()

    def find(self, neighbours, points):
        return neighbours.compute(points, box=np.zeros((3, 3), points.dtype), periodic=False, quantities="P")[0]

    def still(self, points):
        return self.find(self.make(), points)

    def moving(self, points):
        return self.find(self.list, points)


class VesinOneThread(Vesin):
    threads = 1


def one_thread(method):
    """A method of BroadCL, on one thread."""

    class OneThread(method):
        def __init__(self, boxes):
            super().__init__(boxes, algorithm="sweep-and-prune", threads=1)

    return OneThread


class Rtree:
    package = "rtree"

    def __init__(self, boxes):
        from rtree import index

        self.index = index

    def still(self, boxes):
        lower, upper = boxes[:, :3].astype(float), boxes[:, 3:].astype(float)
        properties = self.index.Property(dimension=3)
        tree = self.index.Index((np.arange(len(boxes)), lower, upper), properties=properties, interleaved=True)
        others, counts = tree.intersection_v(lower, upper)
        pairs = np.stack([np.repeat(np.arange(len(boxes)), counts.astype(np.int64)), others], axis=1)
        return pairs[pairs[:, 0] < pairs[:, 1]]

    moving = still  # it is built anew

    def all_pairs(self, found):
        return found


class Coal:
    """Its results stay in C++. The number of pairs and 1,000 of them are compared."""

    package = "coal"

    def __init__(self, boxes):
        import coal

        self.coal = coal
        shape = coal.Box(1, 1, 1)
        centres = (boxes[:, :3] + boxes[:, 3:]).astype(float) / 2
        self.objects = [coal.CollisionObject(shape, np.eye(3), centre) for centre in centres]
        self.manager = coal.DynamicAABBTreeCollisionManager()
        self.register()

    def register(self):
        for thing in self.objects:  # registerObjects() needs a list that Python cannot make
            self.manager.registerObject(thing)
        self.manager.setup()

    def find(self):
        collect = self.coal.CollisionCallBackCollect(8 * len(self.objects))  # pairs at most
        self.manager.collide(collect)
        return collect

    def still(self, boxes):
        self.manager.clear()
        self.register()
        return self.find()

    def moving(self, boxes):
        for thing, centre in zip(self.objects, (boxes[:, :3] + boxes[:, 3:]).astype(float) / 2):
            thing.setTranslation(centre)
            thing.computeAABB()
        self.manager.update()
        return self.find()

    def check(self, found, reference):
        """It has no other way to tell Python which pairs it found."""
        some = reference[:: max(1, len(reference) // 1000)]
        things = self.objects
        missing = [not (found.exist(things[a], things[b]) or found.exist(things[b], things[a])) for a, b in some]
        return sum(missing) + abs(found.numCollisionPairs() - len(reference))


class Fcl:
    """Its callback gets objects and collects them in a list."""

    package = "python-fcl"

    def __init__(self, boxes):
        import fcl

        self.fcl = fcl
        self.shape = fcl.Box(1, 1, 1)
        self.objects = [fcl.CollisionObject(self.shape, fcl.Transform(c)) for c in self.centres(boxes)]
        self.manager = fcl.DynamicAABBTreeCollisionManager()
        self.manager.registerObjects(self.objects)
        self.manager.setup()

    @staticmethod
    def centres(boxes):
        return (boxes[:, :3] + boxes[:, 3:]).astype(float) / 2

    def find(self):
        found = []

        def collect(a, b, _):
            found.append((a, b))
            return False

        self.manager.collide(None, collect)
        return found

    def still(self, boxes):
        self.manager.clear()
        self.manager.registerObjects(self.objects)
        self.manager.setup()
        return self.find()

    def moving(self, boxes):
        for thing, centre in zip(self.objects, self.centres(boxes)):
            thing.setTranslation(centre)
        self.manager.update()
        return self.find()

    def all_pairs(self, found):
        index = {tuple(thing.getTranslation()): k for k, thing in enumerate(self.objects)}
        pairs = [[index[tuple(thing.getTranslation())] for thing in pair] for pair in found]
        return np.array(pairs, np.uint32).reshape(-1, 2)


class Trimesh:
    """Its CollisionManager, which also tests the triangles of the cubes."""

    package = "trimesh"

    def __init__(self, boxes):
        import trimesh

        self.manager = trimesh.collision.CollisionManager()
        mesh = trimesh.creation.box((1, 1, 1))
        for k, transform in enumerate(self.transforms(boxes)):
            self.manager.add_object(str(k), mesh, transform)

    @staticmethod
    def transforms(boxes):
        for centre in (boxes[:, :3] + boxes[:, 3:]).astype(float) / 2:
            transform = np.eye(4)
            transform[:3, 3] = centre
            yield transform

    def still(self, boxes):
        return self.manager.in_collision_internal(return_names=True)[1]

    def moving(self, boxes):
        for k, transform in enumerate(self.transforms(boxes)):
            self.manager.set_transform(str(k), transform)
        return self.still(boxes)

    def all_pairs(self, found):
        return np.array([[int(a), int(b)] for a, b in found], np.uint32).reshape(-1, 2)


class Ipctk:
    """Each box as that of an edge between its corners. Its list of candidates is not turned into an array."""

    package = "ipctk"
    method = "LBVH"

    def __init__(self, boxes):
        import ipctk

        self.broad_phase = getattr(ipctk, self.method)()
        self.edges = np.arange(2 * len(boxes), dtype=np.int32).reshape(-1, 2)
        self.faces = np.empty((0, 3), np.int32)

    def still(self, boxes):
        self.broad_phase.build(boxes.reshape(-1, 3).astype(float), self.edges, self.faces)
        return self.broad_phase.detect_edge_edge_candidates()

    moving = still

    def all_pairs(self, found):
        return np.array([[pair.edge0_id, pair.edge1_id] for pair in found], np.uint32).reshape(-1, 2)


class IpctkHashGrid(Ipctk):
    method = "HashGrid"


class IpctkSweep(Ipctk):
    method = "SweepAndPrune"


class IpctkSpatialHash(Ipctk):
    method = "SpatialHash"


SCENES = {
    "cubes": (
        cubes,
        {
            "broadcl": BroadCL,
            "broadcl, one thread": one_thread(BroadCL),
            "rtree": Rtree,
            "coal": Coal,
            "python-fcl": Fcl,
            "trimesh": Trimesh,
            "ipctk LBVH": Ipctk,
            "ipctk SpatialHash": IpctkSpatialHash,
            "ipctk HashGrid": IpctkHashGrid,
            "ipctk SweepAndPrune": IpctkSweep,
        },
    ),
    "squares": (
        squares,
        {"broadcl": BroadCL, "broadcl, one thread": one_thread(BroadCL), "shapely STRtree": Shapely},
    ),
    "points": (
        points,
        {
            "broadcl": Points,
            "broadcl, one thread": one_thread(Points),
            "vesin": Vesin,
            "vesin, one thread": VesinOneThread,
            "cKDTree, one thread": CKDTree,
        },
    ),
}


def keys(pairs: np.ndarray) -> np.ndarray:
    pairs = np.sort(np.asarray(pairs, np.uint64), axis=1)
    return np.sort(pairs[:, 1] << np.uint64(32) | pairs[:, 0])


def compare(name: str, subject, found, reference: np.ndarray) -> None:
    """Ends the program if the pairs are not those of BroadCL."""
    if hasattr(subject, "check"):
        wrong = subject.check(found, reference)
    else:
        pairs = found if isinstance(found, np.ndarray) else subject.all_pairs(found)
        found, expected = keys(pairs), keys(reference)
        wrong = 0 if np.array_equal(found, expected) else max(1, len(np.setxor1d(found, expected)))
    if wrong:
        sys.exit(f"{name}: {wrong} pairs missing or extra, of {len(reference)}")


def is_installed(package: str) -> bool:
    try:
        importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def timed(function, *arguments):
    start = time.perf_counter()
    result = function(*arguments)
    return time.perf_counter() - start, result


def measure(scene: str, n: int, rounds: int, budget: float, seconds: dict) -> list[dict]:
    make, methods = SCENES[scene]
    still = make(n)
    check = methods["broadcl"](still)
    subjects, rows = {}, {}
    for name, method in methods.items():
        # Times grow at least linearly with the number of boxes.
        if not is_installed(method.package) or (name in seconds and seconds[name][1] * n / seconds[name][0] > budget):
            continue
        start, subject = timed(method, still)
        subjects[name] = subject
        rows[name] = {"scene": scene, "method": name, "boxes": n, "start_ms": start * 1e3, "still": [], "moving": []}
    for kind in ("still", "moving"):
        for turn in range(rounds):
            boxes = still if kind == "still" else moved(still, turn)
            reference = check.still(boxes)
            for name, subject in subjects.items():
                took, found = timed(getattr(subject, kind), boxes)
                rows[name][kind].append(took)
                if turn == rounds - 1:
                    compare(name, subject, found, reference)
    for name, row in rows.items():
        seconds[name] = n, max(max(row["still"]), max(row["moving"]), row["start_ms"] / 1e3)
        row["pairs"] = len(reference)
        row["still_ms"] = statistics.median(row.pop("still")) * 1e3
        row["moving_ms"] = statistics.median(row.pop("moving")) * 1e3
    return list(rows.values())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--most", type=int, default=1_000_000, help="boxes at most")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--budget", type=float, default=60, help="seconds that one search may take")
    parser.add_argument("--scene", choices=SCENES, help="only this one")
    parser.add_argument("--json", help="write the results here too")
    arguments = parser.parse_args()
    if arguments.json == "-":
        parser.error("--json: name a file")

    versions = {}
    for package in dict.fromkeys(method.package for _, methods in SCENES.values() for method in methods.values()):
        if is_installed(package):
            versions[package] = importlib.metadata.version(package)
        else:
            print(f"{package} is not installed", file=sys.stderr)
    device = broadcl.BroadPhase().device
    where = f"{device or 'the host'}, {os.cpu_count()} cores"
    print(f"{where}; " + ", ".join(f"{package} {version}" for package, version in versions.items()), flush=True)

    results = []
    for scene in [arguments.scene] if arguments.scene else SCENES:
        seconds: dict = {}
        for n in (1_000, 10_000, 100_000, 1_000_000):
            if n > arguments.most:
                break
            rows = measure(scene, n, arguments.rounds, arguments.budget, seconds)
            heading = f"{n:,} {scene}, {rows[0]['pairs']:,} pairs"
            print(f"\n{heading}\n{'':22}{'start':>12}{'still':>12}{'moving':>12}   ms")
            for row in rows:
                times = "".join(f"{row[key]:12.2f}" for key in ("start_ms", "still_ms", "moving_ms"))
                print(f"{row['method']:22}{times}", flush=True)
            results += rows
    if arguments.json:
        with open(arguments.json, "w", encoding="utf-8") as file:
            json.dump({"where": where, "versions": versions, "results": results}, file, indent=1)
            file.write("\n")


if __name__ == "__main__":
    main()
