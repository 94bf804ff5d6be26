#!/usr/bin/env python3
"""check_page.py DIR: opens DIR/report.html in headless Chromium, in light and dark, wide and narrow, and checks that it
works and that its tables hold what study.csv says. Screenshots go to DIR/screenshots."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from browser import Browser
from expected import Expected
from figures import FIGURE_CHECKS
from replay import REPLAY_CHECKS, replay_without_webgl
from selenium.common.exceptions import WebDriverException
from selenium.webdriver.support.ui import WebDriverWait

Check = Callable[[Browser, Expected], None]

VIEWS = [("light", 1400), ("dark", 1400), ("light", 360), ("dark", 360)]
WORKED_THROUGH = [("light", 1400), ("dark", 360)]  # where buttons are pressed too
SECTIONS = (
    "header.top",
    "#compared",
    "#verdict",
    "#over-objects",
    "#over-frames",
    "#scenes",
    "#tables",
    "#method",
)


def is_ready(browser: Browser) -> bool:
    """Every figure is drawn, and the replay is loaded where there is one."""
    return browser.js(
        "const plots = [...document.querySelectorAll('figure.chart')];"
        "const canvas = document.getElementById('replay-canvas');"
        "return plots.every(p => p.querySelector('.plot .main-svg')) && (!canvas || canvas.dataset.drawn > 0);"
    )


def no_errors(browser: Browser, _: Expected) -> None:
    """No script fails, and the console has no error."""
    errors = browser.errors()
    assert not errors, errors


def no_network(browser: Browser, _: Expected) -> None:
    """The page asks for nothing but itself."""
    requests = browser.requests()
    assert not requests, requests


def no_sideways_scroll(browser: Browser, _: Expected) -> None:
    """The page is no wider than the window."""
    wide = browser.js(
        "const limit = document.documentElement.clientWidth;"
        "const inside = e => e.closest('.scrolls') && !e.matches('.scrolls');"
        "const wide = [...document.body.querySelectorAll('*')].filter(e => !inside(e)"
        "  && !e.closest('svg') && e.getBoundingClientRect().right > limit + 1);"
        "return [document.documentElement.scrollWidth, wide.slice(0, 5).map(e => e.outerHTML.slice(0, 90))];"
    )
    assert wide[0] <= browser.width and not wide[1], wide


def theme(browser: Browser, _: Expected) -> None:
    """The page follows the system's colours, and the button changes them."""

    def brightness() -> int:
        colour = browser.js("return getComputedStyle(document.body).backgroundColor")
        return sum(int(x) for x in colour[4:-1].split(",")[:3])

    before = brightness()
    assert (before > 384) == (browser.theme == "light"), f"{browser.theme}, but {before}"
    for is_light in (browser.theme != "light", browser.theme == "light"):
        browser.js("document.getElementById('theme').click()")
        assert (brightness() > 384) == is_light, "the button does not change the colours"


def tables(browser: Browser, expected: Expected) -> None:
    """Every number of every table is what study.csv gives, and none is missing."""
    rows = browser.js(
        "return [...document.querySelectorAll('#tables tbody tr')].map(tr => ["
        "  tr.closest('[data-table]').dataset.table, tr.dataset.scenario, Number(tr.dataset.objects),"
        "  tr.dataset.broadphase, tr.dataset.device,"
        "  [...tr.querySelectorAll('td.number')].map(td => [td.dataset.column || '', td.textContent])])"
    )
    wanted: set[tuple[Any, ...]] = {
        (table, *key)
        for table in ("total", "search", "update", "broad_phase", "pairs")
        for key in expected.columns
    }
    shown = [tuple(row[:5]) for row in rows]
    assert len(shown) == len(set(shown)) and set(shown) == wanted, sorted(
        wanted.symmetric_difference(shown)
    )[:3]
    bases = {
        (row[0], *row[1:3]): tuple(row[1:5]) for row in rows if any(not name for name, _ in row[5])
    }
    for table, *key, cells in rows:
        base = bases.get((table, *key[:2]))
        assert (
            base is not None or table == "pairs"
        ), f"{table} of {key[:2]} is compared with nothing"
        got = {name: text for name, text in cells if name}
        right = expected.cells(tuple(key), table, base)
        assert got == right, f"{table} of {key}: {got}, but study.csv gives {right}"


def verdict(browser: Browser, expected: Expected) -> None:
    """Each scenario's card names the one with the least total time, and the times of the others."""
    cards = browser.js(
        "return [...document.querySelectorAll('.card')].map(c => [c.dataset.scenario,"
        " c.querySelector('.first code').textContent, c.querySelector('.first').textContent, c.textContent])"
    )
    scenarios = {key[0] for key in expected.columns}
    assert {card[0] for card in cards} == scenarios, f"cards of {[card[0] for card in cards]}"
    for scenario, name, line, text in cards:
        objects = expected.most_objects(scenario)
        first = expected.first(scenario, objects, "total")
        assert name.split(" · ")[0] == first[2], f"{scenario}: {name}, not {first[2]}"
        clear = True
        for key in expected.rivals(scenario, objects):
            _, low, _ = expected.ratio(key, first, "total")
            clear = clear and (key == first or low > 1)
        assert ("clearly first" in line) == clear, f"{scenario}: '{line}', but clear is {clear}"
        assert (
            expected.cells(first, "total", None)["total_mean_ms"] in text
        ), f"{scenario}: {text[:200]}"


ALWAYS: list[Check] = [no_sideways_scroll, theme, tables, verdict]


def run(checks: list[Check], browser: Browser, expected: Expected, view: str) -> int:
    """Runs all of them and prints what became of each; the number that failed."""
    failed = 0
    for check in checks:
        try:
            check(browser, expected)
            print(f"{view}: {check.__name__}: ok", flush=True)
        except (AssertionError, WebDriverException) as error:
            failed += 1
            print(f"{view}: {check.__name__}: FAILED: {type(error).__name__}: {error}", flush=True)
    return failed


def main() -> int:
    """The exit status: 0 where every check passed."""
    if len(sys.argv) != 2:
        print("usage: scripts/check-report DIR", file=sys.stderr)
        return 2
    folder = Path(sys.argv[1])
    page, screenshots = folder / "report.html", folder / "screenshots"
    expected = Expected(folder)
    screenshots.mkdir(exist_ok=True)
    failed = 0
    for theme_name, width in VIEWS:
        view = f"{theme_name}-{width}"
        with Browser(page, width, theme_name) as browser:
            WebDriverWait(browser.driver, 60).until(
                lambda _: is_ready(browser), "the page is not ready"
            )
            for section in SECTIONS:
                name = section.removeprefix("#").replace(".", "-")
                (screenshots / f"{view}-{name}.png").write_bytes(browser.picture(section))
            checks = list(ALWAYS)
            if (theme_name, width) in WORKED_THROUGH:
                checks += [*FIGURE_CHECKS, *REPLAY_CHECKS]
            failed += run([*checks, no_network, no_errors], browser, expected, view)
    with Browser(page, 1400, "light", webgl=False) as browser:
        failed += run([replay_without_webgl, no_errors], browser, expected, "without WebGL")
    print(f"{failed} checks failed" if failed else "all checks passed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
