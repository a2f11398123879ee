"""The foot on the ground: stiffness and restitution as physical numbers.

A foot pad is a spring with a dashpot, ``f = k x + b v`` while that is positive: a foot does not stick. The
two numbers are those of a drop test: the leg's effective mass hits the floor without gravity, ``stiffness``
is force over deflection where the deflection is greatest (the dashpot gives nothing there), ``restitution``
is speed after over speed before.

The bands are those of rubber pads, after Hertz and from rebound resilience: ``docs/evaluation.md``. Plant and
engine apply the pad's force themselves; MuJoCo's own contact is not used for feet there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_range
from sprintlab.core.errors import RobotModelError

STIFFNESS_BAND = (40e3, 160e3)
"""Stiffness of a foot pad whose maker states none [N/m]: half to twice the nominal one."""
RESTITUTION_BAND = (0.2, 0.6)
"""Restitution of a foot pad that its maker has not stated [-]."""


@dataclass(frozen=True, kw_only=True)
class FootContact:
    """A foot pad on the ground."""

    stiffness: float = 80e3  # [N/m], 5e3 to 1e6
    # speed after over speed before a drop of the leg's effective mass, 0.15 to 0.95 [-]
    restitution: float = 0.4

    def __post_init__(self) -> None:
        check_range("foot.stiffness", self.stiffness, 5e3, 1e6, "N/m")
        check_range("foot.restitution", self.restitution, 0.15, 0.95)

    @property
    def damping_ratio(self) -> float:
        """Damping over critical damping that gives ``restitution``: more than for a foot that sticks."""
        low, high = 0.0, 0.999
        while high - low > 1e-9:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _restitution(middle) > self.restitution else (low, middle)
        return low

    def damping(self, mass: float) -> float:
        """Damping of the pad [N s/m] under a leg of effective ``mass`` [kg]."""
        return 2.0 * self.damping_ratio * math.sqrt(self.stiffness * mass)

    @property
    def tangential_stiffness(self) -> float:
        """Stiffness of the pad's bristles along the ground [N/m]: that of the pad."""
        return self.stiffness

    def tangential_damping(self, mass: float) -> float:
        """Damping of the bristles [N s/m]: critical for a quarter of the leg's effective ``mass`` [kg].

        Along the ground a standing leg weighs a fifth (BP2) to a half (Go1) of what it weighs vertically.
        """
        return math.sqrt(self.tangential_stiffness * mass)


NOMINAL_FOOT = FootContact()
"""The foot pads behind every published number."""


def _restitution(ratio: float) -> float:
    """Restitution of a spring and dashpot that lets go where its force ends (Schwager and Poeschel 2007)."""
    return math.exp(-ratio / math.sqrt(1.0 - ratio**2) * contact_angle(ratio))


def contact_angle(ratio: float) -> float:
    """Damped angular frequency times the time until the force ends [rad]."""
    return math.atan2(2.0 * ratio * math.sqrt(1.0 - ratio**2), 2.0 * ratio**2 - 1.0)


def effective_leg_mass(model: mujoco.MjModel) -> float:
    """Mean vertical inertia at the feet, standing, knee springs rigid [kg]: what a drop test drops."""
    rigid = np.flatnonzero(model.jnt_stiffness[model.dof_jntid] == 0.0)
    mass = float(np.mean(foot_masses(model, rigid, (2,))))
    if not (math.isfinite(mass) and mass > 0.0):
        raise RobotModelError("the legs' masses and inertias are too far apart to be worked with")
    return mass


def foot_masses(
    model: mujoco.MjModel, moving: NDArray[np.int_], axes: Sequence[int] = (0, 1, 2)
) -> FloatArray:
    """Mass that each foot shows along some of x, y and z ``(feet, axes)`` [kg], standing.

    Args:
        model: with spheres named ``{leg}_foot`` and the keyframe ``stand``.
        moving: degrees of freedom that give way; the others are rigid.
        axes: 0 for x, 1 for y, 2 for z.
    """
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("stand").id)
    mujoco.mj_forward(model, data)
    inertia, jacobian = np.zeros((model.nv, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    masses: list[FloatArray] = []
    for geom in (geom for geom in range(model.ngeom) if model.geom(geom).name.endswith("_foot")):
        mujoco.mj_jac(model, data, jacobian, None, data.geom_xpos[geom], model.geom_bodyid[geom])
        along = np.ascontiguousarray(jacobian[list(axes)][:, moving])
        try:
            moved = np.linalg.solve(inertia[np.ix_(moving, moving)], along.T)
        except np.linalg.LinAlgError:
            moved = np.full(along.T.shape, np.nan)
        masses.append(1.0 / np.diag(along @ moved))
    return np.array(masses)


def set_friction(model: mujoco.MjModel, friction: float) -> None:
    """Give all geoms of a compiled model one sliding friction coefficient [-]."""
    model.geom_friction[:, 0] = friction
