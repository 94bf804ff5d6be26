"""The verdict as text. Every claim is computed; names are marked as `code`."""

from __future__ import annotations

from report.standing import COMPARED, Standing, ours_over_bullet, run_times, standing
from report.statistics import Ratio, ratio_digits, ratio_of_medians, three_digits
from report.study import Series, Study


# For whoever looks at one of the two alone.
UPDATE_COUNTS = (
    "The work of a broad phase in `setAabb()` counts as update; `bullet-sap` does nearly all of its work"
    " there."
)


def times_as_long(study: Study, ratio: Ratio) -> str:
    """The ratio, with its interval in brackets; says so if it has none but others do."""
    if ratio.interval is None:
        missing = "" if is_of_single_runs(study) else " (one run: no interval)"
        return ratio_digits(ratio.value) + missing
    low, high = (ratio_digits(end) for end in ratio.interval)
    return f"{ratio_digits(ratio.value)} ({low} to {high})"


def enumerated(items: list[str]) -> str:
    """Returns "a, b and c"."""
    return " and ".join(filter(None, (", ".join(items[:-1]), items[-1])))


def name(study: Study, series: Series) -> str:
    return f"`{study.label(series)}`"


def is_of_single_runs(study: Study) -> bool:
    """Whether nothing ran twice, so that no difference can be called certain."""
    return all(len(repeats.frames) < 2 for repeats in study.cells.values())


def certainty(study: Study) -> str:
    """Explains how certain a difference is."""
    if is_of_single_runs(study):
        return "Each ran once, so there is no measure of how certain a difference is."
    return (
        "“Times as long” comes with its 95 % interval; a difference is clear if that interval"
        " excludes 1."
    )


def headline(study: Study) -> list[str]:
    """What the whole study says about the total time with the most objects."""
    places = {s: standing(study, s, study.objects(s)[-1], "total") for s in study.scenarios}
    claims = []
    for series in dict.fromkeys(place.first for place in places.values()):
        where = [
            scenario + (" (not clearly)" if place.ties and not is_of_single_runs(study) else "")
            for scenario, place in places.items()
            if place.first == series
        ]
        claims.append(f"{name(study, series)} in {enumerated(where)}")
    sizes = sorted({place.objects for place in places.values()})
    most = enumerated([f"{n:,}" for n in sizes])
    sentences = [f"With {most} objects, the total time is shortest with {'; with '.join(claims)}."]
    if is_of_single_runs(study):
        sentences.append(certainty(study))
    ratios = []
    for scenario, place in places.items():
        rivals = ours_over_bullet(study, place)
        if rivals:
            ratios.append((between(study, scenario, place, "total", *rivals), scenario))
    if ratios:
        low, high = min(ratios, key=lambda r: r[0].value), max(ratios, key=lambda r: r[0].value)
        ends = f"{times_as_long(study, low[0])} times as long in {low[1]}"
        if low != high:
            ends = f"from {ends} to {times_as_long(study, high[0])} times in {high[1]}"
        sentences.append(
            "Compared with the fastest of Bullet's own broad phases, the same simulation with the"
            f" fastest of BroadCL's takes {ends}."
        )
    return sentences


def sentences(study: Study, scenario: str, metric: str) -> list[str]:
    """One scenario by one metric: who is first with the most objects, against Bullet, and in general."""
    places = [standing(study, scenario, n, metric) for n in study.objects(scenario)]
    result = [_who_is_first(study, places[-1], metric)]
    rivals = ours_over_bullet(study, places[-1])
    if rivals:
        result.append(_against_bullet(study, scenario, places[-1], metric, *rivals))
    if len(places) > 1:
        result.append(_over_objects(study, places))
    return result


