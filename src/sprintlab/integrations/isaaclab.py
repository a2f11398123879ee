"""Isaac Lab 3: the motor law as an explicit actuator, its motors matched to the joints by name.

Needs ``SimulationCfg(use_newton_actuators=False)``: otherwise Isaac Lab hands explicit actuators to Newton,
which knows only its own kinds and refuses this one.
"""

from __future__ import annotations

# pyright: reportMissingImports=false
from collections.abc import Sequence
from dataclasses import MISSING
from typing import Any

import numpy as np
import torch
from isaaclab.actuators import ActuatorBaseCfg, IdealPDActuator
from isaaclab.utils import configclass

from sprintlab.motors import (
    Gear,
    MotorModel,
    PmsmParameters,
    drive_torque,
    no_load_speed,
    reflected_inertia,
    unchecked,
)
from sprintlab.motors.parameters import MOTOR_UNITS
from sprintlab.robots import JointMotors


class PmsmActuator(IdealPDActuator):
    """A PD loop on geared permanent-magnet motors, one per joint of the group.

    ``parameters`` holds a tensor ``(environments, joints)`` for each field of ``PmsmParameters`` and for
    ``gear_ratio``, ``gear_efficiency`` and ``bus_voltage``; randomize them in place.
    """

    cfg: PmsmActuatorCfg

    def __init__(self, cfg: PmsmActuatorCfg, joint_names: list[str], *args: Any, **kwargs: Any) -> None:
        super().__init__(cfg, joint_names, *args, **kwargs)
        like = self.computed_effort
        self.parameters: dict[str, torch.Tensor] = {
            field: like.new_tensor([values[name] for name in joint_names]).expand_as(like).clone()
            for field, values in cfg.motors.items()
        }

    def _clip_effort(self, effort: torch.Tensor, joint_vel: torch.Tensor) -> torch.Tensor:
        """Torque that the motors give [N m] for the PD loop's, both ``(environments, joints)``."""
        values = self.parameters
        motor = unchecked(PmsmParameters, {name: values[name] for name in MOTOR_UNITS})
        gear = unchecked(Gear, {"ratio": values["gear_ratio"], "efficiency": values["gear_efficiency"]})
        return drive_torque(
            motor, gear, effort, joint_vel, values["bus_voltage"], self.cfg.motor_model
        ).torque


@configclass
class PmsmActuatorCfg(ActuatorBaseCfg):
    """Configuration of ``PmsmActuator``: made by ``pmsm_actuator``.

    Not an ``IdealPDActuatorCfg``: Isaac Lab takes every subclass of that for an ideal PD loop.
    """

    class_type: type = PmsmActuator
    motors: dict[str, dict[str, float]] = MISSING  # pyright: ignore[reportAssignmentType]  # as Isaac Lab's own
    """Numbers of the motors by parameter and joint name, as Isaac Lab has those of its joints."""
    motor_model: MotorModel = "refined"
    """One of ``sprintlab.motors.MOTOR_MODELS``."""


def pmsm_actuator(joint_names: Sequence[str], motors: JointMotors, **fields: Any) -> PmsmActuatorCfg:
    """The actuator group of these joints, with armature and limits from their motors.

    Isaac Lab's effort limit of the joint is what the motors can hold when braking, with gear losses, so that
    nothing is clipped twice. Names are in any order; ``fields`` are ``stiffness``, ``damping`` and others of
    the configuration.
    """
    found, values = motors.ordered(joint_names), motors.parameters(joint_names)
    ratio, efficiency = values["gear_ratio"], values["gear_efficiency"]
    derived = {
        "armature": reflected_inertia(found.gear, values["rotor_inertia"]),
        "actuator_velocity_limit": no_load_speed(found.motor, found.bus_voltage) / ratio,
        "joint_effort_limit": values["peak_torque"] * ratio / efficiency,
    }

    def by_name(numbers: Any) -> dict[str, float]:
        return dict(zip(joint_names, np.asarray(numbers).tolist(), strict=True))

    return PmsmActuatorCfg(
        joint_names_expr=list(joint_names),
        motors={name: by_name(numbers) for name, numbers in values.items()},
        **{**{name: by_name(numbers) for name, numbers in derived.items()}, **fields},
    )
