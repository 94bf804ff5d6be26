"""The tables. Each number is a cell that names its column, each row names its configuration."""

from __future__ import annotations

import numpy as np

from report.markup import escaped, prose
from report.palette import Style
from report.standing import SEARCH, reference, run_times
from report.statistics import ratio_digits, ratio_of_medians, three_digits
from report.study import Repeats, Series, Study
from report.verdict import is_of_single_runs


def _number(column: str, text: str, extra: str = "") -> str:
    return f'<td class="number{extra}" data-column="{column}">{text}</td>'


def _label(study: Study, series: Series, style: Style) -> str:
    swatch = f'<i class="swatch" style="background:{style.colour}"></i>'
    return f'<th scope="row">{swatch}<code>{escaped(study.label(series))}</code></th>'


def _rows(study: Study, scenario: str, styles: dict[Series, Style], cells_of_row) -> str:
    """One table body per number of objects, with one row per series."""
    text = ""
    for objects in study.objects(scenario):
        cells = study.cells_of(scenario, objects)
        text += "<tbody>"
        for k, (series, repeats) in enumerate(cells.items()):
            text += (
                f'<tr data-scenario="{escaped(scenario)}" data-objects="{objects}"'
                f' data-broadphase="{escaped(series.broadphase)}"'
                f' data-device="{escaped(series.device)}">'
            )
            if k == 0:
                text += (
                    f'<th class="objects" scope="rowgroup" rowspan="{len(cells)}">{objects:,}</th>'
                )
            text += _label(study, series, styles[series]) + cells_of_row(cells, series, repeats)
            text += "</tr>"
        text += "</tbody>"
    return text


def _table(head: list[str], body: str, caption: str) -> str:
    columns = "".join(
        f'<th scope="col"{" class=number" if k > 1 else ""}>{title}</th>'
        for k, title in enumerate(head)
    )
    return (
        f'<div class="scrolls" tabindex="0"><table><caption>{caption}</caption>'
        f"<thead><tr>{columns}</tr></thead>{body}</table></div>"
    )


def times_table(study: Study, scenario: str, metric: str, styles: dict[Series, Style]) -> str:
    """Times of one metric, and how they compare with the reference."""
    kinds = () if metric == SEARCH else ("median", "p95")

    def cells_of_row(cells: dict[Series, Repeats], series: Series, repeats: Repeats) -> str:
        fastest = min(float(np.median(run_times(r, metric))) for r in cells.values())
        mean = float(np.median(run_times(repeats, metric)))
        text = _number(f"{metric}_mean_ms", three_digits(mean), " best" if mean == fastest else "")
        for kind in kinds:
            column = f"{metric}_{kind}_ms"
            text += _number(column, three_digits(float(np.median(repeats.summary[column]))))
        base = reference(study, cells)
        if series == base:
            return text + '<td class="number base" colspan="3">reference</td>'
        ratio = ratio_of_medians(run_times(repeats, metric), run_times(cells[base], metric))
        text += _number("ratio", ratio_digits(ratio.value), "" if ratio.is_clear else " unclear")
        for end in (0, 1):
            limit = ratio_digits(ratio.interval[end]) if ratio.interval else "–"
            text += _number(("ratio_low", "ratio_high")[end], limit)
        return text

    head = ["objects", "broad phase", "mean, ms", *(f"{kind}, ms" for kind in kinds)]
    head += ["ratio", "from", "to"]
    return _table(head, _rows(study, scenario, styles, cells_of_row), escaped(scenario))


def about_times(study: Study) -> str:
    """Explains the columns of times_table."""
    bases = {
        study.label(reference(study, study.cells_of(scenario, n)))
        for scenario in study.scenarios
        for n in study.objects(scenario)
    }
    interval = ", with the ends of its 95 % interval; grey if that contains 1"
    return prose(
        "Milliseconds per frame: medians of the repeats. Ratio: mean over that of"
        f" {' or '.join(f'`{base}`' for base in sorted(bases))}"
        f"{'' if is_of_single_runs(study) else interval}. Bold: the lowest mean."
    )


def pairs_table(study: Study, scenario: str, styles: dict[Series, Style]) -> str:
    """Mean number of pairs, pairs in the last frame, and times of the whole run and of the first frame."""

    def cells_of_row(cells: dict[Series, Repeats], series: Series, repeats: Repeats) -> str:
        summary = {column: float(np.median(x)) for column, x in repeats.summary.items()}
        return (
            _number("pairs_mean", f"{summary['pairs_mean']:,.1f}")
            + _number("pairs_last", f"{summary['pairs_last']:,.0f}")
            + _number("total_sum_ms", three_digits(summary["total_sum_ms"]))
            + _number("first_frame_total_ms", three_digits(summary["first_frame_total_ms"]))
        )

    head = [
        "objects",
        "broad phase",
        "pairs, mean",
        "pairs, last frame",
        "whole run, ms",
        "frame 0, ms",
    ]
    return _table(head, _rows(study, scenario, styles, cells_of_row), escaped(scenario))
