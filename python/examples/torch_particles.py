"""Spheres that overlap are pushed apart by an optimiser of PyTorch. Their neighbours come from BroadCL, and nothing leaves the GPU.

python torch_particles.py [--device cuda] [--spheres N] [--steps N] [--verify]
"""

import argparse

import numpy as np
import torch

import broadcl

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--device", default="cuda", help="cuda, cuda:1 and so on")
parser.add_argument("--spheres", type=int, default=100_000)
parser.add_argument("--steps", type=int, default=60)
parser.add_argument("--verify", action="store_true", help="compare the first step's neighbours with those found on the host")
options = parser.parse_args()

DENSITY = 0.4  # the part of the container that the spheres fill

torch.manual_seed(1)
device = torch.device(options.device)
radii = torch.empty(options.spheres, device=device).uniform_(0.5, 1)
side = (4 / 3 * torch.pi * radii.pow(3).sum().item() / DENSITY) ** (1 / 3)  # of the container, a cube
positions = (side * torch.rand(options.spheres, 3, device=device)).requires_grad_()
optimiser = torch.optim.Adam([positions], lr=0.05)

broad_phase = broadcl.DeviceBroadPhase(device)
boxes = torch.from_dlpack(broad_phase.boxes(options.spheres))  # shared memory: what is written here is not copied


def neighbours() -> tuple[torch.Tensor, broadcl.DeviceDelta]:
    """Pairs of spheres whose boxes overlap, (m, 2) int32. Indices have no gradient, so PyTorch records nothing here."""
    with torch.no_grad():
        boxes[:, :3] = positions - radii[:, None]
        boxes[:, 3:] = positions + radii[:, None]
    delta = broad_phase.update(boxes)
    return torch.from_dlpack(broad_phase.pairs()), delta


def energy(pairs: torch.Tensor) -> torch.Tensor:
    """Half the sum of squared depths: how far two spheres overlap, and how far centres are outside of the container."""
    ends = positions[pairs]  # (m, 2, 3)
    distances = torch.linalg.vector_norm(ends[:, 0] - ends[:, 1], dim=1)
    depths = (radii[pairs].sum(dim=1) - distances).clamp(min=0)
    outside = positions - positions.detach().clamp(0, side)
    return (depths.square().sum() + outside.square().sum()) / 2


def verify(pairs: torch.Tensor) -> None:
    on_host = broadcl.overlapping_pairs(boxes.cpu().numpy())
    if not np.array_equal(pairs.cpu().numpy(), on_host):
        raise SystemExit(f"{len(pairs):,} pairs differ from the {len(on_host):,} that the host found")
    print(f"the host found the same {len(on_host):,} pairs")


for step in range(options.steps):
    pairs, delta = neighbours()
    if options.verify and step == 0:
        verify(pairs)
    total = energy(pairs)
    print(f"step {step:3}: energy {total.item():12.4f}, {len(pairs):,} pairs of boxes, {len(delta.added):,} of them new, "
          f"{len(delta.removed):,} gone")
    optimiser.zero_grad()
    total.backward()
    optimiser.step()
