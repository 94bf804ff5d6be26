"""What the page says of known times."""

from __future__ import annotations

import base64
import itertools
import zlib
from pathlib import Path

import numpy as np
import pytest

from study import store, verdict
from study.data import Cell, read_study
from study.figures import medians_of, number_of
from study.page import make
from study.plan import PAPER, StudyError
from study.recording import LEVELS, count_overlaps, pack, quantised, read_recording, replay_data
from study.statistics import noise_of, ratio_of_medians, rest_of, standing, three_digits


def test_a_cell_has_the_frames_that_all_of_its_runs_have(small_study: Path) -> None:
    study = read_study(small_study)
    assert [tuple(c) for c in study.cells("free-fall")] == [("free-fall", 10, 6), ("free-fall", 20, 6), ("free-fall", 20, 9)]
    assert set(study.times(Cell("free-fall", 20, 6))) == {"bullet-bvh", "tiles", "auto"}
    assert set(study.times(Cell("free-fall", 20, 9))) == {"bullet-bvh", "tiles"}
    assert [c.frames for c in study.over_objects("free-fall")] == [6, 6]
    row = study.runs.query("scenario == 'free-fall' and frames == 9 and broadphase == 'tiles' and repeat == 3").iloc[0]
    assert (row.search_mean_ms, row.rest_mean_ms, row.rest_cpu_mean_ms) == pytest.approx((1, 3, 3))
    assert (row.pairs_mean, row.pairs_last, row.total_sum_ms) == pytest.approx((90, 160, 32))


def test_verdicts_are_of_cpu_time_and_nothing_is_clear_within_the_noise(small_study: Path) -> None:
    study = read_study(small_study)
    cell = Cell("mixed-sizes", 20, 6)
    assert rest_of(study, cell, "") == pytest.approx([3, 9.9]) and rest_of(study, cell, "_cpu") == pytest.approx([3, 3.3])
    place = standing(study, cell, "search")
    assert place.first == "auto" and place.ties == ["tiles"]  # 4 % slower, in each run, and on a device
    assert place.over_first["tiles"].noise == pytest.approx(2.3) and place.over_first["bullet-bvh"].noise == pytest.approx(0.1)
    assert place.over_first["tiles"].interval and place.over_first["tiles"].interval[0] > 1.03
    assert noise_of(study, Cell("free-fall", 20, 9), "_cpu") == pytest.approx(0.1)  # which has tiles alone
    text = " ".join(verdict.sentences(study, "mixed-sizes", "search"))
    assert "Within noise, times as long: `tiles` 1.042" in text and "Clearly slower: `bullet-bvh` 5.21" in text
    assert "takes 0.192 (0.191 to 0.193) times as long as Bullet's fastest, `bullet-bvh`: clearly less" in text
    assert verdict.headline(study)[0].startswith("With 20 objects, update and broad phase together take least time with ")


def test_four_runs_have_no_interval_and_nothing_is_clear(small_study: Path) -> None:
    for path in small_study.glob("runs/*-5.csv.gz"):
        path.unlink()
    study = read_study(small_study)
    text = " ".join(s for metric in ("search", "total") for s in verdict.sentences(study, "mixed-sizes", metric))
    assert "first, 0.960 ms per frame. Within noise, times as long: `tiles` 1.042. Times as long: `bullet-bvh` 5.21." in text
    assert "clearly" not in text + " ".join(verdict.headline(study))
    assert "there are at most 4" in verdict.certainty(study)


def test_says_what_did_not_run(small_study: Path) -> None:
    (small_study / "runs" / "mixed-sizes-20-auto-5.csv.gz").unlink()
    lines = verdict.absent(read_study(small_study))
    assert lines == ["`gpu-bf` has no runs.", "6 of 65 planned runs are not done yet."]


def test_intervals_are_those_of_all_resamples() -> None:
    a, b = np.array([1.0, 2.0, 4.0, 5.0, 7.0]), np.array([1.0, 1.1, 1.5, 1.6, 2.0])
    medians = [np.median(list(itertools.product(x, repeat=5)), axis=1) for x in (a, b)]
    every = np.divide.outer(*medians).ravel()
    ratio = ratio_of_medians(a, b)
    assert ratio.value == pytest.approx(4 / 1.5)
    np.testing.assert_allclose(ratio.interval, np.quantile(every, (0.025, 0.975)), rtol=0.05)


def test_numbers_have_three_digits() -> None:
    numbers = {0: "0", 0.00123456: "0.00123", 0.9996: "1.00", 9.996: "10.0", 99.96: "100", 1234.5: "1,234"}
    assert {x: three_digits(x) for x in numbers} == numbers


