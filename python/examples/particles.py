"""A Lennard-Jones fluid whose neighbours within a cut-off come from a BroadPhase.

python particles.py [PICTURE]
"""

import sys

import matplotlib
import numpy as np

import broadcl

matplotlib.use("Agg")
import matplotlib.pyplot as plt

CUT_OFF = 2.5  # in diameters
WALL = 14.0
STEP = 0.004


def neighbours(broad_phase: broadcl.BroadPhase, positions: np.ndarray) -> tuple[np.ndarray, broadcl.Delta]:
    """Pairs of particles that are at most CUT_OFF apart. Their cubes of that size overlap, and those of some others."""
    boxes = broad_phase.map(len(positions))
    boxes[:, :3] = positions - CUT_OFF / 2
    boxes[:, 3:] = positions + CUT_OFF / 2
    delta = broad_phase.update()
    pairs = broad_phase.pairs()
    apart = positions[pairs[:, 0]] - positions[pairs[:, 1]]
    return pairs[(apart**2).sum(axis=1) <= CUT_OFF**2], delta


def forces(positions: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    apart = positions[pairs[:, 0]] - positions[pairs[:, 1]]
    inverse = 1 / (apart**2).sum(axis=1, keepdims=True)
    push = 24 * inverse**4 * (2 * inverse**3 - 1) * apart
    total = np.empty_like(positions)
    for axis in range(3):
        total[:, axis] = np.bincount(pairs[:, 0], push[:, axis], len(positions))
        total[:, axis] -= np.bincount(pairs[:, 1], push[:, axis], len(positions))
    return total


random = np.random.default_rng(1)
grid = np.stack(np.meshgrid(*[np.arange(0.6, WALL, 1.2)] * 3), axis=-1).reshape(-1, 3)
positions = grid[random.random(len(grid)) < 0.6]
velocities = random.normal(0, 0.9, positions.shape)

broad_phase = broadcl.BroadPhase()
pairs, _ = neighbours(broad_phase, positions)
added, removed, kept = [], [], []
force = forces(positions, pairs)
for step in range(400):
    velocities += STEP / 2 * force
    positions += STEP * velocities
    outside = (positions < 0) | (positions > WALL)
    velocities[outside] *= -1
    positions = np.clip(positions, 0, WALL)
    pairs, delta = neighbours(broad_phase, positions)
    force = forces(positions, pairs)
    velocities += STEP / 2 * force
    velocities *= 0.999  # cools down
    added.append(len(delta.added))
    removed.append(len(delta.removed))
    kept.append(len(pairs))
print(f"{len(positions):,} particles, {kept[-1]:,} neighbours, on average {np.mean(added):.0f} pairs of cubes more and "
      f"{np.mean(removed):.0f} fewer per step")

figure, (left, right) = plt.subplots(1, 2, figsize=(9.5, 4.5), layout="constrained")
count = np.bincount(pairs.reshape(-1), minlength=len(positions))
slice_ = np.abs(positions[:, 2] - WALL / 2) < 1.2
inside = slice_[pairs].all(axis=1)
near = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1) < 1.4
for a, b in pairs[inside & near]:
    left.plot(*positions[[a, b], :2].T, color="0.7", linewidth=1, zorder=1)
dots = left.scatter(*positions[slice_, :2].T, c=count[slice_], s=90, cmap="viridis", zorder=2)
left.set(aspect="equal", xlim=(-0.5, WALL + 0.5), ylim=(-0.5, WALL + 0.5), xticks=[], yticks=[],
         title=f"Slice of a box with {len(positions):,} particles;\nlines join those at most 1.4 diameters apart")
figure.colorbar(dots, ax=left, label=f"neighbours within {CUT_OFF} diameters")
right.plot(added, label="pairs of cubes that start overlapping")
right.plot(removed, label="pairs that stop overlapping")
right.set(xlabel="step", ylim=(0, None), ylabel="pairs",
          title="What update() returns in each step:\nonly the changes")
right.legend()
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "particles.png", dpi=110)
