import array
import ctypes

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import broadcl
from conftest import OnlyDlpack, boxes, oracle, uniform

pytestmark = pytest.mark.filterwarnings("ignore::broadcl.InvertedBoxesWarning")  # of random boxes

HOST = ["auto", "sweep-and-prune", "oracle"]


def in_columns(values):
    return np.asfortranarray(values)


def backwards(values):
    return values[::-1].copy()[::-1]


def every_second(values):
    wide = np.full((2 * len(values), 9), np.nan, values.dtype)
    wide[::2, 2:8] = values
    return wide[::2, 2:8]


def misaligned(values):
    record = np.dtype([("tag", "u1"), ("box", values.dtype, 6)])  # not aligned
    records = np.zeros(len(values), record)
    records["box"] = values
    return records["box"]


def other_byte_order(values):
    return values.astype(values.dtype.newbyteorder())


def read_only(values):
    values = values.copy()
    values.flags.writeable = False
    return values


def corners(values):
    return values.reshape(-1, 2, 3)


def two_arrays(values):
    return values[:, :3], values[:, 3:]


def two_in_columns(values):
    return in_columns(values[:, :3]), in_columns(values[:, 3:])


def two_strides(values):
    return values[:, :3].copy(), in_columns(values[:, 3:])


def two_dtypes(values):
    return values[:, :3].astype(np.float64), values[:, 3:].copy()


FORMS = [
    np.copy, in_columns, backwards, every_second, misaligned, other_byte_order, read_only, corners, two_arrays, two_in_columns,
    two_strides, two_dtypes, OnlyDlpack, memoryview, np.ndarray.tolist,
]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.__name__)
def test_reads_every_form(form, dtype):
    values = uniform(60).astype(dtype)
    assert np.array_equal(broadcl.overlapping_pairs(form(values)), oracle(values))
    assert np.array_equal(broadcl.overlapping_pairs(values[:20], form(values)), oracle(values[:20], values))


def test_reads_buffers_that_numpy_does_not_know():
    assert broadcl.overlapping_pairs(((ctypes.c_float * 6) * 2)((0, 0, 0, 1, 1, 1), (1, 1, 1, 2, 2, 2))).tolist() == [[0, 1]]
    one = array.array("d", [0, 0, 0, 1, 1, 1])
    assert broadcl.overlapping_pairs(one, one).tolist() == [[0, 0]]


@pytest.mark.parametrize("dtype", ["i1", "u2", "i4", "u4", "i8", "u8", int])
def test_integers_are_float64(dtype):
    values = np.round(uniform(60) * 2).astype(dtype)
    for form in set(FORMS) - {every_second}:  # which needs a NaN
        assert np.array_equal(broadcl.overlapping_pairs(form(values)), oracle(values)), form
    broad_phase = broadcl.BroadPhase(dtype=np.float64)
    assert np.array_equal(broad_phase.update(values).added, oracle(values))
    large = np.array([[0, 0, 0, 2**53 - 1, 1, 1], [2**53, 0, 0, 2**53, 1, 1]])  # float32 cannot tell these
    assert len(broadcl.overlapping_pairs(large)) == len(broadcl.overlapping_pairs(large.tolist())) == 0


def test_nested_lists_and_lists_of_boxes():
    lower, upper = np.zeros((2, 3)), np.ones((2, 3))
    assert broadcl.overlapping_pairs((lower, upper)).tolist() == [[0, 1]]
    assert broadcl.overlapping_pairs([[[0, 0, 0], [1, 1, 1]], [[1, 1, 1], [2, 2, 2]]]).tolist() == [[0, 1]]
    assert broadcl.overlapping_pairs([np.array([[0, 0, 0], [1, 1, 1]])] * 3).tolist() == [[0, 1], [0, 2], [1, 2]]


def test_sizes_of_one_and_none():
    assert broadcl.overlapping_pairs(np.empty((0, 6))).shape == (0, 2)
    assert broadcl.overlapping_pairs(np.empty((0, 2, 3), np.float32), np.ones((1, 6))).shape == (0, 2)
    assert broadcl.overlapping_pairs(np.broadcast_to(np.float32([0, 0, 0, 1, 1, 1]), (3, 6))).tolist() == [
        [0, 1], [0, 2], [1, 2],
    ]


@pytest.mark.parametrize("form", [np.copy, in_columns, backwards, np.ndarray.tolist], ids=lambda form: form.__name__)
def test_two_dimensions(form):
    values = uniform(60)
    flat = values.copy()
    flat[:, [2, 5]] = 0
    assert np.array_equal(broadcl.overlapping_pairs(form(values[:, [0, 1, 3, 4]])), oracle(flat))


