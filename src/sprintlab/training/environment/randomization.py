"""What differs from robot to robot, drawn once: functions ``(Fleet, parameters by name)``, and a run's list.

PyTorch is not imported here, so that settings, which name these functions, can be read at once. ``between``
are the ends of what is drawn uniformly.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sprintlab.core.constants import GRAVITY
from sprintlab.robots import DRAG_AREA_BAND, RESTITUTION_BAND, STIFFNESS_BAND
from sprintlab.training.terms import RandomizationTerm, drawn

if TYPE_CHECKING:
    from sprintlab.training.environment.fleet import Fleet

Interval = tuple[float, float]


def friction(fleet: Fleet, *, between: Interval) -> None:
    """Friction coefficient of the feet."""
    fleet.engine.friction.copy_(fleet.uniform(*between))


def feet(fleet: Fleet, *, stiffness: Interval, restitution: Interval) -> None:
    """The pads: stiffness [N/m], its logarithm uniform; restitution in a drop of the leg's effective mass."""
    softest, stiffest = stiffness
    drawn = fleet.uniform(math.log(softest), math.log(stiffest)).exp()
    fleet.engine.draw_pads(drawn, fleet.uniform(*restitution))


def clock(fleet: Fleet, *, between: Interval) -> None:
    """Factor of the policy's period: gaits that count policy steps do not fit all robots."""
    fleet.engine.timestep.mul_(fleet.uniform(*between))


def drag_area(fleet: Fleet, *, between: Interval) -> None:
    """Drag coefficient times frontal area of the robot in still air [m^2]."""
    fleet.engine.drag_area.copy_(fleet.uniform(*between))


def payload(fleet: Fleet, *, mass: Interval) -> None:
    """Mass added to the trunk [kg]."""
    added = fleet.uniform(*mass)
    fleet.engine.trunk_mass.add_(added)
    fleet.engine.weight.add_(GRAVITY * added)


def center_of_mass(fleet: Fleet, *, distance: float) -> None:
    """Shift of the trunk's centre of mass along each axis, either way [m]."""
    fleet.engine.trunk_center.add_(fleet.uniform(-distance, distance, 3))


def gains(fleet: Fleet, *, between: Interval) -> None:
    """Factors of each joint's stiffness and damping."""
    for gain in (fleet.engine.stiffness, fleet.engine.damping):
        gain.mul_(fleet.uniform(*between, gain.shape[1]))


def strength(fleet: Fleet, *, between: Interval, joints: float) -> None:
    """Factor of the torque that each motor delivers: the robot's own, times each joint's, 1 +- ``joints``."""
    factors = fleet.engine.strength
    factors.copy_(
        fleet.uniform(*between)[:, None] * fleet.uniform(1.0 - joints, 1.0 + joints, factors.shape[1])
    )


def bus_voltage(fleet: Fleet, *, between: Interval) -> None:
    """Factor of the bus voltage."""
    fleet.engine.voltage.mul_(fleet.uniform(*between))


def winding_resistance(fleet: Fleet, *, between: Interval) -> None:
    """Factor of the stator resistance: a warm winding has more."""
    fleet.engine.resistance_factor.copy_(fleet.uniform(*between))


def dry_friction(fleet: Fleet, *, between: Interval) -> None:
    """Factor of the joints' dry friction."""
    fleet.engine.friction_factor.copy_(fleet.uniform(*between))


def slope(fleet: Fleet, *, between: Interval) -> None:
    """Rise over run of the ground along x; gravity turns, the ground stays."""
    fleet.slope.copy_(fleet.uniform(*between).atan())
    fleet.engine.tilt(fleet.slope)


def delay(fleet: Fleet, *, between: Interval, jitter: float) -> None:
    """Time from the policy's reading to the joints' new targets [s], in whole physics steps.

    ``jitter`` is by how much that time changes from one policy step to the next, either way [s]: gaits must
    not live on the policy's clock.
    """
    step = fleet.engine.options.timestep
    fleet.delay.copy_(fleet.uniform(*between) / step)
    fleet.delay_jitter = jitter / step


def joint_offset(fleet: Fleet, *, between: Interval) -> None:
    """Error of each encoder's zero [rad]: what it says is too high, and what it is driven to too low."""
    fleet.joint_offset.copy_(fleet.uniform(*between, fleet.joint_offset.shape[1]))


def default_randomization() -> dict[str, RandomizationTerm]:
    """The list of a run, a line a term, in the order in which they are drawn."""
    return {
        "friction": drawn(friction, between=(0.5, 1.2)),
        "feet": drawn(feet, stiffness=STIFFNESS_BAND, restitution=RESTITUTION_BAND),
        "clock": drawn(clock, between=(0.9, 1.1)),
        "drag_area": drawn(drag_area, between=DRAG_AREA_BAND),
        "payload": drawn(payload, mass=(-1.0, 4.0)),
        "center_of_mass": drawn(center_of_mass, distance=0.03),
        "gains": drawn(gains, between=(0.92, 1.08)),
        "strength": drawn(strength, between=(0.9, 1.03), joints=0.03),
        "bus_voltage": drawn(bus_voltage, between=(0.9, 1.0)),
        "winding_resistance": drawn(winding_resistance, between=(1.0, 1.25)),
        "dry_friction": drawn(dry_friction, between=(0.7, 1.3)),
        "slope": drawn(slope, between=(-0.05, 0.05)),
        "delay": drawn(delay, between=(0.0, 0.0125), jitter=0.0025),
        "joint_offset": drawn(joint_offset, between=(-0.02, 0.02)),
    }
