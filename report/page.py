"""The page, self-contained in one file."""

from __future__ import annotations

import string
from pathlib import Path
from typing import Any

import numpy as np

from report.curves import figure_names, frames_counted, page_data
from report.markup import escaped, inline_script, listed, prose, script_json
from report.pairs import agreement
from report.palette import styles_of
from report.recording import Recording
from report.scenes import recordings_data, scenes
from report.standing import COMPARED, SEARCH, standing
from report.statistics import RESAMPLES, SEED, three_digits
from report.study import METRICS, Study, StudyError
from report.tables import about_times, pairs_table, times_table
from report.verdict import UPDATE_COUNTS, absent, certainty, headline, sentences

HERE = Path(__file__).parent
PLOTLY = Path("/usr/share/python3-plotly/plotly.js")
THREE = Path("/usr/share/javascript/three/three.min.js")
ORBIT_CONTROLS = Path("/usr/share/javascript/three/examples/js/controls/OrbitControls.js")


def _own(name: str) -> str:
    return (HERE / name).read_text(encoding="utf-8")


def _library(path: Path) -> str:
    try:
        return inline_script(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise StudyError(f"{error}: run 'scripts/setup report' to install it") from None


def _facts(study: Study) -> str:
    info, host = study.info, study.info["host"]
    devices = [d["label"] for d in info["devices"]] or ["none: only broad phases on the host"]
    facts = {
        "Measured": info["date"].replace("T", " ").replace("Z", " UTC"),
        "Processor": f"{host['cpu']}, {host['threads']} threads",
        "System": host["system"],
        "OpenCL device" + ("s" if len(devices) > 1 else ""): "; ".join(devices),
        "Versions": f"BroadCL {info['versions']['broadcl']}, Bullet {info['versions']['bullet']}",
        "Objects": ", ".join(f"{n:,}" for n in info["objects"]),
        "Runs": f"{sum(len(r.frames) for r in study.cells.values()):,}, of {frames_counted(study)}"
        f" frames each; {info['repeat']} repeats",
        "Command": f"`{info['command']}`",
    }
    return "".join(f"<div><dt>{escaped(k)}</dt><dd>{prose(v)}</dd></div>" for k, v in facts.items())


def _broadphases(study: Study) -> str:
    colours = {s.broadphase: style.colour for s, style in styles_of(study).items()}
    items = ""
    for row in study.info["broadphases"]:
        colour = colours.get(row["name"], "transparent")
        exact = "" if row["exact"] else "; its boxes have margins, so it may have extra pairs"
        items += (
            f'<li><div><i class="swatch" style="background:{colour}"></i>'
            f"<code>{escaped(row['name'])}</code></div>"
            f"<span>{escaped(row['summary'] + exact)}</span></li>"
        )
    return f'<ul class="names">{items}</ul>'


def _scenarios(study: Study) -> str:
    names, summaries = study.info["scenarios"], study.info["scenario_summaries"]
    items = "".join(
        f"<li><code>{escaped(s)}</code><span>{escaped(summaries.get(s, ''))}</span></li>"
        for s in names
    )
    return f'<ul class="names">{items}</ul>'


def _absent(study: Study) -> str:
    lines = absent(study)
    return f'<div class="note absent"><b>Not measured</b>{listed(lines)}</div>' if lines else ""


def _card(study: Study, scenario: str) -> str:
    objects = study.objects(scenario)[-1]
    place = standing(study, scenario, objects, "total")
    first = place.first
    colour = styles_of(study)[first].colour
    clear = "clearly first" if not place.ties else "first, but not clearly"
    text = (
        f'<article class="card" data-scenario="{escaped(scenario)}"><h3>{escaped(scenario)}</h3>'
        f'<p class="first"><span><i class="swatch" style="background:{colour}"></i></span>'
        f"<code>{escaped(study.label(first))}</code><span>{three_digits(place.milliseconds[first])}"
        f" ms per frame with {objects:,} objects, {clear}</span></p>"
    )
    for metric in ("total", SEARCH):
        text += f"<h4>{COMPARED[metric].capitalize()}</h4>"
        text += listed(sentences(study, scenario, metric))
    text += "<details><summary>Update and broad phase separately</summary>"
    for metric in ("update", "broad_phase"):
        text += f"<h4>{COMPARED[metric].capitalize()}</h4>"
        text += listed(sentences(study, scenario, metric))
    return text + "</details></article>"


def _frame_figures(study: Study) -> str:
    return "".join(
        f'<figure class="chart" id="{name}" data-kind="frames" data-scenario="{escaped(scenario)}">'
        f"<figcaption><b>Figure {name[-1]}.</b> {escaped(scenario)}: total, update, broad phase and"
        " pairs in each frame.</figcaption></figure>"
        for scenario, name in figure_names(study).items()
        if scenario in study.scenarios
    )


def _tables(study: Study) -> str:
    styles = styles_of(study)
    text = ""
    for metric in ("total", SEARCH, *METRICS[:2]):
        title = COMPARED[metric].capitalize()
        tables = "".join(times_table(study, s, metric, styles) for s in study.scenarios)
        about = f"<p>{about_times(study)}</p>"
        text += f'<div data-table="{metric}" data-title="{title}">{about}{tables}</div>'
    pairs = ""
    for scenario in study.scenarios:
        pairs += pairs_table(study, scenario, styles)
        pairs += listed(agreement(study, scenario))
    about = (
        "Pairs in the pair cache, and times of the whole run and of frame 0: medians of the repeats."
        " Exact broad phases are listed together if they had the same number of pairs in every frame of"
        " every repeat. If the order of the pairs differs, the solver processes contacts in another order,"
        " and the same scenario takes another course."
    )
    return text + f'<div data-table="pairs" data-title="Pairs"><p>{about}</p>{pairs}</div>'


def _method(study: Study) -> str:
    warm_up = study.info["warm_up_frames"]
    first = "Frame 0 is warm-up" if warm_up == 1 else f"The first {warm_up} frames are warm-up"
    return listed(
        [
            "All times are wall-clock times, measured by the same code for all broad phases. Update:"
            " `btCollisionWorld::updateAabbs()`, which computes every object's box and passes it to"
            " `setAabb()`, plus the removal and addition of objects if the scenario has them."
            " Broad phase: `btCollisionWorld::computeOverlappingPairs()`. Total: the whole"
            " `stepSimulation()`, including collision response, plus the removal and addition of objects;"
            " so a broad phase that takes half as long does not halve the total.",
            f"One step of 1/30 s per frame. {first} and excluded, except from “frame 0” in the table of"
            " pairs and from Figures 2 to 5. The order of the runs is random (seed"
            f" {study.info['seed']}), so that a drift in the machine's speed favours none of them.",
            "Mean, median and p95 are taken over the frames of a run; the tables show their medians over the"
            " repeats. Ratios are of these medians of the mean, which stands for the time of the whole run.",
            f"Intervals: bootstrap over the repeats. The repeats of both sides are resampled with"
            f" replacement {RESAMPLES:,} times (numpy's default generator, seed {SEED}), and the interval"
            " is from the 2.5th to the 97.5th percentile of the ratio of medians. With few repeats it"
            " spans little more than the repeats themselves. There is no correction for multiple"
            " comparisons: of twenty comparisons without a difference, about one is expected to look clear.",
        ]
    )


def page(study: Study, recordings: list[Recording], images: dict[str, list[np.ndarray]]) -> str:
    """The whole page as text."""
    data = page_data(study)
    files = [*(["figure-1"] if recordings else []), *data["names"].values(), "figure-6"]
    links = ", ".join(
        f'{name.replace("-", " ").capitalize()} (<a href="figures/{name}.svg">SVG</a>,'
        f' <a href="figures/{name}.png">PNG</a>)'
        for name in files
    )
    moving: dict[str, Any] = {"runs": [], "ramp": []}
    if recordings:
        moving = recordings_data(recordings)
    return string.Template(_own("template.html")).substitute(
        title=f"BroadCL study: {escaped(study.info['preset'])}, {escaped(study.info['date'][:10])}",
        style=_own("style.css"),
        version=escaped(study.info["versions"]["broadcl"]),
        preset=escaped(study.info["preset"]),
        headline="".join(f"<p>{prose(s)}</p>" for s in headline(study)),
        facts=_facts(study),
        broadphases=_broadphases(study),
        scenarios=_scenarios(study),
        absent=_absent(study),
        certainty=prose(certainty(study)),
        verdict="".join(_card(study, s) for s in study.scenarios),
        frame_figures=_frame_figures(study),
        update_counts=prose(UPDATE_COUNTS),
        scenes=scenes(recordings, images),
        tables=_tables(study),
        method=_method(study),
        files=links,
        data=script_json("data", data) + script_json("recordings", moving),
        libraries="\n".join(_library(path) for path in (PLOTLY, THREE, ORBIT_CONTROLS)),
        scripts="\n".join(inline_script(_own(f"{n}.js")) for n in ("charts", "page", "replay")),
    )
