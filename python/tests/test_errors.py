import sys

import numpy as np
import pytest

import broadcl
from conftest import uniform

NAN = np.float32(np.nan)


def with_nan(row):
    values = uniform(20)
    values[row, 4] = NAN
    return values


@pytest.mark.parametrize("values", [
    np.zeros((2, 6), np.float16), np.zeros((2, 6), bool), np.zeros((2, 6), complex), np.zeros((2, 6), object), None, "boxes", object(), {1: 2},
], ids=lambda values: f"{type(values).__name__}-{getattr(values, 'dtype', '')}")
def test_another_type(values):
    with pytest.raises(TypeError, match="must be float32, float64 or integers"):
        broadcl.overlapping_pairs(values)
    with pytest.raises(TypeError, match="must be float32, float64 or integers"):
        broadcl.BroadPhase().add(values)


@pytest.mark.parametrize("shape", [(), (3,), (2, 5), (3, 3), (2, 3, 3), (1, 2, 2, 3), (1, 0), (2, 1, 6)])
def test_another_shape(shape):
    with pytest.raises(ValueError, match=r"must be of shape \(n, 6\)"):
        broadcl.overlapping_pairs(np.zeros(shape))


@pytest.mark.parametrize("pair", [
    (np.zeros((2, 3)), np.zeros((3, 3))), (np.zeros(3), np.zeros((1, 3))), (np.zeros((2, 2)), np.zeros((2, 2))),
], ids=["lengths", "dimensions", "columns"])
def test_another_shape_of_two(pair):
    with pytest.raises(ValueError, match="same shape|must be of shape"):
        broadcl.overlapping_pairs(pair)


@pytest.mark.parametrize("two", [2, 3])
def test_a_list_of_two_arrays_is_not_a_tuple(two):
    lower, upper = np.zeros((two, 3)), np.ones((two, 3))
    for take in (broadcl.overlapping_pairs, broadcl.BroadPhase().add, broadcl.BroadPhase().update):
        with pytest.raises(ValueError, match=r"boxes is a list of two arrays; give the tuple \(lower, upper\)"):
            take([lower, upper])


def test_sets_of_different_dimensions():
    solid, flat = uniform(5), uniform(5)[:, [0, 1, 3, 4]]
    with pytest.raises(ValueError, match="a has boxes in 3 dimensions and b in 2; give both in the same"):
        broadcl.overlapping_pairs(solid, flat)
    with pytest.raises(ValueError, match="a has boxes in 2 dimensions and b in 3; give both in the same"):
        broadcl.overlapping_pairs(flat, (solid[:, :3], solid[:, 3:]))
    assert len(broadcl.overlapping_pairs(flat, flat)) >= 5
    assert len(broadcl.overlapping_pairs(flat, [])) == 0


def test_masked_values():
    masked = np.ma.array(uniform(5), mask=False)
    assert np.array_equal(broadcl.overlapping_pairs(masked), broadcl.overlapping_pairs(uniform(5)))
    masked[2] = np.ma.masked
    broad_phase = broadcl.BroadPhase()
    ids = broad_phase.add(uniform(5))
    for take in (broadcl.overlapping_pairs, broad_phase.add, broad_phase.update, lambda boxes: broad_phase.move(ids, boxes)):
        for boxes in (masked, (masked[:, :3], masked[:, 3:])):
            with pytest.raises(ValueError, match="boxes has masked values; leave them out, or replace boxes by broadcl.EMPTY"):
                take(boxes)
    some = np.ma.array([0, 1], mask=[False, True])
    for take in (broad_phase.remove, lambda ids: broad_phase.set_filter([0, 1], group=ids)):
        with pytest.raises(ValueError, match="has masked values"):
            take(some)
    with pytest.raises(ValueError, match="has masked values"):
        broad_phase.set_exclusions(np.ma.array([[0, 1], [1, 2]], mask=[[False, False], [True, True]]))
    assert len(broad_phase) == 5


@pytest.mark.parametrize("number", [2**53 + 1, -(2**53) - 1, 2**63 - 1, -(2**63), 2**64 - 1])
def test_integers_that_float64_cannot_hold(number):
    boxes = [[0, 0, 0, 1, 1, 1], [min(number, 0), 0, 0, max(number, 0), 1, 1]]
    array = np.array(boxes, np.uint64 if number >= 2**63 else np.int64)
    for values in (array, list(array)):
        with pytest.raises(ValueError, match=rf"boxes must be integers from -2\^53 to 2\^53, .* not {number}; convert"):
            broadcl.overlapping_pairs(values)


