import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

import broadcl
from conftest import as_lists, boxes, finite, hits, near, oracle, proper, rounded, squared_distances, times, uniform, ways

pytestmark = pytest.mark.filterwarnings("ignore::broadcl.InvertedBoxesWarning")  # of random boxes

ALL = 2**32 - 1
DEFAULT = (1, ALL, broadcl.NO_BODY, 0)


def may_pair(s, t):
    worlds = s[3] == t[3] or broadcl.ALL_WORLDS in (s[3], t[3])
    return bool(s[0] & t[1]) and bool(t[0] & s[1]) and worlds and (s[2] != t[2] or s[2] == broadcl.NO_BODY)


def as_set(pairs):
    return {tuple(pair) for pair in pairs.tolist()}


words = st.sampled_from([0, 1, 2, 3, ALL])
reaches = st.sampled_from([0, 0.5, 1, 2, 0.1, 2.0**-70, 2.0**40, 2.0**62])
filters = st.tuples(words, words, st.sampled_from([0, 1, ALL]), st.sampled_from([0, 1, ALL]))


class Machine(RuleBasedStateMachine):
    """Any sequence of calls, compared with a dictionary of boxes and the oracle."""

    algorithm = "auto"
    dtype = np.float32

    def __init__(self):
        super().__init__()
        self.broad_phase = broadcl.BroadPhase(algorithm=self.algorithm, dtype=self.dtype)
        self.boxes = {}
        self.filters = {}
        self.reaches = {}  # of those that have one
        self.followed = set()
        self.begun = None  # the pairs of the update that was begun
        self.saved = None  # a state, and what it was then

    def own(self, values):
        """Boxes of the dtype: in float64, they are apart by less than float32 can tell."""
        if self.dtype == np.float32:
            return values
        return values.astype(np.float64) + (np.arange(len(values)) % 3 * 2.0**-40)[:, None]

    def pairs_now(self):
        ids = sorted(self.boxes)
        reach = self.reaches_of(ids)
        found = oracle(self.boxes_of(ids), reach=reach[:, None] + reach)
        pairs = ((ids[a], ids[b]) for a, b in found.tolist())
        return {(a, b) for a, b in pairs if may_pair(self.filters[a], self.filters[b])}

    def boxes_of(self, ids):
        return np.array([self.boxes[id] for id in ids], self.dtype).reshape(-1, 6)

    def reaches_of(self, ids):
        return np.array([self.reaches.get(id, 0) for id in ids], self.dtype)

    def lowest_free(self):
        return next(id for id in range(len(self.boxes) + 1) if id not in self.boxes)

    def choose(self, data, least=0):
        return data.draw(st.lists(st.sampled_from(sorted(self.boxes)), unique=True, min_size=least))

    @rule(values=boxes(most=6), filter=filters, plain=st.booleans(), reach=reaches)
    def add(self, values, filter, plain, reach):
        values = self.own(values)
        if plain:
            ids = self.broad_phase.add(values)
            filter, reach = DEFAULT, 0
        else:
            group, mask, body, world = filter
            ids = self.broad_phase.add(values, group=group, mask=[mask] * len(values), body=body, world=world, reach=reach)
        expected = []
        for value in values:
            expected.append(self.lowest_free())
            self.boxes[expected[-1]] = value
            self.filters[expected[-1]] = filter
            self.reaches[expected[-1]] = reach
        assert ids.tolist() == expected

    @precondition(lambda self: self.boxes)
    @rule(data=st.data())
    def move(self, data):
        ids = self.choose(data)
        values = data.draw(boxes(most=max(len(ids), 1)).filter(lambda array: len(array) >= len(ids)))[: len(ids)]
        values = self.own(values)
        self.broad_phase.move(ids, values)
        self.boxes.update(zip(ids, values))

    @precondition(lambda self: self.boxes)
    @rule(data=st.data(), filter=filters, worlds=st.lists(st.sampled_from([0, 1, ALL]), min_size=1, max_size=3))
    def set_filter(self, data, filter, worlds):
        ids = self.choose(data)
        group, mask, body, _ = filter
        worlds = np.resize(worlds, len(ids)).tolist()
        self.broad_phase.set_filter(ids, group=group, mask=mask, body=body, world=worlds)
        self.filters.update((id, (group, mask, body, world)) for id, world in zip(ids, worlds))

    @precondition(lambda self: self.boxes)
    @rule(data=st.data(), reach=reaches, single=st.booleans())
    def set_reach(self, data, reach, single):
        ids = self.choose(data)
        self.broad_phase.set_reach(ids, reach if single else [reach] * len(ids))
        self.reaches.update((id, reach) for id in ids)

    @precondition(lambda self: self.boxes)
    @rule(data=st.data())
    def remove(self, data):
        ids = self.choose(data)
        self.broad_phase.remove(np.array(ids, np.int64))
        for id in ids:
            del self.boxes[id], self.filters[id], self.reaches[id]

    @rule(verb=st.sampled_from(["overlapping", "nearest", "along"]), values=boxes(most=40), paths=ways(), filter=st.none() | filters,
          within=st.none() | reaches, limit=st.none() | st.integers(0, 3), excepts=st.booleans(), single=st.booleans())
    def query(self, verb, values, paths, filter, within, limit, excepts, single):
        values = self.own(values)
        ids = sorted(self.boxes)
        now = self.boxes_of(ids)
        keys, arguments, options = None, [], {"within": within}
        if verb == "overlapping":
            finds = near(values, now, self.dtype(within or 0) + self.reaches_of(ids)[None, :])
        elif verb == "nearest":
            keys = squared_distances(values, now)
            finds = proper(values)[:, None] & proper(now)[None, :] if within is None else near(values, now, within)
        else:
            options = {}
            values = finite(values)
            paths = np.resize(paths[: 1 if single else None], (len(values), 4))
            arguments = [paths[0, :3], paths[0, 3]] if single and len(values) else [paths[:, :3], paths[:, 3]]
            keys = times(values, paths[:, :3], paths[:, 3], now)
            finds = ~np.isnan(keys)
        if filter is not None:
            finds &= np.array([may_pair(filter, self.filters[id]) for id in ids], bool)
            options.update(zip(("group", "mask", "body", "world"), filter))
        if excepts:
            finds &= np.arange(len(values))[:, None] != np.array(ids)
            options["except_"] = np.arange(len(values))
        found = getattr(self.broad_phase, verb)(values, *arguments, limit=limit, **options)
        assert as_lists(found) == hits(finds, ids, keys, limit)

    @precondition(lambda self: self.begun is None)
    @rule()
    def partners(self):
        for id in self.boxes:
            expected = sorted(a + b - id for a, b in self.followed if id in (a, b))
            assert self.broad_phase.partners(id).tolist() == expected

    @precondition(lambda self: self.begun is None)
    @rule(values=boxes(most=12))
    def write(self, values):
        values = self.own(values)
        n = len(values)
        view = self.broad_phase.map(n)
        assert view.shape == (n, 6) and view.dtype == self.dtype
        for id in range(n):
            empty = [np.inf] * 3 + [-np.inf] * 3
            old = self.boxes.get(id, self.dtype(empty))
            if (old[:3] <= old[3:]).all():
                assert np.array_equal(view[id], old)
            else:
                assert (view[id, :3] > view[id, 3:]).any()
        view[:] = values
        self.filters = {id: self.filters.get(id, DEFAULT) for id in range(n)}
        self.reaches = {id: self.reaches.get(id, 0) for id in range(n)}
        self.boxes = dict(enumerate(values))

    @precondition(lambda self: self.begun is None)
    @rule(values=boxes(most=12), begins=st.booleans(), double=st.booleans())
    def give(self, values, begins, double):
        values = self.own(values)
        self.filters = {id: self.filters.get(id, DEFAULT) for id in range(len(values))}
        self.reaches = {id: self.reaches.get(id, 0) for id in range(len(values))}
        self.boxes = dict(enumerate(values))
        given = values.astype(np.float64) if double else values.copy()
        if begins:
            self.begun = self.pairs_now()
            self.broad_phase.begin(given)
            given[:] = 0
        else:
            self.check(self.pairs_now(), self.broad_phase.update(given))

    @precondition(lambda self: self.begun is None)
    @rule()
    def begin(self):
        self.begun = self.pairs_now()
        self.broad_phase.begin()

    @rule(call=st.sampled_from(["update", "finish"]))
    def update(self, call):
        expected = self.pairs_now() if self.begun is None else self.begun
        self.begun = None
        self.check(expected, getattr(self.broad_phase, call)())

    @precondition(lambda self: self.begun is None)
    @rule(pickles=st.booleans(), goes_on=st.booleans())
    def save(self, pickles, goes_on):
        self.update("update")
        state = self.broad_phase.save()
        if pickles:
            state = pickle.loads(pickle.dumps(state))
        self.saved = state, *map(copy.copy, (self.boxes, self.filters, self.reaches, self.followed))
        if not goes_on:
            self.broad_phase = copy.copy(self.broad_phase)

    @precondition(lambda self: self.begun is None and self.saved)
    @rule()
    def restore(self):
        state, *now = self.saved
        self.boxes, self.filters, self.reaches, expected = map(copy.copy, now)
        self.check(expected, self.broad_phase.restore(state))

    def check(self, expected, delta):
        added, removed = delta
        assert as_set(removed) <= self.followed
        self.followed -= as_set(removed)
        assert not as_set(added) & self.followed
        self.followed |= as_set(added)
        assert self.followed == expected
        assert as_set(self.broad_phase.pairs()) == expected
        for pairs in (added, removed, self.broad_phase.pairs()):
            assert pairs.tolist() == sorted(pairs.tolist(), key=lambda pair: pair[::-1])

    @invariant()
    def objects(self):
        assert len(self.broad_phase) == len(self.boxes)
        for id in range(max(self.boxes, default=0) + 2):
            assert (id in self.broad_phase) == (id in self.boxes)
            if id not in self.boxes:
                continue
            assert tuple(self.broad_phase.filter(id).values()) == self.filters[id]
            assert self.broad_phase.reach(id) == self.dtype(self.reaches[id])
            box, expected = self.broad_phase.box(id), self.boxes[id]
            assert box.shape == (6,) and box.dtype == self.dtype
            if (expected[:3] <= expected[3:]).all():
                assert np.array_equal(box, expected)
            else:
                assert (box[:3] > box[3:]).any()
        ids, boxes = self.broad_phase.ids(), self.broad_phase.boxes()
        assert ids.tolist() == sorted(self.boxes) and ids.dtype == np.uint32
        assert boxes.shape == (len(ids), 6) and boxes.dtype == self.dtype
        assert all(np.array_equal(box, self.broad_phase.box(id)) for id, box in zip(ids, boxes))
        filters = self.broad_phase.filters()
        assert list(zip(*(values.tolist() for values in filters.values()))) == [self.filters[id] for id in ids]
        reaches = self.broad_phase.reaches()
        assert reaches.dtype == self.dtype and np.array_equal(reaches, self.reaches_of(ids))


