"""Boxes whose numbers are in another order than the call says."""

import warnings

import numpy as np
import pytest

import broadcl
from conftest import OnlyDlpack, oracle, uniform

LAYOUTS = ["min max", "axes", "centre size", "centre half size"]


def in_layout(values, layout):
    """(n, 6) or (n, 4) boxes in another layout, as float64."""
    lower, upper = np.split(values.astype(np.float64), 2, axis=1)
    if layout == "axes":
        return np.stack([lower, upper], axis=2).reshape(values.shape)
    if layout == "min max":
        return np.hstack([lower, upper])
    return np.hstack([(lower + upper) / 2, (upper - lower) / (2 if layout == "centre half size" else 1)])


def whole(n):
    """Boxes whose corners, centres and half sizes are integers."""
    return np.round(uniform(n) * 4) * 2


def calls(values, layout):
    """Each function that takes boxes, as a call with these."""
    broad_phase = broadcl.BroadPhase()
    ids = broad_phase.add(np.tile(broadcl.EMPTY, (len(values), 1)))
    return broad_phase, [
        lambda: broadcl.overlapping_pairs(values, layout=layout),
        lambda: broad_phase.add(values, layout=layout),
        lambda: broad_phase.move(ids, values, layout=layout),
        lambda: broad_phase.update(values, layout=layout),
        lambda: broad_phase.begin(values, layout=layout),
    ]


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("form", [
    np.copy, np.asfortranarray, np.ndarray.tolist, OnlyDlpack, lambda a: a.astype(np.float32), lambda a: a.astype(np.int64), lambda a: a[::-1].copy()[::-1],
])
def test_layouts(layout, form):
    values = whole(60)
    boxes = form(in_layout(values, layout))
    expected = oracle(values)
    assert len(expected)
    assert np.array_equal(broadcl.overlapping_pairs(boxes, layout=layout), expected)
    assert np.array_equal(broadcl.overlapping_pairs(boxes, boxes, layout=layout), oracle(values, values))
    for dtype in (np.float32, np.float64):
        broad_phase = broadcl.BroadPhase(dtype=dtype)
        ids = broad_phase.add(boxes, layout=layout)
        assert np.array_equal([broad_phase.box(id) for id in ids], values)
        assert np.array_equal(broad_phase.update(boxes, layout=layout).added, expected)
        one = in_layout(values[1:2], layout)[0]
        broad_phase.move(ids[0], one, layout=layout)
        assert broad_phase.add(one, layout=layout) == 60
        assert np.array_equal(broad_phase.box(0), values[1]) and np.array_equal(broad_phase.box(60), values[1])
        broad_phase.begin(boxes, layout=layout)
        broad_phase.finish()
        assert np.array_equal(broad_phase.pairs(), expected)
    flat = values[:, [0, 1, 3, 4]]
    expected = oracle(values * [1, 1, 0, 1, 1, 0])
    assert np.array_equal(broadcl.overlapping_pairs(form(in_layout(flat, layout)), layout=layout), expected)


@pytest.mark.parametrize("layout", LAYOUTS[2:])
def test_centres_and_sizes_in_two_arrays(layout):
    values = whole(60)
    boxes = in_layout(values, layout)
    centres, sizes = boxes[:, :3], boxes[:, 3:].astype(np.float32)
    assert np.array_equal(broadcl.overlapping_pairs((centres, sizes), layout=layout), oracle(values))
    assert np.array_equal(broadcl.overlapping_pairs(boxes.reshape(-1, 2, 3), layout=layout), oracle(values))


def test_no_layout_loses_a_pair_to_rounding():
    centres = np.float32([[1e7, 0, 0], [1e7 + 1, 0, 0]])
    sizes = np.ones((2, 3), np.float32)  # the corners between them are no float32
    assert broadcl.overlapping_pairs((centres, sizes), layout="centre size").tolist() == [[0, 1]]


@pytest.mark.parametrize("layout", LAYOUTS[1:])
@pytest.mark.parametrize("call", range(5))
def test_one_warning_names_the_number_the_row_and_the_likely_layout(layout, call):
    values = uniform(50)
    values[:3] = [-10, -10, -10, -9, 9, 10]  # no box in any layout
    wrong = in_layout(values, layout).astype(np.float32)
    number = np.count_nonzero((wrong[:, :3] > wrong[:, 3:]).any(axis=1))
    first = np.flatnonzero((wrong[:, :3] > wrong[:, 3:]).any(axis=1))[0]
    with pytest.warns(broadcl.InvertedBoxesWarning) as caught:
        calls(wrong, "min max")[1][call]()
    assert len(caught) == 1 and caught[0].filename == __file__
    text = str(caught[0].message)
    name = "layout='axes'" if layout == "axes" else "layout='centre size' or 'centre half size'"
    assert f" {number} of 50 rows of boxes, the first of them row {first}; " in text and text.endswith(f"give {name}"), text
    for right in calls(wrong, layout)[1]:
        right()


def test_a_few_inverted_boxes_are_no_layout():
    values = uniform(50).astype(np.float64)
    values[[7, 9]] = values[[7, 9]][:, [3, 1, 2, 0, 4, 5]]
    with pytest.warns(broadcl.InvertedBoxesWarning, match="2 of 50 rows of boxes, the first of them row 7; give broadcl.EMPTY"):
        broadcl.overlapping_pairs(values)
    with pytest.warns(broadcl.InvertedBoxesWarning, match="1 of 1 rows of boxes, the first of them row 0; give broadcl.EMPTY"):
        broadcl.BroadPhase().add([1, 0, 0, -1, 1, -1])


def test_two_sets_have_one_warning():
    right, wrong = uniform(50), in_layout(uniform(50), "axes")
    for a, b, text in (
        (wrong, right, r" \d+ of 50 rows of a, the first of them row \d+; "),
        (right, wrong, r" \d+ of 50 rows of b, the first of them row \d+; "),
        (wrong, wrong, r" \d+ of 50 rows of a, .* row \d+, and \d+ of 50 rows of b, .* row \d+; "),
    ):
        with pytest.warns(broadcl.InvertedBoxesWarning, match=text) as caught:
            broadcl.overlapping_pairs(a, b)
        assert len(caught) == 1


def test_empty_boxes_are_no_reason_to_warn():
    assert broadcl.EMPTY == (np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf)
    for dtype in (np.float32, np.float64):
        values = uniform(50).astype(dtype)
        values[::3] = broadcl.EMPTY
        broad_phase, each = calls(values, "min max")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            for call in each:
                call()
            values[::3, [0, 1, 3, 4]] = broadcl.EMPTY[1:5]
            broadcl.overlapping_pairs(values[:, [0, 1, 3, 4]])
            assert broad_phase.add(broadcl.EMPTY) == 50
        broad_phase.finish()
        assert np.array_equal(broad_phase.pairs(), oracle(values))


def test_a_warning_that_is_an_error_changes_nothing():
    wrong = in_layout(uniform(50), "axes")
    broad_phase, each = calls(wrong, "min max")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for call in each:
            with pytest.raises(broadcl.InvertedBoxesWarning, match="layout='axes'"):
                call()
    assert len(broad_phase) == 50 and tuple(broad_phase.box(0)) != tuple(wrong[0])
    assert len(broad_phase.update().added) == 0
