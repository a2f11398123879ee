"""What the audit limits, as constraints of the training: passing a limit ends a share of the future.

A constraint is broken by a part from 0 (at its limit) to 1 (at ``full``), worst inside of the policy step.
The part times a chance is the share of the future that ends with the step; all constraints together end
``1 - product(1 - chance * part)``, which multiplies the discount like a soft termination (Chane-Sane et al.
2024, "CaT: Constraints as Terminations"). A weight inside of the reward cannot do this: it either lets feet
be hard or makes speed not pay.

``Chances`` moves the chances so that fast robots break each constraint as often as aimed at. What is common
(feet) has low caps: high ones make robots give up speed. What is rare (gears, legs, joint speed, end stops)
may end nearly everything: with low caps it is run over.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import torch

from sprintlab.core.constants import GRAVITY
from sprintlab.core.errors import InvalidValueError
from sprintlab.robots.foot import NOMINAL_FOOT
from sprintlab.training.settings import CONSTRAINTS, PHASES, Constraint, ConstraintSettings

WATCHED = tuple(f"{phase}/{name}" for phase in PHASES for name in CONSTRAINTS)
"""Names of the chances, in the order of ``Chances.values``."""
PAD_LIMIT, FORCE_LIMIT = 0.015, 4.0
"""The audit's limits of a foot: deflection of its pad [m] and force [body weights]. They are one constraint:
a deflection counts as the force that stands as near to its limit."""
_CHANGING = 0.3
"""Distance between command and target beyond which a command rises or falls [m/s]."""
_LAGGING = 1.0
"""A robot that is slower than its command by more than this pushes [m/s]."""
FAST_SHARE = 0.75
"""Robots count as fast above this share of the top of the range."""
INITIAL_CHANCE, _LEAST_CHANCE = 0.003, 1e-3
_RATE = 0.01
"""Greatest change of a chance in an iteration."""
_SLACK = 3.0
"""The range opens beyond ``runner.GATED_TOP`` while feet and gears are broken less than this many times as
often as aimed at."""
_SMOOTHING = 0.05
_STRICT = ("hold/foot", "hold/gear")
"""What must hold before the range of speeds opens further."""


class Monitors(NamedTuple):
    """What the audit measures, the worst inside of the policy step."""

    foot_force: torch.Tensor  # mean of 5 ms [body weights] (n, legs)
    pad_deflection: torch.Tensor  # that the same force gives a nominal pad [m] (n, legs)
    gear_torque: torch.Tensor  # mean of 1 ms [peak torques] (n, joints)
    leg_distance: torch.Tensor  # between the surfaces of two legs [m] (n, pairs)
    joint_speed: torch.Tensor  # over the no-load speed (n, joints)
    stop_depth: torch.Tensor  # in an end stop, over its zone (n, joints)


def nominal_deflection(deflection: torch.Tensor, stiffness: torch.Tensor) -> torch.Tensor:
    """Deflection [m] that the same spring force gives a nominal pad, on which the audit measures.

    Training randomizes the stiffness [N/m] from half to twice the nominal one: a soft pad's own deflection
    would pass 15 mm in gaits that the audit passes, and the range of speeds would never open.
    """
    return deflection * (stiffness / NOMINAL_FOOT.stiffness)


def apparent_weight(lateral: torch.Tensor) -> torch.Tensor:
    """What a robot weighs in a turn, over its weight: ``sqrt(1 + (v w / g)^2)``.

    Its feet carry gravity and the turn together. Held against the weight alone, their force would forbid
    turns at the speeds at which running straight on takes all that the limit allows.

    Args:
        lateral: acceleration to the side that the command asks for, speed times yaw rate [m/s^2] ``(n,)``.
    """
    return (1.0 + (lateral / GRAVITY).square()).sqrt()


def broken_parts(monitors: Monitors, settings: ConstraintSettings) -> torch.Tensor:
    """How far each constraint is broken, from 0 to 1 ``(n, constraints)``; NaN counts as 1."""
    foot = torch.maximum(monitors.foot_force, monitors.pad_deflection * (FORCE_LIMIT / PAD_LIMIT))
    worst = {
        "foot": foot.amax(1),
        "gear": monitors.gear_torque.amax(1),
        "legs": monitors.leg_distance.amin(1),
        "joint_speed": monitors.joint_speed.amax(1),
        "end_stop": monitors.stop_depth.amax(1),
    }
    parts = [_part(worst[name], getattr(settings, name)) for name in CONSTRAINTS]
    return torch.nan_to_num(torch.stack(parts, 1), nan=1.0)


def _part(value: torch.Tensor, constraint: Constraint) -> torch.Tensor:
    return ((value - constraint.limit) / (constraint.full - constraint.limit)).clamp(0.0, 1.0)


def command_phases(command: torch.Tensor, target: torch.Tensor, running_speed: torch.Tensor) -> torch.Tensor:
    """1 in the column of the phase that a robot is in: holding, pushing or braking ``(n, 3)``.

    Args:
        command: forward speed [m/s] ``(n,)``.
        target: where the command is on its way to [m/s] ``(n,)``.
        running_speed: mean over about a stride [m/s] ``(n,)``.
    """
    ahead = target - command
    brake = ahead < -_CHANGING
    push = ((ahead > _CHANGING) | (command - running_speed > _LAGGING)) & ~brake
    return torch.stack((~(brake | push), push, brake), 1).float()


def by_phase(phases: torch.Tensor, parts: torch.Tensor) -> torch.Tensor:
    """The parts in the columns of the robot's phase, zero elsewhere ``(n, len(WATCHED))``."""
    return (phases[:, :, None] * parts[:, None, :]).flatten(1)


