"""Overlapping pairs of boxes, still or moving, on any OpenCL device or on the host.

    pairs = broadcl.overlapping_pairs(boxes)            # (n, 6) -> (m, 2)

    broad_phase = broadcl.BroadPhase()
    ids = broad_phase.add(boxes)
    added, removed = broad_phase.update()
"""

import copyreg

from ._check import check
from ._core import (
    ALL_WORLDS,
    EMPTY,
    NO_BODY,
    BroadPhase,
    Delta,
    Device,
    DeviceArray,
    DeviceBroadPhase,
    DeviceDelta,
    DeviceLost,
    Error,
    InvertedBoxesWarning,
    OutOfDeviceMemory,
    State,
    algorithms,
    along,
    devices,
    filters_from_layers,
    filters_from_one_sided,
    nearest,
    overlapping,
    overlapping_pairs,
    pairs_that_share,
    select_device,
    squared_distances,
)
from ._core import version as __version__
from ._view import Page, view

__all__ = [
    "ALL_WORLDS",
    "EMPTY",
    "NO_BODY",
    "BroadPhase",
    "Delta",
    "Device",
    "DeviceArray",
    "DeviceBroadPhase",
    "DeviceDelta",
    "DeviceLost",
    "Error",
    "InvertedBoxesWarning",
    "OutOfDeviceMemory",
    "Page",
    "State",
    "__version__",
    "algorithms",
    "along",
    "check",
    "devices",
    "filters_from_layers",
    "filters_from_one_sided",
    "nearest",
    "overlapping",
    "overlapping_pairs",
    "pairs_that_share",
    "select_device",
    "squared_distances",
    "view",
]

for _value in (Page, check, view):
    _value.__module__ = __name__

# Functions are pickled by their names, as Python's own are.
copyreg.pickle(type(overlapping_pairs), lambda function: function.__qualname__)
