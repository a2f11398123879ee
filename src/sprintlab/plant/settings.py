"""What is drawn anew for every trial."""

from __future__ import annotations

from dataclasses import dataclass

from sprintlab.core.checks import check_range


@dataclass(frozen=True, kw_only=True)
class TrialSettings:
    """What differs between the trials of one protocol.

    Attributes:
        seed: seed of the initial joint noise, >= 0.
        joint_noise: half-width of the uniform initial joint noise [rad], 0 to 0.3.
        friction: sliding friction of feet and floor, 0.1 to 2.
        payload: mass added to the trunk [kg], -5 to 20.

    Raises:
        InvalidValueError: a field is outside its range.
    """

    seed: int = 0
    joint_noise: float = 0.0
    friction: float = 0.85
    payload: float = 0.0

    def __post_init__(self) -> None:
        check_range("trial.seed", self.seed, 0, 2**32 - 1)
        check_range("trial.joint_noise", self.joint_noise, 0.0, 0.3, "rad")
        check_range("trial.friction", self.friction, 0.1, 2.0)
        check_range("trial.payload", self.payload, -5.0, 20.0, "kg")
