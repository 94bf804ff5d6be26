"""Checks of the page's replay."""

from __future__ import annotations

import re
import time

import numpy as np
from browser import Browser
from expected import Expected
from selenium.webdriver.common.keys import Keys

CANVAS = "#replay-canvas"
SECONDS = 2.0


def _frame(browser: Browser) -> int:
    text = browser.js("return document.getElementById('replay-frame').textContent")
    found = re.match(r"frame (\d+) of", text)
    assert found, f"the replay says '{text}'"
    return int(found[1])


def _settle(browser: Browser) -> None:
    """Until what was asked for is drawn."""
    browser.driver.execute_async_script(
        "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done))"
    )


def _click(browser: Browser, name: str) -> None:
    browser.js("document.getElementById('replay-' + arguments[0]).click()", name)
    _settle(browser)


def _scrub(browser: Browser, value: int) -> None:
    browser.js(
        "const s = document.getElementById('replay-slider'); s.value = arguments[0];"
        "s.dispatchEvent(new Event('input'))",
        value,
    )
    _settle(browser)


def _differ(a: np.ndarray, b: np.ndarray) -> bool:
    return a.shape != b.shape or float(np.abs(a - b).max()) > 0.02


def _covered(picture: np.ndarray) -> np.ndarray:
    """Where something else than the ground is seen, whatever its colour."""
    return np.abs(picture - picture[12, 12]).max(axis=2) > 0.02


def it_plays(browser: Browser, _: Expected) -> None:
    """Frame and picture change while it plays, and stay while it does not."""
    _scrub(browser, 0)
    before = browser.canvas_pixels(CANVAS)
    assert float(before[..., :3].std()) > 0.02, "the canvas is empty"
    still = _frame(browser)
    _click(browser, "play")
    drawn = int(browser.js(f"return document.querySelector('{CANVAS}').dataset.drawn"))
    time.sleep(SECONDS)
    drawn = int(browser.js(f"return document.querySelector('{CANVAS}').dataset.drawn")) - drawn
    _click(browser, "play")
    objects = browser.js("return document.getElementById('replay-kept').textContent").split(" ")[0]
    print(f"  {drawn / SECONDS:.0f} pictures a second, {objects} objects, in software", flush=True)
    assert _frame(browser) != still, "the frame stays"
    after = browser.canvas_pixels(CANVAS)
    moved = int((_covered(after) != _covered(before)).sum())
    assert (
        moved > 50
    ), f"the boxes stay: {moved} pixels have them where they were not, or not where they were"
    paused = _frame(browser), browser.canvas_pixels(CANVAS)
    time.sleep(0.3)
    assert _frame(browser) == paused[0], "it goes on while paused"
    assert not _differ(browser.canvas_pixels(CANVAS), paused[1]), "the picture changes while paused"


def it_scrubs(browser: Browser, _: Expected) -> None:
    """The slider takes it to a frame, forth and back."""
    last = int(browser.js("return document.getElementById('replay-slider').max"))
    frames, pictures = [], []
    for value in (0, last // 2, last, 0):
        _scrub(browser, value)
        frames.append(_frame(browser))
        pictures.append(browser.canvas_pixels(CANVAS))
    assert frames[0] == frames[3] == 0 and 0 < frames[1] < frames[2], frames
    assert _differ(pictures[0], pictures[1]) and _differ(pictures[1], pictures[2]), "pictures alike"
    assert not _differ(pictures[0], pictures[3]), "frame 0 is another picture the second time"


def it_shows(browser: Browser, _: Expected) -> None:
    """Colours by overlaps, outlines, and no boxes: each looks different."""
    last = int(browser.js("return document.getElementById('replay-slider').max"))
    _scrub(browser, last)
    pictures = [browser.canvas_pixels(CANVAS)]
    browser.js(
        "const s = document.getElementById('replay-colour'); s.value = 'overlaps';"
        "s.dispatchEvent(new Event('change'))"
    )
    _settle(browser)
    pictures.append(browser.canvas_pixels(CANVAS))
    for name in ("outlines", "solid"):
        _click(browser, name)
        pictures.append(browser.canvas_pixels(CANVAS))
    for k, (a, b) in enumerate(zip(pictures, pictures[1:])):
        assert _differ(a, b), ("overlaps", "outlines", "no boxes")[k] + " changes nothing"
    for name in ("outlines", "solid"):
        _click(browser, name)


def it_has_keys(browser: Browser, _: Expected) -> None:
    """Full stop and comma step, the space bar plays, arrows turn, and dragging does."""
    canvas = browser.driver.find_element("css selector", CANVAS)
    _scrub(browser, 0)
    step = browser.js(
        "return JSON.parse(document.getElementById('recordings').textContent).runs[0].stride"
    )
    for key, frame in ((".", step), (".", 2 * step), (",", step)):
        canvas.send_keys(key)
        _settle(browser)
        assert _frame(browser) == frame, f"{key} goes to frame {_frame(browser)}, not {frame}"
    before = browser.canvas_pixels(CANVAS)
    canvas.send_keys(Keys.ARROW_LEFT)
    _settle(browser)
    assert _differ(browser.canvas_pixels(CANVAS), before), "an arrow turns nothing"
    for word in ("Pause", "Play"):
        canvas.send_keys(" ")
        _settle(browser)
        assert browser.js("return document.getElementById('replay-play').textContent") == word, word


def it_follows_figure_1(browser: Browser, _: Expected) -> None:
    """The third key frame of the last scenario takes the replay there."""
    button = browser.driver.find_elements("css selector", "[data-key-frame]")[-2]
    wanted, scenario = int(button.get_attribute("data-key-frame")), button.get_attribute(
        "data-scenario"
    )
    browser.js("arguments[0].click()", button)
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline and (
        _frame(browser) < 1
        or browser.js("return document.getElementById('replay-note').textContent")
    ):
        time.sleep(0.1)
    _settle(browser)
    shown = browser.js(
        "return document.getElementById('replay-scenario').selectedOptions[0].textContent"
    )
    run = browser.js(
        "return JSON.parse(document.getElementById('recordings').textContent).runs.at(-1)"
    )
    nearest = min(wanted, (run["frames"] - 1) * run["stride"])
    assert shown == scenario and abs(_frame(browser) - nearest) < run["stride"], (
        shown,
        _frame(browser),
    )


def replay_without_webgl(browser: Browser, _: Expected) -> None:
    """Where WebGL is missing, the page says so in words."""
    note = browser.js("return document.getElementById('replay-note').textContent")
    assert "WebGL" in note, f"it says '{note}'"


REPLAY_CHECKS = [it_plays, it_scrubs, it_shows, it_has_keys, it_follows_figure_1]
