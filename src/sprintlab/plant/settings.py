"""What is drawn anew for every trial."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sprintlab.core.checks import check_range


@dataclass(frozen=True, kw_only=True)
class TrialSettings:
    """What differs between the trials of one protocol.

    Raises:
        InvalidValueError: a field is outside its range.
    """

    seed: int = 0  # decides the initial joint noise, >= 0
    joint_noise: float = 0.0  # half-width of the uniform initial joint noise [rad], to 0.3
    friction: float = 0.85  # sliding friction of feet and floor, 0.1 to 2
    payload: float = 0.0  # mass added to the trunk [kg], -5 to 20
    center_of_mass: tuple[float, float, float] = (0.0, 0.0, 0.0)  # shift forward, left, up [m], to 0.2
    strength: float = 1.0  # torque that the drives deliver over what their currents should give, 0.5 to 1.5
    delay: float = 0.0  # from the policy's reading to the joints' new targets [s], to 0.02
    joint_offset: float = 0.0  # half-width of the errors of the encoders' zeros, drawn once [rad], to 0.2
    sensor_noise: float = 0.0  # uniform noise on each reading, over that of ``SENSOR_NOISE``, to 10
    push_speed: float = 0.0  # by which a push changes the trunk's velocity, any direction [m/s], to 5

    def __post_init__(self) -> None:
        check_range("trial.seed", self.seed, 0, 2**32 - 1)
        check_range("trial.joint_noise", self.joint_noise, 0.0, 0.3, "rad")
        check_range("trial.friction", self.friction, 0.1, 2.0)
        check_range("trial.payload", self.payload, -5.0, 20.0, "kg")
        check_range("trial.center_of_mass", np.asarray(self.center_of_mass), -0.2, 0.2, "m")
        check_range("trial.strength", self.strength, 0.5, 1.5)
        check_range("trial.delay", self.delay, 0.0, 0.02, "s")
        check_range("trial.joint_offset", self.joint_offset, 0.0, 0.2, "rad")
        check_range("trial.sensor_noise", self.sensor_noise, 0.0, 10.0)
        check_range("trial.push_speed", self.push_speed, 0.0, 5.0, "m/s")


JOINT_NOISE = 0.05
"""Half-width of the initial joint noise that every trial carries [rad]: without it a symmetric policy on a
symmetric robot keeps a symmetry that no robot has."""
NOMINAL_TRIAL = TrialSettings(joint_noise=JOINT_NOISE)
"""A trial that is not one of the protocol's draws."""