def test_layouts():
    with pytest.raises(ValueError, match="no layout is named 'x'; the layouts are: 'min max', 'axes', 'centre size', 'centre half"):
        broadcl.overlapping_pairs(uniform(2), layout="x")
    with pytest.raises(ValueError, match=r"boxes must be of shape \(n, 6\) or \(n, 4\) in the layout 'axes'"):
        broadcl.overlapping_pairs(uniform(2).reshape(2, 2, 3), layout="axes")
    with pytest.raises(ValueError, match="boxes must be one array in the layout 'axes'"):
        broadcl.overlapping_pairs((np.zeros((2, 3)), np.ones((2, 3))), layout="axes")
    with pytest.raises(TypeError, match="layout a string"):
        broadcl.overlapping_pairs(uniform(2), layout=None)


@pytest.mark.parametrize("call, name, keyword", [
    (lambda: broadcl.overlapping_pairs(uniform(2), thread=1), "overlapping_pairs", "thread"),
    (lambda: broadcl.overlapping_pairs(boxes=uniform(2)), "overlapping_pairs", "boxes"),
    (lambda: broadcl.pairs_that_share(c=[[0]]), "pairs_that_share", "c"),
    (lambda: broadcl.select_device(device="gpu"), "select_device", "device"),
    (lambda: broadcl.BroadPhase(thread=1), "BroadPhase", "thread"),
    (lambda: broadcl.DeviceBroadPhase(queue=None), "DeviceBroadPhase", "queue"),
    (lambda: broadcl.BroadPhase().add(box=uniform(2)), "add", "box"),
    (lambda: broadcl.BroadPhase().move(id=0, box=uniform(2)), "move", "id"),
    (lambda: broadcl.BroadPhase().set_filter(0, groups=1), "set_filter", "groups"),
    (lambda: broadcl.BroadPhase().set_exclusions(exclusions=[]), "set_exclusions", "exclusions"),
    (lambda: broadcl.BroadPhase().remove(id=0), "remove", "id"),
    (lambda: broadcl.BroadPhase().map(count=0), "map", "count"),
    (lambda: broadcl.BroadPhase().box(ids=0), "box", "ids"),
    (lambda: broadcl.BroadPhase().filter(ids=0), "filter", "ids"),
    (lambda: broadcl.BroadPhase().reach(ids=0), "reach", "ids"),
    (lambda: broadcl.BroadPhase().partners(ids=0), "partners", "ids"),
    (lambda: broadcl.BroadPhase().set_reach(0, reach=0), "set_reach", "reach"),
    (lambda: broadcl.BroadPhase().overlapping(uniform(2), distance=1), "overlapping", "distance"),
    (lambda: broadcl.BroadPhase().nearest(uniform(2), k=1), "nearest", "k"),
    (lambda: broadcl.BroadPhase().along(uniform(2), [1, 0, 0], within=1), "along", "within"),
    (lambda: broadcl.overlapping(uniform(2), uniform(2), device=None), "overlapping", "device"),
    (lambda: broadcl.nearest(uniform(2), uniform(2), k=1), "nearest", "k"),
    (lambda: broadcl.along(uniform(2), uniform(2), direction=[1, 0, 0]), "along", "direction"),
    (lambda: broadcl.squared_distances(uniform(2), pair=[]), "squared_distances", "pair"),
    (lambda: broadcl.BroadPhase().update(uniform(2), order="x"), "update", "order"),
    (lambda: broadcl.BroadPhase().begin(box=uniform(2)), "begin", "box"),
    (lambda: broadcl.BroadPhase().finish(boxes=uniform(2)), "finish", "boxes"),
    (lambda: broadcl.devices(type="gpu"), "devices", "type"),
], ids=lambda value: value if isinstance(value, str) else "")
def test_an_unknown_keyword_is_named(call, name, keyword):
    with pytest.raises(TypeError, match=rf"^{name}\(\) got an unexpected keyword argument '{keyword}'$"):
        call()


def test_a_missing_argument_is_named():
    broad_phase = broadcl.BroadPhase()
    for call, name in ((broad_phase.map, "n"), (broad_phase.box, "id"), (broad_phase.filter, "id")):
        with pytest.raises(TypeError, match=f"^the argument '{name}' is missing$"):
            call()
    for call in (broad_phase.add, broad_phase.remove, broad_phase.move, broad_phase.set_exclusions, broadcl.overlapping_pairs):
        with pytest.raises((TypeError, ValueError), match="^(boxes|ids|pairs) must be .*$"):
            call()


