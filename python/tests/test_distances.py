import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import broadcl
from conftest import boxes, oracle, squared_distances, uniform

pytestmark = pytest.mark.filterwarnings("ignore::broadcl.InvertedBoxesWarning")  # of random boxes

distances = st.sampled_from([0, 1, 2, 0.1, 2.0**-62, 2.0**-64, 2.0**40, 2.0**63])


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@given(values=boxes(), others=boxes(), distance=distances)
def test_any_boxes(dtype, values, others, distance):
    values, others = values.astype(dtype), others.astype(dtype)
    assert np.array_equal(broadcl.overlapping_pairs(values, distance=distance), oracle(values, reach=distance))
    assert np.array_equal(broadcl.overlapping_pairs(values, others, distance=distance), oracle(values, others, distance))
    broad_phase = broadcl.BroadPhase(distance=distance, dtype=dtype)
    assert np.array_equal(broad_phase.update(values).added, oracle(values, reach=distance))


@given(values=boxes(np.float64), others=boxes(np.float64))
def test_squared_distances(values, others):
    every = np.array([(a, b) for a in range(len(values)) for b in range(len(others))], np.uint32).reshape(-1, 2)
    with np.errstate(over="ignore"):
        single = values.astype(np.float32), others.astype(np.float32)
    for first, second in (single, (values, others)):
        found = broadcl.squared_distances(first, second, every)
        assert found.dtype == np.float64
        assert np.array_equal(found, squared_distances(first, second).ravel())
        inside = every[every[:, 1] < len(first)]
        assert np.array_equal(broadcl.squared_distances(first, inside), squared_distances(first, first)[tuple(inside.T)])
    assert np.array_equal(broadcl.squared_distances(single[0], others, every),
                          squared_distances(single[0].astype(float), others).ravel())


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("n", [0, 1, 31, 32, 33, 1000])
def test_points_are_boxes_of_no_size(dtype, n):
    points = np.random.default_rng(5).uniform(0, 10, (n, 3)).astype(dtype)
    both = np.hstack([points, points])
    pairs = broadcl.overlapping_pairs(points, distance=1.5, layout="points")
    assert np.array_equal(pairs, oracle(both, reach=1.5))
    assert n < 1000 or len(pairs) > 1000
    assert np.array_equal(broadcl.overlapping_pairs((points, points), distance=1.5), pairs)
    assert np.array_equal(broadcl.squared_distances(points, pairs, layout="points"), squared_distances(both, both)[tuple(pairs.T)])
    flat = np.hstack([points[:, :2], np.zeros((n, 1), dtype)])
    assert np.array_equal(broadcl.overlapping_pairs(points[:, :2], distance=0.5, layout="points"),
                          oracle(np.hstack([flat, flat]), reach=0.5))


@pytest.mark.parametrize("algorithm", broadcl.algorithms())
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_spheres_that_move_and_grow(algorithm, dtype):
    random = np.random.default_rng(6)
    points = random.uniform(0, 8, (300, 3)).astype(dtype)
    reaches = random.uniform(0, 1, 300).astype(dtype)

    def expected():
        return oracle(np.hstack([points, points]), reach=reaches[:, None] + reaches)

    broad_phase = broadcl.BroadPhase(algorithm=algorithm, dtype=dtype)
    ids = broad_phase.add(points, reach=reaches, layout="points")
    assert [broad_phase.reach(id) for id in ids] == reaches.tolist()
    assert np.array_equal(broad_phase.update().added, expected())
    assert np.array_equal(broad_phase.box(0), np.hstack([points[0], points[0]]))
    for frame in range(4):
        some = random.permutation(300)[:40]
        before = {tuple(pair) for pair in broad_phase.pairs().tolist()}
        if frame % 2 == 0:
            reaches[some] = random.uniform(0, 1.5, 40)
            broad_phase.set_reach(some, reaches[some])
        else:
            points[some] += 0.5
            broad_phase.move(some, points[some], layout="points")
        added, removed = broad_phase.update()
        after = {tuple(pair) for pair in expected().tolist()}
        assert {tuple(pair) for pair in added.tolist()} == after - before
        assert {tuple(pair) for pair in removed.tolist()} == before - after
        assert np.array_equal(broad_phase.pairs(), expected())
    broad_phase.set_reach(ids, 0)
    assert len(broad_phase.update().added) == 0 and len(broad_phase.pairs()) == 0


def test_a_distance_is_that_of_the_pair_and_of_all_objects():
    broad_phase = broadcl.BroadPhase(distance=3)
    broad_phase.add([[0, 0, 0], [3, 0, 0], [6.5, 0, 0]], layout="points")
    assert broad_phase.update().added.tolist() == [[0, 1]]
    assert broad_phase.reach(0) == 1.5
    for refused in (lambda: broad_phase.set_reach(0, 1), lambda: broad_phase.add([0, 0, 0], layout="points", reach=1)):
        with pytest.raises(ValueError, match="distance"):
            refused()
    assert len(broad_phase) == 3


def test_queries_meet_what_reaches_them():
    broad_phase = broadcl.BroadPhase()
    broad_phase.add([[0, 0, 0], [5, 0, 0]], layout="points", reach=[1, 2])
    for within, expected in ((None, [1]), (0, [1]), (1, [1]), (2, [0, 1])):
        assert broad_phase.overlapping([3, 0, 0], layout="points", within=within)[1].tolist() == expected


def test_what_is_refused():
    broad_phase = broadcl.BroadPhase()
    ids = broad_phase.add(uniform(3), reach=1)
    for reach in (-1, np.nan, np.inf, 2.0**63, [1, 1, -1]):
        with pytest.raises(ValueError, match="reach"):
            broad_phase.set_reach(ids, reach)
        with pytest.raises(ValueError, match="reach"):
            broad_phase.add(uniform(3), reach=reach)
    for reach in ("1", None, [True]):
        with pytest.raises(TypeError, match="must be a number or an array of numbers"):
            broad_phase.set_reach(ids, reach)
    with pytest.raises(ValueError, match=r"reaches must be of shape \(n,\), not \(1, 1\)"):
        broad_phase.set_reach(ids, [[1]])
    with pytest.raises(ValueError, match="reaches"):
        broad_phase.set_reach(ids, [1, 2])
    with pytest.raises(ValueError, match="no object has the id 3"):
        broad_phase.set_reach([0, 3], 2)
    assert [broad_phase.reach(id) for id in ids] == [1, 1, 1] and len(broad_phase) == 3
    for distance in (-1, np.nan, np.inf):
        with pytest.raises(ValueError, match="distance"):
            broadcl.overlapping_pairs(uniform(3), distance=distance)
        with pytest.raises(ValueError, match="distance"):
            broadcl.BroadPhase(distance=distance)
    with pytest.raises(TypeError, match="distance must be a number"):
        broadcl.overlapping_pairs(uniform(3), distance="1")
    with pytest.raises(ValueError, match=r"\(0, 3\)"):
        broadcl.squared_distances(uniform(3), [[0, 3]])
    with pytest.raises(ValueError, match=r"pairs must be of shape \(n, 2\)"):
        broadcl.squared_distances(uniform(3), uniform(2), [0, 1])
    with pytest.raises(ValueError, match="a has boxes in 3 dimensions and b in 2"):
        broadcl.squared_distances(uniform(3), uniform(3)[:, :4], [])