@given(boxes(np.float32))
@pytest.mark.parametrize("algorithm", HOST)
def test_pairs_of_float32(algorithm, values):
    pairs = broadcl.overlapping_pairs(values, algorithm=algorithm)
    assert pairs.dtype == np.uint32
    assert np.array_equal(pairs, oracle(values))


@given(boxes(np.float64))
@pytest.mark.parametrize("algorithm", HOST)
def test_pairs_of_float64(algorithm, values):
    assert np.array_equal(broadcl.overlapping_pairs(values, algorithm=algorithm), oracle(values))


def test_float64_is_exact_and_float32_is_what_the_caller_rounds():
    lower = np.float64([[0.1 + 0.2, 0, 0], [0, 0, 0]])
    upper = np.float64([[1, 1, 1], [0.3, 1, 1]])
    assert broadcl.overlapping_pairs((lower, upper)).tolist() == []
    assert broadcl.overlapping_pairs((lower.astype(np.float32), upper.astype(np.float32))).tolist() == [[0, 1]]
    far = np.hstack([lower, upper]) + [6.4e6, 0, 0] * 2
    assert np.array_equal(broadcl.overlapping_pairs(far), oracle(far))


@given(boxes(np.float32), boxes(np.float64))
def test_two_sets(a, b):
    assert np.array_equal(broadcl.overlapping_pairs(a, b), oracle(a, b))


@given(boxes(np.float32), boxes(np.float32), st.integers(1, 4), st.sampled_from(["i8", "u4", "u2"]))
@pytest.mark.parametrize("algorithm", HOST)
def test_exclusions(algorithm, a, b, step, dtype):
    expected = oracle(a)
    kept = np.arange(len(expected)) % step != 0
    given = expected[~kept].astype(dtype)[::-1, ::-1]  # in another order, and with i > j
    assert np.array_equal(broadcl.overlapping_pairs(a, exclusions=given, algorithm=algorithm), expected[kept])
    expected = oracle(a, b)
    kept = np.arange(len(expected)) % step != 0
    given = np.vstack([expected[~kept], np.arange(min(len(a), len(b)))[:, None].repeat(2, axis=1)])
    kept &= expected[:, 0] != expected[:, 1]
    assert np.array_equal(broadcl.overlapping_pairs(a, b, exclusions=given, algorithm=algorithm), expected[kept])


def test_exclusions_on_a_device():
    values = uniform(2000)
    for second in (None, uniform(300)):
        expected = oracle(values, second)
        for algorithm in ("brute-force", "tiles"):
            pairs = broadcl.overlapping_pairs(values, second, exclusions=expected[::2], device=broadcl.select_device(), algorithm=algorithm)
            assert np.array_equal(pairs, expected[1::2])


def shared(a, b):
    """The rows of a and of b that have a number in common, by the definition."""
    pairs = [(i, j) for j, t in enumerate(b) for i, s in enumerate(a) if set(s) & set(t)]
    return np.array(pairs, np.uint32).reshape(-1, 2)


@given(hnp.arrays(np.int64, st.tuples(st.integers(0, 20), st.integers(1, 3)), elements=st.integers(0, 12)),
       hnp.arrays(np.uint32, st.tuples(st.integers(0, 20), st.integers(1, 3)), elements=st.integers(0, 12)))
def test_pairs_that_share(a, b):
    assert np.array_equal(broadcl.pairs_that_share(a, b), shared(a.tolist(), b.tolist()))
    both = shared(a.tolist(), a.tolist())
    assert np.array_equal(broadcl.pairs_that_share(a), both[both[:, 0] < both[:, 1]])


def test_pairs_that_share_of_lists():
    pairs = broadcl.pairs_that_share([[0, 1], [1, 2], [3, 4]])
    assert pairs.dtype == np.uint32 and pairs.tolist() == [[0, 1]]
    assert broadcl.pairs_that_share([[0, 1]], [[5], [1]]).tolist() == [[0, 1]]
    assert broadcl.pairs_that_share([]).shape == (0, 2)
    assert broadcl.pairs_that_share(np.empty((0, 3), int), [[1]]).shape == (0, 2)


@given(st.integers(1, 3000), st.integers(0, 9))
def test_many(n, seed):
    values = uniform(n, seed=seed)
    assert np.array_equal(broadcl.overlapping_pairs(values, threads=1 + seed % 3), oracle(values))


def test_on_a_device():
    values = uniform(2000)
    device = broadcl.select_device()
    for selector in (device, device.id, device.name):
        assert np.array_equal(broadcl.overlapping_pairs(values, device=selector, algorithm="tiles"), oracle(values))
