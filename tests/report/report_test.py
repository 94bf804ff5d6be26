#!/usr/bin/env python3
"""Tests of the report, without a browser."""

from __future__ import annotations

import base64
import contextlib
import io
import itertools
import json
import tempfile
import unittest
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import small_study

from report.__main__ import make
from report.overlaps import count_overlaps
from report.recording import LEVELS, pack, quantised
from report.static_figures import medians_of
from report.statistics import ratio_of_medians, three_digits
from report.study import StudyError, read_study
from report.tables import about_times
from report.verdict import absent, headline, sentences


class SmallStudy(unittest.TestCase):
    """A test with the small study in a folder."""

    def setUp(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name) / "study"
        small_study.write(self.folder)
        self.run_file = self.folder / "runs" / "free-fall-10-bullet-bvh-1.csv"

    def make(self) -> Path:
        with contextlib.redirect_stdout(io.StringIO()):
            return make(self.folder)


class Report(SmallStudy):
    def test_is_the_same_file_each_time(self) -> None:
        names = [
            "report.html",
            *(f"figures/figure-{k}.{e}" for k in (1, 2, 5, 6) for e in ("svg", "png")),
        ]
        names = [name.replace("figure-5", "figure-3") for name in names]
        self.make()
        first = {name: (self.folder / name).read_bytes() for name in names}
        self.make()
        self.assertEqual({name: (self.folder / name).read_bytes() for name in names}, first)
        self.assertFalse(list(self.folder.glob(".report-*")))

    def test_explains_update_and_broad_phase_wherever_they_stand_alone(self) -> None:
        self.assertIn("The work of a broad phase in <code>setAabb()</code>", self.make().read_text())

    def test_asks_for_nothing_and_escapes_names(self) -> None:
        text = self.make().read_text(encoding="utf-8")
        self.assertNotIn("one <b>", text)
        self.assertNotIn("A <CPU>", text)
        self.assertNotRegex(text[: text.index("<script type")], r'(src|href)="(https?:)?//')

    def test_prints_little(self) -> None:
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            make(self.folder)
        self.assertIn("With 20 objects, the total time is shortest with tiles", printed.getvalue())
        self.assertLess(len(printed.getvalue()), 600)

    def test_needs_no_recording(self) -> None:
        (self.folder / "recordings" / "free-fall.npy").unlink()
        self.assertIn("no recordings", self.make().read_text(encoding="utf-8"))


class BadInput(SmallStudy):
    def expect(self, reason: str, spoil: Callable[[], object]) -> None:
        """Expects one clear error, which leaves everything in the folder as it was."""
        (self.folder / "report.html").write_text("before", encoding="utf-8")
        spoil()
        files = set(self.folder.iterdir())
        with self.assertRaisesRegex(StudyError, reason):
            self.make()
        self.assertEqual((self.folder / "report.html").read_text(encoding="utf-8"), "before")
        self.assertEqual(set(self.folder.iterdir()), files)

    def edit(self, path: Path, old: str, new: str) -> None:
        text = path.read_text(encoding="utf-8")
        self.assertIn(old, text)
        path.write_text(text.replace(old, new, 1), encoding="utf-8")

    def test_no_study(self) -> None:
        self.expect("not a folder of `broadcl study`", (self.folder / "study.json").unlink)

    def test_no_json(self) -> None:
        self.expect("not JSON", lambda: (self.folder / "study.json").write_text("{"))

    def test_another_format(self) -> None:
        self.expect(
            "format 1", lambda: self.edit(self.folder / "study.json", '"format": 1', '"format": 2')
        )

    def test_a_missing_key(self) -> None:
        self.expect(
            "no 'devices'", lambda: self.edit(self.folder / "study.json", '"devices"', '"other"')
        )

    def test_a_scenario_that_is_a_path(self) -> None:
        self.expect(
            "'../free-fall' is not the name",
            lambda: self.edit(self.folder / "study.json", '"free-fall"', '"../free-fall"'),
        )

    def test_no_summary(self) -> None:
        self.expect("no run has finished", (self.folder / "study.csv").unlink)

    def test_no_runs(self) -> None:
        header = small_study.HEADER + "\n"
        self.expect("no run has finished", lambda: (self.folder / "study.csv").write_text(header))

    def test_a_missing_run(self) -> None:
        self.expect("bullet-bvh-1.csv is missing", self.run_file.unlink)

    def test_a_run_that_is_not_in_the_summary(self) -> None:
        other = self.folder / "runs" / "free-fall-10-bullet-bvh-4.csv"
        self.expect("is not in study.csv", lambda: other.write_bytes(self.run_file.read_bytes()))

    def test_wrong_columns(self) -> None:
        self.expect("the first line is not", lambda: self.edit(self.run_file, "total_ms", "all_ms"))

    def test_a_column_too_few(self) -> None:
        self.expect("too few or too many", lambda: self.edit(self.run_file, "\n3,1.998000", "\n3"))

    def test_nan_in_a_run(self) -> None:
        self.expect("not finite", lambda: self.edit(self.run_file, "\n3,1.998000", "\n3,nan"))

    def test_nan_in_the_summary(self) -> None:
        self.expect("not finite", lambda: self.edit(self.folder / "study.csv", "1.998000", "nan"))

    def test_too_few_frames(self) -> None:
        self.expect(
            "5 frames",
            lambda: self.run_file.write_text(
                "".join(self.run_file.read_text().splitlines(keepends=True)[:-1])
            ),
        )

    def test_a_recording_of_another_shape(self) -> None:
        path = self.folder / "recordings" / "free-fall.npy"
        self.expect("shape", lambda: np.save(path, np.zeros((4, 6), np.float32)))

    def test_a_recording_with_nan(self) -> None:
        path = self.folder / "recordings" / "free-fall.npy"
        self.expect("not finite", lambda: np.save(path, np.full((2, 4, 6), np.nan, np.float32)))


