#!/usr/bin/env python3
"""All overlapping pairs of boxes by BroadCL and by other packages of PyPI, which need not all be installed:

    pip install . python-fcl rtree trimesh ipctk coal
    bench/python.py [--most 1000000] [--json FILE]

From a NumPy array of boxes to pairs, in ms: medians of rounds in which the packages take turns. "still" is a search from
scratch, "moving" a frame in which all boxes move. What is done once is left out: objects of coal and python-fcl, meshes of
ipctk and trimesh. Each list of pairs is compared with BroadCL's. A package is left out of the larger sizes once it would take
more than --budget seconds.
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


def cubes(n: int) -> np.ndarray:
    """n cubes of size 1, each of which overlaps about three. Multiples of 1/1024, so that no package has to round."""
    lower = np.random.default_rng(1).uniform(0, (8 * n / 3) ** (1 / 3), (n, 3))
    lower = np.round(lower * 1024) / 1024
    return np.hstack([lower, lower + 1]).astype(np.float32)


def moved(boxes: np.ndarray, frame: int) -> np.ndarray:
    step = np.random.default_rng(frame).integers(-102, 103, (len(boxes), 3)) / 1024
    return boxes + np.hstack([step, step]).astype(np.float32)


class BroadCL:
    package = "broadcl"

    def __init__(self, boxes, **config):
        self.config = config
        self.broad_phase = broadcl.BroadPhase(**config)
        self.moving(boxes)

    def still(self, boxes):
        return broadcl.overlapping_pairs(boxes, **self.config)

    def moving(self, boxes):
        self.broad_phase.boxes(len(boxes))[:] = boxes
        return self.broad_phase.update()

    def all_pairs(self, _):
        return self.broad_phase.pairs()


class OneThread(BroadCL):
    def __init__(self, boxes):
        super().__init__(boxes, algorithm="sweep-and-prune", threads=1)


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


METHODS = {
    "broadcl": BroadCL,
    "broadcl, one thread": OneThread,
    "rtree": Rtree,
    "coal": Coal,
    "python-fcl": Fcl,
    "trimesh": Trimesh,
    "ipctk LBVH": Ipctk,
    "ipctk SpatialHash": IpctkSpatialHash,
    "ipctk HashGrid": IpctkHashGrid,
    "ipctk SweepAndPrune": IpctkSweep,
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
        wrong = len(np.setxor1d(keys(pairs), keys(reference)))
    if wrong:
        sys.exit(f"{name}: {wrong} pairs missing or extra, of {len(reference)}")


def timed(function, *arguments):
    start = time.perf_counter()
    result = function(*arguments)
    return time.perf_counter() - start, result


def measure(n: int, rounds: int, budget: float, seconds: dict, names: list) -> list[dict]:
    still = cubes(n)
    subjects, rows = {}, {}
    for name in names:
        # Times grow at least linearly with the number of boxes.
        if name in seconds and seconds[name][1] * n / seconds[name][0] > budget:
            continue
        start, subject = timed(METHODS[name], still)
        subjects[name] = subject
        rows[name] = {"method": name, "boxes": n, "start_ms": start * 1e3, "still": [], "moving": []}
    for kind in ("still", "moving"):
        for turn in range(rounds):
            boxes = still if kind == "still" else moved(still, turn)
            reference = broadcl.overlapping_pairs(boxes)
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
    parser.add_argument("--json", help="write the results here too")
    arguments = parser.parse_args()

    versions, names = {}, []
    for name, method in METHODS.items():
        try:
            versions[method.package] = importlib.metadata.version(method.package)
            names.append(name)
        except importlib.metadata.PackageNotFoundError:
            print(f"{method.package} is not installed", file=sys.stderr)
    device = broadcl.BroadPhase().device
    where = f"{device or 'the host'}, {os.cpu_count()} cores"
    print(f"{where}; " + ", ".join(f"{package} {version}" for package, version in versions.items()), flush=True)

    results, seconds = [], {}
    for n in (1_000, 10_000, 100_000, 1_000_000):
        if n > arguments.most:
            break
        rows = measure(n, arguments.rounds, arguments.budget, seconds, names)
        print(f"\n{n:,} boxes, {rows[0]['pairs']:,} pairs\n{'':22}{'start':>12}{'still':>12}{'moving':>12}   ms")
        for row in rows:
            print(f"{row['method']:22}{row['start_ms']:12.2f}{row['still_ms']:12.2f}{row['moving_ms']:12.2f}", flush=True)
        results += rows
    if arguments.json:
        with open(arguments.json, "w", encoding="utf-8") as file:
            json.dump({"where": where, "versions": versions, "results": results}, file, indent=1)
            file.write("\n")


if __name__ == "__main__":
    main()
