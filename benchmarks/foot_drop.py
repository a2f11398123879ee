"""The drop test of a foot: a leg's mass falls on its pad, without gravity, straight down or sliding along."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.plant.pad import PadLaw, Pads
from sprintlab.robots import FootContact
from sprintlab.robots.foot import contact_angle

FRICTION = 0.8
RADIUS = 0.03  # [m]


@dataclass(frozen=True, kw_only=True)
class Drop:
    """What a drop shows.

    Attributes:
        restitution: vertical speed after over before [-].
        deflection: greatest [m].
        peak_force: greatest normal force [N].
        slowed: by how much the sliding has slowed down [m/s].
    """

    restitution: float
    deflection: float
    peak_force: float
    slowed: float = 0.0


def exact_drop(foot: FootContact, mass: float, speed: float) -> Drop:
    """The solution of the equation of motion, for a mass that slides until it leaves the ground.

    ``x'' = -w^2 x - 2 z w x'`` from ``x = 0``, ``x' = v``: each derivative of ``exp(-z w t) sin(w_d t)``
    turns its phase by ``b = pi - acos(z)`` and multiplies it by ``w``.
    """
    ratio, frequency = foot.damping_ratio, math.sqrt(foot.stiffness / mass)
    root, turn = math.sqrt(1.0 - ratio**2), math.pi - math.acos(ratio)

    def swing(angle: float, derivatives: int) -> float:
        """Derivative of the deflection at ``w_d t = angle``."""
        size = speed * frequency ** (derivatives - 1) / root * math.exp(-ratio / root * angle)
        return size * math.sin(angle + derivatives * turn)

    deepest, hardest = math.pi - turn, max(2.0 * math.pi - 3.0 * turn, 0.0)
    return Drop(
        restitution=-swing(contact_angle(ratio), 1) / speed,
        deflection=swing(deepest, 0),
        peak_force=-mass * swing(hardest, 2),
        slowed=FRICTION * (1.0 + foot.restitution) * speed,
    )


def drop_model(mass: float, timestep: float) -> mujoco.MjModel:
    """A ball of ``mass`` [kg] that does not turn, without gravity and without contacts of the solver."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = timestep, (0.0, 0.0, 0.0)
    ball = spec.worldbody.add_body(name="ball", mass=mass, inertia=(1e6, 1e6, 1e6))
    ball.explicitinertial, ball.ipos = True, (0.0, 0.0, 0.0)
    ball.add_freejoint(name="fall")
    ball.add_geom(name="foot", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(RADIUS, 0, 0))
    return spec.compile()


Step = Callable[[mujoco.MjModel, mujoco.MjData], None]
"""From a state with forces to the next state."""


def drop_course(
    foot: FootContact,
    mass: float,
    velocity: tuple[float, float],
    timestep: float,
    phase: float = 0.5,
    step: Step = mujoco.mj_step2,
) -> FloatArray:
    """Rows ``(deflection, vx, vz, fx, fz, way slid)`` from before the touchdown to after the lift-off.

    Args:
        foot: the pad.
        mass: [kg].
        velocity: down and along [m/s].
        timestep: [s].
        phase: phase of a time step between start and touchdown, 0 to 1.
        step: step of the engine.
    """
    down, along = velocity
    model = drop_model(mass, timestep)
    data = mujoco.MjData(model)
    pads = Pads(model, data, ["foot"], PadLaw.of(foot, mass), FRICTION)
    data.qpos[2], data.qvel[0], data.qvel[2] = RADIUS + (1.0 + phase) * timestep * down, along, -down
    contact = contact_angle(foot.damping_ratio) * math.sqrt(mass / foot.stiffness)
    rows = []
    for _ in range(int(2.0 * contact / timestep) + 8):
        mujoco.mj_step1(model, data)
        pads.press()
        force = data.xfrc_applied[1]
        rows.append((RADIUS - data.qpos[2], data.qvel[0], data.qvel[2], force[0], force[2], pads.slid[0]))
        step(model, data)
    return np.array(rows)


def drop_test(
    foot: FootContact,
    mass: float,
    velocity: tuple[float, float],
    timestep: float,
    phase: float = 0.5,
    step: Step = mujoco.mj_step2,
) -> Drop:
    """The numbers of a drop; arguments as of ``drop_course``."""
    deflection, along, rising, _, force, _ = drop_course(foot, mass, velocity, timestep, phase, step).T
    return Drop(
        restitution=float(rising[-1] / velocity[0]),
        deflection=float(deflection.max()),
        peak_force=float(force.max()),
        slowed=float(velocity[1] - along[-1]),
    )
