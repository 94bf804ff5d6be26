"""What the page says in words. Every claim is computed; names are marked as `code`."""

from __future__ import annotations

from itertools import groupby

from study.data import CELL, Study
from study.plan import listed
from study.statistics import FEWEST, Ratio, Standing, ratio_digits, standing, three_digits


def times_as_long(ratio: Ratio) -> str:
    """The ratio, with its interval in brackets if it has one."""
    ends = f" ({ratio_digits(ratio.interval[0])} to {ratio_digits(ratio.interval[1])})" if ratio.interval else ""
    return ratio_digits(ratio.value) + ends


def certainty(study: Study) -> str:
    """Which clock judges, and when a difference is called clear."""
    waiting = listed([f"`{b}`" for b in study.broadphases if "" in set(study.runs.clock[study.runs.broadphase == b])] or ["none"])
    text = f"Times are CPU times of the thread that simulates; by the wall clock if it waits for a device: those of {waiting}. "
    most = study.runs.groupby([*CELL, "broadphase"]).size().max()
    if most < FEWEST:
        return f"{text}Intervals need {FEWEST} runs, but there are at most {most}: so nothing is called clear."
    return text + ("A difference is clear if its 95 % interval excludes 1 and it exceeds the noise, which is how much times differ, by"
                   " the same clocks, that should be equal (see “How far to trust this”).")  # fmt: skip


def headline(study: Study) -> list[str]:
    """What the whole study says with the most objects, first about update and broad phase together."""
    sentences = []
    for metric, subject in (("search", "update and broad phase together take"), ("total", "the whole frame takes")):
        places = {s: standing(study, study.largest(s), metric) for s in study.scenarios}
        claims = []
        for first in dict.fromkeys(place.first for place in places.values()):
            own = [(s, place) for s, place in places.items() if place.first == first]
            claims.append(f"`{first}` in " + listed([s + " (within noise)" * bool(p.ties) for s, p in own]))
        most = listed([f"{n:,}" for n in sorted({place.cell.objects for place in places.values()})])
        sentences.append(f"With {most} objects, {subject} least time with {'; with '.join(claims)}.")
        ratios = sorted(((place.rivals[2], s) for s, place in places.items() if place.rivals), key=lambda r: r[0].value)
        if ratios:
            low, high = (f"{times_as_long(r)} times as long{' (within noise)' * r.is_tie} in {s}" for r, s in (ratios[0], ratios[-1]))
            ends = low if len(ratios) == 1 else f"from {low} to {high}"
            sentences.append(f"With BroadCL's fastest, compared with the fastest of Bullet's own, {subject} {ends}.")
    return sentences


def sentences(study: Study, scenario: str, metric: str) -> list[str]:
    """One scenario by one metric: who is first with the most objects, against Bullet, and over the numbers of objects."""
    place = standing(study, study.largest(scenario), metric)
    result = [_who_is_first(place)]
    if place.rivals:
        ours, bullet, ratio = place.rivals
        judged = "clearly less" if ratio.value < 1 else "clearly more"
        text = f"BroadCL's fastest, `{ours}`, takes {times_as_long(ratio)} times as long as Bullet's fastest, `{bullet}`"
        result.append(text + (f": {judged if ratio.is_clear else 'no clear difference'}." if ratio.interval else "."))
    places = [standing(study, cell, metric) for cell in study.over_objects(scenario)]
    return result + [_over_objects(places)] if len(places) > 1 else result


def _who_is_first(place: Standing) -> str:
    text = f"With {place.cell}: `{place.first}` is first, {three_digits(place.milliseconds[place.first])} ms per frame."
    named = {b: f"`{b}` {times_as_long(ratio)}" for b, ratio in place.over_first.items()}
    if place.ties:
        text += f" Within noise, times as long: {listed([named[b] for b in place.ties])}."
    if not (slower := [b for b in named if b not in place.ties]):
        return text if named else f"{text} Nothing else ran."
    if place.over_first[slower[0]].is_clear:
        return f"{text} Clearly slower: {named[slower[0]]} times as long{', and others' * (len(slower) > 1)}."
    return f"{text} Times as long: {listed([named[b] for b in slower])}."


def _over_objects(places: list[Standing]) -> str:
    """Ranges of numbers of objects with the same first."""
    texts = []
    for first, group in groupby(places, key=lambda place: place.first):
        same = list(group)
        sizes = f"{same[0].cell.objects:,}" + (f" to {same[-1].cell.objects:,}" if len(same) > 1 else "")
        ties = [f"{p.cell.objects:,}" for p in same if p.ties]
        texts.append(f"`{first}` with {sizes}" + (f" (within noise at {listed(ties)})" if ties else ""))
    if len(texts) == 1:
        return f"First at every number of objects: {texts[0]}."
    return f"The first changes with the number of objects: {', then '.join(texts)}."


def absent(study: Study) -> list[str]:
    """What did not run."""
    plan, lines = study.plan, []
    ran = {(r.scenario, r.objects, r.broadphase) for r in study.frames}
    for broadphase in plan.broadphases:
        missing: dict[tuple[str, ...], list[str]] = {}
        for scenario in plan.scenarios:
            sizes = tuple(f"{n:,}" for n in plan.objects if (scenario, n, broadphase) not in ran)
            missing.setdefault(sizes, []).append(scenario)
        missing.pop((), None)
        if broadphase in study.broadphases:
            lines += [f"`{broadphase}` has no runs of {listed(s)} with {listed(list(n))} objects." for n, s in missing.items()]
        else:
            lines.append(f"`{broadphase}` has no runs.")
    if undone := len(plan.runs()) - len(study.frames):
        lines.append(f"{undone:,} of {len(plan.runs()):,} planned runs are not done yet.")
    return lines