def test_the_first_nan_is_named():
    good = uniform(20)
    with pytest.raises(ValueError, match="row 7 of boxes has a NaN"):
        broadcl.overlapping_pairs(with_nan(7))
    with pytest.raises(ValueError, match="row 7 of a has a NaN"):
        broadcl.overlapping_pairs(with_nan(7), good)
    with pytest.raises(ValueError, match="row 7 of b has a NaN"):
        broadcl.overlapping_pairs(good, with_nan(7).astype(np.float64))
    broad_phase = broadcl.BroadPhase()
    with pytest.raises(ValueError, match="row 7 of boxes has a NaN"):
        broad_phase.add(with_nan(7))
    assert len(broad_phase) == 0
    ids = broad_phase.add(good)
    with pytest.raises(ValueError, match="row 7 of boxes has a NaN"):
        broad_phase.move(ids, with_nan(7))
    for update in (broad_phase.update, broad_phase.begin):
        with pytest.raises(ValueError, match="row 7 of boxes has a NaN"):
            update(with_nan(7))
        assert np.array_equal([broad_phase.box(id) for id in ids], good)


@pytest.mark.parametrize("update", ["update", "begin", "finish"])
def test_a_nan_that_was_written_can_be_corrected(update):
    broad_phase = broadcl.BroadPhase()
    boxes = broad_phase.map(20)
    boxes[:] = with_nan(7)
    for _ in range(2):
        with pytest.raises(ValueError, match="box 7 has a NaN"):
            getattr(broad_phase, update)()
    boxes[:] = uniform(20)
    getattr(broad_phase, update)()
    broad_phase.finish()
    assert np.array_equal(broad_phase.pairs(), broadcl.overlapping_pairs(uniform(20)))


def test_ids():
    broad_phase = broadcl.BroadPhase()
    ids = broad_phase.add(uniform(5))
    box = uniform(1)[0]
    broad_phase.remove(2)
    for unknown in (2, 5, 2**32 - 1, [0, 2]):
        with pytest.raises(ValueError, match="no object has the id"):
            broad_phase.remove(unknown)
    with pytest.raises(ValueError, match="no object has the id 2"):
        broad_phase.move([1, 2], [box, box])
    with pytest.raises(ValueError, match="no object has the id 2"):
        broad_phase.set_filter(2, group=4)
    with pytest.raises(ValueError, match="given twice"):
        broad_phase.remove([1, 3, 1])
    for word in (-1, 2**32, [-1], np.array([2**40])):
        with pytest.raises(ValueError, match="0 to 4294967295"):
            broad_phase.remove(word)
    for name, lowest, remedy in (("group", -(2**31), ""), ("mask", -(2**31), ""), ("body", 0, "; broadcl.NO_BODY "),
                                 ("world", 0, "; broadcl.ALL_WORLDS ")):
        for word in (lowest - 1, 2**32, [lowest - 1], np.array([2**40])):
            with pytest.raises(ValueError, match=f"{name} must be {lowest} to 4294967295, not .*{remedy}"):
                broad_phase.add([[0, 0, 0, 1, 1, 1]], **{name: word})
    for word in (0.5, [0.5], None, "1"):
        with pytest.raises(TypeError, match="integer"):
            broad_phase.remove(word)
    with pytest.raises(ValueError, match="one id and one box"):
        broad_phase.move([0, 1], box)
    with pytest.raises(ValueError, match="one id and one box"):
        broad_phase.move(0, [box])
    with pytest.raises(ValueError, match=r"shape \(n,\)"):
        broad_phase.remove([[0, 1]])
    with pytest.raises(ValueError, match="row 1 of pairs has the id 2 twice"):
        broad_phase.set_exclusions([[0, 1], [2, 2]])
    with pytest.raises(ValueError, match=r"shape \(n, 2\)"):
        broad_phase.set_exclusions([0, 1])
    with pytest.raises(ValueError, match="filters must be"):
        broad_phase.add(uniform(2), world=[1, 2, 3])
    assert len(broad_phase) == 4  # nothing above did anything
    broad_phase.remove(ids[[0, 1, 3, 4]])
    assert len(broad_phase) == 0


def test_exclusions():
    values, others = uniform(5), uniform(3)
    for message, rows, second in (
        ("row 1 of exclusions has the id 2 twice", [[0, 1], [2, 2]], None),
        (r"row 1 of exclusions is \(1, 5\), but there are 5 boxes; ", [[0, 1], [1, 5]], None),
        (r"row 0 of exclusions is \(5, 1\), but there are 5 boxes in a and 3 in b; ", [[5, 1]], others),
        (r"row 0 of exclusions is \(2, 3\), but there are 5 boxes in a and 3 in b; ", [[2, 3]], others),
        (r"exclusions must be of shape \(n, 2\), not \(1, 3\)", [[0, 1, 2]], None),
        ("exclusions must be 0 to 4294967295", [[-1, 1]], None),
    ):
        with pytest.raises(ValueError, match=message):
            broadcl.overlapping_pairs(values, second, exclusions=rows)
    with pytest.raises(ValueError, match=r"row 0 of exclusions is \(0, 1\), but there is 1 box; "):
        broadcl.overlapping_pairs(uniform(1), exclusions=[[0, 1]])
    with pytest.raises(TypeError, match="exclusions must be an integer or an array of integers"):
        broadcl.overlapping_pairs(values, exclusions=[[0.5, 1]])


