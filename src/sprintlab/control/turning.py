"""A policy that turns less than it is told is told to turn more.

At speed, policies turn with a share of the commanded yaw rate, and with an offset where they run unevenly to
both sides. How much more has to be asked for belongs to the policy, as its filters do; who commands need not
know it. The gyroscope measures the yaw rate, so that an integral removes what is left.
"""

from __future__ import annotations

import msgspec

from sprintlab.control.filters import low_pass
from sprintlab.core.checks import check_range

FADING = 0.5
"""The loop acts on forward commands up to so much faster than ``fastest`` [m/s]."""
BRAKING = 1.0
"""A forward command that falls faster than this brakes [m/s^2]: the ground is needed for that."""
_FASTEST, _LARGEST, _SLOWEST = 10.0, 100.0, 0.1
"""Largest doubling speed, yaw rate [rad/s] and forward command [m/s]: beyond, nothing grows, so that
any command and any measurement give a finite yaw rate."""


class TurningContract(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which yaw rate reaches the network.

    Attributes:
        doubling_speed: forward command at which the network is asked for twice the yaw rate [m/s]; the
            excess grows with the square of the command.
        smoothing: time constant of the smoothed command [s]: what a heading loop corrects within a stride is
            passed on as it is.
        onset: smoothed yaw rate from which on the loop acts [rad/s], wholly from one and a half of it on.
            Straight on, a policy runs as without the loop.
        integral: rate at which the error of the yaw rate adds to what is asked for [1/s].
        limit: greatest yaw rate that the network is asked for [rad/s].
        lateral_limit: hardest turn that is asked for, forward command times yaw rate [m/s^2]: for a harder
            one the ground may not do.
        fastest: forward command up to which the loop acts [m/s]; 0.5 m/s above it it has faded. A robot that
            is pushed off its straight course at top speed is asked for too much by it, and tilts.

    Raises:
        InvalidValueError: a number is out of range.
    """

    doubling_speed: float = 14.0
    smoothing: float = 0.15
    onset: float = 0.11
    integral: float = 2.0
    limit: float = 1.25
    lateral_limit: float = 5.0
    fastest: float = 12.5

    def __post_init__(self) -> None:
        check_range("turning.doubling_speed", self.doubling_speed, 1.0, 1e6, "m/s")
        check_range("turning.smoothing", self.smoothing, 0.0, 60.0, "s")
        check_range("turning.onset", self.onset, 1e-3, 10.0, "rad/s")
        check_range("turning.integral", self.integral, 0.0, 20.0, "1/s")
        check_range("turning.limit", self.limit, 0.1, 10.0, "rad/s")
        check_range("turning.lateral_limit", self.lateral_limit, 1.0, 1e6, "m/s^2")
        check_range("turning.fastest", self.fastest, 0.0, 1e6, "m/s")


class TurningLoop:
    """Feed-forward and integral of the yaw rate.

    Args:
        contract: gains and limit.
        rate_hz: rate of the policy [Hz].
    """

    def __init__(self, contract: TurningContract, rate_hz: float) -> None:
        self._contract, self._rate_hz = contract, rate_hz
        self.reset()

    def reset(self) -> None:
        """Forget the integral and the commands so far."""
        self._forward = self._smooth = self._correction = 0.0

    def step(self, forward: float, asked: float, measured: float) -> float:
        """The yaw rate [rad/s] that the network is asked for in this policy step.

        ``asked + share (forward / doubling_speed)^2 smooth + sum(share integral (asked - measured)) dt``:
        ``asked`` within ``lateral_limit``, ``smooth`` the same behind a low-pass, ``share`` how much the loop
        acts, and the sum and the whole within ``limit``. Straight on, faster than ``fastest``, and while the
        robot brakes, the second and the third term fade.

        Args:
            forward: forward command that the network is given [m/s].
            asked: yaw rate that is commanded [rad/s].
            measured: by the gyroscope [rad/s].
        """
        contract, period = self._contract, 1.0 / self._rate_hz
        hardest = min(contract.limit, contract.lateral_limit / max(abs(forward), _SLOWEST))
        asked, measured = _within(hardest, asked), _within(_LARGEST, measured)
        braking = abs(self._forward) - abs(forward) > BRAKING * period
        self._forward = forward
        fading = period / (contract.smoothing + period)
        self._smooth = low_pass(self._smooth, 0.0 if braking else asked, fading)
        share = 0.0 if braking else self._share(forward)
        more = share * contract.integral * (asked - measured) * period
        kept = (1.0 - (1.0 - share) * fading) * self._correction
        self._correction = _within(contract.limit, kept + more)
        excess = share * min(abs(forward) / contract.doubling_speed, _FASTEST) ** 2
        return _within(contract.limit, asked + excess * self._smooth + self._correction)

    def _share(self, forward: float) -> float:
        """How much the loop acts, from 0 to 1."""
        turning = 2.0 * (abs(self._smooth) / self._contract.onset - 1.0)
        slow = (self._contract.fastest - abs(forward)) / FADING + 1.0
        return _fraction(turning) * _fraction(slow)


def _fraction(value: float) -> float:
    """The number from 0 to 1 that is nearest to a value."""
    return min(max(value, 0.0), 1.0)


def _within(limit: float, value: float) -> float:
    """The number of at most this magnitude that is nearest to a value."""
    return min(max(value, -limit), limit)
