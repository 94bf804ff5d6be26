"""What the page says in words. Every claim is computed; names are marked as `code`."""

from __future__ import annotations

from study.data import Study
from study.errors import listed
from study.statistics import FEWEST, Ratio, Standing, ratio_digits, standing, three_digits


def times_as_long(ratio: Ratio) -> str:
    """The ratio, with its interval in brackets if it has one."""
    if ratio.interval is None:
        return ratio_digits(ratio.value)
    low, high = (ratio_digits(end) for end in ratio.interval)
    return f"{ratio_digits(ratio.value)} ({low} to {high})"


def certainty(study: Study) -> str:
    """Explains when a difference is called clear."""
    fewest = study.runs.groupby(["scenario", "objects", "frames", "broadphase"]).size()
    rule = "its 95 % interval excludes 1 and it exceeds the difference of times that should be equal"
    if fewest.max() < FEWEST:
        return f"Intervals need {FEWEST} runs, but there are at most {fewest.max()}: so nothing is called clear."
    return f"A difference is clear if {rule} (see “How far to trust this”). Ratios without an interval are of fewer than " + (
        f"{FEWEST} runs, and not judged."
    )


def headline(study: Study) -> list[str]:
    """What the whole study says with the most objects, first about update and broad phase together."""
    sentences = []
    for metric, subject, whole in (
        ("search", "Update and broad phase together are shortest", "update and broad phase take"),
        ("total", "The total time is shortest", "the whole frame takes"),
    ):
        places = {s: standing(study, study.largest(s), metric) for s in study.scenarios}
        claims = []
        for first in dict.fromkeys(place.first for place in places.values()):
            where = [
                s + (" (not clearly)" if place.is_judged and place.ties else "")
                for s, place in places.items()
                if place.first == first
            ]
            claims.append(f"`{first}` in {listed(where)}")
        most = listed([f"{n:,}" for n in sorted({place.cell.objects for place in places.values()})])
        sentences.append(f"With {most} objects: {subject[0].lower()}{subject[1:]} with {'; with '.join(claims)}.")
        ratios = [(place.ours_over_bullet[2], s) for s, place in places.items() if place.ours_over_bullet]
        if ratios:
            low, high = min(ratios, key=lambda r: r[0].value), max(ratios, key=lambda r: r[0].value)
            ends = f"{times_as_long(low[0])} times as long in {low[1]}"
            if low != high:
                ends = f"from {ends} to {times_as_long(high[0])} times in {high[1]}"
            sentences.append(f"With the fastest of BroadCL's broad phases, {whole} {ends}, compared with the fastest of Bullet's own.")
    return sentences


def sentences(study: Study, scenario: str, metric: str) -> list[str]:
    """One scenario by one metric: who is first with the most objects, against Bullet, and over the numbers of objects."""
    place = standing(study, study.largest(scenario), metric)
    result = [_who_is_first(place)]
    if place.ours_over_bullet:
        ours, bullet, ratio = place.ours_over_bullet
        judged = ""
        if ratio.interval:
            judged = ": no clear difference" if not ratio.is_clear else ": clearly less" if ratio.value < 1 else ": clearly more"
        result.append(f"BroadCL's fastest, `{ours}`, takes {times_as_long(ratio)} times as long as Bullet's fastest, `{bullet}`{judged}.")
    cells = study.over_objects(scenario)
    if len(cells) > 1:
        result.append(_over_objects([standing(study, cell, metric) for cell in cells]))
    return result


def _who_is_first(place: Standing) -> str:
    text = f"With {place.cell}: `{place.first}` is first, {three_digits(place.milliseconds[place.first])} ms per frame."
    if not place.is_judged:
        others = [f"`{b}` {times_as_long(r)}" for b, r in place.over_first.items()]
        return f"{text} Times as long: {listed(others)}." if others else f"{text} Nothing else ran."
    if place.ties:
        ties = [f"`{b}` at {times_as_long(place.over_first[b])}" for b in place.ties]
        text += f" Not clearly slower: {listed(ties)} times that."
    slower = [b for b, ratio in place.over_first.items() if ratio.is_clear]
    if not slower:
        return f"{text} None is clearly slower."
    which = "Clearly slower is" if place.ties else "The next, clearly slower, is"
    return f"{text} {which} `{slower[0]}`, {times_as_long(place.over_first[slower[0]])} times as long."


def _over_objects(places: list[Standing]) -> str:
    """Ranges of numbers of objects with the same first."""
    ranges: list[list[Standing]] = []
    for place in places:
        if ranges and ranges[-1][-1].first == place.first:
            ranges[-1].append(place)
        else:
            ranges.append([place])
    texts = []
    for same in ranges:
        sizes = f"{same[0].cell.objects:,}" + (f" to {same[-1].cell.objects:,}" if len(same) > 1 else "")
        unclear = [f"{p.cell.objects:,}" for p in same if p.is_judged and p.ties]
        doubt = f" (not clearly at {listed(unclear)})" if unclear else ""
        texts.append(f"`{same[0].first}` with {sizes}{doubt}")
    if len(ranges) == 1:
        return f"First at every number of objects: {texts[0]}."
    return f"The first changes with the number of objects: {', then '.join(texts)}."


def absent(study: Study) -> list[str]:
    """What did not run, or less than the rest."""
    plan = study.plan
    lines = []
    ran = {(r.scenario, r.objects, r.broadphase) for r in study.frames}
    for broadphase in plan.broadphases:
        missing: dict[tuple[str, ...], list[str]] = {}
        for scenario in plan.scenarios:
            sizes = tuple(f"{n:,}" for n in plan.objects if (scenario, n, broadphase) not in ran)
            missing.setdefault(sizes, []).append(scenario)
        missing.pop((), None)
        if broadphase not in study.broadphases:
            lines.append(f"`{broadphase}` has no runs.")
            continue
        lines += [f"`{broadphase}` has no runs of {listed(s)} with {listed(list(n))} objects." for n, s in missing.items()]
    done, planned = len(study.frames), len(plan.runs())
    if done < planned:
        lines.append(f"{planned - done:,} of {planned:,} planned runs are not done yet.")
    return lines + [f"Left out of the preset `{plan.preset}`: {text}." for text in plan.left_out]
