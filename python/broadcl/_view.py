from __future__ import annotations

import html
import os
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from . import _core, _frames, _replay
from ._frames import Frames

MOST_BYTES = 6_000_000  # of a page
MOST_SHOWN = 10_000  # objects that a page shows of a frame; of more, a sample
FEWEST_SHOWN = 2_500  # of a sample, so that more frames are stored
STORED = 500_000  # boxes that a page has, of all frames; those of frames in between are interpolated
MOST_PARTNERS = 64  # that a page has of a box
MOST_POINTS = 20_000  # of the curve
HUGE = 1000  # times the median size: such boxes do not determine how much of space is shown


class Page:
    """A page in which boxes can be seen, as one text without anything beside it. Jupyter shows it.

    `html` is the text; `save(file)` writes it.
    """

    def __init__(self, text: str) -> None:
        self.html = text

    def save(self, file: str | os.PathLike[str]) -> None:
        """Writes the page, replacing a file only when all of it is there."""
        path = Path(file)
        beside = path.with_name(f".{path.name}.part")
        try:
            beside.write_text(self.html, encoding="utf-8")
            os.replace(beside, path)
        except BaseException:
            beside.unlink(missing_ok=True)
            raise

    def _repr_html_(self) -> str:
        frame = '<iframe style="width:100%;height:960px;border:0" sandbox="allow-scripts" srcdoc="{}"></iframe>'
        return frame.format(html.escape(self.html))


def view(
    boxes: Any, *, group: Any = 1, mask: Any = -1, body: Any = -1, world: Any = 0, distance: float = 0, title: str = "Boxes"
) -> Page:
    """Makes a page in which boxes can be seen: turned, played frame by frame, coloured, and selected one by one.

    All pairs of all frames are found, and are exact. The page has at most 6 MB. Of more than ten thousand
    boxes it shows a random sample, of many frames some, between which boxes are interpolated; it says so.

    Parameters
    ----------
    boxes : array_like
        ``(n, 6)`` of lower x, y, z, upper x, y, z, or ``(n, 2, 3)``, or in two dimensions ``(n, 4)``; a tuple of lower and
        upper corners; for frames, ``(frames, n, 6)``, or a list or an iterator of the former. Box k is object k in
        every frame.
    group, mask, body, world : array_like, optional
        The filters of the objects, as in `BroadPhase.add`: one number, or one for each.
    distance : float, optional
        As of `BroadPhase`: pairs are within it.
    title : str, optional
        The heading of the page.

    Returns
    -------
    Page
        Shown by Jupyter; `save` writes it to a file.

    Raises
    ------
    ValueError
        For a shape or a number that cannot be used, such as a NaN.
    TypeError
        For other types than float32, float64 and integers.
    Error
        If the pairs cannot be found.

    Examples
    --------
    >>> page = broadcl.view([[0, 0, 2, 2], [1, 1, 3, 3], [5, 5, 6, 6]], title="Three squares")
    >>> "Three squares" in page.html
    True
    """
    given = {"group": group, "mask": mask, "body": body, "world": world}
    return Page(_page(_frames.from_boxes(boxes, distance, **given), title))


