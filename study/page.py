"""The page, self-contained in one file, and files beside it: figures and study.csv."""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

import jinja2
import matplotlib
import numpy as np
from markupsafe import Markup, escape

from study import figures, replay, statistics, verdict
from study.data import INEXACT, METRICS, Cell, Study, read_study
from study.plan import BULLETS, listed
from study.recording import Recording, read_recordings, replay_data
from study.run import say
from study.statistics import compare, ratio_digits, rest_of, standing, three_digits

HERE = Path(__file__).parent
KEY_FRAMES = 4


def _with_code(text: str) -> Markup:
    """Escaped text, with `names` set as code."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def _facts(study: Study) -> dict[str, str]:
    document, here = study.document, study.document["here"]
    shares = document["shares"]
    at_once = f"{len(shares)}"
    if len(shares) > 1:
        gpus = len({gpu for _, gpu in shares})
        at_once += f", each on {shares[0][0].count(',') + 1} of the processors" + f" and one of {gpus} GPUs" * (gpus > 1)
    return {
        "Measured": document["date"],
        "Processor": f"{here['cpu']}, {here['threads']} threads",
        "System": here["system"],
        "OpenCL device": f"{here['device']} ({here['driver']})" if here["device"] else "none",
        "Versions": f"BroadCL {here['broadcl']}, Bullet {here['bullet']}",
        "Runs": f"{len(study.frames):,}, of {listed([f'{n:,}' for n in sorted({r.frames for r in study.frames})])} frames",
        "Runs at once": at_once,
        "Command": f"`{document['command']}`",
    }


def _ran_on(study: Study, broadphase: str) -> str:
    return listed([device or "the host" for device in sorted(set(study.runs[study.runs.broadphase == broadphase].device))])


def _medians(study: Study, cell: Cell, broadphase: str, columns: list[str]) -> dict[str, str]:
    return {c: three_digits(float(np.median(study.times(cell, c)[broadphase]))) for c in columns}


def _row(study: Study, cell: Cell, metric: str, broadphase: str) -> dict[str, Any]:
    """Columns of a table of times: of a metric, or of pairs."""
    if metric == "pairs":
        columns = ["pairs_mean", "pairs_last", "total_sum_ms", "first_frame_total_ms"]
        return _medians(study, cell, broadphase, columns) | {"is_best": False}
    times = study.times(cell)
    base = next(b for b in ("bullet-bvh", *BULLETS, *times) if b in times)
    row: dict[str, Any] = _medians(study, cell, broadphase, [f"{metric}_{c}_ms" for c in ("mean", "cpu_mean", "median", "p95")])
    ratio = compare(study, cell, metric, broadphase, base)
    row["ratio"] = "1" if broadphase == base else ratio_digits(ratio.value)
    row["from"], row["to"] = (ratio_digits(x) if x and broadphase != base else "" for x in ratio.interval or (0, 0))
    return row | {"is_clear": ratio.is_clear, "is_best": standing(study, cell, metric).first == broadphase}


def _rest_rows(study: Study) -> list[tuple[Cell, list[str]]]:
    """Of each cell that tells: least and most of rest_of() by either clock, then by how much they differ."""
    rests = {cell: [rest_of(study, cell, clock) for clock in ("", "_cpu")] for cell in study.cells() if rest_of(study, cell, "")}
    return [
        (cell, [three_digits(x) for rest in both for x in (rest[0], rest[-1])] + [f"{x[-1] / x[0] - 1:.1%}" for x in both])
        for cell, both in rests.items()
    ]


def _frame_figures(study: Study, scenario: str) -> dict[int, Markup]:
    """The figure of each number of objects, the paper's first; that has more points."""
    shown = figures.shown_objects(study, scenario)
    others = sorted({cell.objects for cell in study.cells(scenario)} - {shown})
    points = {shown: figures.POINTS} | dict.fromkeys(others, figures.FEW_POINTS)
    return {n: Markup(figures.inline(figures.over_frames(study, scenario, n, most))) for n, most in points.items()}


def page(study: Study, recordings: list[Recording], files: list[str]) -> str:
    """The whole page as text."""
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(HERE), autoescape=True, undefined=jinja2.StrictUndefined,
                                     trim_blocks=True, lstrip_blocks=True)  # fmt: skip
    environment.filters["code"] = _with_code
    runs = [replay_data(recording) for recording in recordings]
    return environment.get_template("page.html").render(
        study=study, runs=runs, key_frames=lambda run: np.linspace(0, run["frames"] - 1, KEY_FRAMES).round().astype(int).tolist(),
        files=["study.csv", *(f"figures/{name}" for name in files)], facts=_facts(study), rests=_rest_rows(study),
        verdict=verdict, figures=figures, statistics=statistics,
        METRICS=METRICS, INEXACT=INEXACT, row=_row, ran_on=_ran_on,
        over_frames={s: _frame_figures(study, s) for s in study.scenarios},
        over_objects={m: Markup(figures.inline(figures.over_objects(study, m))) for m in METRICS},
        style=Markup(replay.STYLE + (HERE / "style.css").read_text()), replay=Markup(replay.CONTROLS),
        scripts=Markup(replay.scripts(runs)),
    )  # fmt: skip


def make(folder: Path) -> str:
    """Makes the page; an existing one is replaced only when everything is done. Returns what to tell the user."""
    say("making the page, which takes up to some minutes")
    matplotlib.use("Agg")
    study = read_study(folder)
    recordings = read_recordings(folder, study.scenarios)
    with matplotlib.rc_context(figures.SETTINGS), tempfile.TemporaryDirectory(dir=folder, prefix=".page-") as beside:
        made = Path(beside)
        (made / "figures").mkdir()
        files = figures.save_all(study, made / "figures")
        (made / "index.html").write_text(page(study, recordings, files), encoding="utf-8")
        study.runs.to_csv(made / "study.csv", index=False, float_format="%.6g")
        shutil.rmtree(folder / "figures", ignore_errors=True)
        for name in ("figures", "study.csv", "index.html"):
            os.replace(made / name, folder / name)
    path = folder / "index.html"
    said = "\n".join(verdict.headline(study)).replace("`", "")
    return f"{said}\nThe page: '{path}' ({path.stat().st_size / 1e6:.1f} MB)"
