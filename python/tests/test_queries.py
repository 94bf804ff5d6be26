import itertools
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import broadcl
from conftest import as_lists, boxes, finite, hits, near, oracle, proper, rounded, squared_distances, times, uniform, ways

pytestmark = pytest.mark.filterwarnings("ignore::broadcl.InvertedBoxesWarning")  # of random boxes


def lists(hits):
    offsets, ids = hits
    assert offsets.dtype == np.uint64 and ids.dtype == np.uint32 and offsets[-1] == len(ids)
    return [ids[begin:end].tolist() for begin, end in itertools.pairwise(offsets)]


def found(queries, values, reach=0):
    return [np.flatnonzero(row).tolist() for row in near(queries, values, reach)]


def kept(values, **options):
    broad_phase = broadcl.BroadPhase(**options)
    broad_phase.add(values)
    return broad_phase


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@given(values=boxes(), queries=boxes(), within=st.sampled_from([None, 0, 1, 0.1, 2.0**62]))
def test_any_boxes(dtype, values, queries, within):
    values, queries = values.astype(dtype), queries.astype(dtype)
    expected = found(queries, values, within or 0)
    assert lists(broadcl.overlapping(values, queries, within=within)) == expected
    assert lists(kept(values, dtype=dtype).overlapping(queries, within=within)) == expected


@given(values=boxes(np.float64), queries=boxes(np.float64))
def test_float64_is_exact_in_one_search_and_rounded_outward_in_float32(values, queries):
    assert lists(broadcl.overlapping(values, queries)) == found(queries, values)
    with np.errstate(over="ignore"):
        single = queries.astype(np.float32)
    assert lists(broadcl.overlapping(values, single)) == found(single.astype(float), values)
    assert lists(kept(values).overlapping(queries)) == found(rounded(queries), rounded(values))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@given(values=boxes(), queries=boxes(), within=st.sampled_from([None, 0, 1, 0.1, 2.0**62]), limit=st.none() | st.integers(0, 3))
def test_what_is_nearest(dtype, values, queries, within, limit):
    values, queries = values.astype(dtype), queries.astype(dtype)
    finds = proper(queries)[:, None] & proper(values)[None, :] if within is None else near(queries, values, within)
    expected = hits(finds, np.arange(len(values)), squared_distances(queries, values), limit)
    assert as_lists(broadcl.nearest(values, queries, within=within, limit=limit)) == expected
    assert as_lists(kept(values, dtype=dtype).nearest(queries, within=within, limit=limit)) == expected


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@given(values=boxes(), starts=boxes().map(finite), paths=ways(), limit=st.none() | st.integers(0, 3))
def test_what_is_on_the_way(dtype, values, starts, paths, limit):
    values, starts = values.astype(dtype), starts.astype(dtype)
    paths = np.resize(paths, (len(starts), 4))
    directions, lengths = paths[:, :3], paths[:, 3]
    met = times(starts, directions, lengths, values)
    expected = hits(~np.isnan(met), np.arange(len(values)), met, limit)
    assert as_lists(broadcl.along(values, starts, directions, lengths, limit=limit)) == expected
    assert as_lists(kept(values, dtype=dtype).along(starts, directions, lengths, limit=limit)) == expected


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_nearest_points_and_rays_among_many(dtype):
    points = np.random.default_rng(4).uniform(0, 10, (1000, 3)).astype(dtype)
    both = np.hstack([points, points])
    expected = hits(np.ones((len(both[::7]), 1000), bool), np.arange(1000), squared_distances(both[::7], both), 5)
    assert as_lists(kept(both, dtype=dtype).nearest(points[::7], limit=5, layout="points")) == expected
    assert as_lists(broadcl.nearest(points, points[::7], limit=5, layout="points")) == expected
    values = uniform(1000).astype(dtype)
    directions = np.random.default_rng(5).normal(size=(1000, 3))
    broad_phase = kept(values, dtype=dtype)
    for lengths in (None, 0, 2.5):
        met = times(both, directions, np.full(1000, np.inf if lengths is None else lengths), values)
        expected = hits(~np.isnan(met), np.arange(1000), met)
        assert as_lists(broad_phase.along(points, directions, lengths, layout="points")) == expected
        assert as_lists(broadcl.along(values, (points, points), directions, lengths)) == expected
        offsets, ids, found = broad_phase.along(points, directions, lengths, count_only=True, layout="points")
        assert offsets.tolist() == expected[0] and len(ids) == len(found) == 0


