import re
import subprocess
import sys
from pathlib import Path

import matplotlib.image as image
import numpy as np
import pytest

import broadcl
from conftest import uniform

ROOT = Path(__file__).parents[2]


def code(text):
    return "\n".join(re.findall(r"```python\n(.*?)```", text, re.DOTALL))


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


@pytest.mark.parametrize("example", sorted((ROOT / "python/examples").glob("*.py")), ids=lambda path: path.stem)
def test_examples(example, tmp_path):
    picture = tmp_path / "picture.png"
    run = subprocess.run([sys.executable, "-W", "error", example, picture], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stdout
    pixels = image.imread(picture)
    assert pixels.std() > 0.05  # not an empty page
    assert pixels.shape == image.imread(ROOT / f"docs/images/{example.stem}.png").shape
