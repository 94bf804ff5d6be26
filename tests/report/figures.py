"""Checks of the page's figures."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from browser import Browser
from expected import Expected
from selenium.webdriver.common.action_chains import ActionChains

TRACES = (
    "return document.querySelector(`#${arguments[0]} .plot`).data.map(t => "
    "({name: t.name, visible: t.visible, x: Array.from(t.x), y: Array.from(t.y), axis: t.yaxis}))"
)
DRAWN = (
    "return [...document.querySelectorAll(`#${arguments[0]} .scatterlayer .trace`)]"
    ".filter(trace => trace.querySelector('.js-line, .point')).length"
)
AXES = (
    "const full = document.querySelector(`#${arguments[0]} .plot`)._fullLayout;"
    "return Object.keys(full).filter(k => /^yaxis/.test(k)).map(k => full[k].type)"
)
TICKS = (
    "const full = document.querySelector(`#${arguments[0]} .plot`)._fullLayout;"
    "return Object.keys(full).filter(k => /^yaxis/.test(k)).map(k => "
    "[...document.querySelectorAll(`#${arguments[0]} .y${k.slice(5)}tick`)]"
    ".map(t => t.textContent).filter(text => text))"
)
IDS = "return [...document.querySelectorAll('figure.chart')].map(f => f.id)"
PANELS = ("update", "broad_phase", "total", "pairs")


def _traces(browser: Browser, figure: str) -> list[dict[str, Any]]:
    """A figure's lines, none of which is empty or has a number missing."""
    traces = browser.js(TRACES, figure)
    assert traces, f"{figure} has no lines"
    for trace in traces:
        numbers = trace["x"] + trace["y"]
        fine = all(isinstance(n, (int, float)) and math.isfinite(n) for n in numbers)
        assert fine and trace["y"] and len(trace["x"]) == len(trace["y"]), f"{figure}: {trace}"
    return traces


def every_figure(browser: Browser, expected: Expected) -> None:
    """Figure 6 and one a scenario are there; no line is empty, and each is drawn, if only as a point."""
    scenarios = {key[0] for key in expected.columns}
    ids = browser.js(IDS)
    assert len(ids) == 1 + len(scenarios) and "figure-6" in ids, ids
    for figure in ids:
        traces = _traces(browser, figure)
        drawn = browser.js(DRAWN, figure)
        assert traces and drawn == len(
            traces
        ), f"{figure}: {drawn} of {len(traces)} lines are drawn"
        if figure != "figure-6":
            series = {trace["name"] for trace in traces}
            assert len(traces) == len(PANELS) * len(series), f"{figure}: {len(traces)} lines"


def figure_6_is_the_study(browser: Browser, expected: Expected) -> None:
    """The lines of Figure 6 are the times of whole runs in study.csv."""
    right = []
    for columns in expected.columns.values():
        right.append(np.median(columns["total_sum_ms"]) / 1000)
    shown = [y for trace in browser.js(TRACES, "figure-6") for y in trace["y"]]
    assert len(shown) == len(right), f"{len(shown)} points, not {len(right)}"
    close = np.isclose(sorted(shown), sorted(right), rtol=1e-3)
    assert close.all(), f"{np.array(sorted(shown))[~close]} are not in study.csv"


def key_frames(browser: Browser, _: Expected) -> None:
    """Figure 1 has four pictures of each recording, and each can be seen."""
    pictures = browser.js(
        "return [...document.querySelectorAll('#figure-1 img')].map(i => i.complete && i.naturalWidth > 99)"
    )
    recordings = browser.js(
        "return JSON.parse(document.getElementById('recordings').textContent).runs.length"
    )
    assert recordings > 0 and len(pictures) == 4 * recordings and all(pictures), pictures


def toggling(browser: Browser, _: Expected) -> None:
    """The legend hides a series in every figure, and shows it again."""
    ids = browser.js(IDS)
    name = browser.js("return document.querySelector('.legend button').dataset.series")
    before = {figure: browser.js(DRAWN, figure) for figure in ids}
    for figure in ids:
        own = sum(trace["name"] == name for trace in browser.js(TRACES, figure))
        browser.js(f"document.querySelector('#{figure} .legend button').click()")
        after = browser.js(DRAWN, figure)
        assert own > 0 and after == before[figure] - own, f"{figure}: {after} of {before[figure]}"
        browser.js(f"document.querySelector('#{figure} .legend button').click()")
        assert browser.js(DRAWN, figure) == before[figure], f"{figure}: {name} does not come back"


def scales(browser: Browser, _: Expected) -> None:
    """Axes become linear, and logarithmic again, and their ticks with them; each has two at least."""
    press = (
        "document.querySelector(`#${arguments[0]} .segments button[value=${arguments[1]}]`).click()"
    )
    for figure in browser.js(IDS):
        seen = {}
        for scale in ("linear", "log"):
            browser.js(press, figure, scale)
            types = browser.js(AXES, figure)
            assert types and set(types) == {scale}, f"{figure}: {types}, not {scale}"
            seen[scale] = browser.js(TICKS, figure)
            assert all(len(ticks) >= 2 for ticks in seen[scale]), f"{figure}: {seen[scale]}"
        assert seen["linear"] != seen["log"], f"{figure}: the same ticks in both"


def choices(browser: Browser, expected: Expected) -> None:
    """Another number of objects, or another time, shows other lines."""
    for figure in browser.js(IDS):
        options = browser.js(
            f"return [...document.querySelectorAll('#{figure} select option')].map(o => o.value)"
        )
        seen = set()
        for option in options:
            browser.js(
                "const s = document.querySelector(`#${arguments[0]} select`); s.value = arguments[1];"
                "s.dispatchEvent(new Event('change'))",
                figure,
                option,
            )
            seen.add(str([trace["y"][-1] for trace in _traces(browser, figure)]))
        assert options and len(seen) == len(options), f"{figure}: {len(seen)} of {options}"


def hovering(browser: Browser, _: Expected) -> None:
    """The pointer over a panel brings up the values there."""
    for figure in browser.js(IDS):
        panel = browser.driver.find_element("css selector", f"#{figure} .nsewdrag")
        browser.js("arguments[0].scrollIntoView({block: 'center', behavior: 'instant'})", panel)
        ActionChains(browser.driver).move_to_element(panel).pause(0.4).perform()
        ActionChains(browser.driver).move_by_offset(3, 3).pause(0.4).perform()
        shown = browser.js(f"return document.querySelector('#{figure} .hoverlayer').textContent")
        assert "s" in shown, f"{figure}: nothing comes up"


FIGURE_CHECKS = [
    every_figure,
    figure_6_is_the_study,
    key_frames,
    toggling,
    scales,
    hovering,
    choices,
]
