"""The drop test of a foot: a leg's mass falls on the floor, without gravity, and shows the pad's numbers."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from sprintlab.robots import DropOutcome, FootContact, drop_outcome, set_foot_contact
from sprintlab.robots.foot import add_foot_pair, contact_angle

DROP_SPEEDS = (2.0, 4.0)
"""Speeds of the drop test [m/s]."""


def expected_drop(foot: FootContact, mass: float, speed: float) -> DropOutcome:
    """The drop test in closed form, for any engine to be held against (no gravity, exact integration).

    Args:
        foot: the pad.
        mass: that falls [kg].
        speed: of the fall [m/s].
    """
    ratio, frequency = foot.damping_ratio, math.sqrt(foot.stiffness / mass)
    root = math.sqrt(1.0 - ratio**2)
    return DropOutcome(
        stiffness=foot.stiffness,
        restitution=foot.restitution,
        deflection=speed / frequency * math.exp(-ratio / root * math.atan2(root, ratio)),
        contact_time=contact_angle(ratio) / (frequency * root),
    )


def drop_model(foot: FootContact, mass: float, timestep: float) -> mujoco.MjModel:
    """A ball of ``mass`` [kg] with a foot's contact on a floor, without gravity, radius 0.03 m."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = timestep, (0.0, 0.0, 0.0)
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 0.05))
    ball = spec.worldbody.add_body(name="ball", pos=(0, 0, 0.03), mass=mass, inertia=(1e-3, 1e-3, 1e-3))
    ball.explicitinertial, ball.ipos = True, (0.0, 0.0, 0.0)
    ball.add_freejoint(name="fall")
    ball.add_geom(name="foot", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(0.03, 0, 0))
    add_foot_pair(spec, "foot", 0.8)
    model = spec.compile()
    set_foot_contact(model, foot, mass)
    return model


def drop_test(
    foot: FootContact, mass: float, speed: float, timestep: float, phase: float = 0.5
) -> DropOutcome:
    """Drop ``mass`` on the floor in MuJoCo C, without gravity.

    Args:
        foot: the pad.
        mass: [kg].
        speed: [m/s].
        timestep: [s].
        phase: of a time step between start and touchdown, 0 to 1.
    """
    model = drop_model(foot, mass, timestep)
    data = mujoco.MjData(model)
    data.qpos[2] += phase * timestep * speed
    data.qvel[2] = -speed
    contact = expected_drop(foot, mass, speed).contact_time
    course = []
    for _ in range(int(3.0 * contact / timestep) + 8):
        mujoco.mj_forward(model, data)
        course.append((0.03 - data.qpos[2], data.qvel[2], mass * data.qacc[2]))
        mujoco.mj_step(model, data)
    return drop_outcome(timestep, *np.array(course).T)
