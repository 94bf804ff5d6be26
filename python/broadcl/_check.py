from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from . import _core


def _frames() -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Two frames of each scene: its name, the boxes, and the pairs by definition."""
    frames = []
    for number, boxes in enumerate(_scenes()):
        for frame in range(2):
            boxes[::3, [0, 3]] += np.float32(0.25 * frame)
            expected = _core.overlapping_pairs(boxes, algorithm="oracle")
            frames.append((f"scene {number}, frame {frame}", boxes.copy(), expected))
    return frames


def _scenes() -> Iterator[np.ndarray]:
    """Kinds of boxes that often break broad phases."""
    random = np.random.default_rng(1)
    for count in (1, 2, 65, 257, 1000, 3000):
        lower = random.uniform(0, count ** (1 / 3), (count, 3))
        for size in (0.0, 0.5, random.lognormal(-1, 1, (count, 1))):
            yield np.hstack([lower, lower + size]).astype(np.float32)
        flat = lower * [1, 1, 0]
        mixed = np.hstack([flat, flat + 0.5]).astype(np.float32)
        mixed[::7] = [-np.inf, -np.inf, 0, np.inf, np.inf, 0]  # planes
        mixed[::5] = _core.EMPTY
        yield mixed


def check(device: str | _core.Device | None = None) -> dict[str, str]:
    """Compares every algorithm on a device with the oracle, in scenes that often break broad phases, still and moving.

    Parameters
    ----------
    device : str or Device, optional
        A selector as for `select_device`. None for the default device, or for only the algorithms of the host if there is none.

    Returns
    -------
    dict of str to str
        For each algorithm ``"right"``, or what is wrong.

    Raises
    ------
    Error
        If the named device does not exist.
    """
    if device is not None or _core.devices():
        device = _core.select_device(device)
    names = _core.algorithms() if device is not None else _core.host_algorithms()
    frames = _frames()
    return {name: _result(name, device, frames) for name in names}


def _result(algorithm: str, device: _core.Device | None, frames: list[tuple[str, np.ndarray, np.ndarray]]) -> str:
    try:
        broad_phase = _core.BroadPhase(device=device, algorithm=algorithm)
        known = np.empty((0, 2), np.uint32)
        for frame, boxes, expected in frames:
            broad_phase.map(len(boxes))[:] = boxes
            added, removed = broad_phase.update()
            known = _apply(known, added, removed)
            for pairs in (broad_phase.pairs(), known):
                if not np.array_equal(pairs, expected):
                    return f"wrong in {frame}: pairs: {len(pairs)}, expected: {len(expected)}"
    except _core.Error as error:
        return str(error)
    return "right"


def _apply(known: np.ndarray, added: np.ndarray, removed: np.ndarray) -> np.ndarray:
    def key(pairs: np.ndarray) -> np.ndarray:
        return pairs[:, 1].astype(np.uint64) << np.uint64(32) | pairs[:, 0]

    stays = known[~np.isin(key(known), key(removed))]
    result = np.vstack([stays, added])
    return result[np.argsort(key(result), kind="stable")]