class TilesMachine(Machine):
    algorithm = "tiles"


class DoubleMachine(Machine):
    algorithm = "sweep-and-prune"
    dtype = np.float64


TestAnyCalls = Machine.TestCase
TestAnyCallsInDoublePrecision = DoubleMachine.TestCase
TestAnyCallsOnADevice = TilesMachine.TestCase
TestAnyCallsOnADevice.settings = settings(max_examples=max(5, settings().max_examples // 6))


@given(boxes(np.float64))
def test_float64_is_rounded_outward(values):
    broad_phase = broadcl.BroadPhase()
    broad_phase.add(values)
    assert np.array_equal(broad_phase.update().added, oracle(rounded(values)))


@given(boxes(np.float64))
def test_float64_is_exact_if_asked_for(values):
    broad_phase = broadcl.BroadPhase(dtype=np.float64)
    assert np.array_equal(broad_phase.update(values).added, oracle(values))


def test_dtype():
    assert broadcl.BroadPhase().dtype == np.float32
    for double in (np.float64, "float64", float, np.dtype("d")):
        broad_phase = broadcl.BroadPhase(dtype=double)
        assert broad_phase.dtype == np.float64
    assert broad_phase.add([0, 0, 0, 1, 1, 1]) == 0
    assert broad_phase.box(0).dtype == np.float64 and broad_phase.map(1).dtype == np.float64
    with pytest.raises(ValueError, match="dtype must be float32 or float64, not int32"):
        broadcl.BroadPhase(dtype=np.int32)
    for other in ("boxes", None):
        with pytest.raises(TypeError):
            broadcl.BroadPhase(dtype=other)


@pytest.mark.parametrize("algorithm", broadcl.algorithms())
def test_flush_boxes_in_map_coordinates(algorithm):
    edges = 6.4e6 + 0.1 * np.arange(41)
    values = np.zeros((40, 6))
    values[:, 0], values[:, 3] = edges[:-1], edges[1:]
    values[::4, 0] = np.nextafter(values[::4, 0], np.inf)  # apart by an ulp
    broad_phase = broadcl.BroadPhase(algorithm=algorithm, dtype="float64")
    assert np.array_equal(broad_phase.update(values).added, oracle(values))
    values[:, 0] = edges[:-1]
    added, removed = broad_phase.update(values)
    assert len(added) == 9 and len(removed) == 0


@pytest.mark.parametrize("algorithm", broadcl.algorithms())
def test_every_algorithm(algorithm):
    broad_phase = broadcl.BroadPhase(algorithm=algorithm)
    values = uniform(500)
    ids = broad_phase.add(values)
    delta = broad_phase.update()
    assert np.array_equal(delta.added, oracle(values)) and len(delta.removed) == 0
    values[:50] += 1
    broad_phase.move(ids[:50], values[:50])
    broad_phase.update()
    assert np.array_equal(broad_phase.pairs(), oracle(values))
    assert broad_phase.algorithm == algorithm


def test_filters_of_many_are_set_for_all_or_for_none():
    broad_phase = broadcl.BroadPhase()
    ids = broad_phase.add(uniform(4))
    broad_phase.set_filter(ids, body=[1, 2, 3, 4])
    before = broad_phase.filters()
    with pytest.raises(ValueError, match="no object has the id 4"):
        broad_phase.set_filter([0, 1, 2, 4], world=5)
    for name, values in broad_phase.filters().items():
        assert np.array_equal(values, before[name])
    broad_phase.set_filter([0, 0, 3, 0], world=[1, 2, 3, 4])
    assert broad_phase.filters()["world"].tolist() == [4, 0, 0, 3]


def test_objects_in_arrays():
    broad_phase = broadcl.BroadPhase()
    assert broad_phase.ids().shape == (0,) and broad_phase.boxes().shape == (0, 6) and broad_phase.reaches().shape == (0,)
    assert broad_phase.exclusions().shape == (0, 2) and {values.shape for values in broad_phase.filters().values()} == {(0,)}
    broad_phase.add(uniform(5), reach=np.arange(5), body=np.arange(5))
    broad_phase.set_exclusions([[4, 1], [1, 4], [0, 2]])
    boxes, exclusions = broad_phase.boxes(), broad_phase.exclusions()
    assert exclusions.tolist() == [[0, 2], [1, 4]] and exclusions.dtype == np.uint32
    boxes[:] = 0  # they are the caller's
    exclusions[:] = 0
    assert not np.array_equal(broad_phase.boxes(), boxes) and broad_phase.exclusions().tolist() == [[0, 2], [1, 4]]
    broad_phase.update()
    other = broadcl.BroadPhase(algorithm="oracle")
    other.add(broad_phase.boxes(), reach=broad_phase.reaches())
    other.set_filter(other.ids(), **broad_phase.filters())
    other.set_exclusions(broad_phase.exclusions())
    assert len(other.update().added) and np.array_equal(other.pairs(), broad_phase.pairs())


def test_one_object():
    broad_phase = broadcl.BroadPhase()
    assert broad_phase.add([0, 0, 0, 1, 1, 1]) == 0
    assert broad_phase.add(((1, 1, 1), (2, 2, 2))) == 1
    assert broad_phase.add(np.zeros((2, 3), np.float32), world=1) == 2
    assert isinstance(broad_phase.add((0, 0, 1, 1)), int)
    assert broad_phase.update().added.tolist() == [[0, 1], [0, 3]]
    broad_phase.move(1, (5, 5, 5, 6, 6, 6))
    broad_phase.set_filter(np.uint32(2))
    broad_phase.remove(3)
    added, removed = broad_phase.update()
    assert added.tolist() == [[0, 2]] and removed.tolist() == [[0, 1], [0, 3]]


def test_what_it_says_of_itself():
    host = broadcl.BroadPhase(algorithm="sweep-and-prune")
    assert host.device is None and host.profile() == {} and host.memory == {"device": 0, "device_peak": 0, "pinned": 0}
    broad_phase = broadcl.BroadPhase(algorithm="tiles", profile=True)
    broad_phase.add(uniform(1000))
    broad_phase.update()
    stages = broad_phase.profile()
    assert {"upload", "test", "order"} <= stages.keys()
    assert all(times["host_seconds"] >= 0 for times in stages.values())
    assert sum(times["device_seconds"] for times in stages.values()) > 0
    assert broad_phase.memory["device"] > 24_000
    assert broad_phase.device.id == broadcl.select_device().id
    assert broad_phase.device.type in ("gpu", "cpu", "accelerator", "other")
    assert broad_phase.device.name in str(broad_phase.device)


def test_writing_counts_once():
    broad_phase = broadcl.BroadPhase()
    view = broad_phase.map(2)
    view[:] = [0, 0, 0, 1, 1, 1]
    assert broad_phase.update().added.tolist() == [[0, 1]]
    with pytest.raises(ValueError, match="read-only"):  # map() was not called
        view[1] = [5, 5, 5, 6, 6, 6]
    again = broad_phase.map(2)
    assert np.shares_memory(again, view) and again[1, 0] == 0  # the memory of the core, without a copy
    again[1] = [5, 5, 5, 6, 6, 6]
    assert broad_phase.update().removed.tolist() == [[0, 1]]
    view = broad_phase.map(2)
    view[:] = [0, 0, 0, 1, 1, 1]
    broad_phase.move(1, [5, 5, 5, 6, 6, 6])  # after what was written
    assert not view.flags.writeable
    assert len(broad_phase.update().added) == 0
    assert broad_phase.map(2)[1, 0] == 5


@pytest.mark.parametrize("masks", [-1, [-1, -1], np.array([-1, -1]), np.array([-1, -1], np.int8), 0xFFFFFFFF], ids=repr)
def test_minus_one_is_all_bits(masks):
    values = [[0, 0, 0, 1, 1, 1]] * 2
    broad_phase = broadcl.BroadPhase()
    ids = broad_phase.add(values, group=[1, -(2**31)], mask=masks)
    assert len(broad_phase.update().added) == 1
    broad_phase.set_filter(ids, group=[1, 2], mask=~1)  # whoever is in group 1 pairs with nobody
    assert len(broad_phase.update().removed) == 1
    broad_phase.set_filter(ids, group=2, mask=~1)
    assert len(broad_phase.update().added) == 1


def test_an_empty_list_is_no_boxes():
    broad_phase = broadcl.BroadPhase()
    for empty in ([], (), ([], []), np.empty(0), np.empty((0, 6))):
        assert broadcl.overlapping_pairs(empty).shape == (0, 2)
        assert broadcl.overlapping_pairs(empty, uniform(2)).shape == (0, 2)
        ids = broad_phase.add(empty, mask=[])
        assert ids.shape == (0,) and ids.dtype == np.uint32
        broad_phase.move([], empty)
        broad_phase.remove([])
    assert len(broad_phase) == 0


@pytest.mark.parametrize("algorithm", ["sweep-and-prune", "tiles"])
def test_shrink(algorithm):
    values = uniform(200)
    broad_phase = broadcl.BroadPhase(algorithm=algorithm)
    broad_phase.add(values)
    others = broad_phase.add(np.tile(np.float32([9, 0, 0, 10, 1, 1]), (2000, 1)))
    spike = broad_phase.update().added
    count = len(spike)
    broad_phase.remove(others)
    kept = broad_phase.update().removed
    broad_phase.shrink()
    assert np.array_equal(broad_phase.pairs(), oracle(values))
    assert len(spike) == count and len(kept) >= 1_999_000  # arrays stay
    broad_phase.map(2)[:] = [0, 0, 0, 1, 1, 1]
    broad_phase.shrink()
    broad_phase.begin()
    with pytest.raises(broadcl.Error, match="finish"):
        broad_phase.shrink()
    broad_phase.finish()
    assert broad_phase.pairs().tolist() == [[0, 1]]


def test_exclusions():
    values = uniform(200)
    expected = oracle(values)
    broad_phase = broadcl.BroadPhase()
    broad_phase.add(values)
    broad_phase.set_exclusions(expected[::2, ::-1])
    assert np.array_equal(broad_phase.update().added, expected[1::2])
    broad_phase.set_exclusions([])
    assert np.array_equal(broad_phase.update().added, expected[::2])
    view = broad_phase.map(2)
    view[:] = [0, 0, 0, 1, 1, 1]
    broad_phase.set_exclusions([[1, 0]])  # after what was written
    broad_phase.update()
    assert len(broad_phase.pairs()) == 0
