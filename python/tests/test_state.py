"""Going back: states, their pickles, and objects that are copied or pickled with them."""

import copy
import pickle

import numpy as np
import pytest

import broadcl
from conftest import uniform

DTYPES = pytest.mark.parametrize("dtype", [np.float32, np.float64])


def made(dtype=np.float32, **options):
    """An object of which an id is free, with filters, reaches and exclusions."""
    broad_phase = broadcl.BroadPhase(dtype=dtype, **options)
    broad_phase.add(uniform(60), body=np.arange(60) // 2, world=np.arange(60) % 2, reach=np.arange(60) / 60)
    broad_phase.remove(7)
    broad_phase.set_exclusions([[0, 9], [3, 8]])
    broad_phase.update()
    return broad_phase


def everything(broad_phase):
    arrays = [broad_phase.ids(), broad_phase.boxes(), *broad_phase.filters().values(), broad_phase.reaches(),
              broad_phase.exclusions(), broad_phase.pairs()]
    return [array.tolist() for array in arrays]


def disturb(broad_phase):
    broad_phase.remove([0, 1, 2])
    broad_phase.add(uniform(9) + 1, group=4)
    broad_phase.set_filter(20, mask=0)
    broad_phase.set_reach(broad_phase.ids(), 0.1)
    broad_phase.set_exclusions([])


@DTYPES
@pytest.mark.parametrize("reported", [False, True])
def test_everything_is_as_it_was(dtype, reported):
    broad_phase = made(dtype)
    expected = everything(broad_phase)
    state = broad_phase.save()
    disturb(broad_phase)
    if reported:
        broad_phase.update()
    known = {tuple(pair) for pair in broad_phase.pairs().tolist()}
    added, removed = broad_phase.restore(state)
    assert everything(broad_phase) == expected
    assert bool(len(added) or len(removed)) == reported
    after = known - {tuple(pair) for pair in removed.tolist()} | {tuple(pair) for pair in added.tolist()}
    assert after == {tuple(pair) for pair in expected[-1]}
    assert not any(map(len, broad_phase.update())) and broad_phase.add(np.zeros(6)) == 7


@DTYPES
@pytest.mark.parametrize("algorithm", broadcl.algorithms())
def test_a_state_fits_other_objects(dtype, algorithm):
    broad_phase = made(dtype)
    other = broadcl.BroadPhase(dtype=dtype, algorithm=algorithm, threads=1)
    assert np.array_equal(other.restore(broad_phase.save()).added, broad_phase.pairs())
    assert everything(other) == everything(broad_phase)


@DTYPES
@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_states_and_objects_can_be_copied(dtype, again):
    broad_phase = made(dtype, algorithm="sweep-and-prune", threads=1)
    state = again(broad_phase.save())
    assert state.dtype == dtype and repr(state) == f"<broadcl.State {np.dtype(dtype)}>"
    other = again(broad_phase)
    assert other.algorithm == "sweep-and-prune" and other.dtype == dtype
    assert not any(map(len, other.update())) and everything(other) == everything(broad_phase)
    disturb(other)
    other.update()
    assert everything(other) != everything(broad_phase)
    other.restore(state)
    assert everything(other) == everything(broad_phase)


def test_a_copy_has_the_distance_and_selects_its_device_anew():
    broad_phase = broadcl.BroadPhase(distance=3, device=broadcl.select_device(), algorithm="tiles", profile=True)
    broad_phase.update([[0, 0, 0, 1, 1, 1], [3, 0, 0, 4, 1, 1]])
    other = pickle.loads(pickle.dumps(broad_phase))
    assert other.device == broad_phase.device and other.reach(0) == 1.5 and other.pairs().tolist() == [[0, 1]]
    other.move(0, [9, 0, 0, 10, 1, 1])
    assert len(other.update().removed) and other.profile()
    with pytest.raises(ValueError, match="distance"):
        broadcl.BroadPhase().restore(broad_phase.save())


def test_what_is_unreported_cannot_be_saved():
    broad_phase = made()
    state = broad_phase.save()
    boxes = broad_phase.map(3)
    for call in (broad_phase.save, lambda: copy.copy(broad_phase), lambda: pickle.dumps(broad_phase)):
        with pytest.raises(broadcl.Error, match=r"call update\(\) first"):
            call()
    boxes[:] = 0
    broad_phase.begin()
    for call in (broad_phase.save, lambda: broad_phase.restore(state)):
        with pytest.raises(broadcl.Error, match=r"between begin\(\) and finish\(\)"):
            call()
    broad_phase.finish()
    boxes = broad_phase.map(3)
    broad_phase.restore(state)
    with pytest.raises(ValueError, match="read-only"):
        boxes[:] = 0


def test_a_state_of_the_other_type_is_refused():
    for dtype, other in ((np.float32, np.float64), (np.float64, np.float32)):
        broad_phase = made(other)
        expected = everything(broad_phase)
        with pytest.raises(ValueError, match=f"boxes in {np.dtype(dtype)}; restore it in a BroadPhase with this dtype"):
            broad_phase.restore(made(dtype).save())
        assert everything(broad_phase) == expected
    for wrong in ((), (None,), (3,)):
        with pytest.raises(TypeError):
            made().restore(*wrong)
    with pytest.raises(TypeError, match="no constructor"):
        broadcl.State()


@pytest.mark.filterwarnings("ignore:nanobind")
def test_damaged_pickles_are_refused():
    state = made().save()
    in_double, data = state.__getstate__()
    new = broadcl.State.__new__
    for damaged in (data[:-1], data + b"0", b"", data[:60], b"X" + data[1:], data[:8] + b"\xff" + data[9:]):
        with pytest.raises(ValueError, match="state"):
            new(broadcl.State).__setstate__((in_double, damaged))
    with pytest.raises(ValueError, match="a state in float64"):
        new(broadcl.State).__setstate__((True, data))
    for wrong in ((data,), (False, None), None, (False, np.zeros(100, np.uint8))):
        with pytest.raises(TypeError):
            new(broadcl.State).__setstate__(wrong)
    with pytest.raises(TypeError):  # it cannot be changed
        state.__setstate__((False, data))
    with pytest.raises(TypeError):
        broadcl.BroadPhase().restore(new(broadcl.State))
    good = made().__getstate__()
    for k, wrong, error in ((0, "no such device", broadcl.Error), (1, "magic", ValueError), (4, np.nan, ValueError),
                            (4, 1.0, ValueError), (5, True, ValueError), (6, None, TypeError), (2, -1, TypeError)):
        given = [*good[:k], wrong, *good[k + 1 :]]
        if k == 0:
            given[1] = "tiles"
        broken = broadcl.BroadPhase.__new__(broadcl.BroadPhase)
        with pytest.raises(error):
            broken.__setstate__(tuple(given))
        with pytest.raises(TypeError):
            len(broken)