def _who_is_first(study: Study, place: Standing, metric: str) -> str:
    first, milliseconds = name(study, place.first), three_digits(place.milliseconds[place.first])
    text = f"With {place.objects:,} objects, {first} is first: {milliseconds} ms per frame."
    if not place.over_first:
        return text + " Nothing else ran."
    if is_of_single_runs(study):
        others = [f"{name(study, s)} {times_as_long(study, r)}" for s, r in place.over_first.items()]
        return f"{text} Times as long: {enumerated(others)}."
    if place.ties:
        ties = [f"{name(study, s)} at {times_as_long(study, place.over_first[s])}" for s in place.ties]
        text += f" Not clearly slower: {enumerated(ties)} times that."
    if place.clearly_slower:
        after = place.clearly_slower[0]
        text += (
            f" {'Clearly slower' if place.ties else 'The next, clearly slower,'} is "
            f"{name(study, after)}, {times_as_long(study, place.over_first[after])} times as long."
        )
    else:
        text += " None is clearly slower."
    return text


def between(
    study: Study, scenario: str, place: Standing, metric: str, a: Series, b: Series
) -> Ratio:
    """Time of a over that of b."""
    cells = study.cells_of(scenario, place.objects)
    return ratio_of_medians(run_times(cells[a], metric), run_times(cells[b], metric))


def _against_bullet(
    study: Study, scenario: str, place: Standing, metric: str, ours: Series, bullet: Series
) -> str:
    ratio = between(study, scenario, place, metric, ours, bullet)
    text = (
        f"BroadCL's fastest, {name(study, ours)}, takes {times_as_long(study, ratio)} times as long as"
        f" Bullet's fastest, {name(study, bullet)}"
    )
    if is_of_single_runs(study):
        return text + "."
    judged = "no clear difference"
    if ratio.is_clear:
        judged = "clearly less" if ratio.value < 1 else "clearly more"
    return f"{text}: {judged}."


def _over_objects(study: Study, places: list[Standing]) -> str:
    """Ranges of numbers of objects with the same first."""
    ranges: list[list[Standing]] = []
    for place in places:
        if ranges and ranges[-1][-1].first == place.first:
            ranges[-1].append(place)
        else:
            ranges.append([place])
    texts = []
    for same in ranges:
        sizes = f"{same[0].objects:,}"
        if len(same) > 1:
            sizes += f" to {same[-1].objects:,}"
        if is_of_single_runs(study):
            texts.append(f"{name(study, same[0].first)} with {sizes}")
            continue
        unclear = [f"{p.objects:,}" for p in same if p.ties]
        clearly = "clearly" if not unclear else "not clearly"
        if unclear and len(unclear) < len(same):
            clearly = f"not clearly at {enumerated(unclear)}"
        texts.append(f"{name(study, same[0].first)} with {sizes} ({clearly})")
    if len(ranges) == 1:
        return f"First at every number of objects: {texts[0]}."
    return f"The first changes with the number of objects: {', then '.join(texts)}."


def _by_sizes(missing: dict[str, list[int]]) -> list[tuple[list[str], list[str]]]:
    """Groups scenarios that lack the same numbers of objects: those numbers, and the scenarios."""
    groups: dict[tuple[int, ...], list[str]] = {}
    for scenario, sizes in missing.items():
        if sizes:
            groups.setdefault(tuple(sizes), []).append(scenario)
    return [([f"{n:,}" for n in sizes], scenarios) for sizes, scenarios in groups.items()]


def absent(study: Study) -> list[str]:
    """Broad phases that did not run, or not with every scenario and number of objects."""
    lines = []
    for broadphase in (row["name"] for row in study.info["broadphases"]):
        ran = {(c.scenario, c.objects) for c in study.cells if c.series.broadphase == broadphase}
        if not ran:
            lines.append(f"`{broadphase}` has no runs.")
            continue
        missing = {
            scenario: [n for n in study.info["objects"] if (scenario, n) not in ran]
            for scenario in study.info["scenarios"]
        }
        lines += [
            f"`{broadphase}` has no runs of {enumerated(scenarios)} with {enumerated(sizes)} objects."
            for sizes, scenarios in _by_sizes(missing)
        ]
    return lines + [
        f"Left out of the preset `{study.info['preset']}`: {text}." for text in study.info["cut"]
    ]

