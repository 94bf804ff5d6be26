import doctest
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image

import broadcl
from conftest import uniform

ROOT = Path(__file__).parents[2]


OF_TENSORS = ROOT / "python/examples/torch_particles.py"


def code(text, language="python"):
    return "\n".join(re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL))


def test_the_chapter():
    names = {"beams": uniform(30), "ducts": uniform(50)}
    exec(code((ROOT / "docs/python.md").read_text()), names)
    assert len(names["pairs"]) and len(names["worlds"]) == 10_001


def test_the_readme():
    names = {"boxes": uniform(100)}
    exec(code((ROOT / "README.md").read_text()), names)
    assert np.array_equal(names["added"], names["pairs"])


def test_the_readme_of_the_package():
    text = (ROOT / "python/README.md").read_text()
    names = {}
    exec(code(text), names)
    assert len(names["pairs"]) and len(names["added"])
    assert not re.search(r"\]\((?!https://)", text)  # a package index has no files that relative links could lead to


def test_the_first_page():
    names = {"broadcl": broadcl, "boxes": uniform(100)}
    exec(code((ROOT / "docs/index.md").read_text()), names)
    assert len(names["added"])


def test_the_page_about_seeing_boxes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(code((ROOT / "docs/see.md").read_text()), {})
    assert (tmp_path / "boxes.html").stat().st_size > 30_000


def test_going_back():
    names = {}
    exec(code((ROOT / "docs/going-back.md").read_text()), names)
    assert len(names["added"]) + len(names["removed"]) and len(names["changes"].removed)


def test_the_gallery_compiles():  # without its data
    assert "view" in compile(code((ROOT / "docs/gallery.md").read_text()), "gallery.md", "exec").co_names


def test_what_may_pair():
    page = doctest.DocTestParser().get_doctest(code((ROOT / "docs/what-may-pair.md").read_text()), {}, "what-may-pair.md", None, 0)
    assert len(page.examples) > 50
    wrong = []
    doctest.DocTestRunner(verbose=False).run(page, out=wrong.append)
    assert not wrong, "".join(wrong)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_definition_of_rays_and_nearest(dtype):
    page = {}
    exec(code((ROOT / "docs/rays.md").read_text()), page)
    assert len(page["squares"]) == 8000 and len(page["times"])
    random = np.random.default_rng(6)
    corners = random.integers(0, 30, (2, 60, 3)).astype(dtype) / dtype(3)
    boxes, queries = np.stack([corners, corners + dtype(2)], axis=2)
    directions, lengths = random.integers(-1, 3, (60, 3)).astype(dtype), random.integers(0, 9, 60).astype(dtype)
    of_nearest = broadcl.nearest(boxes, queries, limit=5, within=3)
    of_along = broadcl.along(boxes, queries, directions, lengths)
    for k, (query, direction, length) in enumerate(zip(queries, directions, lengths)):
        with np.errstate(divide="ignore"):
            expected = page["nearest"](boxes, query, 5, 3), page["along"](boxes, query, direction, length)
        for (offsets, ids, keys), hits in zip((of_nearest, of_along), expected):
            of_k = slice(*offsets[k : k + 2])
            assert list(zip(keys[of_k], ids[of_k])) == hits


@pytest.mark.parametrize("header, declaration", [
    ("broad_phase.hpp", "Delta update(const BoxView& boxes)"), ("broad_phase.hpp", "void begin(const BoxView& boxes)"),
    ("opencl.hpp", "Result update(const Boxes& boxes)"), ("mpi_opencl.hpp", "Result update(const Boxes& boxes)"),
    ("broadcl.h", "broadcl_broad_phase_update_boxes("), ("broadcl.h", "broadcl_broad_phase_begin_boxes("),
    ("broadcl.h", "broadcl_device_broad_phase_update("),
])
def test_the_first_sentence_about_new_boxes_says_which_objects_they_remove(header, declaration):
    lines = (ROOT / "host/broadcl" / header).read_text().splitlines()
    end = begin = next(k for k, line in enumerate(lines) if declaration in line)
    while lines[begin - 1].strip().startswith("///"):
        begin -= 1
    text = " ".join(line.strip().removeprefix("///").strip() for line in lines[begin:end]).removeprefix("Collective. ")
    assert "beyond" in text.split(". ")[0]


def test_the_first_sentence_about_new_boxes_says_which_objects_they_remove_in_python():
    for function in (broadcl.BroadPhase.update, broadcl.BroadPhase.begin, broadcl.DeviceBroadPhase.update):
        assert "beyond" in function.__doc__.split("\n\n")[1].split(". ")[0]


@pytest.mark.parametrize("example", sorted({*OF_TENSORS.parent.glob("*.py")} - {OF_TENSORS}), ids=lambda path: path.stem)
def test_examples(example, tmp_path):
    picture = tmp_path / "picture.png"
    run = subprocess.run([sys.executable, "-W", "error", example, picture], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stdout
    pixels = image.imread(picture)
    assert pixels.std() > 0.05  # not an empty page
    assert pixels.shape == image.imread(ROOT / f"docs/images/{example.stem}.png").shape