def test_ways_in_two_dimensions_and_one_for_all():
    flat = np.array([[0, 0, 1, 1], [3, 0, 4, 1], [6, 2, 7, 3]])
    starts = np.array([[-1, 0.5, -1, 0.5], [5, 2.5, 5, 2.5]])
    broad_phase = kept(flat)
    for along in (broad_phase.along, lambda *ways, **options: broadcl.along(flat, *ways, **options)):
        assert as_lists(along(starts, (0.5, 0))) == ([0, 2, 3], [0, 1, 2], [2, 8, 2])
        assert as_lists(along(starts, [[0.5, 0], [-1, -2]], [5, np.inf])) == ([0, 1, 2], [0, 1], [2, 1])
        assert as_lists(along(starts[0], [1, 0], 4)) == ([0, 2], [0, 1], [1, 4])
        assert as_lists(along(starts[0], [0, 0])) == ([0, 0], [], [])
        assert as_lists(along([], [])) == ([0], [], [])
    assert as_lists(broad_phase.along([-1, 0.5], [1, 0], limit=1, layout="points")) == ([0, 1], [0], [1])
    assert as_lists(broad_phase.along([[-1, 0.5, 0]], [1, 0, 0], except_=[0], layout="points")) == ([0, 1], [1], [4])
    assert as_lists(broad_phase.nearest([5, 1], limit=2, layout="points")) == ([0, 2], [1, 2], [1, 2])


