"""A policy that turns less than it is told is told to turn more.

At speed, policies turn with a share of the commanded yaw rate, and with an offset where they run unevenly to
both sides. How much more has to be asked for belongs to the policy, as its filters do; who commands need not
know it. The gyroscope measures the yaw rate, so that an integral removes what is left.
"""

from __future__ import annotations

import msgspec

from sprintlab.core.checks import check_range

SLOWEST_CORRECTED = 0.5
"""Below this forward command the yaw rate is asked for as it is, and the integral is forgotten [m/s]."""
_FASTEST, _LARGEST = 10.0, 100.0
"""Of the doubling speed, and of yaw rates [rad/s]: beyond, nothing grows, so that any command and any
measurement give a finite yaw rate."""


class TurningContract(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which yaw rate reaches the network.

    Attributes:
        doubling_speed: forward command at which the network is asked for twice the yaw rate [m/s]; the
            excess grows with the square of the command.
        smoothing: time constant of the commanded yaw rate that counts for the excess [s]: a heading loop's
            small corrections within a stride are passed on as they are.
        integral: rate at which the error of the yaw rate adds to what is asked for [1/s].
        limit: greatest yaw rate that the network is asked for [rad/s].

    Raises:
        InvalidValueError: a number is out of range.
    """

    doubling_speed: float = 12.0
    smoothing: float = 0.3
    integral: float = 2.0
    limit: float = 1.25

    def __post_init__(self) -> None:
        check_range("turning.doubling_speed", self.doubling_speed, 1.0, 1e6, "m/s")
        check_range("turning.smoothing", self.smoothing, 0.0, 60.0, "s")
        check_range("turning.integral", self.integral, 0.0, 20.0, "1/s")
        check_range("turning.limit", self.limit, 0.1, 10.0, "rad/s")


class TurningLoop:
    """Feed-forward and integral of the yaw rate.

    Args:
        contract: gains and limit.
        rate_hz: of the policy [Hz].
    """

    def __init__(self, contract: TurningContract, rate_hz: float) -> None:
        self._contract, self._rate_hz = contract, rate_hz
        self.reset()

    def reset(self) -> None:
        """Forget the integral and the commands so far."""
        self._smooth = self._correction = 0.0

    def step(self, forward: float, asked: float, measured: float) -> float:
        """The yaw rate [rad/s] that the network is asked for in this policy step.

        ``asked + (forward / doubling_speed)^2 smooth + integral * sum(asked - measured) / rate_hz``, where
        ``smooth`` is the low-passed ``asked``, and the sum and the whole stay within the limit.

        Args:
            forward: forward command that the network is given [m/s].
            asked: yaw rate that is commanded [rad/s].
            measured: by the gyroscope [rad/s].
        """
        if abs(forward) < SLOWEST_CORRECTED:
            self.reset()
            return asked
        contract, period = self._contract, 1.0 / self._rate_hz
        asked, measured = (min(max(value, -_LARGEST), _LARGEST) for value in (asked, measured))
        self._smooth += (asked - self._smooth) * period / (contract.smoothing + period)
        self._correction = self._limited(self._correction + contract.integral * (asked - measured) * period)
        excess = min(abs(forward) / contract.doubling_speed, _FASTEST) ** 2
        return self._limited(asked + excess * self._smooth + self._correction)

    def _limited(self, yaw_rate: float) -> float:
        return min(max(yaw_rate, -self._contract.limit), self._contract.limit)
