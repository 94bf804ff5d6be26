"""Figure 1: four key frames of each recorded scenario, drawn with matplotlib's 3-D axes."""

from __future__ import annotations

import io

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from report.recording import Recording

COLOUR_MAP = "viridis"
LIGHT = {0: 0.8, 1: 1.0, 2: 0.6}  # brightness of the faces towards +x, +y and +z
EDGES = 0.3  # brightness of the edges of boxes
DOTS = 150  # per inch
INCHES = 2.6


def _to_plot(points: np.ndarray) -> np.ndarray:
    """From the simulation's axes, y up, to matplotlib's, z up."""
    return points[..., [2, 0, 1]]


def _faces(boxes: np.ndarray, axis: int) -> np.ndarray:
    """The face of each box towards an axis: (n, 4, 3)."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    faces = np.empty((len(boxes), 4, 3))
    faces[:, :, axis] = boxes[:, 3 + axis, None]
    faces[:, :, u] = boxes[:, [u, 3 + u, 3 + u, u]]
    faces[:, :, v] = boxes[:, [v, v, 3 + v, 3 + v]]
    return faces


def _outline(low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    points = low + corners * (high - low)
    edges = [(a, b) for a in range(8) for b in range(a) if (corners[a] != corners[b]).sum() == 1]
    return [_to_plot(points[list(edge)]) for edge in edges]


def top_speed(recording: Recording) -> float:
    """The speed with the brightest colour, m/s."""
    return max(float(np.quantile(recording.speeds(f), 0.98)) for f in recording.key_frames) or 1.0


def draw(recording: Recording, frame: int) -> np.ndarray:
    """One key frame as an image (pixels, pixels, 4), coloured by speed, with a transparent background."""
    boxes = np.asarray(recording.boxes[frame], dtype=float)
    scale = Normalize(0, top_speed(recording))
    colours = plt.get_cmap(COLOUR_MAP)(scale(recording.speeds(frame)))
    figure = Figure(figsize=(INCHES, INCHES), dpi=DOTS)
    axes = figure.add_axes((-0.05, -0.05, 1.1, 1.1), projection="3d", computed_zorder=False)
    faces = np.concatenate([_to_plot(_faces(boxes, axis)) for axis in range(3)])
    shaded = np.concatenate([colours * [*[LIGHT[axis]] * 3, 1] for axis in range(3)])
    edges = np.concatenate([colours * [EDGES, EDGES, EDGES, 1]] * 3)
    axes.add_collection3d(
        Poly3DCollection(faces, facecolors=shaded, edgecolors=edges, linewidths=0.25, zorder=2)
    )
    axes.add_collection3d(
        Line3DCollection(
            _outline(recording.low, recording.high), colors="#8b8f98", linewidths=0.6, zorder=1
        )
    )
    low, high = _to_plot(recording.low), _to_plot(recording.high)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low)
    axes.view_init(elev=22, azim=35)
    axes.set_axis_off()
    figure.patch.set_alpha(0)
    axes.patch.set_alpha(0)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba()).copy()


def png(image: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    plt.imsave(buffer, image, format="png", metadata={"Software": None})
    return buffer.getvalue()