@pytest.mark.parametrize("algorithm", broadcl.algorithms())
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_every_algorithm_and_size(algorithm, dtype):
    random = np.random.default_rng(3)
    broad_phase = broadcl.BroadPhase(algorithm=algorithm, dtype=dtype)
    for n in (0, 1, 31, 32, 33, 200, 1000):
        values, queries = uniform(n).astype(dtype), uniform(max(n, 5), seed=1).astype(dtype)
        broad_phase.update(values)
        assert lists(broad_phase.overlapping(queries)) == found(queries, values)
        assert lists(broad_phase.overlapping(values)) == found(values, values)
        moved = random.permutation(n)[: n // 4]
        values[moved] += 1
        broad_phase.move(moved, values[moved])
        assert lists(broad_phase.overlapping(queries[:3])) == found(queries[:3], values)  # before the update, by single queries
        assert lists(broad_phase.overlapping(queries)) == found(queries, values)
        broad_phase.update()
        assert np.array_equal(broad_phase.pairs(), oracle(values))


def test_between_begin_and_finish_boxes_are_those_that_are_set():
    values = uniform(500)
    broad_phase = kept(values)
    broad_phase.begin()
    later = values + np.float32(0.25)
    broad_phase.move(np.arange(250), later[:250])
    broad_phase.remove(499)
    now = np.vstack([later[:250], values[250:499]])
    assert lists(broad_phase.overlapping(values)) == found(values, now)
    assert np.array_equal(broad_phase.finish().added, oracle(values))
    assert lists(broad_phase.overlapping(values)) == found(values, now)
    broad_phase.update()
    assert np.array_equal(broad_phase.pairs(), oracle(now))


def test_what_is_written_in_place_counts_at_once():
    broad_phase = kept(uniform(300))
    broad_phase.update()
    view = broad_phase.map(300)
    view[7] = [50, 50, 50, 51, 51, 51]
    assert lists(broad_phase.overlapping([[50, 50, 50, 50, 50, 50]])) == [[7]]
    assert view.flags.writeable
    view[8] = [50, 50, 50, 51, 51, 51]
    assert lists(broad_phase.overlapping([[50, 50, 50, 50, 50, 50]])) == [[7, 8]]


def test_the_query_is_among_its_answers_unless_it_is_excepted():
    values = uniform(300)
    broad_phase = kept(values)
    everything = lists(broad_phase.overlapping(values))
    assert all(id in ids for id, ids in enumerate(everything))
    others = lists(broad_phase.overlapping(values, except_=np.arange(300)))
    assert others == [[id for id in ids if id != own] for own, ids in enumerate(everything)]
    assert lists(broad_phase.overlapping(values, except_=[2**32 - 1] * 300)) == everything
    broad_phase.update()
    assert [broad_phase.partners(id).tolist() for id in range(300)] == others


def test_points_boxes_and_empty_ones():
    values = np.array([[0, 0, 0, 1, 1, 1], [1, 0, 0, 2, 1, 1], broadcl.EMPTY, [-np.inf] * 3 + [np.inf] * 3])
    for broad_phase in (kept(values), kept(values, dtype=np.float64)):
        assert lists(broad_phase.overlapping([1, 1, 1], layout="points")) == [[0, 1, 3]]
        assert lists(broad_phase.overlapping([[0.5, 0.5, 0.5], [9, 9, 9]], layout="points")) == [[0, 3], [3]]
        assert lists(broad_phase.overlapping([[0.5, 0], [9, 9]], layout="points")) == [[0, 3], [3]]
        assert lists(broad_phase.overlapping([broadcl.EMPTY, values[3]])) == [[], [0, 1, 3]]
        assert lists(broad_phase.overlapping([])) == []
        assert broad_phase.overlapping([])[0].tolist() == [0]
    points = np.random.default_rng(0).uniform(0, 10, (100, 3))
    both = points, points
    assert lists(broadcl.overlapping(uniform(200), both)) == found(np.hstack(both), uniform(200).astype(float))
    assert lists(broadcl.overlapping(points, points[::2], within=2, layout="points")) == found(
        np.hstack(both)[::2], np.hstack(both), 2)


def test_filters():
    broad_phase = broadcl.BroadPhase()
    box = [0, 0, 0, 1, 1, 1]
    broad_phase.add([box] * 6, group=[1, 2, 1, 1, 1, 1], mask=[-1, -1, 2, -1, -1, -1], body=[broadcl.NO_BODY] * 3 + [7] + [broadcl.NO_BODY] * 2,
                    world=[0, 0, 0, 0, 1, broadcl.ALL_WORLDS])
    assert lists(broad_phase.overlapping(box)) == [[0, 1, 2, 3, 4, 5]]  # no filter is tested
    assert lists(broad_phase.overlapping(box, world=0)) == [[0, 1, 3, 5]]
    assert lists(broad_phase.overlapping(box, mask=2)) == [[1]]
    assert lists(broad_phase.overlapping(box, body=7)) == [[0, 1, 5]]
    assert lists(broad_phase.overlapping(box, world=broadcl.ALL_WORLDS, group=-1)) == [[0, 1, 2, 3, 4, 5]]
    assert lists(broad_phase.overlapping([box] * 3, world=[0, 1, 2])) == [[0, 1, 3, 5], [4, 5], [5]]


@pytest.mark.parametrize("limit", [0, 1, 3, 2**32 - 1])
def test_a_limit_keeps_the_lowest_ids(limit):
    values = uniform(300, overlaps=10)
    broad_phase = kept(values)
    expected = [ids[:limit] for ids in found(values, values)]
    assert lists(broad_phase.overlapping(values, limit=limit)) == expected
    offsets, ids = broad_phase.overlapping(values, limit=limit, count_only=True)
    assert offsets.tolist() == np.cumsum([0] + [len(row) for row in expected]).tolist() and len(ids) == 0


def test_more_hits_than_are_allowed_are_an_error_and_not_cut_off():
    values = uniform(300)
    broad_phase = kept(values)
    hits = len(broad_phase.overlapping(values)[1])
    for overlapping in (broad_phase.overlapping, lambda queries, **options: broadcl.overlapping(values, queries, **options)):
        assert len(overlapping(values, most_hits=hits)[1]) == hits
        with pytest.raises(broadcl.Error, match=f"more than {hits - 1}"):
            overlapping(values, most_hits=hits - 1)
    crowd = np.tile(uniform(1), (2_000, 1))
    with pytest.raises(broadcl.Error, match="more than 1000000"):
        kept(crowd).overlapping(crowd, most_hits=1_000_000)
    assert kept(crowd).overlapping(crowd, count_only=True)[0][-1] == 4_000_000
    assert kept(crowd).overlapping(crowd, most_hits=1_000_000, limit=500)[0][-1] == 1_000_000


def test_what_is_refused():
    broad_phase = kept(uniform(20))
    bad = uniform(20)
    bad[7, 2] = np.nan
    with pytest.raises(ValueError, match="row 7 of boxes has a NaN"):
        broad_phase.overlapping(bad)
    with pytest.raises(ValueError, match="row 7 of queries has a NaN"):
        broadcl.overlapping(uniform(5), bad)
    with pytest.raises(ValueError, match="row 7 of boxes has a NaN"):
        broadcl.overlapping(bad, uniform(5))
    with pytest.raises(ValueError, match="filters must be"):
        broad_phase.overlapping(bad[:3], world=[1, 2])
    for within in (-1, np.nan, np.inf):
        with pytest.raises(ValueError, match="within"):
            broad_phase.overlapping(bad[:3], within=within)
    with pytest.raises(ValueError, match="exceptions"):
        broad_phase.overlapping(bad[:3], except_=[1, 2])
    with pytest.raises(ValueError, match="row 7 of boxes has a NaN"):
        broad_phase.nearest(bad, limit=1)
    for within in (-1, np.nan, np.inf):
        with pytest.raises(ValueError, match="within"):
            broad_phase.nearest(bad[:3], within=within)
    with pytest.raises(ValueError, match="boxes has boxes in 3 dimensions and queries in 2"):
        broadcl.nearest(uniform(5), uniform(5)[:, [0, 1, 3, 4]])
    with pytest.raises(broadcl.Error, match="more than 59"):
        broad_phase.nearest(bad[:3], most_hits=59)
    with pytest.raises(ValueError, match="boxes has boxes in 3 dimensions and queries in 2"):
        broadcl.overlapping(uniform(5), uniform(5)[:, [0, 1, 3, 4]])
    with pytest.raises(ValueError, match=r"boxes must be of shape \(n, 3\) or \(n, 2\) in the layout 'points'.*not \(20, 6\)"):
        broad_phase.overlapping(bad, layout="points")
    with pytest.raises(ValueError, match="boxes must be one array in the layout 'points'"):
        broad_phase.overlapping((bad[:, :3], bad[:, 3:]), layout="points")
    with pytest.raises(ValueError, match=r"not \(20, 3\); for points, give layout='points'"):
        broad_phase.overlapping(bad[:, :3])
    with pytest.raises(ValueError, match="no object has the id 20"):
        broad_phase.partners(20)
    broad_phase.begin()
    with pytest.raises(broadcl.Error, match="finish"):
        broad_phase.partners(0)


@pytest.mark.parametrize("error, message, changes", [
    (ValueError, "row 7 of starts has a NaN", {"starts": np.where(np.arange(20)[:, None] == 7, np.nan, uniform(20))}),
    (ValueError, "start 7 is infinite", {"starts": np.where(np.arange(20)[:, None] == 7, np.inf, uniform(20))}),
    (ValueError, r"starts must be of shape .*not \(20, 3\); for points, give layout='points'", {"starts": uniform(20)[:, :3]}),
    (TypeError, "starts must be float32", {"starts": None}),
    (ValueError, r"directions must be of shape \(n, 3\) or \(3,\), not \(20,\)", {"directions": np.zeros(20)}),
    (ValueError, r"directions must be of shape \(n, 3\) or \(3,\), not \(\)", {"directions": 1}),
    (ValueError, r"directions must be of shape \(n, 3\) or \(3,\), not \(20, 2\)", {"directions": np.zeros((20, 2))}),
    (ValueError, r"directions must be of shape \(n, 3\) or \(3,\), not \(1, 20, 3\)", {"directions": np.zeros((1, 20, 3))}),
    (TypeError, "directions must be a number or an array of numbers, not complex128", {"directions": np.zeros((20, 3), complex)}),
    (TypeError, "directions must be a number or an array of numbers, not object", {"directions": None}),
    (ValueError, "19 directions for 20 queries", {"directions": np.zeros((19, 3))}),
    (ValueError, "0 directions for 20 queries", {"directions": []}),
    (ValueError, "direction 0 is infinite or NaN", {"directions": [0, np.nan, 0]}),
    (ValueError, "direction 0 is infinite or NaN", {"directions": [0, np.inf, 0]}),
    (ValueError, "directions has masked values", {"directions": np.ma.array([0, 1, 0], mask=[0, 1, 0])}),
    (ValueError, "length 0 is -1", {"lengths": -1}),
    (ValueError, "length 19 is -?nan", {"lengths": [1] * 19 + [np.nan]}),
    (ValueError, "2 lengths for 20 queries", {"lengths": [1, 2]}),
    (ValueError, "lengths is empty", {"lengths": []}),
    (ValueError, r"lengths must be of shape \(n,\), not \(20, 1\)", {"lengths": np.zeros((20, 1))}),
    (TypeError, "lengths must be a number or an array of numbers, not <U1", {"lengths": "1"}),
    (ValueError, "exceptions", {"except_": [1, 2]}),
    (broadcl.Error, "more than 2", {"most_hits": 2}),
], ids=lambda value: value if isinstance(value, str) else "")
def test_ways_that_are_refused(error, message, changes):
    values = uniform(20)
    arguments = {"starts": values, "directions": [1, 0, 0], **changes}
    for along in (kept(values).along, lambda **arguments: broadcl.along(values, **arguments)):
        with pytest.raises(error, match=message):
            along(**arguments)


def test_partners_are_those_of_the_last_update():
    broad_phase = broadcl.BroadPhase()
    broad_phase.add([[0, 0, 0, 1, 1, 1]] * 3 + [[5, 5, 5, 6, 6, 6]])
    assert broad_phase.partners(0).tolist() == []
    broad_phase.update()
    assert broad_phase.partners(1).tolist() == [0, 2] and broad_phase.partners(3).tolist() == []
    broad_phase.move(3, [0, 0, 0, 1, 1, 1])
    broad_phase.remove(0)
    assert broad_phase.partners(1).tolist() == [0, 2]
    first = broad_phase.partners(1)
    broad_phase.update()
    broad_phase.shrink()
    assert broad_phase.partners(1).tolist() == [2, 3] and first.tolist() == [0, 2] and first.dtype == np.uint32


def test_several_threads_query_at_the_same_time():
    values = uniform(20_000)
    expected = [(offsets.tolist(), ids.tolist()) for offsets, ids in [broadcl.overlapping(values, values)]]
    broad_phase = kept(values)
    broad_phase.update()
    broad_phase.move(np.arange(100), values[:100])
    together = threading.Barrier(4)

    def work(k):
        together.wait()
        for _ in range(3):
            offsets, ids = broad_phase.overlapping(values)
            assert (offsets.tolist(), ids.tolist()) == expected[0]
            assert len(broad_phase.partners(k)) == len(ids[int(offsets[k]):int(offsets[k + 1])]) - 1
        return True

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(work, range(4)))


def test_nothing_changes_during_a_query():
    broad_phase = kept(np.tile(uniform(1), (20_000, 1)))
    broad_phase.overlapping(uniform(1))
    queries = np.tile(uniform(1), (5_000, 1))
    thread = threading.Thread(target=lambda: broad_phase.overlapping(queries, count_only=True))
    thread.start()
    refused = 0
    while thread.is_alive():
        try:
            broad_phase.set_filter(0, group=1)
        except RuntimeError as error:
            assert "another thread is using this object" in str(error)
            refused += 1
    thread.join()
    assert refused
    broad_phase.set_filter(0, group=1)
