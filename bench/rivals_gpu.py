#!/usr/bin/env python3
"""Overlapping pairs of moving boxes by BroadCL, by the BVH of NVIDIA Warp, by the broad phases of Newton and by PyTorch, on one GPU:

    pip install . warp-lang newton torch pyopencl
    bench/rivals_gpu.py [--sizes 3500 16000] [--worlds 4096] [--json FILE]

Packages that are not installed are left out. The scenes are those of updates.json: n cubes whose centres are uniform in the unit
cube, with an edge such that each overlaps about four others ("uniform"), or with three classes of sizes and about 20 overlaps
("mixed"). In every frame each cube moves by a tenth of the edge. Medians in microseconds, after three frames, of --frames frames,
by default of 24 to 100. The tree of "refit" is as old as that.

    total     from boxes in pinned memory of the host to the result there
    memory    the same, from boxes in a NumPy array
    device    from boxes on the device to the result there. BroadCL: wall time until the queue has finished; it needs pyopencl.
              Warp and Newton: time between two events
    wall      wall time from boxes in memory of CUDA to the result there. All frames are computed before, since a GPU that has waited
              for the host is slower. BroadCL: from tensors to tensors; a kernel of CUDA has written the boxes just before, since the
              GPU then changes to another context. Warp and Newton: until the host knows that their graph has finished; it does not
              read their count

BroadCL delivers the pairs that start and stop overlapping, in order, and its lists grow. PyTorch compares all boxes with all, and
delivers all pairs. Warp and Newton deliver all pairs, in no order, in an array that is half as large again as it must be in the
first frame. On a GPU their frames are CUDA graphs. In the last frame, pairs are compared with those that BroadCL finds on the host.

--worlds N measures N worlds of 64 cubes instead, each uniform in the unit cube, with tensors: BroadCL gets filters, PyTorch
compares the boxes of each world.
"""

import argparse
import functools
import json
import statistics
import sys
import time

import numpy as np

import broadcl

try:
    import warp as wp
except ImportError:
    wp = None
try:
    import newton
except ImportError:
    newton = None
try:
    import pyopencl
    import pyopencl.array
except ImportError:
    pyopencl = None
try:
    import torch
except ImportError:
    torch = None

KINDS = "total", "memory", "device", "wall"
BOXES_OF_A_WORLD = 64


