"""The page, self-contained in one file, and files beside it: figures and study.csv."""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

import jinja2
import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from markupsafe import Markup

from study import figures, verdict
from study.data import INEXACT, METRICS, Cell, Study, read_study
from study.errors import StudyError
from study.key_frames import COLOUR_MAP, data_url, draw, top_speed
from study.recording import FRAME_SECONDS, Recording, read_recordings, replay_data
from study.statistics import (
    FEWEST, RESAMPLES, SEED, noise_of, ratio_digits, ratio_of_medians, reference, rest_of, standing, three_digits
)

HERE = Path(__file__).parent
LIBRARIES = Path("/usr/share/javascript/three")
MOST_BYTES = 6_000_000
FEWEST_FOR_REPLAYS = 500_000


def script(source: str) -> Markup:
    """A script, with its strings and comments kept from ending the element early."""
    return Markup("<script>" + re.sub("</(script)", r"<\\/\1", source, flags=re.I) + "</script>")


def replay_scripts(recordings: list[Recording], budget: float, **changes: Any) -> Markup:
    """What the replay needs, its runs in a budget of characters."""
    try:
        libraries = [(LIBRARIES / n).read_text() for n in ("three.min.js", "examples/js/controls/OrbitControls.js")]
    except OSError as error:
        raise StudyError(f"{error}: run 'scripts/setup study' to install it") from None
    ramp = np.rint(plt.get_cmap(COLOUR_MAP)(np.arange(256))[:, :3] * 255).astype(int).ravel().tolist()
    share = max(budget - sum(map(len, libraries)), FEWEST_FOR_REPLAYS) / max(len(recordings), 1)
    data = {"runs": [replay_data(r, share) | changes for r in recordings], "ramp": ramp}
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    head = Markup(f'<script type="application/json" id="recordings">{text}</script>')
    return head + Markup().join(map(script, [*libraries, (HERE / "replay.js").read_text()]))


def _with_code(text: str) -> Markup:
    """Escaped text, with `names` set as code."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(jinja2.utils.markupsafe.escape(text))))


def _facts(study: Study) -> dict[str, str]:
    document, here = study.document, study.document["here"]
    lengths = sorted({run.frames for run in study.frames})
    at_once = f"{document['jobs']}"
    if document["tried_jobs"]:
        tried = "; ".join(f"{ratio:.2f} with {jobs}" for jobs, ratio in document["tried_jobs"][1:])
        at_once += f" (CPU time of a run's thread, as a multiple of that alone: {tried})"
    if document["jobs"] > 1:
        at_once += f", each on {len(document['shares'][0].split(','))} of the processors"
    return {
        "Measured": document["date"],
        "Processor": f"{here['cpu']}, {here['threads']} threads",
        "System": here["system"],
        "OpenCL device": f"{here['device']} ({here['driver']})" if here["device"] else "none",
        "Versions": f"BroadCL {here['broadcl']}, Bullet {here['bullet']}",
        "Runs": f"{len(study.frames):,}, of {verdict.listed([f'{n:,}' for n in lengths])} frames",
        "Runs at once": at_once,
        "Command": f"`{document['command']}`",
    }


def _ran_on(study: Study, broadphase: str) -> str:
    devices = sorted(set(study.runs[study.runs.broadphase == broadphase].device))
    return verdict.listed([device or "the host" for device in devices])


def _row(study: Study, cell: Cell, metric: str, broadphase: str) -> dict[str, Any]:
    """Columns of a table of times."""
    times = study.times(cell, f"{metric}_mean_ms")
    base = reference(list(times))
    columns = [f"{metric}_mean_ms", f"{metric}_cpu_mean_ms", f"{metric}_median_ms", f"{metric}_p95_ms"]
    row: dict[str, Any] = {c: three_digits(float(np.median(study.times(cell, c)[broadphase]))) for c in columns}
    ratio = ratio_of_medians(times[broadphase], times[base], noise_of(study, cell))
    low, high = ratio.interval or (None, None)
    row["ratio"] = "1" if broadphase == base else ratio_digits(ratio.value)
    row["from"], row["to"] = (ratio_digits(x) if x and broadphase != base else "" for x in (low, high))
    row["is_clear"] = ratio.is_clear
    row["is_best"] = standing(study, cell, metric).first == broadphase
    return row


def _pairs_row(study: Study, cell: Cell, broadphase: str) -> dict[str, str]:
    columns = ("pairs_mean", "pairs_last", "total_sum_ms", "first_frame_total_ms")
    mean, last, whole, first = (float(np.median(study.times(cell, c)[broadphase])) for c in columns)
    return dict(zip(columns, (f"{mean:,.1f}", f"{last:,.0f}", three_digits(whole), three_digits(first))))


def _rest_rows(study: Study) -> list[dict[str, Any]]:
    rows = []
    for cell in study.cells():
        wall, cpu = rest_of(study, cell), rest_of(study, cell, "_cpu")
        if wall and cpu:
            ends = [f(r.milliseconds.values()) for r in (wall, cpu) for f in (min, max)]
            texts = [three_digits(x) for x in ends] + [f"{r.difference * 100:.1f} %" for r in (wall, cpu)]
            rows.append({"cell": cell, "names": ", ".join(wall.milliseconds), "texts": texts})
    return rows


def _frame_figures(study: Study, scenario: str) -> dict[int, Markup]:
    """The figure of each number of objects, the paper's first; that has more points."""
    shown = figures.shown_objects(study, scenario)
    others = sorted({cell.objects for cell in study.cells(scenario)} - {shown})
    points = {shown: figures.POINTS} | dict.fromkeys(others, figures.FEW_POINTS)
    return {n: Markup(figures.inline(figures.over_frames(study, scenario, n, most))) for n, most in points.items()}


