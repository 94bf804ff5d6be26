"""Figure 1: four key frames of each recorded scenario."""

from __future__ import annotations

import base64
import io

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from study.recording import Recording

COLOUR_MAP = "viridis"
DOTS = 120  # per inch
INCHES = 2.6


def top_speed(recording: Recording) -> float:
    """The speed with the brightest colour, m/s."""
    return max(float(np.quantile(recording.speeds(f), 0.98)) for f in recording.key_frames) or 1.0


def draw(recording: Recording, frame: int) -> np.ndarray:
    """One key frame as an image (pixels, pixels, 4), coloured by speed, with a transparent background."""
    # From the simulation's axes, y up, to matplotlib's, z up.
    axes_order = [2, 0, 1]
    boxes = np.asarray(recording.boxes[frame], dtype=float)
    low, size = boxes[:, axes_order], (boxes[:, 3:] - boxes[:, :3])[:, axes_order]
    world_low, world_high = recording.low[axes_order], recording.high[axes_order]
    colours = plt.get_cmap(COLOUR_MAP)(recording.speeds(frame) / top_speed(recording))
    figure = Figure(figsize=(INCHES, INCHES), dpi=DOTS)
    figure.patch.set_alpha(0)
    axes = figure.add_axes((-0.05, -0.05, 1.1, 1.1), projection="3d")
    axes.bar3d(*low.T, *size.T, color=colours, edgecolor=(0, 0, 0, 0.35), linewidth=0.2)
    limits = dict(zip(("xlim", "ylim", "zlim"), zip(world_low, world_high)))
    axes.set(**limits, xticks=[], yticks=[], zticks=[], facecolor="none")
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((0.5, 0.5, 0.5, 0.08))
        axis.line.set_color("#8b8f98")
    axes.set_box_aspect(world_high - world_low)
    axes.view_init(elev=22, azim=35)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba()).copy()


def data_url(image: np.ndarray) -> str:
    buffer = io.BytesIO()
    plt.imsave(buffer, image, format="png", metadata={"Software": None})
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