def ended_share(parts: torch.Tensor, chances: torch.Tensor) -> torch.Tensor:
    """Share of the future that ends with this step ``(n,)``, from parts ``(n, k)`` and chances ``(k,)``."""
    return 1.0 - (1.0 - chances * parts).prod(1)


class Chances:
    """The chance of each constraint in each phase, moved once an iteration; plain numbers on the host."""

    def __init__(self, settings: ConstraintSettings) -> None:
        constraints: list[Constraint] = [getattr(settings, name) for name in CONSTRAINTS]
        self._constraints = constraints * len(PHASES)
        self._caps = [each.caps[phase] for phase in range(len(PHASES)) for each in constraints]
        self.values = [INITIAL_CHANCE] * len(WATCHED)
        self.shares: list[float | None] = [None] * len(WATCHED)

    def update(self, row: Mapping[str, float], moving: bool) -> None:
        """Follow what fast robots did in an iteration.

        Args:
            row: ``fast/PHASE``: share of the steps in which a robot was fast and in this phase;
                ``broken/PHASE/NAME``: mean of the broken part over all steps, counted for fast robots.
            moving: whether chances move, or only the shares are noted.
        """
        for place, name in enumerate(WATCHED):
            often = row[f"fast/{name.partition('/')[0]}"]
            if often < 1e-4:
                continue
            share, before = row[f"broken/{name}"] / often, self.shares[place]
            self.shares[place] = share if before is None else before + _SMOOTHING * (share - before)
            if moving:
                self._move(place)

    def _move(self, place: int) -> None:
        """One step of at most the rate, in the logarithm of the chance."""
        share = self.shares[place] or 0.0
        distance = math.log((share + 1e-6) / self._constraints[place].aim)
        step = _RATE * max(-1.0, min(1.0, distance))
        self.values[place] = max(_LEAST_CHANCE, min(self._caps[place], self.values[place] * math.exp(step)))

    @property
    def held(self) -> bool:
        """Whether feet and gears of robots that hold their speed are near enough to what is aimed at."""
        places = [WATCHED.index(name) for name in _STRICT]
        return all((self.shares[k] or 0.0) < _SLACK * self._constraints[k].aim for k in places)

    def state_dict(self) -> dict[str, Any]:
        """What a checkpoint keeps."""
        return {"values": self.values, "shares": self.shares}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on from a checkpoint. Raises ``InvalidValueError`` where it has other constraints."""
        for name in ("values", "shares"):
            if len(state[name]) != len(WATCHED):
                raise InvalidValueError(f"chances.{name}", len(state[name]), f"{len(WATCHED)} numbers")
        self.values, self.shares = list(state["values"]), list(state["shares"])
