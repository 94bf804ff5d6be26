"""Recorded runs for the replay: reads, thins, quantises and packs them."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from report.overlaps import count_overlaps
from report.study import StudyError

FRAME_SECONDS = 1 / 30
BUDGET = 10_000_000  # characters of all recordings together
STRIDES = (1, 2, 4)  # every how many frames one is stored; those in between are interpolated
LEVELS = 65535
KEY_FRAMES = 4


@dataclass(frozen=True)
class Recording:
    scenario: str
    boxes: np.ndarray  # (frames, n, 6) float32, memory-mapped: the initial state, then each frame
    low: np.ndarray  # (3,) corners of the world
    high: np.ndarray

    @property
    def objects(self) -> int:
        return int(self.boxes.shape[1])

    @property
    def key_frames(self) -> list[int]:
        """The first frame, the last one, and two evenly spaced between them."""
        return [round(x) for x in np.linspace(0, len(self.boxes) - 1, KEY_FRAMES)]

    def speeds(self, frame: int, stride: int = 1) -> np.ndarray:
        """Speeds of the centres, m/s, since the previous frame (for the first frame: to the next)."""
        after = max(frame, min(stride, len(self.boxes) - 1))
        before = max(0, after - stride)
        moved = (self.boxes[after] - self.boxes[before]).reshape(-1, 2, 3).mean(axis=1)
        return np.linalg.norm(moved, axis=1) / (max(1, after - before) * FRAME_SECONDS)


def read_recordings(folder: Path, scenarios: list[str]) -> list[Recording]:
    """The recordings of those scenarios that have one."""
    paths = {s: folder / "recordings" / f"{s}.npy" for s in scenarios}
    return [read_recording(s, path) for s, path in paths.items() if path.exists()]


def read_recording(scenario: str, path: Path) -> Recording:
    """One recording; throws StudyError."""
    try:
        boxes = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, OSError) as error:
        raise StudyError(f"{path} is not a recording: {error}") from None
    if boxes.dtype != np.float32 or boxes.ndim != 3 or boxes.shape[2] != 6 or min(boxes.shape) < 1:
        raise StudyError(f"{path}: float32 of shape (frames, n, 6) is needed, not {boxes.shape}")
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for block in boxes:
        if not np.all(np.isfinite(block)) or np.any(block[:, :3] > block[:, 3:]):
            raise StudyError(f"{path}: a box is not finite, or its corners are swapped")
        low, high = np.minimum(low, block[:, :3].min(0)), np.maximum(high, block[:, 3:].max(0))
    return Recording(scenario, boxes, low, high)


def quantised(boxes: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Coordinates as uint16, scaled between the world's corners."""
    size = np.where(high > low, high - low, 1)
    return np.rint((boxes - np.tile(low, 2)) / np.tile(size, 2) * LEVELS).astype(np.uint16)


def pack(rows: Iterable[np.ndarray], budget: float = np.inf) -> tuple[str, int]:
    """Packs as many uint16 rows as fit into a budget of characters, at least two; the text and their number.

    Each row is the difference from the previous one, low bytes first, then high bytes; deflated, in base64.
    """
    compressor = zlib.compressobj()
    before: np.ndarray | None = None
    packed, kept = b"", 0
    for row in rows:
        change = row if before is None else row - before
        with_row = compressor.copy()
        data = (change & 0xFF).astype(np.uint8).tobytes() + (change >> 8).astype(np.uint8).tobytes()
        more = with_row.compress(data) + with_row.flush(zlib.Z_SYNC_FLUSH)
        if kept >= 2 and (len(packed) + len(more)) * 4 / 3 + 16 > budget:
            break
        compressor, before, packed, kept = with_row, row, packed + more, kept + 1
    return base64.b64encode(packed + compressor.flush()).decode("ascii"), kept


def replay_data(recording: Recording, budget: int) -> dict[str, Any]:
    """A recording as the page's replay reads it, within a budget of characters, but at least two frames."""
    low, high = recording.low, recording.high
    for stride in STRIDES:
        # Grouped by coordinate, so that similar values are adjacent and compress better.
        steps = (quantised(block, low, high).T for block in recording.boxes[::stride])
        boxes, kept = pack(steps, budget * 0.9)
        if kept * stride >= len(recording.boxes):
            break
    frames = range(0, kept * stride, stride)
    overlaps = np.stack([np.minimum(count_overlaps(recording.boxes[f]), 255) for f in frames])
    speeds = np.concatenate([recording.speeds(f, stride) for f in frames])
    return {
        "scenario": recording.scenario,
        "objects": recording.objects,
        "recorded_frames": len(recording.boxes),
        "stride": stride,
        "frames": len(frames),
        "frame_seconds": FRAME_SECONDS,
        "low": low.tolist(),
        "high": high.tolist(),
        "key_frames": recording.key_frames,
        "top_speed": max(float(np.quantile(speeds, 0.98)), 1e-3),
        "top_overlaps": max(int(np.quantile(overlaps, 0.99)), 1),
        "boxes": boxes,
        "overlaps": pack(overlaps.astype(np.uint16))[0],
    }
