"""A forward command runs no further ahead, and falls no faster, than the policy follows well.

A robot at top speed whose command falls too fast braces its front legs against the ground: the hardest
steps of a run are those of its first second of braking. A robot that is too weak or too heavy for its command
stumbles at a lead that it never saw in training. Both limits belong to the policy, as its filters do; who
commands need not know them.
"""

from __future__ import annotations

import msgspec

from sprintlab.core.checks import check_range

_SLOWEST = 0.1
"""Below this the power limits nothing [m/s]: the deceleration does."""


class PaceContract(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the forward command that reaches the network may differ from the robot's speed, and change.

    Attributes:
        power: greatest power at which the commanded motion gives up its energy, for each kilogram of robot
            [W/kg]: at the speed v the command falls by ``power / v`` at most, softly from the top.
        deceleration: greatest deceleration [m/s^2], which decides at low speed.
        lead: how far the forward command may run ahead of the speed that the policy estimates [m/s]; None: as
            far as it is given.

    Raises:
        InvalidValueError: a number is out of range.
    """

    power: float = 30.0
    deceleration: float = 5.0
    lead: float | None = None

    def __post_init__(self) -> None:
        check_range("pace.power", self.power, 1.0, 1000.0, "W/kg")
        check_range("pace.deceleration", self.deceleration, 0.5, 50.0, "m/s^2")
        if self.lead is not None:
            check_range("pace.lead", self.lead, 0.5, 50.0, "m/s")


def limit_lead(contract: PaceContract, estimated: float, asked: float) -> float:
    """The forward command [m/s] that runs ahead of the robot by no more than ``lead``.

    Args:
        contract: with the lead.
        estimated: forward speed, as the policy estimates it [m/s]; zero for a policy that does not.
        asked: forward speed that is commanded [m/s].
    """
    if contract.lead is None:
        return asked
    return min(max(asked, min(estimated, 0.0) - contract.lead), max(estimated, 0.0) + contract.lead)


def limit_braking(contract: PaceContract, previous: float, asked: float, rate_hz: float) -> float:
    """The forward command [m/s] of this policy step; only its fall toward zero is limited.

    ``max(asked, v - min(deceleration, power / v) / rate_hz)`` where v is ``previous``, for a robot that runs
    forward, and its mirror image backward.

    Args:
        contract: power and deceleration.
        previous: what this returned one policy step before [m/s].
        asked: forward speed that is commanded now [m/s].
        rate_hz: rate of the policy [Hz].
    """
    step = min(contract.deceleration, contract.power / max(abs(previous), _SLOWEST)) / rate_hz
    if previous > 0.0:
        return max(asked, previous - step)
    if previous < 0.0:
        return min(asked, previous + step)
    return asked


def braking_time(contract: PaceContract, speed: float) -> float:
    """How long the forward command takes from ``speed`` [m/s] to rest [s], where rest is asked for."""
    slow = min(speed, max(contract.power / contract.deceleration, _SLOWEST))
    return (speed**2 - slow**2) / (2.0 * contract.power) + slow / contract.deceleration
