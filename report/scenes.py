"""The section of the page that shows the scenes: Figure 1 and the replay."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from report.key_frames import COLOUR_MAP, png, top_speed
from report.markup import escaped
from report.recording import BUDGET, FRAME_SECONDS, Recording, replay_data


def figure_1(recordings: list[Recording], images: dict[str, list[np.ndarray]]) -> str:
    """The key frames as pictures; each is a button that moves the replay to its frame."""
    text = '<figure id="figure-1"><figcaption><b>Figure 1.</b> Four key frames of each scenario, coloured'
    text += " by speed. Click a picture to move the replay below to its frame.</figcaption>"
    text += '<div class="frames">'
    for recording in recordings:
        text += f"<h3>{escaped(recording.scenario)} <span>{recording.objects:,} objects; speed"
        text += f" from 0 (violet) to {top_speed(recording):.3g} m/s (yellow)</span></h3>"
        for frame, image in zip(recording.key_frames, images[recording.scenario]):
            data = base64.b64encode(png(image)).decode("ascii")
            seconds = f"{frame * FRAME_SECONDS:.1f}"
            text += (
                f'<button type="button" data-scenario="{escaped(recording.scenario)}"'
                f' data-key-frame="{frame}"><img src="data:image/png;base64,{data}"'
                f' width="{image.shape[1]}" height="{image.shape[0]}"'
                f' alt="{escaped(recording.scenario)} in frame {frame}">frame {frame} · {seconds} s</button>'
            )
    return text + "</div></figure>"


def recordings_data(recordings: list[Recording], budget: int = BUDGET) -> dict[str, Any]:
    """The data of the replay: the runs, in a budget of characters, and 256 colours as bytes."""
    ramp = np.rint(plt.get_cmap(COLOUR_MAP)(np.arange(256))[:, :3] * 255).astype(int)
    runs = [replay_data(r, budget // len(recordings)) for r in recordings]
    return {"runs": runs, "ramp": ramp.ravel().tolist()}


def scenes(recordings: list[Recording], images: dict[str, list[np.ndarray]]) -> str:
    """The section's content."""
    if not recordings:
        return '<p class="note">The study has no recordings, so there is nothing to show here.</p>'
    replay = Path(__file__).with_name("replay.html").read_text(encoding="utf-8")
    return figure_1(recordings, images) + "<h3>Replay</h3>" + replay