def view_file(path: Path) -> Page:
    """The same of a file."""
    try:
        return Page(_page(_frames.from_file(path), path.name.encode(errors="replace").decode()))
    except OSError as error:
        raise ValueError(f"cannot read '{path}': {error.strerror or error}") from None
    except (ValueError, TypeError, EOFError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(f"cannot use '{path}': {error}") from None


def _page(frames: Frames, title: str) -> str:
    scope = _scope(frames)
    stored = STORED
    while True:
        data = _replay_data(frames, scope, title, stored)
        text = _html(data, title)
        if len(text.encode()) <= MOST_BYTES or stored == 0:
            return text
        stored //= 2


def _html(data: dict[str, Any], title: str) -> str:
    template = (Path(__file__).parent / "_replay" / "view.html").read_text(encoding="utf-8")
    parts = {"title": html.escape(title), "version": _core.version, "style": _replay.STYLE, "controls": _replay.CONTROLS,
             "scripts": _replay.scripts([data])}  # fmt: skip
    return "".join(parts.get(piece, piece) for piece in template.split("@"))


class _Scope(NamedTuple):
    """What all frames have in common."""

    frames: int
    ids: np.ndarray  # of all objects that there ever were, ascending
    low: np.ndarray  # (3,) corners of what is shown
    high: np.ndarray


def _scope(frames: Frames) -> _Scope:
    count, ids = 0, np.empty(0, np.uint32)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for frame in frames.read():
        count += 1
        if not np.array_equal(frame.ids, ids):
            ids = np.union1d(ids, frame.ids)
        boxes = frame.boxes[np.isfinite(frame.boxes).all(axis=1) & (frame.boxes[:, :3] <= frame.boxes[:, 3:]).all(axis=1)]
        if len(boxes):
            with np.errstate(over="ignore"):
                edges = (boxes[:, 3:] - boxes[:, :3]).max(axis=1)
                median = np.partition(edges, (len(edges) - 1) // 2)[(len(edges) - 1) // 2]
                usual = boxes[(edges <= HUGE * median) | (median == 0)]
            low, high = np.minimum(low, usual[:, :3].min(axis=0)), np.maximum(high, usual[:, 3:].max(axis=0))
    if count == 0:
        raise ValueError("there is no frame")
    if np.any(low > high):
        low, high = np.zeros(3), np.ones(3)
    return _Scope(count, ids, np.clip(low, -1e37, 1e37), np.clip(high, -1e37, 1e37))


def _sampled(scope: _Scope, stored: int) -> tuple[np.ndarray, np.ndarray]:
    """The rows of the objects, and the numbers of the frames, that are stored."""
    shown = len(scope.ids)
    if shown > min(MOST_SHOWN, stored):
        shown = min(max(stored // scope.frames, FEWEST_SHOWN), MOST_SHOWN, stored)
    rows = np.sort(np.random.default_rng(1).choice(len(scope.ids), shown, replace=False))
    count = max(min(stored // max(shown, 1), scope.frames, MOST_POINTS), min(2, scope.frames))
    return rows, np.floor(np.linspace(0, scope.frames - 1, count) + 0.5).astype(np.int64)


def _replay_data(frames: Frames, scope: _Scope, title: str, stored: int) -> dict[str, Any]:
    """As replay.js reads it."""
    rows, numbers = _sampled(scope, stored)
    wanted = set(numbers.tolist())
    levels, filters, counts, partners = [], [], [], []
    curve = np.empty((scope.frames, 3), np.uint32)
    for number, (pairs, added, removed, boxes, of_rows) in enumerate(_searched(frames, scope)):
        curve[number] = len(pairs), added, removed
        if number in wanted:
            levels.append(_replay.quantised(boxes[rows], scope.low, scope.high).T)
            filters.append(of_rows[rows].T)
            of_each, found = _partners(pairs, rows, len(scope.ids))
            counts.append(np.minimum(of_each, 65535).astype(np.uint16))
            partners.append(_first(found, of_each, MOST_PARTNERS))
    most, overlaps = MOST_PARTNERS, np.array(counts)
    while most > 1 and np.minimum(overlaps, most).sum() > 4 * stored:
        most //= 2
    of_all = _first(np.concatenate(partners), np.minimum(overlaps, MOST_PARTNERS).ravel(), most)
    # Box by box, since the next frame has mostly the same, which is packed into little.
    boxes_of_all = np.repeat(np.tile(np.arange(len(rows)), len(numbers)), np.minimum(overlaps, most).ravel())
    of_all = of_all[np.argsort(boxes_of_all, kind="stable")]
    per_point = -(-scope.frames // MOST_POINTS)
    peaks = np.maximum.reduceat(curve, np.arange(0, scope.frames, per_point))
    return {
        "scenario": title, "objects": len(rows), "all_objects": len(scope.ids), "recorded_frames": scope.frames,
        "stride": (scope.frames - 1) / max(len(numbers) - 1, 1) or 1, "frames": len(numbers), "frame_seconds": 1 / 30,
        "levels": _replay.LEVELS, "low": scope.low.tolist(), "high": scope.high.tolist(),
        "colours": ["overlaps", "world", "group"],
        "top_overlaps": max(int(np.quantile(overlaps, 0.95)) if overlaps.size else 1, 1),
        "focus": [(scope.low + share * (scope.high - scope.low)).tolist() for share in _focus(np.array(levels))],
        "boxes": _replay.pack(np.array(levels)), "overlaps": _replay.pack(overlaps), "filters": _replay.pack(np.array(filters)),
        "ids": _replay.pack(scope.ids[rows][None]), "most_partners": most,
        "partners": _replay.pack(scope.ids[of_all][None]),
        "curve": _replay.pack(peaks), "frames_per_point": per_point,
    }  # fmt: skip


def _focus(levels: np.ndarray) -> np.ndarray:
    """Between which shares of what is shown, by axis, most boxes are: (2, 3)."""
    is_there = levels[:, 0] != _replay.ABSENT
    if not is_there.any():
        return np.array([[0, 0, 0], [1, 1, 1]])
    lower, upper = (np.moveaxis(levels, 1, 0)[k, is_there] for k in (slice(0, 3), slice(3, 6)))
    return np.stack([np.quantile(lower, 0.05, axis=1), np.quantile(upper, 0.95, axis=1)]) / _replay.LEVELS


def _searched(frames: Frames, scope: _Scope) -> Iterator[tuple[np.ndarray, int, int, np.ndarray, np.ndarray]]:
    """Of each frame all pairs of rows, how many were added and removed, and the box and the filter of each row."""
    broad_phase = _core.BroadPhase(dtype=frames.dtype, distance=frames.distance)
    broad_phase.map(len(scope.ids))  # row k is object k, whose box is empty while it is not there
    filters = np.tile(_frames.DEFAULT_FILTER, (len(scope.ids), 1))
    reaches, exclusions = np.zeros(len(scope.ids)), None
    for frame in frames.read():
        rows = np.searchsorted(scope.ids, frame.ids)
        again = rows[np.isin(frame.ids, frame.gone)]
        broad_phase.remove(again)
        broad_phase.add(np.tile(np.array(_core.EMPTY, frames.dtype), (len(again), 1)))  # gets the same ids, the lowest
        changed = np.union1d(rows[(filters[rows] != frame.filters).any(axis=1)], again)
        filters[rows] = frame.filters
        group, mask, body, world = filters[changed].T
        broad_phase.set_filter(changed, group=group, mask=mask, body=body, world=world)
        changed = np.union1d(rows[reaches[rows] != frame.reaches], again)
        reaches[rows] = frame.reaches
        if reaches.any():
            broad_phase.set_reach(changed, reaches[changed])
        if exclusions is not frame.exclusions:
            exclusions = frame.exclusions
            broad_phase.set_exclusions(_excluded_rows(exclusions, scope.ids))
        boxes = broad_phase.map(len(scope.ids))
        boxes[:] = _core.EMPTY
        boxes[rows] = frame.boxes
        shown = boxes.copy()
        added, removed = broad_phase.update()
        yield broad_phase.pairs(), len(added), len(removed), shown, filters


def _excluded_rows(exclusions: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Without those of objects that there never are."""
    exclusions = exclusions[np.isin(exclusions, ids).all(axis=1)]
    return np.searchsorted(ids, exclusions).astype(np.uint32)


def _partners(pairs: np.ndarray, rows: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """How many partners each of these rows has, and the partners of all of them, in order."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    is_shown = np.zeros(count, bool)
    is_shown[rows] = True
    both = both[is_shown[both[:, 0]]]
    return np.bincount(both[:, 0], minlength=count)[rows], both[np.lexsort((both[:, 1], both[:, 0])), 1]


def _first(partners: np.ndarray, counts: np.ndarray, most: int) -> np.ndarray:
    """The first partners of each box, which has so many."""
    ranks = np.arange(len(partners)) - np.repeat(np.cumsum(counts) - counts, counts)
    return partners[ranks < most]