def test_long_lines_are_of_medians() -> None:
    frames, medians = medians_of(np.array([1.0, 5.0, 2.0, 8.0, 7.0, 9.0, 100.0]), 3)
    assert (frames.tolist(), medians.tolist()) == ([1, 4], [2, 8])


def test_the_page_is_the_same_each_time_needs_no_recording_and_escapes_names(small_study: Path) -> None:
    make(small_study)
    first = {path: path.read_text() for path in [small_study / "study.csv", *small_study.glob("figures/*")]}
    whole = (small_study / "index.html").read_text()
    (small_study / "recordings" / "free-fall.npy").unlink()
    make(small_study)
    assert {path.name for path in first} == {"study.csv", *(f"figure-{n}.svg" for n in ("2", "5", "6", "6-search"))}
    assert [number_of(s) for s in (*PAPER, "streaming")] == [2, 3, 4, 5, 7]
    assert {path: path.read_text() for path in first} == first and not list(small_study.glob(".page-*"))
    text = (small_study / "index.html").read_text()
    before, after = (page.partition('<section id="scenes">') for page in (whole, text))
    assert before[0] == after[0] and "no recordings" in after[2] and 'id="figure-1"' in before[2]
    assert ">2, each on 2 of the processors and one of 2 GPUs<" in whole
    assert "A <CPU>" not in whole and "<GPU>" not in whole and 'src="http' not in whole


@pytest.mark.parametrize(
    ("reason", "name", "content"),
    [
        ("has runs but no study.json", "study.json", None),
        ("is damaged", "study.json", b"{"),
        ("'.*auto-1.csv.gz' is damaged: it is not a file of a run", "runs/free-fall-10-auto-1.csv.gz", b"x"),
        ("is damaged: it has not 6 frames", "runs/free-fall-10-auto-1.csv.gz", f'""\n{store.COLUMNS}\n'.encode()),
        ("frame 0 is malformed", "runs/free-fall-10-auto-1.csv.gz",
         f'""\n{store.COLUMNS}\n'.encode() + b"0,nan,1,1,1,1,1,1\n" * 6),
        ("is not a recording", "recordings/free-fall.npy", b"x"),
    ],
)
def test_bad_input_is_one_error_and_leaves_everything(small_study: Path, reason: str, name: str, content: bytes | None) -> None:
    (small_study / "index.html").write_text("before")
    path = small_study / name
    path.unlink()
    if content is not None:
        path.write_bytes(store.gzip.compress(content) if content.startswith(b'""') else content)
    files = set(small_study.iterdir())
    with pytest.raises(StudyError, match=reason):
        make(small_study)
    assert (small_study / "index.html").read_text() == "before" and set(small_study.iterdir()) == files


@pytest.mark.parametrize("array", [np.zeros((4, 6), np.float32), np.full((2, 4, 6), np.nan, np.float32), np.zeros((2, 4, 6))])
def test_refuses_what_is_no_recording(tmp_path: Path, array: np.ndarray) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(StudyError, match="is not a recording: "):
        read_recording("a", tmp_path / "a.npy")


def _boxes() -> np.ndarray:
    random = np.random.default_rng(3)
    low = random.integers(-9, 9, (300, 3)).astype(np.float32)  # many touch
    return np.concatenate([low, low + random.integers(0, 3, (300, 3)).astype(np.float32)], axis=1)


def test_overlaps_are_those_of_all_pairs() -> None:
    boxes = _boxes()
    below = boxes[:, None, :3] <= boxes[None, :, 3:]
    meets = np.all(below & np.swapaxes(below, 0, 1), axis=2)
    np.testing.assert_array_equal(count_overlaps(boxes), meets.sum(axis=1) - 1)


def test_packed_boxes_come_back() -> None:
    boxes = _boxes()
    low, high = boxes[:, :3].min(axis=0), boxes[:, 3:].max(axis=0)
    steps = np.frombuffer(zlib.decompress(base64.b64decode(pack(quantised(boxes, low, high)))), "<u2").reshape(boxes.shape)
    unpacked = np.cumsum(steps, axis=0, dtype=np.uint16)
    back = unpacked / LEVELS * np.tile(high - low, 2) + np.tile(low, 2)
    assert np.abs(back - boxes).max() < 0.51 * (high - low).max() / LEVELS + 1e-6


def test_long_recordings_are_thinned(small_study: Path) -> None:
    recording = read_recording("free-fall", small_study / "recordings" / "free-fall.npy")
    whole, thin = replay_data(recording), replay_data(recording, most_boxes=25)
    assert [(data["stride"], data["frames"], data["recorded_frames"]) for data in (whole, thin)] == [(1, 6, 6), (3, 2, 6)]
