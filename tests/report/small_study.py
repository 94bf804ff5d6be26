"""A small study in a folder, with times that are known."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np

SCENARIOS = ("free-fall", "mixed-sizes")
OBJECTS = (10, 20)
FRAMES = 6
REPEAT = 3
DEVICE = 'Some "GPU", 2nd / one <b>'
SLUG = "some-gpu-2nd-one-b"
# Milliseconds of a frame with 10 objects; twice as long with 20.
TIMES = {"bullet-bvh": (2.0, 0.5, 4.0), "tiles": (0.1, 0.4, 2.0), "auto": (0.1, 0.4, 2.001)}
HEADER = (
    "scenario,objects,frames,repeat,broadphase,device,update_mean_ms,update_median_ms,update_p95_ms,"
    "broad_phase_mean_ms,broad_phase_median_ms,broad_phase_p95_ms,total_mean_ms,total_median_ms,total_p95_ms,"
    "total_sum_ms,pairs_mean,pairs_last,first_frame_total_ms"
)


def _info() -> dict[str, object]:
    return {
        "format": 1,
        "preset": "small",
        "command": "broadcl study --preset small",
        "date": "2020-01-02T03:04:05Z",
        "versions": {"broadcl": "1.2.3", "bullet": "3.24"},
        "host": {"cpu": "A <CPU>", "threads": 2, "system": "A system"},
        "seed": 1,
        "repeat": REPEAT,
        "frames": FRAMES,
        "warm_up_frames": 1,
        "scenarios": SCENARIOS,
        "scenario_summaries": {s: f"what happens in {s}" for s in SCENARIOS},
        "objects": OBJECTS,
        "broadphases": [
            {
                "name": name,
                "summary": name,
                "exact": name != "bullet-bvh",
                "bullet": name == "bullet-bvh",
            }
            for name in (*TIMES, "gpu-bf")
        ],
        "devices": [{"label": DEVICE}],
        "cut": ["gpu-bf: would take 3 h"],
    }


def write(folder: Path) -> None:
    """Writes the study, with a recording of its first scenario; gpu-bf has no runs."""
    (folder / "runs").mkdir(parents=True)
    (folder / "recordings").mkdir()
    (folder / "study.json").write_text(json.dumps(_info()), encoding="utf-8")
    random = np.random.default_rng(7)
    rows = []
    for scenario in SCENARIOS:
        for objects in OBJECTS:
            for name, times in TIMES.items():
                for repeat in range(1, REPEAT + 1):
                    # Repeats differ by a thousandth, so that auto and tiles cannot be told apart.
                    noise = 1 + 0.001 * (repeat - 2)
                    table = np.tile(np.array(times) * objects / 10 * noise, (FRAMES, 1))
                    table = np.column_stack([np.arange(FRAMES), table, np.arange(FRAMES) * objects])
                    device = "" if name == "bullet-bvh" else DEVICE
                    run = f"{scenario}-{objects}-{name}{'-' + SLUG if device else ''}-{repeat}.csv"
                    lines = ["frame,update_ms,broad_phase_ms,total_ms,pairs"]
                    lines += [
                        f"{r[0]:.0f},{r[1]:.6f},{r[2]:.6f},{r[3]:.6f},{r[4]:.0f}" for r in table
                    ]
                    (folder / "runs" / run).write_text("\n".join(lines) + "\n", encoding="utf-8")
                    counted = table[1:]
                    row: list[object] = [scenario, objects, FRAMES, repeat, name, device]
                    for column in (1, 2, 3):
                        times_of = counted[:, column]
                        summary = times_of.mean(), np.median(times_of), times_of.max()
                        row += [f"{x:.6f}" for x in summary]
                    row += [counted[:, 3].sum(), counted[:, 4].mean(), counted[-1, 4], table[0, 3]]
                    rows.append(row)
    with (folder / "study.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([HEADER.split(","), *rows])
    low = random.uniform(-3, 3, (1, 10, 3)) + random.uniform(0, 0.2, (FRAMES, 10, 3)).cumsum(axis=0)
    np.save(
        folder / "recordings" / "free-fall.npy",
        np.concatenate([low, low + 1], axis=2).astype(np.float32),
    )
