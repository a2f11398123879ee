"""The pad's law in the engine's steps against the exact solution of a mass on it; landings of robots."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from benchmarks.engine_accuracy import CASES, rebounds
from tests.engine.pads import slide

from sprintlab.engine import Engine, EngineOptions
from sprintlab.robots import FootContact, load_robot
from sprintlab.robots.foot import contact_angle

MASS, FRICTION = 1.6, 0.9
SPEEDS = (1.0, 2.0, 4.0, 8.0)
PADS = [(k, e) for k in (40e3, 80e3, 160e3) for e in (0.2, 0.4, 0.6)]
PHASES = (np.arange(8) + 0.5) / 8


def landings(pad: tuple[float, float], velocity: tuple[float, float, float], step: float) -> list[tuple]:
    """Velocity after, and log of each step, of masses that touch down anywhere between two steps."""
    foot = FootContact(stiffness=pad[0], restitution=pad[1])
    law = {"k": foot.stiffness, "b": foot.damping(MASS), "drag": foot.tangential_damping(MASS)}
    return [
        slide(
            mass=MASS, mu=FRICTION, step=step, velocity=velocity, phase=phase, steps=round(0.06 / step), **law
        )
        for phase in PHASES
    ]


def exact_peak(pad: tuple[float, float], speed: float, step: float) -> float:
    """Greatest mean force over one step of the closed-form landing [N]."""
    foot = FootContact(stiffness=pad[0], restitution=pad[1])
    ratio, omega = foot.damping_ratio, math.sqrt(pad[0] / MASS)
    damped = omega * math.sqrt(1.0 - ratio**2)
    time = np.linspace(0.0, contact_angle(ratio) / damped, 4001)
    depth = speed / damped * np.exp(-ratio * omega * time) * np.sin(damped * time)
    force = pad[0] * depth + foot.damping(MASS) * np.gradient(depth, time)
    width = max(round(step / time[1]), 1)
    return float(np.convolve(force, np.ones(width) / width, "valid").max())


@pytest.mark.parametrize("step", [0.001, 0.0005])
@pytest.mark.parametrize("sideways", [0.0, 6.0])
def test_force_and_rebound_are_the_exact_ones(step: float, sideways: float) -> None:
    """Vertical and sliding, 1 to 8 m/s, over the band of stiffness and restitution: 3 %."""
    for pad in PADS:
        for speed in SPEEDS:
            results = landings(pad, (sideways, 0.0, -speed), step)
            rebounds = [after[2] / speed for after, _ in results]
            assert np.allclose(rebounds, pad[1], rtol=0.03)
            peak = max(log[:, 2].max() for _, log in results)
            assert peak == pytest.approx(exact_peak(pad, speed, step), rel=0.03)


def test_a_sliding_foot_loses_what_friction_takes() -> None:
    """Sliding all along: ``mu (1 + e) v``."""
    for pad in PADS:
        for speed in (1.0, 2.0):
            for after, _ in landings(pad, (0.0, 6.0, -speed), 0.001):
                lost = FRICTION * (1.0 + pad[1]) * speed
                assert after[1] == pytest.approx(6.0 - lost, abs=0.03 * lost)


def test_where_a_slip_ends_the_step_hardly_matters() -> None:
    """3 % of the landing's speed, mean over the pads: a foot that has gripped springs back as it lets go."""
    for velocity in ((6.0, 0.0, -8.0), (1.0, 1.0, -3.0)):
        errors = []
        for pad in PADS:
            coarse, fine = (
                np.mean([after for after, _ in landings(pad, velocity, step)], axis=0)
                for step in (0.0005, 1e-5)
            )
            errors.append(np.abs(coarse - fine).max() / np.linalg.norm(velocity))
        assert np.mean(errors) < 0.03


def test_friction_stays_inside_of_the_cone() -> None:
    for pad in PADS:
        for velocity in ((6.0, 0.0, -3.0), (2.0, 1.0, -8.0), (0.1, 0.0, -1.0)):
            for _, log in landings(pad, velocity, 0.001):
                assert (np.hypot(log[:, 0], log[:, 1]) <= FRICTION * log[:, 2] * (1.0 + 1e-6) + 1e-9).all()


@pytest.mark.parametrize("name", ["bp2", "go1"])
def test_feet_of_landing_robots_keep_to_the_cone(name: str) -> None:
    """At 3 m/s down, still and at 6 m/s along: beyond the cone by less than 5 % of the landing's peak."""
    n, step = 32, 0.0005
    for along in (0.0, 6.0):
        engine = Engine(load_robot(name), EngineOptions(robots=n, timestep=step, substeps=1), "cpu")
        engine.qpos[:, 2] += torch.linspace(0.001, 0.01, n)
        engine.qvel[:, 2], engine.qvel[:, 0] = -3.0, along
        engine.draw_pads(torch.linspace(40e3, 160e3, n), torch.linspace(0.6, 0.2, n))
        beyond, peak = torch.zeros(n, 4), torch.zeros(n, 4)
        for _ in range(60):
            engine.step()
            normal = engine.contact_force[..., 2]
            slip = engine.contact_force[..., :2].norm(dim=-1)
            beyond = torch.maximum(beyond, slip - engine.friction[:, None] * normal)
            peak = torch.maximum(peak, normal)
        assert (beyond < 0.05 * engine.friction[:, None] * peak).all()


def test_a_robot_on_a_slope_below_the_friction_angle_does_not_creep() -> None:
    engine = Engine(load_robot("bp2"), EngineOptions(robots=2, timestep=0.001, substeps=20), "cpu")
    engine.tilt(torch.tensor([0.0, 0.05]))
    for _ in range(100):
        engine.step()
    before = engine.foot_position.clone()
    for _ in range(100):
        engine.step()
    assert (engine.foot_position - before).abs().max() < 5e-4


@pytest.mark.parametrize("case", list(CASES))
def test_an_articulated_leg_rebounds_as_with_fine_steps(case: str) -> None:
    """2 and 4 m/s, over the band of stiffness and restitution: 10 %, with the default step."""
    assert rebounds(0.0005, *CASES[case])["deviation from fine steps"] < 0.1
