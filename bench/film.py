"""A moving picture of two runs side by side, drawn by the replay of a study's page; see scripts/film."""

from __future__ import annotations

import io
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont
from selenium.webdriver.support.ui import WebDriverWait

from browser import Browser
from study import replay
from study.data import Study, read_study
from study.figures import STYLES
from study.plan import StudyError
from study.recording import FRAME_SECONDS, Recording, read_recording, replay_data

SCENARIO = "mixed-sizes"
RUNS = {"bullet-bvh": "Bullet (bullet-bvh)", "auto": "BroadCL (auto)"}
STEP = 4  # frames of the simulation per picture
TOGETHER = 8  # frames whose mean time is shown while they pass
EDGE = 296  # of the picture of a run, pixels
SCALE = 2  # the page draws this many times larger, for smooth edges
GAP = 8
HEAD, FOOT = 45, 19
RAMP = matplotlib.colormaps["viridis"]
GROUND, TEXT, SOFT, TRACK = "#ffffff", "#1d2129", "#5b616d", "#e3e5e9"
QUALITY = 20
ZOOMS = 4  # presses of the key that brings the camera nearer
TOP_OVERLAPS = 30  # of the brightest boxes


def _page(recordings: list[Recording]) -> str:
    """The replay alone, as large as a picture."""
    edge = EDGE * SCALE
    style = f"body{{margin:0}} canvas{{display:block;width:{edge}px;height:{edge}px;background:{GROUND}}}"
    style += " .controls,.scale,.note,.small{display:none}"
    return (
        f'<!DOCTYPE html><html lang="en"><meta charset="utf-8"><style>{style}</style>'
        + replay.CONTROLS
        + replay.scripts([replay_data(r, most_boxes=sys.maxsize) | {"top_overlaps": TOP_OVERLAPS} for r in recordings])
    )


def _pictures(recordings: list[Recording], frames: range) -> list[list[Image.Image]]:
    """For each run, its pictures."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "replay.html"
        path.write_text(_page(recordings), encoding="utf-8")
        with Browser(path, EDGE * SCALE, "light") as browser:
            _wait(browser, "return document.getElementById('replay-canvas').dataset.drawn > 0")
            return [_run_pictures(browser, k, frames) for k in range(len(recordings))]


def _wait(browser: Browser, condition: str) -> None:
    WebDriverWait(browser.driver, 60).until(lambda _: browser.js(condition), "the replay is not loaded")


def _run_pictures(browser: Browser, index: int, frames: range) -> list[Image.Image]:
    browser.js(
        "const set = (name, value) => { const e = document.getElementById('replay-' + name);"
        "  e.value = value; e.dispatchEvent(new Event('change')); };"
        "document.getElementById('replay-kept').textContent = '';"
        "set('scenario', arguments[0]); set('colour', 'overlaps');",
        index,
    )
    _wait(browser, "return document.getElementById('replay-kept').textContent")
    browser.js(
        "const outlines = document.getElementById('replay-outlines');"
        "if (!outlines.checked) outlines.click();"
        "for (let k = 0; k < arguments[0]; ++k) document.getElementById('replay-canvas')"
        ".dispatchEvent(new KeyboardEvent('keydown', { key: '+' }));",
        ZOOMS,
    )
    pictures = []
    for frame in frames:
        browser.js(
            "const s = document.getElementById('replay-slider'); s.value = arguments[0];"
            "s.dispatchEvent(new Event('input'))",
            frame,
        )
        browser.settle()
        pictures.append(Image.open(io.BytesIO(browser.picture("#replay-canvas"))).resize((EDGE, EDGE), Image.LANCZOS))
    return pictures


def _font(size: int, weight: str = "normal") -> ImageFont.FreeTypeFont:
    path = font_manager.findfont(font_manager.FontProperties("DejaVu Sans", weight=weight))
    return ImageFont.truetype(path, size)


def _composed(pictures: list[Image.Image], times: list[float], longest: float, foot: str) -> Image.Image:
    """The pictures of one frame with captions."""
    image = Image.new("RGB", (2 * EDGE + GAP, HEAD + EDGE + FOOT), GROUND)
    draw = ImageDraw.Draw(image)
    bold, small = _font(13, "bold"), _font(10)
    for k, (name, title) in enumerate(RUNS.items()):
        left = k * (EDGE + GAP)
        right = left + EDGE - 4
        draw.text((left + 4, 6), title, TEXT, bold)
        draw.text((right, 6), f"{times[k]:.1f} ms", TEXT, bold, anchor="ra")
        draw.rectangle((left + 4, 28, right, 39), TRACK)
        width = (right - left - 4) * min(times[k] / longest, 1)
        draw.rectangle((left + 4, 28, left + 4 + width, 39), STYLES[name].colour)
        image.paste(pictures[k], (left, HEAD))
    y = HEAD + EDGE + 2
    draw.text((4, y), foot, SOFT, small)
    draw.text((right, y), f"{TOP_OVERLAPS} overlaps", SOFT, small, anchor="ra")
    left = right - 128
    for x, colour in enumerate(RAMP(np.linspace(0, 1, 52), bytes=True)):
        draw.line((left + x, y + 2, left + x, y + 10), tuple(colour))
    draw.text((left - 10, y), "0", SOFT, small)
    return image


def _times(study: Study, name: str, objects: int) -> np.ndarray:
    """Update and broad phase in ms, for each frame: the median of the repeats."""
    by_frame = study.medians_by_frame(SCENARIO, objects)
    if name not in by_frame:
        raise StudyError(f"'{study.folder}' has no runs of {SCENARIO} with {objects:,} objects and {name}")
    return by_frame[name].search_ms.to_numpy()


def film(runs: Path, folder: Path, out: Path, caption: str) -> None:
    """Makes the moving picture."""
    recordings = [read_recording(name, runs / f"{name}.npy") for name in RUNS]
    objects = recordings[0].objects
    study = read_study(folder)
    times = [_times(study, name, objects) for name in RUNS]
    count = min(*(len(r.boxes) - 1 for r in recordings), *(len(t) for t in times))
    low = np.min([r.low for r in recordings], axis=0)
    high = np.max([r.high for r in recordings], axis=0)
    recordings = [replace(r, boxes=r.boxes[: count + 1], low=low, high=high) for r in recordings]
    frames = range(STEP, count + 1, STEP)
    pictures = _pictures(recordings, frames)
    longest = max(float(np.quantile(t[1:], 0.99)) for t in times)
    foot = f"update and broad phase, {objects:,} objects, {SCENARIO}; {caption}"
    composed = []
    for k, frame in enumerate(frames):
        # Frame 0 is the warm-up.
        first = max((frame - 1) // TOGETHER * TOGETHER, 1)
        shown = [float(t[first : first + TOGETHER].mean()) for t in times]
        composed.append(_composed([run[k] for run in pictures], shown, longest, foot))
    composed[0].save(
        out,
        save_all=True,
        append_images=composed[1:],
        duration=round(STEP * FRAME_SECONDS * 1000),
        loop=0,
        quality=QUALITY,
        method=6,
        minimize_size=True,
    )


def main() -> int:
    """Runs the command line; returns the exit status."""
    runs, study, out, caption = sys.argv[1:]
    try:
        film(Path(runs), Path(study), Path(out), caption)
    except (StudyError, OSError) as error:
        print(f"film: {error}", file=sys.stderr)
        return 1
    print(f"'{out}' ({Path(out).stat().st_size / 1e6:.1f} MB)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