class Words(SmallStudy):
    def test_name_who_is_first_and_whether_clearly(self) -> None:
        study = read_study(self.folder)
        total = " ".join(sentences(study, "free-fall", "total"))
        self.assertIn("With 20 objects, `tiles` is first: 4.00 ms per frame.", total)
        self.assertIn("Not clearly slower: `auto` at 1.000 (", total)
        self.assertIn("Clearly slower is `bullet-bvh`, 2.00", total)
        self.assertIn("takes 0.500 (0.499 to 0.501) times as long as Bullet's fastest", total)
        self.assertIn("clearly less", total)
        self.assertIn("`tiles` with 10 to 20 (not clearly)", total)
        self.assertIn(
            "`tiles` in free-fall (not clearly) and mixed-sizes (not clearly)", headline(study)[0]
        )

    def test_claim_nothing_of_single_runs(self) -> None:
        for path in self.folder.glob("runs/*.csv"):
            if not path.stem.endswith("-1"):
                path.unlink()
        table = self.folder / "study.csv"
        rows = table.read_text().splitlines(keepends=True)
        table.write_text("".join(rows[:1] + [row for row in rows if row.split(",")[3] == "1"]))
        study = read_study(self.folder)
        total = " ".join(sentences(study, "free-fall", "total"))
        self.assertRegex(total, r"`tiles` is first: \S+ ms per frame. Times as long: `auto` 1.\d+")
        self.assertNotIn("clear", total + " ".join(headline(study)))
        self.assertIn("Each ran once", " ".join(headline(study)))
        self.assertNotIn("interval", about_times(study))

    def test_say_if_one_of_several_ran_once(self) -> None:
        for repeat in (2, 3):
            (self.folder / "runs" / f"free-fall-20-bullet-bvh-{repeat}.csv").unlink()
        table = self.folder / "study.csv"
        rows = table.read_text().splitlines(keepends=True)
        once = "free-fall,20,6,{},bullet-bvh,"
        gone = (once.format(2), once.format(3))
        table.write_text("".join(row for row in rows if not row.startswith(gone)))
        study = read_study(self.folder)
        total = " ".join(sentences(study, "free-fall", "total"))
        self.assertIn("`bullet-bvh` at 2.00 (one run: no interval)", total)
        self.assertIn("95 % interval", about_times(study))

    def test_name_sizes_without_runs(self) -> None:
        info = json.loads((self.folder / "study.json").read_text())
        info["objects"].append(30)
        (self.folder / "study.json").write_text(json.dumps(info))
        lines = absent(read_study(self.folder))
        self.assertIn("`tiles` has no runs of free-fall and mixed-sizes with 30 objects.", lines)

    def test_name_what_was_left_out(self) -> None:
        lines = absent(read_study(self.folder))
        self.assertIn("`gpu-bf` has no runs.", lines)
        self.assertIn("Left out of the preset `small`: gpu-bf: would take 3 h.", lines)


