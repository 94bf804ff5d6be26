#!/usr/bin/env python3
"""check_page.py DIR: opens DIR/index.html in headless Chromium, in light and dark, wide and narrow, and checks that it works and
that its tables have what study.csv says. Screenshots go to DIR/screenshots."""

from __future__ import annotations

import csv
import io
import re
import sys
import time
from pathlib import Path
from statistics import median

import matplotlib.image
import numpy as np
from browser import Browser
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

VIEWS = [("light", 1400), ("dark", 1400), ("light", 360), ("dark", 360)]
WORKED_THROUGH = [("light", 1400), ("dark", 360)]  # where buttons are pressed too
CANVAS = "#replay-canvas"
READY = "const canvas = document.getElementById('replay-canvas'); return !canvas || canvas.dataset.drawn > 0"


def layout(browser: Browser, _: Path) -> None:
    """The page is no wider than the window, and in the system's colours until the button is pressed."""
    wide = browser.js("""
      const limit = document.documentElement.clientWidth, inside = e => e.closest(".scrolls") && !e.matches(".scrolls");
      return [...document.body.querySelectorAll("*")].filter(e => !inside(e) && !e.closest("svg")
        && e.getBoundingClientRect().right > limit + 1).slice(0, 5).map(e => e.outerHTML.slice(0, 90))""")
    assert not wide, wide
    for is_light in (browser.theme == "light", browser.theme != "light", browser.theme == "light"):
        colour = browser.js("return getComputedStyle(document.body).backgroundColor")
        assert (sum(map(int, re.findall(r"\d+", colour))) > 384) == is_light, colour
        browser.js("document.getElementById('theme').click()")
    browser.js("document.getElementById('theme').click()")