def test_labels():
    with pytest.raises(ValueError, match=r"a must be of shape \(n, k\), not \(3,\)"):
        broadcl.pairs_that_share([0, 1, 2])
    with pytest.raises(ValueError, match=r"b must be of shape \(n, k\), not \(1, 1, 1\)"):
        broadcl.pairs_that_share([[0]], [[[1]]])
    with pytest.raises(ValueError, match="b must be 0 to 4294967295"):
        broadcl.pairs_that_share([[0]], [[-1]])
    with pytest.raises(TypeError, match="a must be an integer or an array of integers"):
        broadcl.pairs_that_share([[0.5]])


def test_names():
    with pytest.raises(ValueError, match="no algorithm is named 'x'; the algorithms are: auto,"):
        broadcl.BroadPhase(algorithm="x")
    with pytest.raises(ValueError, match="no algorithm is named 'x'"):
        broadcl.overlapping_pairs(uniform(2), algorithm="x")
    with pytest.raises(broadcl.Error, match="no OpenCL device matches"):
        broadcl.BroadPhase(device="no such device")
    with pytest.raises(TypeError):
        broadcl.BroadPhase(device=3)
    assert issubclass(broadcl.Error, RuntimeError)
    assert issubclass(broadcl.OutOfDeviceMemory, broadcl.Error) and issubclass(broadcl.DeviceLost, broadcl.Error)


def test_calls_between_begin_and_finish():
    broad_phase = broadcl.BroadPhase()
    broad_phase.add(uniform(5))
    broad_phase.begin()
    with pytest.raises(broadcl.Error, match="finish"):
        broad_phase.pairs()
    with pytest.raises(broadcl.Error, match="finish"):
        broad_phase.map(3)
    for update in (broad_phase.update, broad_phase.begin):
        with pytest.raises(broadcl.Error, match="finish"):
            update(uniform(5))
    broad_phase.finish()


@pytest.mark.skipif(sys.platform != "linux", reason="needs a limit of address space")
def test_no_memory():
    import resource

    values = np.broadcast_to(np.float32([0, 0, 0, 1, 1, 1]), (100_000, 6))  # five billion pairs
    old = resource.getrlimit(resource.RLIMIT_AS)
    with open("/proc/self/statm") as file:
        used = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + (256 << 20), old[1]))
    try:
        with pytest.raises(MemoryError):
            broadcl.overlapping_pairs(values, threads=1)
    finally:
        resource.setrlimit(resource.RLIMIT_AS, old)


@pytest.mark.parametrize("begins", [False, True])
def test_no_memory_for_the_delta(begins):
    testing = pytest.importorskip("_testcapi", reason="CPython's own tests are needed")
    broad_phase = broadcl.BroadPhase(algorithm="sweep-and-prune")
    broad_phase.add(np.tile(np.float32([0, 0, 0, 1, 1, 1]), (80, 1)))
    if begins:
        broad_phase.begin()
    delta = None
    testing.set_nomemory(0)
    try:
        delta = broad_phase.finish()
    except MemoryError:
        pass
    finally:
        testing.remove_mem_hooks()
    assert delta is None
    for boxes in (None, uniform(3)):
        with pytest.raises(broadcl.Error, match="finish"):
            broad_phase.begin(boxes)
    with pytest.raises(broadcl.Error, match="finish"):
        broad_phase.update(uniform(3))
    assert len(broad_phase.update().added) == 80 * 79 // 2
    assert len(broad_phase.update().added) == 0


def test_too_many_boxes():
    too_many = np.lib.stride_tricks.as_strided(np.float32([0]), (2**40, 6), (24, 4))  # which nobody may read
    with pytest.raises(ValueError, match="too many"):
        broadcl.overlapping_pairs(too_many)
    broad_phase = broadcl.BroadPhase()
    with pytest.raises(ValueError, match="too many"):
        broad_phase.add(too_many)
    with pytest.raises(ValueError, match="too many"):
        broad_phase.move([0], too_many)
    with pytest.raises(ValueError, match="not one and an array of one"):
        broad_phase.move(0, np.float32([[0, 0, 0, 1, 1, 1]]))
    for n in (2**34, 2**63):
        with pytest.raises(ValueError, match="too many"):
            broad_phase.map(n)
    assert len(broad_phase.map(3)) == 3


def test_devices_are_values():
    for one, another in zip(broadcl.devices(), broadcl.devices()):
        assert one == another and hash(one) == hash(another) and one in broadcl.devices()
        assert one != "another"
