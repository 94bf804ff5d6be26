"""What a study measures, and in which order. Needs nothing but Python."""

from __future__ import annotations

import itertools
import random
import re
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

PAPER = ("free-fall", "agitated", "rolling-gravity", "mixed-sizes")  # Figures 2 to 5, in this order
PAPER_OBJECTS = 1250  # in Figures 2 to 5
RECORDINGS = "recordings"  # beside the parts of a plan: runs for the replay, which are not measured
BULLETS = ("bullet-bf", "bullet-sap", "bullet-bvh")
ALL = (*BULLETS, "gpu-bf", "brute-force", "tiles", "auto", "auto+culling")


class StudyError(Exception):
    """One line that says what is wrong and what to do about it."""


def listed(items: list[str]) -> str:
    """Returns "a, b and c"."""
    return " and ".join(filter(None, (", ".join(items[:-1]), items[-1])))


@dataclass(frozen=True)
class Part:
    """Each combination of scenario, number of objects and broad phase runs `repeat` times."""

    name: str
    scenarios: tuple[str, ...]
    objects: tuple[int, ...]
    broadphases: tuple[str, ...]
    frames: int  # per run; frame 0 is the warm-up
    repeat: int


class Run(NamedTuple):
    """One simulation. Its name is that of its file."""

    scenario: str
    objects: int
    broadphase: str
    repeat: int  # from 1
    frames: int

    @property
    def name(self) -> str:
        return f"{self.scenario}-{self.objects}-{self.broadphase}-{self.repeat}"


@dataclass(frozen=True)
class Plan:
    preset: str
    parts: tuple[Part, ...]
    seed: int = 1  # of the simulations and of the order of the runs
    device: str = ""  # as `broadcl simulate --device` takes it

    @property
    def scenarios(self) -> list[str]:
        return list(dict.fromkeys(s for part in self.parts for s in part.scenarios))

    @property
    def objects(self) -> list[int]:
        return sorted({n for part in self.parts for n in part.objects})

    @property
    def broadphases(self) -> list[str]:
        """In the order of the page."""
        names = {b for part in self.parts for b in part.broadphases}
        return sorted(names, key=lambda b: (ALL.index(b) if b in ALL else len(ALL), b))

    def runs(self, part: str | None = None) -> list[Run]:
        """All runs, or those of one part. A run of several parts has the frames of the longest."""
        longest: dict[tuple[str, int, str, int], int] = {}
        wanted = set()
        for each in self.parts:
            for key in itertools.product(each.scenarios, each.objects, each.broadphases, range(1, each.repeat + 1)):
                longest[key] = max(each.frames, longest.get(key, 0))
                if part in (None, each.name):
                    wanted.add(key)
        return [Run(*key, frames) for key, frames in longest.items() if key in wanted]

    def in_order(self, runs: list[Run]) -> list[Run]:
        """First all first repeats, then all second ones, ...; at random within each, so that a drift in the
        machine's speed favours nobody, and that an unfinished study has everything equally often."""
        shuffled = sorted(runs)
        random.Random(self.seed).shuffle(shuffled)
        return sorted(shuffled, key=lambda run: run.repeat)

    @staticmethod
    def from_json(data: dict[str, Any]) -> Plan:
        parts = tuple(Part(**{k: tuple(v) if isinstance(v, list) else v for k, v in p.items()}) for p in data["parts"])
        names = [name for part in parts for name in (*part.scenarios, *part.broadphases)]
        numbers = [n for part in parts for n in (*part.objects, part.frames, part.repeat)]
        if not parts or not all(re.fullmatch("[a-z0-9+-]+", name) for name in names) or min(numbers) < 1:
            raise ValueError("no plan")  # names become parts of paths
        return Plan(data["preset"], parts, data["seed"], data["device"])


# fmt: off
PRESETS = {plan.preset: (summary, plan) for summary, plan in (
    ("500 and 1,250 objects, 48 frames; takes about two minutes on two cores", Plan("quick", (
        Part("all", (*PAPER, "streaming"), (500, 1250), ALL, 48, 3),
    ))),
    ("Figures 2 to 6 of Serpa and Rodrigues 2014; takes many hours", Plan("paper", (
        Part("figures-2-5", PAPER, (PAPER_OBJECTS,), (*BULLETS, "gpu-bf", "auto"), 2048, 5),
        Part("figure-6", PAPER, (500, 1250, 2000, 2750, 3500), (*BULLETS[1:], "gpu-bf", "auto", "auto+culling"), 512, 5),
        Part("bullet-bf", PAPER, (500, 1250), BULLETS[:1], 512, 5),  # with more objects it takes 0.1 to 0.2 s per frame
        Part("bullet-bf-3500", PAPER, (3500,), BULLETS[:1], 64, 1),
        Part("algorithms", PAPER, (1250, 3500), ("brute-force", "tiles"), 512, 5),
    ))),
)}
# fmt: on


def plan_of(preset: str, seed: int, device: str, **replaced: Any) -> Plan:
    """A preset, each part of which has these scenarios, objects, broadphases, frames and repeat instead if they are not None."""
    if preset not in PRESETS:
        raise StudyError(f"no preset is named '{preset}'; the presets are: {', '.join(PRESETS)}")
    given = {name: value for name, value in replaced.items() if value is not None}
    plan = PRESETS[preset][1]
    return replace(plan, parts=tuple(replace(part, **given) for part in plan.parts), seed=seed, device=device)