def page(study: Study, recordings: list[Recording], images: dict[str, list[np.ndarray]], files: list[str]) -> str:
    """The whole page as text."""
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(HERE), autoescape=True, undefined=jinja2.StrictUndefined,
                                     trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"code": _with_code, "url": data_url}
    shown = {
        **{f.__name__.strip("_"): f for f in (_row, _pairs_row, _ran_on, _rest_rows, rest_of, standing, three_digits, top_speed)},
        **{"study": study, "recordings": recordings, "images": images, "files": files, "facts": _facts(study)},
        **{"verdict": verdict, "figures": figures, "METRICS": METRICS, "INEXACT": INEXACT, "frame_seconds": FRAME_SECONDS},
        "over_objects": {m: Markup(figures.inline(figures.over_objects(study, m))) for m in METRICS},
        "over_frames": {s: _frame_figures(study, s) for s in study.scenarios},
        **{"resamples": RESAMPLES, "seed": SEED, "fewest": FEWEST, "listed": verdict.listed},
        **{name: Markup((HERE / name.replace("_", ".")).read_text()) for name in ("style_css", "replay_html")},
    }
    text = environment.get_template("page.html").render(shown)
    if not recordings:
        return text
    end = text.rindex("</body>")
    return text[:end] + str(replay_scripts(recordings, MOST_BYTES - len(text.encode()))) + text[end:]


def make(folder: Path) -> str:
    """Makes the page; an existing one is replaced only when everything is done. Returns what to tell the user."""
    matplotlib.use("Agg")
    study = read_study(folder)
    recordings = read_recordings(folder, study.scenarios)
    images = {r.scenario: [draw(r, frame) for frame in r.key_frames] for r in recordings}
    with matplotlib.rc_context(figures.SETTINGS), tempfile.TemporaryDirectory(dir=folder, prefix=".page-") as beside:
        made = Path(beside)
        (made / "figures").mkdir()
        files = figures.save_all(study, recordings, images, made / "figures")
        (made / "index.html").write_text(page(study, recordings, images, files), encoding="utf-8")
        study.runs.to_csv(made / "study.csv", index=False, float_format="%.6g")
        shutil.rmtree(folder / "figures", ignore_errors=True)
        for name in ("figures", "study.csv", "index.html"):
            os.replace(made / name, folder / name)
    path = folder / "index.html"
    said = "\n".join(verdict.headline(study)).replace("`", "")
    return f"{said}\nThe page: '{path}' ({path.stat().st_size / 1e6:.1f} MB)"
