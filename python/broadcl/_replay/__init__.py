"""The replay of boxes in a page, and how it gets them. Needs only NumPy: the study uses it without the package."""

from __future__ import annotations

import base64
import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np

LEVELS = 16383  # of a coordinate
ABSENT = 65535  # instead of a level: there is no box

_HERE = Path(__file__).parent
CONTROLS = (_HERE / "replay.html").read_text(encoding="utf-8")
STYLE = (_HERE / "replay.css").read_text(encoding="utf-8")


def quantised(boxes: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Coordinates of (n, 6) boxes as uint16, scaled between the corners of what is shown, beyond which they are clamped."""
    size = np.where(high > low, high - low, 1)
    with np.errstate(over="ignore"):
        shares = (boxes - np.tile(low, 2)) / np.tile(size, 2)
    levels = np.rint(np.clip(shares, 0, 1) * LEVELS).astype(np.uint16)
    levels[(boxes[:, :3] > boxes[:, 3:]).any(axis=1)] = ABSENT
    return levels


def pack(rows: np.ndarray) -> str:
    """Little-endian uint16 or uint32: each row as what it differs by from the row before, deflated, in base64."""
    rows = rows.reshape(len(rows), -1)
    rows = np.diff(rows, axis=0, prepend=np.zeros_like(rows[:1]))
    numbers = rows.astype(rows.dtype.newbyteorder("<")).tobytes()
    return base64.b64encode(zlib.compress(numbers)).decode("ascii")


def scripts(runs: list[dict[str, Any]]) -> str:
    """What follows CONTROLS in a page, for runs as replay.js describes them."""
    text = json.dumps(runs, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    script = (_HERE / "replay.js").read_text(encoding="utf-8")
    return f'<script type="application/json" id="recordings">{text}</script><script>{script}</script>'
