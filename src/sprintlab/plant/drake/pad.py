"""A foot pad in Drake: Hunt and Crossley's law whose dissipation follows from the restitution wanted.

Drake's compliant contact pushes with ``k x (1 + d v)`` (penetration x, its rate v). With a constant ``d`` a
foot would bounce the less the faster it comes down; a pad's restitution is stated for all speeds. So ``d`` is
set anew at each touchdown, inversely to its speed, as Lankarani and Nikravesh (1990) do: ``d = a / speed``.

Drake's other approximation, ``kSap``, has a linear dashpot but pushes harder where a foot slides: at 2 m/s
down and 3 m/s along, twice as hard. The lagged approximation used here does not depend on the slip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

from sprintlab.robots.foot import FootContact

SLOWEST_TOUCHDOWN = 0.1
"""Touchdowns below this speed dissipate as if they had it [m/s]."""

_MOST_NUMBER = 200.0
_PHASES = 8  # where between two time steps a dropped foot touches down


@dataclass(frozen=True, kw_only=True)
class Pad:
    """A foot's pad.

    Attributes:
        stiffness: [N/m].
        dissipation_number: dissipation times touchdown speed [-].
    """

    stiffness: float
    dissipation_number: float

    def dissipation(self, speed: float) -> float:
        """Hunt and Crossley's dissipation [s/m] after a touchdown at a sinking speed [m/s]."""
        return self.dissipation_number / max(speed, SLOWEST_TOUCHDOWN)


def pad_for(foot: FootContact, mass: float, timestep: float) -> Pad:
    """The pad that shows a foot's stiffness and restitution under a leg.

    Args:
        foot: what to show.
        mass: the leg's effective mass [kg].
        timestep: Drake's [s].
    """
    number = dissipation_number(foot.stiffness, foot.restitution, round(mass, 6), timestep)
    return Pad(stiffness=foot.stiffness, dissipation_number=number)


@lru_cache(maxsize=256)
def dissipation_number(stiffness: float, restitution: float, mass: float, timestep: float) -> float:
    """Dissipation times touchdown speed [-] that shows a restitution at Drake's time step.

    Args:
        stiffness: of the pad [N/m].
        restitution: speed after over speed before [-].
        mass: that falls [kg].
        timestep: [s].

    Returns:
        0 where the step alone takes more than the restitution wanted.
    """
    low, high = 0.0, _MOST_NUMBER
    for _ in range(40):
        middle = 0.5 * (low + high)
        if stepped_restitution(middle, stiffness, mass, timestep) > restitution:
            low = middle
        else:
            high = middle
    return low


def stepped_restitution(number: float, stiffness: float, mass: float, timestep: float) -> float:
    """Mean restitution of a drop at 1 m/s in Drake's time steps: the law holds for every speed."""
    phases = ((phase + 0.5) / _PHASES for phase in range(_PHASES))
    return sum(_drop(number, stiffness, mass, timestep, phase) for phase in phases) / _PHASES


def _drop(number: float, stiffness: float, mass: float, timestep: float, phase: float) -> float:
    """Speed after one drop at 1 m/s; each step solves for the velocity at its end."""
    depth, sinking = -phase * timestep, 1.0
    for _ in range(round(20.0 * math.sqrt(mass / stiffness) / timestep) + 4):
        sinking = _next_sinking(number, timestep * stiffness / mass, depth, sinking, timestep)
        depth += timestep * sinking
        if sinking < 0.0 and depth < 0.0:
            break
    return -sinking


def _next_sinking(number: float, rate: float, depth: float, sinking: float, timestep: float) -> float:
    """Sinking speed v' at a step's end: ``v' = v - rate (x + h v') (1 + d v')``, without pull."""
    if depth + timestep * sinking <= 0.0 or 1.0 + number * sinking <= 0.0:
        return sinking
    curvature = rate * timestep * number
    slope = 1.0 + rate * (depth * number + timestep)
    rest = rate * depth - sinking
    # The larger root, in the form that survives a vanishing dissipation.
    return -2.0 * rest / (slope + math.sqrt(slope * slope - 4.0 * curvature * rest))
