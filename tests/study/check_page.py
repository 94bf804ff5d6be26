"""check_page.py DIR: opens DIR/index.html in headless Chromium, in light and dark, wide and narrow, and checks that it works and
that its tables have what study.csv says. Screenshots go to DIR/screenshots."""

from __future__ import annotations

import re
import sys
import time
from pathlib import Path

import pandas as pd
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from browser import Browser

VIEWS = [("light", 1400), ("dark", 1400), ("light", 360), ("dark", 360)]
WORKED_THROUGH = [("light", 1400), ("dark", 360)]  # where buttons are pressed too
SECTIONS = ("header", "#over-objects", "#over-frames", "#verdict", "#scenes", "#tables", "#trust", "#compared")
CELL = ["scenario", "objects", "frames", "broadphase"]


def layout(browser: Browser, _: Path) -> None:
    """The page is no wider than the window, and in the system's colours until the button is pressed."""
    wide = browser.js("""
      const limit = document.documentElement.clientWidth, inside = e => e.closest(".scrolls") && !e.matches(".scrolls");
      return [...document.body.querySelectorAll("*")].filter(e => !inside(e) && !e.closest("svg")
        && e.getBoundingClientRect().right > limit + 1).slice(0, 5).map(e => e.outerHTML.slice(0, 90))""")
    assert not wide, wide
    for is_light in (browser.theme == "light", browser.theme != "light"):
        colour = browser.js("return getComputedStyle(document.body).backgroundColor")
        assert (sum(map(int, re.findall(r"\d+", colour))) > 384) == is_light, colour
        browser.js("document.getElementById('theme').click()")


def tables(browser: Browser, folder: Path) -> None:
    """Every number of every table is a median of study.csv, and none is missing."""
    medians = pd.read_csv(folder / "study.csv").groupby(CELL).median(numeric_only=True)
    shown = browser.js("""return [...document.querySelectorAll("#tables td[data-column]")].map(td => {
      const row = td.closest("tr").dataset; return [`${row.cell}/${row.broadphase}`, td.dataset.column, td.textContent]; })""")
    cells = {(key, column): text for key, column, text in shown if column not in ("ratio", "from", "to")}
    columns = [c for c in medians if re.match("pairs|.*_ms$", c) and not c.startswith("rest")]
    assert len(cells) == len(medians) * len(columns), f"{len(cells)} numbers, not {len(medians)} rows of {len(columns)}"
    for (key, column), text in cells.items():
        scenario, objects, frames, broadphase = key.split("/")
        right, number = medians.loc[scenario, int(objects), int(frames), broadphase][column], float(text.replace(",", ""))
        assert abs(number - right) <= max(0.006 * right, 0.5 * (right > 100)), f"{key}: {text}, but study.csv gives {right}"
    assert any(column == "ratio" and text != "1" for _, column, text in shown)


def figures(browser: Browser, _: Path) -> None:
    """Figure 6 and one of each scenario have lines of each broad phase, which the legend hides in all and shows again."""
    ids = browser.js("return [...document.querySelectorAll('figure[id]')].map(f => f.id)")
    scenarios = browser.js("return document.querySelectorAll('.card').length")
    assert {"figure-1", "figure-6-search", "figure-6"} <= set(ids) and len(set(ids)) == scenarios + 3, ids
    count = """return [...document.querySelectorAll(`svg [id$='--${arguments[0]}']`)].filter(e => e.querySelector('path')
      && e.style.display !== 'none').length"""
    for name in browser.js("return [...document.querySelector('.legend').children].map(b => b.dataset.broadphase)"):
        numbers = [browser.js(count, name)]
        for _press in range(2):
            browser.js("document.querySelector(`.legend [data-broadphase='${arguments[0]}']`).click()", name)
            numbers.append(browser.js(count, name))
        assert numbers[0] == numbers[2] >= 5 * scenarios and numbers[1] == 0, f"{name} has {numbers} lines"


def replay(browser: Browser, _: Path) -> None:
    """It plays and pauses, goes to a frame, shows other things, has keys, and follows Figure 1."""

    def pixels(selector: str = "#replay-canvas") -> str:
        browser.settle()
        return str(browser.js("return document.querySelector(arguments[0]).toDataURL()", selector))

    def change(name: str, value: object) -> None:
        browser.js("""const e = document.getElementById("replay-" + arguments[0]); if (arguments[1] === null) return e.click();
          e.value = arguments[1]; e.dispatchEvent(new Event("input")); e.dispatchEvent(new Event("change"))""", name, value)

    def frame() -> int:
        return int(browser.js("return document.getElementById('replay-frame').textContent").split()[1])

    last = int(browser.js("return document.getElementById('replay-slider').max"))
    seen = []
    for value in (0, last // 2, last, 0):
        change("slider", value)
        seen.append(pixels())
    assert len(set(seen)) == 3 and seen[0] == seen[3], "the slider does not change the picture"
    change("play", None)
    WebDriverWait(browser.driver, 20).until(lambda _: frame() > 0, "it does not play")
    change("play", None)
    paused = pixels()
    time.sleep(0.3)
    assert pixels() == paused != seen[0], "it goes on while paused"
    shown = [paused]
    for name, value in (("colour", "overlaps"), ("outlines", None), ("solid", None)):
        change(name, value)
        shown.append(pixels())
    assert len(set(shown)) == 4, "colours, outlines or boxes change nothing"
    canvas = browser.driver.find_element("css selector", "#replay-canvas")
    change("slider", 0)
    step = browser.js("return JSON.parse(document.getElementById('recordings').textContent)[0].stride")
    for key, expected in ((".", step), (".", 2 * step), (",", step)):
        canvas.send_keys(key)
        browser.settle()
        assert frame() == expected, f"{key} goes to frame {frame()}, not {expected}"
    before = pixels()
    canvas.send_keys(Keys.ARROW_LEFT)
    assert pixels() != before, "an arrow turns nothing"
    buttons = browser.driver.find_elements("css selector", "[data-key-frame]")
    assert len({pixels(f"[data-run='0'][data-key-frame='{b.get_attribute('data-key-frame')}'] canvas") for b in buttons[:4]}) == 4
    browser.js("arguments[0].click()", buttons[-1])
    WebDriverWait(browser.driver, 20).until(lambda _: str(frame()) == buttons[-1].text.split()[1], "Figure 1 does not move it")


def main() -> None:
    """Ends with an AssertionError if something is wrong."""
    folder = Path(sys.argv[1])
    (folder / "screenshots").mkdir(exist_ok=True)
    ready = "const canvas = document.getElementById('replay-canvas'); return !canvas || canvas.dataset.drawn > 0"
    for theme, width in VIEWS:
        with Browser(folder / "index.html", width, theme) as browser:
            WebDriverWait(browser.driver, 60).until(lambda _: browser.js(ready), "the page is not ready")
            for section in SECTIONS:
                (folder / "screenshots" / f"{theme}-{width}-{section.lstrip('#')}.png").write_bytes(browser.picture(section))
            for check in (layout, tables, figures, replay) if (theme, width) in WORKED_THROUGH else (layout,):
                check(browser, folder)
                print(f"{theme}, {width} pixels: {check.__name__}: ok", flush=True)
            assert not browser.errors(), browser.errors()


if __name__ == "__main__":
    main()
