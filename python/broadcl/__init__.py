"""Overlapping pairs of boxes, still or moving, on any OpenCL device or on the host.

    pairs = broadcl.overlapping_pairs(boxes)            # (n, 6) -> (m, 2)

    broad_phase = broadcl.BroadPhase()
    ids = broad_phase.add(boxes)
    added, removed = broad_phase.update()
"""

from ._check import check
from ._core import (
    ALL_WORLDS,
    NO_BODY,
    BroadPhase,
    Delta,
    Device,
    DeviceBroadPhase,
    DeviceDelta,
    DeviceLost,
    Error,
    OutOfDeviceMemory,
    algorithms,
    devices,
    overlapping_pairs,
    pairs_that_share,
    select_device,
)
from ._core import version as __version__

__all__ = [
    "ALL_WORLDS",
    "NO_BODY",
    "BroadPhase",
    "Delta",
    "Device",
    "DeviceBroadPhase",
    "DeviceDelta",
    "DeviceLost",
    "Error",
    "OutOfDeviceMemory",
    "__version__",
    "algorithms",
    "check",
    "devices",
    "overlapping_pairs",
    "pairs_that_share",
    "select_device",
]
