import gc
import subprocess
import sys
import weakref

import numpy as np
import pytest

import broadcl
from conftest import oracle, uniform


def resident() -> int:
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096


@pytest.mark.parametrize("algorithm", ["auto", "tiles", "gpu-bf"])
def test_arrays_outlive_their_object(algorithm):
    values = uniform(2000)
    broad_phase = broadcl.BroadPhase(algorithm=algorithm)
    view = broad_phase.map(len(values))
    view[:] = values
    first = broad_phase.update()
    kept = first.added
    copy = kept.copy()
    broad_phase.map(5_000)[:] = uniform(5_000)  # other memory
    second = broad_phase.update().added.copy()
    all_pairs = broad_phase.pairs()
    del broad_phase, first
    gc.collect()
    ballast = [np.full((2000, 6), np.nan, np.float32) for _ in range(20)]
    assert np.array_equal(kept, copy) and np.array_equal(kept, oracle(values))
    assert len(second) and len(all_pairs)
    assert np.array_equal(view, values)
    del ballast


@pytest.mark.parametrize("algorithm", ["sweep-and-prune", "tiles", "gpu-bf"])
@pytest.mark.parametrize("most", [1, 2, 100])
def test_deltas_may_be_kept(algorithm, most):
    n = 4000
    broad_phase = broadcl.BroadPhase(algorithm=algorithm)
    kept = []
    known = set()
    for frame in range(9):
        values = uniform(n, overlaps=8, seed=frame // 2)
        if frame % 2:
            values[:10] += 1  # few changes
        broad_phase.map(n)[:] = values
        if frame % 3 == 0:
            broad_phase.begin()
        delta = broad_phase.update()
        kept.append((*delta, delta.added.copy(), delta.removed.copy()))
        known = (known - set(map(tuple, delta.removed.tolist()))) | set(map(tuple, delta.added.tolist()))
        assert known == set(map(tuple, oracle(values).tolist()))
        del kept[:-most], delta
    sizes = [len(added) for added, *_ in kept]
    del broad_phase
    gc.collect()
    for added, removed, *copies in kept:
        assert np.array_equal(added, copies[0]) and np.array_equal(removed, copies[1])
    assert most < 100 or (min(sizes) < 500 and sum(size > 5000 for size in sizes) >= 5)


@pytest.mark.parametrize("algorithm", ["sweep-and-prune", "tiles"])
def test_many_changes_are_not_copied(algorithm):
    values = np.tile(np.float32([0, 0, 0, 1, 1, 1]), (300, 1))
    apart = values + np.arange(300, dtype=np.float32)[:, None] * 2
    broad_phase = broadcl.BroadPhase(algorithm=algorithm)
    places = set()
    ballast = []
    for frame in range(10):
        broad_phase.map(300)[:] = (values, apart)[frame % 2]
        delta = broad_phase.update()  # the last one is kept until now
        assert len(delta.added) + len(delta.removed) == 300 * 299 // 2
        pairs = delta.added if len(delta.added) else delta.removed
        places.add(pairs.ctypes.data)
        ballast.append(np.empty_like(pairs))  # takes the place of a copy that was freed
        del pairs
    assert len(places) < 6  # the same memory, in turn
    del broad_phase
    delta.removed[0] = 7, 8  # may be written, as every array that is returned
    assert delta.removed[:2].tolist() == [[7, 8], [0, 2]]


def test_deltas_at_exit():
    """Arrays of a device's memory that live until the interpreter ends."""
    code = """
import broadcl, numpy
broad_phase = broadcl.BroadPhase(algorithm="tiles")
broad_phase.add(numpy.tile(numpy.float32([0, 0, 0, 1, 1, 1]), (300, 1)))
delta = broad_phase.update()
other = broadcl.BroadPhase(algorithm="tiles")
other.add(delta.added.repeat(3, axis=1).astype(numpy.float32)[:100])
other.begin()
print(len(delta.added))
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (run.returncode, run.stdout.strip(), run.stderr) == (0, "44850", "")


def test_boxes_may_die_before_the_update():
    values = uniform(500)
    broad_phase = broadcl.BroadPhase()
    broad_phase.add(values.copy())
    broad_phase.map(len(values))[:] = values
    gc.collect()
    assert np.array_equal(broad_phase.update().added, oracle(values))


@pytest.mark.parametrize("bad", [False, True])
def test_arguments_are_not_kept(bad):
    values = uniform(50)
    if bad:
        values[3, 3] = np.nan
    ids = np.arange(50, dtype=np.uint32)
    broad_phase = broadcl.BroadPhase()
    broad_phase.add(uniform(50))
    corners = values[:, :3], values[:, 3:]
    pairs = np.array([[0, 1], [1, 2]], np.uint32)
    objects = [values, ids, pairs, *corners]
    before = [sys.getrefcount(thing) for thing in objects]
    for _ in range(10):
        for call in (
            lambda: broadcl.overlapping_pairs(values), lambda: broadcl.overlapping_pairs(corners, values),
            lambda: broad_phase.move(ids, values), lambda: broad_phase.move(ids[:3], values),
            lambda: broadcl.overlapping_pairs(values, exclusions=pairs), lambda: broadcl.pairs_that_share(pairs, pairs),
            lambda: broadcl.overlapping_pairs(values[:, :5]), lambda: broadcl.overlapping_pairs(values.astype("i4")),
        ):
            try:
                call()
            except (ValueError, TypeError, RuntimeWarning):
                pass
    gc.collect()
    assert [sys.getrefcount(thing) for thing in objects] == before


def test_nothing_leaks():
    values = uniform(20_000)
    broad_phase = broadcl.BroadPhase(algorithm="sweep-and-prune")
    ids = broad_phase.add(values)

    def use():
        broadcl.overlapping_pairs(values.astype(np.float64))
        broad_phase.move(ids[:2000], values[1000:3000])
        broad_phase.update()
        broad_phase.move(ids[:2000], values[:2000])
        broad_phase.update()
        broad_phase.pairs()
        other = broadcl.BroadPhase(algorithm="sweep-and-prune")
        other.map(20_000)[:] = values
        other.update()

    for _ in range(10):
        use()
    before = resident()
    for _ in range(100):
        use()  # a list of pairs is 0.24 MB
    assert resident() - before < 8 << 20


def test_objects_are_collected():
    class Own(broadcl.BroadPhase):
        pass

    own = Own()
    own.me = own
    reference = weakref.ref(own)
    del own
    gc.collect()
    assert reference() is None


def test_a_clean_exit():
    # nanobind reports what was leaked when the interpreter ends.
    code = "import broadcl as b; p = b.BroadPhase(); v = p.map(3); v[:] = 0; d = p.update(); a, r = d"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "" and run.stderr == ""
