"""Which broad phases found the same number of pairs in every frame."""

from __future__ import annotations

import numpy as np

from report.study import Series, Study
from report.verdict import enumerated, name

PAIRS = 3  # column of Repeats.frames


def groups_alike(study: Study, scenario: str, objects: int) -> list[list[Series]]:
    """Exact broad phases whose numbers of pairs are the same in every frame of every repeat."""
    exact = {row["name"] for row in study.info["broadphases"] if row["exact"]}
    groups: list[tuple[np.ndarray, list[Series]]] = []
    for series, repeats in study.cells_of(scenario, objects).items():
        if series.broadphase not in exact:
            continue
        pairs = repeats.frames[:, :, PAIRS]
        alike = bool(np.all(pairs == pairs[0]))
        for known, group in groups:
            if alike and np.array_equal(known, pairs[0]):
                group.append(series)
                break
        else:
            groups.append((pairs[0] if alike else np.array([]), [series]))
    return [group for _, group in groups]


def agreement(study: Study, scenario: str) -> list[str]:
    """One sentence per number of objects."""
    lines = []
    for objects in study.objects(scenario):
        groups = groups_alike(study, scenario, objects)
        if not groups:
            continue
        text = "; ".join(enumerated([name(study, s) for s in group]) for group in groups)
        if len(groups) == 1:
            lines.append(f"With {objects:,} objects, the same number in every frame: {text}.")
        else:
            lines.append(f"With {objects:,} objects, {len(groups)} different courses: {text}.")
    return lines
