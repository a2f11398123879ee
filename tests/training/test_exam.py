"""The exam of a training: what it measures, and that it changes nothing but the choice of the policy."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tests.training.small import networks, small_settings

from sprintlab.evaluation.audit import CHECKS, TOLERANCE
from sprintlab.evaluation.results import REST_SPEED
from sprintlab.training import exam as exam_module
from sprintlab.training.exam import GROUPS, LIMITS, Exam, GroupResult
from sprintlab.training.learner.algorithm import build_actor
from sprintlab.training.runs.checkpoint import read_checkpoint
from sprintlab.training.runs.runner import BestExam, Runner
from sprintlab.training.settings import ExamSettings

SETTINGS = small_settings(exam=ExamSettings(interval=2))


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four robots per speed, and a run of two seconds."""
    torch.set_num_threads(1)
    monkeypatch.setattr(exam_module, "ROBOTS", 4)
    for name, value in {"HOLD": 0.6, "REST": 0.4, "STEADY": 0.4, "REST_WINDOW": 0.2}.items():
        monkeypatch.setattr(exam_module, name, value)


def group(**values: object) -> GroupResult:
    """A group that keeps all limits, but for the values given."""
    worst = {"foot_force": 3.0, "pad_deflection": 0.012, "gear_torque": 2.0, "joint_speed": 1.0,
             "leg_distance": 0.05, "stop_depth": 0.2}  # fmt: skip
    good = GroupResult(
        asked=10.0, held=9.8, fallen=0.0, at_rest=1.0, worst=worst, most=worst, load=(0.25,) * 4,
        duty=(0.2,) * 4, cost=0.9,
    )  # fmt: skip
    return replace(good, **values)  # type: ignore[arg-type]


def test_the_limits_are_those_of_the_audit() -> None:
    limits = {check.name: check.limit for check in CHECKS}
    named = {
        "foot_force": limits["foot force"],
        "pad_deflection": limits["pad deflection"],
        "gear_torque": limits["gear torque"],
        "joint_speed": limits["joint speed"],
        "leg_distance": limits["smallest leg distance"],
    }
    assert named == LIMITS and exam_module.TOLERANCE == TOLERANCE
    assert exam_module.REST_SPEED == REST_SPEED
    others = exam_module.LOAD_SHARE, exam_module.DUTY_FACTOR, exam_module.COMMAND_SHARE
    names = "least load on a foot", "least duty factor of a foot", "held share of the command"
    assert others == tuple(limits[name] for name in names)


def test_what_fails_a_group() -> None:
    wrong = {"fallen": 0.2, "at_rest": 0.5, "held": 7.9, "load": (0.09, 0.3, 0.3, 0.31), "duty": (0.04,) * 4}
    assert group().failed == []
    assert {name: group(**{name: value}).failed for name, value in wrong.items()} == {n: [n] for n in wrong}


@pytest.mark.parametrize("name", LIMITS)
def test_the_median_keeps_a_limit_and_nine_of_ten_nearly(name: str) -> None:
    limit, sign = LIMITS[name], -1.0 if name == "leg_distance" else 1.0
    worse = limit + sign * 0.01
    nearly, far = (limit + sign * share * abs(limit) for share in (0.14, 0.16))
    good = group().worst
    assert group(worst={**good, name: worse}).failed == [name]
    assert group(most={**good, name: nearly}).failed == []
    assert group(most={**good, name: far if limit else worse}).failed == [name]


def test_robots_that_stand_are_measured_as_standing() -> None:
    """A policy without weights gives the default pose: it holds nothing, and presses as its weight does."""
    actor = build_actor(SETTINGS, Runner(SETTINGS, "cpu", "test").environment.robot)
    with torch.no_grad():
        for parameter in actor.policy.parameters():
            parameter.zero_()
    result = Exam(SETTINGS, "cpu", actor).run(2.0)
    assert [g.asked for g in result.groups.values()] == pytest.approx(
        [2.0 * share for share in GROUPS.values()]
    )
    for found in result.groups.values():
        assert (found.fallen, found.at_rest) == (0.0, 1.0) and abs(found.held) < 0.05
        assert found.failed == ["held"]
        assert sum(found.load) == pytest.approx(1.0) and min(found.load) > 0.1
        assert found.duty == pytest.approx((1.0,) * 4)
        assert 0.2 < found.worst["foot_force"] < 1.0 and found.worst["leg_distance"] > 0.1
    assert result.path.shape == (80 + 45, 23) and all(map(math.isfinite, result.row().values()))


def test_one_seed_gives_one_network_with_exams_or_without() -> None:
    """The same networks bit for bit, and the same numbers of the exams."""

    def trained(exam: ExamSettings | None) -> tuple[Runner, list[dict[str, float]]]:
        runner = Runner(replace(SETTINGS, exam=exam), "cpu", "test")
        rows = [runner.iterate() for _ in range(4)]
        return runner, [{k: v for k, v in row.items() if k.startswith("exam/")} for row in rows]

    (first, exams), (second, others), (without, nothing) = map(trained, (SETTINGS.exam, SETTINGS.exam, None))
    for name, value in networks(first.learner).items():
        assert torch.equal(value, networks(second.learner)[name]), name
        assert torch.equal(value, networks(without.learner)[name]), name
    assert [bool(row) for row in exams] == [False, True, False, True] and not any(nothing)
    for row, other in zip(exams, others, strict=True):
        assert {**row, "exam/seconds": 0.0} == {**other, "exam/seconds": 0.0}


def test_the_best_exams_policy_is_kept_and_survives_a_checkpoint(tmp_path: Path) -> None:
    runner = Runner(SETTINGS, "cpu", "test")
    runner.iterate()
    kept = {name: value.clone() for name, value in runner.mean.items()}
    runner.best = BestExam(iteration=1, held=8.0, cost=1.0, policy=kept)
    runner.iterate()
    runner.save(tmp_path / "checkpoint.pt")
    state = read_checkpoint(tmp_path / "checkpoint.pt")
    resumed = Runner(SETTINGS, "cpu", "test")
    resumed.load(state)
    for name, value in kept.items():
        assert torch.equal(state["policy"][name], value) and torch.equal(resumed.chosen[name], value)
        assert torch.equal(resumed.mean[name], runner.mean[name])
    assert resumed.best is not None and resumed.best.held == 8.0


def test_faster_beats_and_as_fast_must_be_cheaper() -> None:
    best = BestExam(iteration=1, held=8.0, cost=1.0, policy={})
    assert best.beaten_by(8.1, 2.0) and best.beaten_by(8.02, 0.9)
    assert not best.beaten_by(8.02, 1.1) and not best.beaten_by(7.9, 0.5)
