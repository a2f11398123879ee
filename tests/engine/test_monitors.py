"""Monitors are the worst or the mean of what single steps show."""

from __future__ import annotations

import pytest
import torch
from tests.engine.test_engine import options, scattered

from sprintlab.engine import Engine
from sprintlab.robots import load_robot

GREATEST = ("gear_torque", "joint_speed", "stop_depth", "foot_force", "pad_deflection")
MEANS = ("power", "limit_share", "stance")


@pytest.fixture(scope="module")
def watched() -> tuple[Engine, list[dict[str, torch.Tensor]]]:
    """A policy step of 20 ms in which robots land, and the same in twenty steps of 1 ms."""
    whole, single = (Engine(load_robot("bp2"), options(16, count), "cpu") for count in (20, 1))
    for engine in (whole, single):
        scattered(engine, 0.42, speed=2.0)
    for _ in range(2):
        whole.step()
        seen = []
        for _ in range(20):
            single.step()
            names = (*GREATEST, *MEANS, "leg_distance", "contact_force", "touchdowns")
            seen.append({name: getattr(single, name).clone() for name in names})
    return whole, seen


def test_a_policy_step_shows_the_worst_of_its_steps(watched: tuple[Engine, list[dict]]) -> None:
    whole, seen = watched
    for name in GREATEST:
        worst = torch.stack([step[name] for step in seen]).amax(0)
        assert torch.allclose(getattr(whole, name), worst, rtol=1e-4, atol=1e-6), name
    nearest = torch.stack([step["leg_distance"] for step in seen]).amin(0)
    late = whole.leg_distance - nearest  # it looks every other millisecond
    assert late.min() > -1e-6 and late.median() < 1e-6 and late.max() < 0.02


def test_means_and_touchdowns_are_those_of_its_steps(watched: tuple[Engine, list[dict]]) -> None:
    whole, seen = watched
    for name in MEANS:
        mean = torch.stack([step[name] for step in seen]).mean(0)
        assert torch.allclose(getattr(whole, name), mean, rtol=1e-4, atol=1e-4), name
    assert torch.equal(whole.touchdowns, torch.stack([step["touchdowns"] for step in seen]).sum(0))
    assert (whole.stance > 0.0).any()


def test_a_foot_force_is_the_mean_over_five_milliseconds(watched: tuple[Engine, list[dict]]) -> None:
    whole, seen = watched
    force = torch.stack([step["contact_force"][..., 2] for step in seen]) / whole.weight[:, None]
    inside = torch.stack([force[start : start + 5].mean(0) for start in range(16)]).amax(0)
    assert (whole.foot_force >= inside - 1e-5).all()