def tables(browser: Browser, folder: Path) -> None:
    """Every number of every table is a median of study.csv, and none is missing."""
    values: dict[tuple[str, str, str], list[float]] = {}
    with (folder / "study.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            cell = f"{row['scenario']}/{row['objects']}/{row['frames']}"
            for column, text in row.items():
                if column.endswith("_ms") or column.startswith("pairs"):
                    values.setdefault((cell, row["broadphase"], column), []).append(float(text))
    shown = browser.js("""return [...document.querySelectorAll("#tables td[data-column]")].map(td => {
      const row = td.closest("tr"); return [row.dataset.cell, row.dataset.broadphase, td.dataset.column, td.textContent]; })""")
    ratios = {"ratio", "from", "to"}
    cells = {(cell, broadphase, column): text for cell, broadphase, column, text in shown if column not in ratios}
    assert set(cells) == {key for key in values if not key[2].startswith("rest")}, "other rows than in study.csv"
    for key, text in cells.items():
        right, number = median(values[key]), float(text.replace(",", ""))
        close = abs(number - right) <= 0.51 * (1 if "pairs_last" in key[2] else 0.1 if "pairs" in key[2] else right / 100)
        assert close or abs(number - right) <= 0.5 < right, f"{key}: {text}, but study.csv gives {right}"
    assert any(column == "ratio" and text != "1" for _, _, column, text in shown)


def figures(browser: Browser, folder: Path) -> None:
    """Figure 6 and one of each scenario have lines of each broad phase, which the legend hides in all and shows again."""
    scenarios = browser.js("return [...document.querySelectorAll('.card')].map(c => c.dataset.scenario)")
    ids = browser.js("return [...document.querySelectorAll('figure[id]')].map(f => f.id)")
    assert scenarios and {"figure-6-search", "figure-6"} <= set(ids) and len(set(ids)) == len(ids), ids
    assert browser.js("return [...document.images].every(i => i.complete && i.naturalWidth > 99)")
    count = ("return [...document.querySelectorAll(`svg [id$='--${arguments[0]}']`)].filter(e => e.querySelector('path')"
             "  && e.style.display !== 'none').length")
    for name in browser.js("return [...document.querySelector('.legend').children].map(b => b.dataset.broadphase)"):
        assert browser.js(count, name) >= 5 * len(scenarios), f"lines of {name} are missing"
        press = f"document.querySelector('.legend [data-broadphase=\"{name}\"]').click()"
        browser.js(press)
        assert browser.js(count, name) == 0
        browser.js(press)
        assert browser.js(count, name) >= 5 * len(scenarios)


def _frame(browser: Browser) -> int:
    return int(browser.js("return document.getElementById('replay-frame').textContent").split()[1])


def _picture(browser: Browser) -> np.ndarray:
    browser.settle()
    element = browser.driver.find_element("css selector", CANVAS)
    browser.js("arguments[0].scrollIntoView({block: 'center', behavior: 'instant'})", element)
    return matplotlib.image.imread(io.BytesIO(element.screenshot_as_png))


def _differ(a: np.ndarray, b: np.ndarray) -> bool:
    return a.shape != b.shape or float(np.abs(a - b).max()) > 0.02


def replay(browser: Browser, _: Path) -> None:
    """It plays and pauses, goes to a frame, shows other things, has keys, and follows Figure 1."""
    use = lambda name: browser.js("document.getElementById('replay-' + arguments[0]).click()", name)  # noqa: E731
    change = lambda name, value: browser.js(  # noqa: E731
        "const e = document.getElementById('replay-' + arguments[0]); e.value = arguments[1];"
        "for (const kind of ['input', 'change']) e.dispatchEvent(new Event(kind))", name, value)
    last = int(browser.js("return document.getElementById('replay-slider').max"))
    pictures = []
    for value in (0, last // 2, last, 0):
        change("slider", value)
        pictures.append(_picture(browser))
    assert float(pictures[0][..., :3].std()) > 0.02, "the canvas is empty"
    assert _differ(*pictures[:2]) and _differ(*pictures[1:3]) and not _differ(pictures[0], pictures[3])
    use("play")
    time.sleep(1.5)
    use("play")
    at = _frame(browser), _picture(browser)
    assert at[0] > 0 and _differ(at[1], pictures[0]), "it does not play"
    time.sleep(0.3)
    assert _frame(browser) == at[0] and not _differ(_picture(browser), at[1]), "it goes on while paused"
    shown = [at[1]]
    for act in (lambda: change("colour", "overlaps"), lambda: use("outlines"), lambda: use("solid")):
        act()
        shown.append(_picture(browser))
        assert _differ(*shown[-2:]), f"choice {len(shown) - 1} changes nothing"
    canvas = browser.driver.find_element("css selector", CANVAS)
    change("slider", 0)
    step = browser.js("return JSON.parse(document.getElementById('recordings').textContent).runs[0].stride")
    for key, frame in ((".", step), (".", 2 * step), (",", step)):
        canvas.send_keys(key)
        browser.settle()
        assert _frame(browser) == frame, f"{key} goes to frame {_frame(browser)}, not {frame}"
    before = _picture(browser)
    canvas.send_keys(Keys.ARROW_LEFT)
    assert _differ(_picture(browser), before), "an arrow turns nothing"
    button = browser.driver.find_elements("css selector", "[data-key-frame]")[-2]
    browser.js("arguments[0].click()", button)
    WebDriverWait(browser.driver, 20).until(lambda _: _frame(browser) > step, "Figure 1 does not move the replay")
    chosen = browser.js("return document.getElementById('replay-scenario').selectedOptions[0].textContent")
    assert chosen == button.get_attribute("data-scenario") and abs(_frame(browser) - int(button.get_attribute("data-key-frame"))) <= step


def main() -> None:
    """Ends with an AssertionError if something is wrong."""
    folder = Path(sys.argv[1])
    (folder / "screenshots").mkdir(exist_ok=True)
    for theme, width in VIEWS:
        with Browser(folder / "index.html", width, theme) as browser:
            WebDriverWait(browser.driver, 60).until(lambda _: browser.js(READY), "the page is not ready")
            for section in ("header", "#over-objects", "#over-frames", "#verdict", "#scenes", "#tables", "#trust", "#compared"):
                (folder / "screenshots" / f"{theme}-{width}-{section.lstrip('#')}.png").write_bytes(browser.picture(section))
            for check in (layout, tables, figures, replay) if (theme, width) in WORKED_THROUGH else (layout,):
                check(browser, folder)
                print(f"{theme}, {width} pixels: {check.__name__}: ok", flush=True)
            assert not browser.errors(), browser.errors()
    with Browser(folder / "index.html", 1400, "light", webgl=False) as browser:
        assert "WebGL" in browser.js("return document.getElementById('replay-note').textContent")
        assert not browser.errors(), browser.errors()
    print("all checks of the page passed")


if __name__ == "__main__":
    main()
