"""What is planned, and in which order."""

from __future__ import annotations

import json
from dataclasses import asdict

import pytest

from study.plan import BULLETS, PAPER, PRESETS, Plan, StudyError, plan_of

QUICK_PLAN, PAPER_PLAN = PRESETS["quick"][1], PRESETS["paper"][1]


def test_the_papers_set_up() -> None:
    frames = {(r.scenario, r.objects, r.broadphase, r.repeat): r.frames for r in PAPER_PLAN.runs()}
    assert len(frames) == len(PAPER_PLAN.runs())
    for scenario in PAPER:
        for broadphase in (*BULLETS, "gpu-bf", "auto"):
            assert [frames[scenario, 1250, broadphase, k] for k in range(1, 6)] == [2048] * 5
        for objects in (500, 2000, 2750, 3500):
            for broadphase in (*BULLETS[1:], "gpu-bf", "auto", "auto+culling"):
                assert [frames[scenario, objects, broadphase, k] for k in range(1, 6)] == [512] * 5
        beyond = {key[1:]: n for key, n in frames.items() if key[0] == scenario and key[2] == "bullet-bf" and key[1] > 1250}
        assert beyond == {(3500, "bullet-bf", 1): 64}
        assert {key[1] for key in frames if key[2] == "tiles"} == {1250, 3500}


def test_a_part_has_its_own_runs_with_the_frames_of_the_longest_part() -> None:
    part = PAPER_PLAN.runs("figure-6")
    assert {r.broadphase for r in part} == {"bullet-sap", "bullet-bvh", "gpu-bf", "auto", "auto+culling"}
    assert {r.frames for r in part if r.objects == 1250 and r.broadphase == "auto"} == {2048}


def test_the_order_is_random_by_repeat_and_depends_on_the_seed_alone() -> None:
    runs = QUICK_PLAN.runs()
    order = QUICK_PLAN.in_order(runs)
    assert [r.repeat for r in order] == sorted(r.repeat for r in runs)
    assert order == QUICK_PLAN.in_order(runs[::-1])
    assert sorted(order) == sorted(plan_of("quick", 2, "").in_order(runs)) and order != plan_of("quick", 2, "").in_order(runs)
    first = [r for r in order if r.repeat == 1]
    assert first != sorted(first)


def test_options_replace_what_each_part_has() -> None:
    plan = plan_of("paper", 7, "cpu", objects=(9,), frames=3, repeat=1, broadphases=("tiles",))
    assert len(plan.runs()) == 4 and {(r.objects, r.frames) for r in plan.runs()} == {(9, 3)}
    assert (plan.seed, plan.device) == (7, "cpu")
    with pytest.raises(StudyError, match="no preset is named 'slow'; the presets are: quick, paper"):
        plan_of("slow", 1, "")


def test_json_and_back() -> None:
    text = json.dumps(asdict(PAPER_PLAN))
    assert Plan.from_json(json.loads(text)) == PAPER_PLAN
    with pytest.raises(ValueError):
        Plan.from_json(json.loads(text.replace("free-fall", "../x")))
