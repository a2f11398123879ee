"""What is drawn for one sprint of a robustness study."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sprintlab.core.checks import check_choice, check_range
from sprintlab.evaluation.trial import TrialRequest
from sprintlab.plant import PlantOptions, TrialSettings
from sprintlab.robots import RESTITUTION_BAND, STIFFNESS_BAND, FootContact

Interval = tuple[float, float]

CAUSES = (
    "friction",
    "payload",
    "centre of mass",
    "strength",
    "bus voltage",
    "delay",
    "sensor noise",
    "joint offsets",
    "pushes",
    "foot",
)
"""What can differ from the nominal robot, each by itself or all at once."""

ALL, NOMINAL = "all", "nominal"
"""Groups of sprints beside those of one cause: everything at once, nothing but the initial joint noise."""

GROUPS = (ALL, NOMINAL, *CAUSES)

_JOINT_NOISE = 0.05  # of every sprint's start, as in the protocol [rad]


@dataclass(frozen=True, kw_only=True)
class RobustnessRanges:
    """What is drawn from, evenly (the foot's stiffness: evenly in its logarithm).

    Attributes:
        friction: sliding friction of feet and ground.
        payload: mass added to the trunk [kg].
        center_of_mass: half-width of the trunk's shift along each axis [m].
        strength: delivered over asked torque.
        bus_voltage: over the robot's nominal one; 0.9 to 1 are 54 to 60 V for BP2.
        delay: from reading to new targets [s].
        sensor_noise: over that of training.
        joint_offset: half-width of the encoders' zero errors [rad].
        push_speed: of each push; on average one in 3 s [m/s].
        foot_stiffness: of the pads [N/m].
        foot_restitution: of the pads.

    Raises:
        InvalidValueError: an interval is out of range.
    """

    friction: Interval = (0.5, 1.2)
    payload: Interval = (-1.0, 4.0)
    center_of_mass: float = 0.03
    strength: Interval = (0.9, 1.0)
    bus_voltage: Interval = (0.9, 1.0)
    delay: Interval = (0.0, 0.010)
    sensor_noise: float = 1.0
    joint_offset: float = 0.02
    push_speed: float = 0.5
    foot_stiffness: Interval = STIFFNESS_BAND
    foot_restitution: Interval = RESTITUTION_BAND

    def __post_init__(self) -> None:
        for name in ("friction", "strength", "bus_voltage", "foot_stiffness", "foot_restitution"):
            check_range(f"robustness.{name}", np.asarray(getattr(self, name)), 1e-3, 1e7)
        check_range("robustness.delay", np.asarray(self.delay), 0.0, 0.02, "s")


def draw_request(
    seed: int,
    group: str,
    *,
    top_speed: float,
    bus_voltage: float,
    distance: float = 100.0,
    ranges: RobustnessRanges | None = None,
    plant: PlantOptions | None = None,
) -> TrialRequest:
    """The sprint of a seed.

    A cause has the same value alone as together with all others: its draw depends on the seed only.

    Args:
        seed: decides every draw.
        group: one of ``GROUPS``: what is drawn; the rest is nominal.
        top_speed: v* [m/s].
        bus_voltage: nominal [V].
        distance: of the sprint [m].
        ranges: what is drawn from.
        plant: how the robot is simulated otherwise.

    Raises:
        InvalidValueError: there is no such group.
    """
    check_choice("group", group, GROUPS)
    ranges, plant = ranges or RobustnessRanges(), plant or PlantOptions()
    drawn = _drawn_settings(seed, ranges)
    feet, voltage = _drawn_plant(seed, ranges)
    causes = CAUSES if group == ALL else (group,)
    settings = TrialSettings(seed=seed, joint_noise=_JOINT_NOISE)
    for cause in causes:
        settings = replace(settings, **drawn.get(cause, {}))
    if "foot" in causes:
        plant = replace(plant, foot=feet)
    if "bus voltage" in causes:
        plant = replace(plant, bus_voltage=voltage * bus_voltage)
    return TrialRequest(top_speed=top_speed, distance=distance, settings=settings, plant=plant)


def _drawn_settings(seed: int, ranges: RobustnessRanges) -> dict[str, dict[str, object]]:
    """Fields of ``TrialSettings`` by cause."""
    random = np.random.default_rng((seed, 5))
    shift = random.uniform(-ranges.center_of_mass, ranges.center_of_mass, 3)
    return {
        "friction": {"friction": float(random.uniform(*ranges.friction))},
        "payload": {"payload": float(random.uniform(*ranges.payload))},
        "centre of mass": {"center_of_mass": tuple(shift.tolist())},
        "strength": {"strength": float(random.uniform(*ranges.strength))},
        "delay": {"delay": float(random.uniform(*ranges.delay))},
        "sensor noise": {"sensor_noise": ranges.sensor_noise},
        "joint offsets": {"joint_offset": ranges.joint_offset},
        "pushes": {"push_speed": ranges.push_speed},
    }


def _drawn_plant(seed: int, ranges: RobustnessRanges) -> tuple[FootContact, float]:
    """The foot pads, and the bus voltage over the nominal one."""
    random = np.random.default_rng((seed, 6))
    stiffness = float(np.exp(random.uniform(*np.log(ranges.foot_stiffness))))
    foot = FootContact(stiffness=stiffness, restitution=float(random.uniform(*ranges.foot_restitution)))
    return foot, float(random.uniform(*ranges.bus_voltage))
