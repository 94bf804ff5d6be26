"""Recorded runs, and how the replay gets them: thinned."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from study.plan import StudyError
from study.replay import LEVELS, pack, quantised

FRAME_SECONDS = 1 / 30
MOST_BOXES = 48_000  # that the page has of a recording; those of frames in between are interpolated


@dataclass(frozen=True)
class Recording:
    scenario: str
    boxes: np.ndarray  # (frames, n, 6) float32, memory-mapped: the initial state, then each frame
    low: np.ndarray  # (3,) corners of what all boxes occupy
    high: np.ndarray

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
    try:
        boxes = np.load(path, mmap_mode="r", allow_pickle=False)
        if boxes.dtype != np.float32 or boxes.ndim != 3 or boxes.shape[2] != 6 or min(boxes.shape) < 1:
            raise ValueError("float32 of shape (frames, n, 6) is needed")
        low, high = boxes[..., :3].min((0, 1)), boxes[..., 3:].max((0, 1))
        if not np.isfinite([low, high]).all() or np.any(boxes[..., :3] > boxes[..., 3:]):
            raise ValueError("a box is not finite, or its corners are swapped")
    except (ValueError, OSError) as error:
        raise StudyError(f"'{path}' is not a recording: {error}; remove it") from None
    return Recording(scenario, boxes, low, high)


def count_overlaps(boxes: np.ndarray) -> np.ndarray:
    """The number of other boxes that each of (n, 6) closed boxes touches or overlaps; exact, by a sweep along x."""
    order = np.argsort(boxes[:, 0], kind="stable")
    low, high = boxes[order, :3], boxes[order, 3:]
    # Each box is followed by those that begin before it ends.
    behind = np.searchsorted(low[:, 0], high[:, 0], side="right") - np.arange(len(boxes)) - 1
    first = np.repeat(np.arange(len(boxes)), behind)
    second = np.arange(len(first)) - np.repeat(np.cumsum(behind) - behind, behind) + first + 1
    meets = ((low[first, 1:] <= high[second, 1:]) & (low[second, 1:] <= high[first, 1:])).all(axis=1)
    counts = np.empty(len(boxes), dtype=np.int64)
    counts[order] = np.bincount(np.concatenate([first[meets], second[meets]]), minlength=len(boxes))
    return counts


def replay_data(recording: Recording, most_boxes: int = MOST_BOXES) -> dict[str, Any]:
    """A recording as the page's replay reads it: as many of its frames, evenly spaced, as have so many boxes."""
    low, high, objects = recording.low, recording.high, recording.boxes.shape[1]
    stride = max(1, -(-len(recording.boxes) * objects // most_boxes))
    frames = range(0, len(recording.boxes), stride)
    steps = np.stack([quantised(recording.boxes[f], low, high).T for f in frames])
    overlaps = np.stack([np.minimum(count_overlaps(recording.boxes[f]), 255) for f in frames]).astype(np.uint16)
    speeds = np.concatenate([recording.speeds(f, stride) for f in frames])
    return {
        "scenario": recording.scenario, "objects": objects, "recorded_frames": len(recording.boxes), "stride": stride,
        "frames": len(frames), "frame_seconds": FRAME_SECONDS, "levels": LEVELS, "low": low.tolist(), "high": high.tolist(),
        "colours": ["speed", "overlaps"],
        "top_speed": max(float(np.quantile(speeds, 0.98)), 1e-3),
        "top_overlaps": max(int(np.quantile(overlaps, 0.99)), 1),
        "boxes": pack(steps), "overlaps": pack(overlaps),
    }
