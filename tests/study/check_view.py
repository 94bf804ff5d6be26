"""check_view.py PYTHON FOLDER: opens pages of `PYTHON -m broadcl view` in headless Chromium, in light and wide, and in dark and narrow,
and checks that they work, and that they have the pairs that NumPy finds. Screenshots and pages go to FOLDER."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from selenium.webdriver.support.ui import WebDriverWait

from browser import Browser
from check_page import WORKED_THROUGH, layout

MOST_BYTES = 6_000_000
INSIDE = np.array([[0, 0, 0, 10, 10, 10], [4, 4, 4, 6, 6, 6]], np.float32)
FRAMES = {"inside": (1, 2), "one": (1, 1), "one-moving": (1000, 1), "thousand": (1, 1000), "thousand-moving": (1000, 1000), "many": (1, 100_000),
          "many-moving": (20, 100_000)}  # of so many boxes  # fmt: skip


def boxes_of(frames: int, objects: int) -> np.ndarray:
    if objects == len(INSIDE):
        return INSIDE
    random = np.random.default_rng(1)
    low = random.uniform(0, (3 * objects) ** (1 / 3), (1, objects, 3)) + 0.3 * np.sin(np.arange(frames)[:, None, None] / 9 + random.uniform(
        0, 9, (1, objects, 3)))
    return np.concatenate([low, low + random.uniform(0.5, 1.5, (objects, 3))], axis=2).astype(np.float32)


def wait_until_drawn(browser: Browser) -> None:
    ready = "return document.getElementById('replay-canvas').dataset.drawn > 0"
    WebDriverWait(browser.driver, 60).until(lambda _: browser.js(ready), "the page is not ready")


def change(browser: Browser, name: str, value: object) -> None:
    browser.js("""const e = document.getElementById("replay-" + arguments[0]); e.value = arguments[1];
      e.dispatchEvent(new Event("input")); e.dispatchEvent(new Event("change"))""", name, str(value))
    browser.settle()


def text(browser: Browser, name: str) -> str:
    return str(browser.js("return document.getElementById('replay-' + arguments[0]).textContent", name))


def frame(browser: Browser) -> int:
    return int(text(browser, "frame").split()[1])


def partners(boxes: np.ndarray, row: int) -> list[int]:
    meets = (boxes[:, :3] <= boxes[row, 3:]).all(axis=1) & (boxes[row, :3] <= boxes[:, 3:]).all(axis=1)
    return [k for k in np.flatnonzero(meets).tolist() if k != row]


def one(browser: Browser, _: np.ndarray) -> None:
    """A click selects the box, and one beside it none."""
    canvas = browser.driver.find_element("css selector", "#replay-canvas")
    canvas.click()
    browser.settle()
    assert text(browser, "details").startswith("Object 0: group 1, mask all, body none, world 0. Box of about ("), text(browser, "details")
    browser.js("""const at = {clientX: 0, clientY: 0, bubbles: true, pointerId: 1};
      arguments[0].setPointerCapture = () => {};
      for (const name of ["pointerdown", "pointerup"]) arguments[0].dispatchEvent(new PointerEvent(name, at));""", canvas)
    browser.settle()
    assert text(browser, "details").startswith("Click a box"), text(browser, "details")


def inside(browser: Browser, _: np.ndarray) -> None:
    """A click selects what is inside of a box that is as large as all."""
    browser.driver.find_element("css selector", "#replay-canvas").click()
    browser.settle()
    assert text(browser, "details").startswith("Object 1: "), text(browser, "details")


def thousand_moving(browser: Browser, boxes: np.ndarray) -> None:
    """It goes to a frame, and plays; counts are those of all pairs, and partners those of the selected box."""
    curve = browser.driver.find_element("css selector", "#replay-curve")
    last = int(browser.js("return document.getElementById('replay-slider').max"))
    change(browser, "slider", last)
    assert frame(browser) == len(boxes) - 1
    count = sum(len(partners(boxes[-1], row)) for row in range(boxes.shape[1])) // 2
    assert f" · {count:,} pairs, " in text(browser, "frame"), text(browser, "frame")
    row = max(range(100), key=lambda k: len(partners(boxes[-1], k)))
    change(browser, "id", row)
    shown = browser.js("return [...document.querySelectorAll('#replay-details button')].map(b => Number(b.textContent))")
    assert shown == partners(boxes[-1], row), f"{shown} are not the partners of {row}"
    browser.js("document.querySelector('#replay-details button').click()")
    browser.settle()
    assert text(browser, "details").startswith(f"Object {shown[0]}: ")
    browser.js("arguments[0].scrollIntoView({block: 'center'})", curve)
    curve.click()
    browser.settle()
    assert abs(frame(browser) - len(boxes) / 2) < len(boxes) / 50, frame(browser)
    before = frame(browser)
    browser.js("document.getElementById('replay-play').click()")
    WebDriverWait(browser.driver, 20).until(lambda _: frame(browser) > before, "it does not play")


def many(browser: Browser, _: np.ndarray) -> None:
    """It says that it shows a sample, and what is not in it cannot be selected."""
    assert "100,000 objects, of which a random sample of 10,000 is shown" in text(browser, "kept"), text(browser, "kept")
    ids = [browser.js("""const e = document.getElementById("replay-id"); e.value = arguments[0]; e.dispatchEvent(new Event("change"));
      return e.checkValidity();""", str(k)) for k in range(100)]
    assert 0 < sum(ids) < 50, ids


def main() -> None:
    """Ends with an AssertionError if something is wrong."""
    python, folder = sys.argv[1], Path(sys.argv[2])
    folder.mkdir(parents=True, exist_ok=True)
    checks: dict[str, Any] = {"inside": inside, "one": one, "thousand-moving": thousand_moving, "many": many}
    for name, (frames, objects) in FRAMES.items():
        boxes, page = boxes_of(frames, objects), folder / f"{name}.html"
        np.save(folder / f"{name}.npy", boxes)
        subprocess.run([python, "-m", "broadcl", "view", folder / f"{name}.npy", "--out", page], check=True)
        assert page.stat().st_size <= MOST_BYTES, page
        for theme, width in WORKED_THROUGH:
            with Browser(page, width, theme) as browser:
                wait_until_drawn(browser)
                (folder / f"{name}-{theme}-{width}.png").write_bytes(browser.picture("body"))
                layout(browser, folder)
                if name in checks:
                    checks[name](browser, boxes)
                assert not browser.errors(), browser.errors()
        print(f"{name}: ok", flush=True)


if __name__ == "__main__":
    main()