class Scene:
    """MovingBoxes of src/scenes/generators.hpp, with other random numbers."""

    def __init__(self, name: str, n: int):
        random = np.random.default_rng(1)
        self.worlds = n // BOXES_OF_A_WORLD if name == "worlds" else 1
        self.world = (np.arange(n) * self.worlds // n).astype(np.int32)
        edge = 1 - np.sqrt(1 - np.cbrt(4 * self.worlds / n))
        factors = np.ones(n)
        if name == "mixed":
            classes = np.array([(0.1, 0.4), (0.8, 1.2), (1.6, 4.0)])[random.permutation(n) % 3]
            factors = random.uniform(classes[:, 0], classes[:, 1])
        self.half = (edge / 2 * factors[:, None]).astype(np.float32)
        self.centres = random.uniform(0, 1, (n, 3)).astype(np.float32)
        steps = random.normal(size=(n, 3))
        steps *= edge / 10 / np.linalg.norm(steps, axis=1, keepdims=True)
        self.steps = steps.astype(np.float32)

    def advance(self) -> np.ndarray:
        """(n, 6) boxes of the next frame."""
        self.centres += self.steps
        outside = (self.centres < 0) | (self.centres > 1)
        np.copyto(self.centres, np.where(self.centres < 0, -self.centres, 2 - self.centres), where=outside)
        np.negative(self.steps, out=self.steps, where=outside)
        return np.hstack([self.centres - self.half, self.centres + self.half])


class BroadCL:
    kinds = "total", "memory"

    def __init__(self, scene: Scene, options):
        self.broad_phase = broadcl.BroadPhase(algorithm=options.algorithm, device=options.opencl)
        end = time.perf_counter() + options.warm_up
        while time.perf_counter() < end or (options.opencl and self.broad_phase.device is None):
            self.memory(scene.advance())

    def load(self, boxes):
        self.broad_phase.map(len(boxes))[:] = boxes

    def total(self):
        return self.broad_phase.update()

    def memory(self, boxes):
        return self.broad_phase.update(boxes)

    def pairs(self):
        return self.broad_phase.pairs()


class BroadCLOnDevice:
    kinds = ("device",)

    def __init__(self, scene: Scene, options):
        name = broadcl.select_device(options.opencl).name.strip()
        devices = [device for platform in pyopencl.get_platforms() for device in platform.get_devices()]
        devices = [device for device in devices if device.name.strip() == name]
        if not devices:
            raise RuntimeError(f"pyopencl does not list {name}")
        context = pyopencl.Context(devices[:1])
        self.queue = pyopencl.CommandQueue(context)
        self.broad_phase = broadcl.DeviceBroadPhase(self.queue)
        self.boxes = pyopencl.array.to_device(self.queue, scene.advance())

    def load(self, boxes):
        self.boxes.set(boxes)
        self.queue.finish()

    def device(self):
        self.broad_phase.update(self.boxes)
        self.queue.finish()

    def pairs(self):
        return self.broad_phase.pairs().get()


class OnTorch:
    """Boxes in a tensor, to which a kernel writes them."""

    kinds = ("wall",)

    def __init__(self, scene: Scene, options):
        boxes = scene.advance()
        self.where = torch.device(options.device)
        self.boxes = self.prepare(scene, len(boxes))
        self.load(boxes)

    def load(self, boxes):
        torch.mul(torch.from_numpy(boxes).to(self.where), 1, out=self.boxes)
        self.wait()

    def wait(self):
        if self.where.type == "cuda":
            torch.cuda.synchronize(self.where)


class BroadCLTensors(OnTorch):
    def prepare(self, scene, n):
        self.broad_phase = broadcl.DeviceBroadPhase(self.where)
        self.worlds = scene.worlds > 1
        world = torch.from_numpy(scene.world).to(self.where)
        ones = torch.ones_like(world)
        self.filters = torch.stack([ones, -ones, -ones, world], 1) if self.worlds else None
        return self.place(n)

    def place(self, n):
        return torch.empty(n, 6, device=self.where)

    def wall(self):
        delta = self.broad_phase.update(self.boxes, filters=self.filters, worlds=self.worlds)
        return torch.from_dlpack(delta.added), torch.from_dlpack(delta.removed)

    def pairs(self):
        return self.broad_phase.pairs().get()


class BroadCLTensorsInPlace(BroadCLTensors):
    def place(self, n):
        return torch.from_dlpack(self.broad_phase.boxes(n))


class TorchAllPairs(OnTorch):
    """Blocks of rows of the matrix of pairs, for each world, right of the diagonal."""

    rows = 4096

    def prepare(self, scene, n):
        self.worlds = scene.worlds
        if n // self.worlds > 16_000:
            raise RuntimeError("not measured: the matrix of all pairs is too large")
        return torch.empty(n, 6, device=self.where)

    def wall(self):
        boxes = self.boxes.view(self.worlds, -1, 6).unbind(2)  # lower x, y, z, upper x, y, z
        count = boxes[0].shape[1]
        found = []
        for begin in range(0, count, self.rows):
            rows = slice(begin, begin + self.rows)
            tests = (
                test
                for lower, upper in zip(boxes[:3], boxes[3:])
                for test in (lower[:, rows, None] <= upper[:, None, begin:], lower[:, None, begin:] <= upper[:, rows, None])
            )
            overlap = functools.reduce(torch.bitwise_and, tests)
            world, a, b = overlap.triu(1).nonzero(as_tuple=True)
            found.append(torch.stack([a, b], 1) + (world * count + begin)[:, None])
        self.found = torch.cat(found)
        self.wait()

    def pairs(self):
        return self.found.cpu().numpy()


class OnWarp:
    """Copies boxes to the device, finds the pairs there, and copies them back."""

    kinds = "total", "memory", "device", "wall"

    def __init__(self, scene: Scene, options):
        boxes = scene.advance()
        n = len(boxes)
        self.where = wp.get_device(options.device)
        pinned = self.where.is_cuda
        self.capacity = int(1.5 * len(broadcl.overlapping_pairs(boxes, algorithm="sweep-and-prune"))) + 1000
        self.host_lower, self.host_upper = (wp.empty(n, dtype=wp.vec3, device="cpu", pinned=pinned) for _ in range(2))
        self.host_found = wp.empty(self.capacity, dtype=wp.vec2i, device="cpu", pinned=pinned)
        self.host_count = wp.zeros(1, dtype=int, device="cpu", pinned=pinned)
        with wp.ScopedDevice(self.where):
            self.lower, self.upper = wp.empty(n, dtype=wp.vec3), wp.empty(n, dtype=wp.vec3)
            self.found = wp.empty(self.capacity, dtype=wp.vec2i)
            self.count = wp.zeros(1, dtype=int)
            self.load(boxes)
            self.upload()
            self.prepare(n)
            self.search()  # compiles kernels
            wp.synchronize()
            self.frame = self.capture(self.whole)
            self.frame_on_device = self.capture(self.search)

    def capture(self, commands):
        """The commands as a CUDA graph. On the CPU they are called."""
        if not self.where.is_cuda:
            return commands
        with wp.ScopedCapture() as capture:
            commands()
        return lambda: wp.capture_launch(capture.graph)

    def upload(self):
        wp.copy(self.lower, self.host_lower)
        wp.copy(self.upper, self.host_upper)

    def whole(self):
        self.upload()
        self.search()
        wp.copy(self.host_count, self.count)

    def load(self, boxes):
        self.host_lower.numpy()[:] = boxes[:, :3]
        self.host_upper.numpy()[:] = boxes[:, 3:]

    def total(self):
        with wp.ScopedDevice(self.where):
            self.frame()
            wp.synchronize_stream()
            count = int(self.host_count.numpy()[0])
            if count > self.capacity:
                raise RuntimeError(f"its list is full: {count} pairs")
            if count:
                wp.copy(self.host_found, self.found, count=count)
                wp.synchronize_stream()
        return self.host_found.numpy()[:count]

    def memory(self, boxes):
        self.load(boxes)
        return self.total()

    def device(self):
        """The seconds that the device takes."""
        with wp.ScopedDevice(self.where):
            self.upload()
            if not self.where.is_cuda:
                return timed(self.frame_on_device)[0]
            start, end = wp.Event(enable_timing=True), wp.Event(enable_timing=True)
            wp.record_event(start)
            self.frame_on_device()
            wp.record_event(end)
            return wp.get_event_elapsed_time(start, end) / 1e3

    def wall(self):
        """The seconds until the host knows that the device has finished."""
        with wp.ScopedDevice(self.where):
            self.upload()
            wp.synchronize_stream()
            return timed(self.finish_on_device)[0]

    def finish_on_device(self):
        self.frame_on_device()
        wp.synchronize_stream()

    def pairs(self):
        return self.total()


class WarpRefit(OnWarp):
    """Builds the tree once, then adapts its bounds."""

    def prepare(self, n):
        self.bvh = wp.Bvh(self.lower, self.upper)

    def renew(self):
        self.bvh.refit()

    def search(self):
        self.renew()
        self.count.zero_()
        inputs = [self.bvh.id, self.lower, self.upper, self.found, self.count]
        wp.launch(query, dim=len(self.lower), inputs=inputs)


class WarpRebuild(WarpRefit):
    def renew(self):
        self.bvh.rebuild()


class NewtonSweep(OnWarp):
    def prepare(self, n):
        self.check_range(n)
        self.world = wp.full(n, -1, dtype=int)
        self.group = wp.full(n, 1, dtype=int)
        self.broad_phase = self.make()

    def check_range(self, n):
        """Its sum of candidates on its axis is a 32-bit integer."""
        axis = np.array([0.5935, 0.7790, 0.1235]) / np.linalg.norm([0.5935, 0.7790, 0.1235])
        lower, upper = self.host_lower.numpy() @ axis, self.host_upper.numpy() @ axis
        lower.sort()
        refuse_beyond_32_bits(int(np.searchsorted(lower, upper).sum()) - n * (n + 1) // 2)

    def make(self):
        return newton.geometry.BroadPhaseSAP(self.world, sort_type="auto")

    def search(self):
        n = len(self.lower)
        self.broad_phase.launch(self.lower, self.upper, None, self.group, self.world, n, self.found, self.count)


class NewtonAllPairs(NewtonSweep):
    def check_range(self, n):
        """Its search for the row of a pair computes n (n - 1) in 32 bits."""
        refuse_beyond_32_bits(n * (n - 1))

    def make(self):
        return newton.geometry.BroadPhaseAllPairs(self.world)


class NewtonExplicit(NewtonSweep):
    """Tests the pairs of a list, here all of them."""

    def check_range(self, n):
        if n > 10_000:
            raise RuntimeError("not measured: the list of all pairs is too long")

    def make(self):
        n = len(self.lower)
        self.listed = wp.array(np.stack(np.triu_indices(n, 1), axis=1).astype(np.int32), dtype=wp.vec2i)
        return newton.geometry.BroadPhaseExplicit()

    def search(self):
        pairs = self.listed
        self.broad_phase.launch(self.lower, self.upper, None, pairs, len(pairs), self.found, self.count)


def refuse_beyond_32_bits(number: int) -> None:
    if number >= 2**31:
        raise RuntimeError(f"beyond 32 bits: {number:,}")


if wp is not None:

    @wp.kernel(enable_backward=False)
    def query(
        bvh: wp.uint64,
        lower: wp.array(dtype=wp.vec3),
        upper: wp.array(dtype=wp.vec3),
        found: wp.array(dtype=wp.vec2i),
        count: wp.array(dtype=int),
    ):
        i = wp.tid()
        boxes = wp.bvh_query_aabb(bvh, lower[i], upper[i])
        j = int(0)  # noqa: RUF046, UP018 (Warp: a variable that changes in a loop)
        while wp.bvh_query_next(boxes, j):
            if i < j:
                k = wp.atomic_add(count, 0, 1)
                if k < found.shape[0]:
                    found[k] = wp.vec2i(i, j)


METHODS, METHODS_OF_WORLDS = {"BroadCL": BroadCL}, {}
if pyopencl is not None:
    METHODS |= {"BroadCL, on the device": BroadCLOnDevice}
if torch is not None:
    METHODS_OF_WORLDS = {
        "BroadCL, tensors": BroadCLTensors,
        "BroadCL, tensors in place": BroadCLTensorsInPlace,
        "torch, all pairs": TorchAllPairs,
    }
    METHODS |= METHODS_OF_WORLDS
if wp is not None:
    METHODS |= {"Warp BVH, refit": WarpRefit, "Warp BVH, rebuild": WarpRebuild}
if wp is not None and newton is not None:
    METHODS |= {"Newton sweep": NewtonSweep, "Newton all pairs": NewtonAllPairs, "Newton explicit": NewtonExplicit}


def timed(function, *arguments):
    start = time.perf_counter()
    result = function(*arguments)
    return time.perf_counter() - start, result


def keys(pairs: np.ndarray) -> np.ndarray:
    pairs = np.sort(np.asarray(pairs, np.uint64), axis=1)
    return np.sort(pairs[:, 1] << np.uint64(32) | pairs[:, 0])


@functools.lru_cache(maxsize=1)
def expected(scene_name: str, n: int, frames: int) -> np.ndarray:
    scene = Scene(scene_name, n)
    for _ in range(frames - 1):
        scene.advance()
    broad_phase = broadcl.BroadPhase(algorithm="sweep-and-prune")
    broad_phase.add(scene.advance(), world=scene.world)
    return keys(broad_phase.update().added)


def measure(method, scene_name: str, n: int, options) -> dict:
    frames = options.frames or min(100, max(24, 25_000_000 // n))
    row = {"frames": frames}
    for kind in (kind for kind in method.kinds if kind in options.kinds):
        subject = method(Scene(scene_name, n), options)
        scene = Scene(scene_name, n)
        seconds = []
        steps = (scene.advance() for _ in range(3 + frames))
        for boxes in list(steps) if kind == "wall" else steps:
            if kind == "memory":
                seconds.append(timed(subject.memory, boxes)[0])
            else:
                subject.load(boxes)
                taken, result = timed(getattr(subject, kind))
                seconds.append(result if isinstance(result, float) else taken)
        row[f"{kind}_us"] = statistics.median(seconds[3:]) * 1e6
        reference = expected(scene_name, n, 3 + frames)
        row["pairs"] = len(reference)
        found = keys(subject.pairs())
        if not np.array_equal(found, reference):
            wrong = max(1, len(np.setxor1d(found, reference)))  # at least a pair that is there twice
            row["failed"] = f"{wrong} pairs missing or extra, of {len(reference)}"
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0", help="of Warp and Newton: cuda:0, or cpu, which only tests the program")
    parser.add_argument("--opencl", help="device of BroadCL: gpu, or its own choice if that of Warp is the cpu")
    parser.add_argument("--algorithm", default="auto", help="of BroadCL")
    parser.add_argument("--scene", choices=("uniform", "mixed"), help="only this one")
    parser.add_argument("--sizes", type=int, nargs="+", default=[3_500, 16_000, 64_000, 256_000, 1_000_000])
    parser.add_argument("--worlds", type=int, nargs="+", metavar="N", help="N worlds of 64 cubes in place of the scenes")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS, help="only these columns")
    parser.add_argument("--frames", type=int, help="of each measurement")
    parser.add_argument("--warm-up", type=float, default=2, help="seconds in which BroadCL's auto may open its device")
    parser.add_argument("--json", help="write the results here too")
    options = parser.parse_args()
    if options.json == "-":
        parser.error("--json: name a file")
    if options.opencl is None and options.device != "cpu":
        options.opencl = "gpu"

    versions = {"broadcl": broadcl.__version__}
    for name, module in {"warp-lang": wp, "newton": newton, "torch": torch, "pyopencl": pyopencl}.items():
        if module is None:
            print(f"{name} is not installed", file=sys.stderr)
        else:
            versions[name] = getattr(module, "VERSION_TEXT", None) or module.__version__
    if wp is not None:
        wp.config.log_level = wp.LOG_WARNING
        wp.init()
    device = broadcl.select_device(options.opencl)
    where = f"{device.name}, driver {device.driver_version}"
    print(f"{where}; " + ", ".join(f"{package} {version}" for package, version in versions.items()), flush=True)

    methods = METHODS_OF_WORLDS if options.worlds else METHODS
    scenes = [("worlds", BOXES_OF_A_WORLD * worlds) for worlds in options.worlds or []]
    if not scenes:
        scenes = [(scene, n) for n in options.sizes for scene in ([options.scene] if options.scene else ["uniform", "mixed"])]
    results = []
    for scene, n in scenes:
        print(f"\n{n:,} {scene}\n{'':25}" + "".join(f"{kind:>12}" for kind in KINDS) + "   us")
        for name, method in methods.items():
            row = {"scene": scene, "boxes": n, "method": name}
            try:
                row |= measure(method, scene, n, options)
            except Exception as error:  # noqa: BLE001 (whatever a package throws is its result)
                row["failed"] = f"{error}"
            times = (row.get(f"{kind}_us") for kind in KINDS)
            cells = "".join(f"{'-':>12}" if value is None else f"{value:12.1f}" for value in times)
            print(f"{name:25}{cells}   {row.get('failed', '')}", flush=True)
            results.append(row)
        if options.json:
            with open(options.json, "w", encoding="utf-8") as file:
                json.dump({"where": where, "versions": versions, "results": results}, file, indent=1)
                file.write("\n")


if __name__ == "__main__":
    main()