class Lines(unittest.TestCase):
    def test_long_ones_are_of_medians(self) -> None:
        frames, medians = medians_of(np.array([1.0, 5.0, 2.0, 8.0, 7.0, 9.0, 100.0]), 3)
        self.assertEqual((frames.tolist(), medians.tolist()), ([1, 4], [2, 8]))
        frames, medians = medians_of(np.array([3.0, 4.0]), 1)
        self.assertEqual((frames.tolist(), medians.tolist()), ([0, 1], [3, 4]))


class Ratios(unittest.TestCase):
    def test_interval_is_that_of_all_resamples(self) -> None:
        a, b = np.array([1.0, 2.0, 4.0]), np.array([1.0, 1.1, 1.5])
        medians = [np.median(list(itertools.product(x, repeat=3)), axis=1) for x in (a, b)]
        every = np.divide.outer(*medians).ravel()
        ratio = ratio_of_medians(a, b)
        self.assertAlmostEqual(ratio.value, 2 / 1.1)
        assert ratio.interval
        np.testing.assert_allclose(ratio.interval, np.quantile(every, (0.025, 0.975)), rtol=0.02)
        self.assertFalse(ratio.is_clear)

    def test_one_run_is_never_clear(self) -> None:
        ratio = ratio_of_medians(np.array([9.0]), np.array([1.0, 1.0]))
        self.assertEqual((ratio.value, ratio.interval, ratio.is_clear), (9.0, None, False))

    def test_a_clear_one(self) -> None:
        self.assertTrue(
            ratio_of_medians(np.array([2.0, 2.1, 2.2]), np.array([1.0, 1.1, 1.2])).is_clear
        )

    def test_three_digits(self) -> None:
        numbers = {
            0: "0",
            0.00123456: "0.00123",
            0.9996: "1.00",
            9.996: "10.0",
            99.96: "100",
            1234.5: "1,234",
        }
        self.assertEqual({x: three_digits(x) for x in numbers}, numbers)


class Boxes(unittest.TestCase):
    def setUp(self) -> None:
        random = np.random.default_rng(3)
        low = random.uniform(-5, 5, (300, 3))
        self.boxes = np.concatenate([low, low + random.uniform(0, 2, (300, 3))], axis=1).astype(
            np.float32
        )

    def test_overlaps_are_those_of_all_pairs(self) -> None:
        low, high = self.boxes[:, None, :3], self.boxes[None, :, 3:]
        meets = np.all((low <= high) & np.swapaxes(low <= high, 0, 1), axis=2)
        np.testing.assert_array_equal(count_overlaps(self.boxes), meets.sum(axis=1) - 1)

    def test_touching_boxes_overlap(self) -> None:
        cube = np.array([0, 0, 0, 1, 1, 1], np.float32)
        boxes = np.stack([cube, cube + np.float32(1), cube + np.float32(3)])
        self.assertEqual(count_overlaps(boxes).tolist(), [1, 1, 0])

    def test_packed_boxes_come_back(self) -> None:
        low, high = self.boxes[:, :3].min(axis=0), self.boxes[:, 3:].max(axis=0)
        frames = np.stack([self.boxes, self.boxes[::-1], self.boxes])
        steps = np.stack([quantised(boxes, low, high).T for boxes in frames])
        text, kept = pack(steps)
        stored = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8)
        planes = stored.astype(np.uint16).reshape(kept, 2, *steps.shape[1:])
        back = np.cumsum(planes[:, 0] | planes[:, 1] << 8, axis=0, dtype=np.uint16)
        np.testing.assert_array_equal(back, steps)
        boxes = np.swapaxes(back, 1, 2) / LEVELS * np.tile(high - low, 2) + np.tile(low, 2)
        self.assertLess(np.abs(boxes - frames).max(), 0.51 * (high - low).max() / LEVELS + 1e-6)

    def test_packed_rows_keep_to_the_budget(self) -> None:
        rows = np.random.default_rng(3).integers(0, 65536, (50, 300)).astype(np.uint16)
        text, kept = pack(rows, budget=10_000)
        self.assertTrue(9_000 < len(text) <= 10_000 and kept < 50, (len(text), kept))
        stored = zlib.decompress(base64.b64decode(text))
        self.assertEqual(len(stored), kept * 600)
        self.assertEqual(pack(rows, budget=10)[1], 2)


if __name__ == "__main__":
    unittest.main()
