"""The motor law as an mjlab actuator: PD torque, gear, voltage limit, saturation, in one stateless law.

The law is mjlab's ``control_law`` contract, so that groups of joints with different motors are computed
together (``mjlab.actuator.fused_group``). Groups are fused by type: each motor model has a type of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np
import torch
from mjlab.actuator import ActuatorCmd, IdealPdActuator, IdealPdActuatorCfg
from mjlab.actuator.actuator import TransmissionType
from mjlab.actuator.builtin_actuator import DcMotorDatasheetParams
from mjlab.actuator.pd_actuator import pd_torque
from mjlab.managers.scene_entity_config import SceneEntityCfg

from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    MOTOR_MODELS,
    Gear,
    MotorModel,
    PmsmParameters,
    drive_torque,
    phase_voltage_limit,
    unchecked,
)
from sprintlab.motors.parameters import MOTOR_UNITS
from sprintlab.robots import JointMotors

_OWN_PARAMETERS = (*MOTOR_UNITS, "gear_ratio", "gear_efficiency", "bus_voltage")


@dataclass(kw_only=True)
class PmsmActuatorCfg(IdealPdActuatorCfg):
    """Geared permanent-magnet motors behind a PD loop, found by the names of the joints they drive.

    ``armature`` left at ``None`` becomes each rotor's reflected inertia, ``effort_limit`` (on the torque that
    the PD loop wants) left at infinity each motor's peak torque times its gear ratio. Passive friction stays
    where mjlab has it: ``frictionloss`` and ``viscous_damping``.
    """

    motors: JointMotors
    """One motor for all joints, or one per joint name, e.g. ``robot_motors("go1")``."""
    model: MotorModel = "refined"
    """Which voltage limit holds: one of ``MOTOR_MODELS``."""

    def __post_init__(self) -> None:
        check_choice("model", self.model, MOTOR_MODELS)
        check_positive("bus_voltage", self.motors.bus_voltage, "V")
        if self.transmission_type != TransmissionType.JOINT:
            raise InvalidValueError("transmission_type", self.transmission_type.value, "must be joint")
        super().__post_init__()

    def build(self, entity: Any, target_ids: list[int], target_names: list[str]) -> PmsmActuator:
        """The actuator of this group, of the type that stands for ``model``."""
        return actuator_type(self.model)(self, entity, target_ids, target_names)


class PmsmActuator(IdealPdActuator[PmsmActuatorCfg]):
    """Joint torque of a geared motor; every parameter is a tensor ``(environments, joints)``.

    The parameters carry the names of ``PmsmParameters``' fields, and ``gear_ratio``, ``gear_efficiency`` and
    ``bus_voltage``. Change them in place only: mjlab makes them views of the fused group's tensors.
    """

    model: ClassVar[MotorModel] = "refined"
    param_names = (*IdealPdActuator.param_names, *_OWN_PARAMETERS)

    @classmethod
    def control_law(  # pyright: ignore[reportIncompatibleMethodOverride]  # mjlab calls it on the type
        cls, params: dict[str, torch.Tensor], cmd: ActuatorCmd
    ) -> torch.Tensor:
        """Torque on the joints [N m] ``(environments, joints)``: the PD torque through ``drive_torque``."""
        limit = params["force_limit"]
        desired = torch.clamp(pd_torque(params["stiffness"], params["damping"], cmd), -limit, limit)
        motor = unchecked(PmsmParameters, {name: params[name] for name in MOTOR_UNITS})
        gear = unchecked(Gear, {"ratio": params["gear_ratio"], "efficiency": params["gear_efficiency"]})
        return drive_torque(motor, gear, desired, cmd.vel, params["bus_voltage"], cls.model).torque

    def edit_spec(self, spec: Any, target_names: list[str]) -> None:
        """As mjlab's; each joint's armature is its rotor's unless the configuration has one."""
        super().edit_spec(spec, target_names)
        if self.cfg.armature is None:
            values = self.cfg.motors.parameters(target_names)
            armature = values["gear_ratio"] ** 2 * values["rotor_inertia"]
            for name, inertia in zip(target_names, armature, strict=True):
                spec.joint(name).armature = inertia

    def initialize(self, mj_model: Any, model: Any, data: Any, device: str) -> None:
        """Lay out the parameters as tensors ``(environments, joints)``."""
        super().initialize(mj_model, model, data, device)
        values: dict[str, Any] = dict(self.cfg.motors.parameters(self.target_names))
        if np.isinf(self.cfg.effort_limit):
            # The wanted torque, before the gear's losses: with them the motor could never reach its peak.
            values["force_limit"] = values["default_force_limit"] = (
                values["peak_torque"] * values["gear_ratio"]
            )
        for name, value in values.items():
            row = torch.as_tensor(value, dtype=torch.float, device=device)
            setattr(self, name, row.expand(data.nworld, len(self.target_names)).clone())

    def set_bus_voltage(self, env_ids: torch.Tensor | slice, voltage: torch.Tensor) -> None:
        """Set the bus voltage [V] of some environments; ``voltage`` is ``(environments,)`` or with joints."""
        self.bus_voltage[env_ids] = voltage.unsqueeze(-1) if voltage.ndim == 1 else voltage


@cache
def actuator_type(model: MotorModel) -> type[PmsmActuator]:
    """The actuator type of a motor model; at every call the same: groups fuse."""
    check_choice("model", model, MOTOR_MODELS)
    name = f"Pmsm{model.title().replace('-', '')}Actuator"
    return type(name, (PmsmActuator,), {"model": model, "__doc__": PmsmActuator.__doc__})


def datasheet_motors(
    sheet: DcMotorDatasheetParams,
    *,
    pole_pairs: int,
    q_axis_inductance: float,
    peak_torque: float,
    rotor_inertia: float,
    gear: Gear,
) -> JointMotors:
    """The permanent-magnet motor with the stall torque and the no-load speed of mjlab's DC motor.

    Args:
        sheet: ``nominal_voltage`` is the DC bus; stall torque [N m] and no-load speed [rad/s] of the shaft.
        pole_pairs: pole pairs of the motor.
        q_axis_inductance: [H]; what the DC motor does not have.
        peak_torque: that the drive's current limit allows [N m]; often far below the stall torque.
        rotor_inertia: [kg m^2].
        gear: behind the shaft.
    """
    voltage = float(phase_voltage_limit(sheet.nominal_voltage))
    flux_linkage = voltage / (pole_pairs * sheet.no_load_speed)
    motor = PmsmParameters(
        pole_pairs=pole_pairs,
        stator_resistance=1.5 * pole_pairs * flux_linkage * voltage / sheet.stall_torque,
        q_axis_inductance=q_axis_inductance,
        flux_linkage=flux_linkage,
        peak_torque=peak_torque,
        rotor_inertia=rotor_inertia,
    )
    return JointMotors(motor=motor, gear=gear, bus_voltage=sheet.nominal_voltage)


_ROBOT = SceneEntityCfg("robot")


def randomize_bus_voltage(
    env: Any,
    env_ids: torch.Tensor | None,
    voltage_range: tuple[float, float],
    asset_cfg: SceneEntityCfg = _ROBOT,
) -> None:
    """An mjlab event: one bus voltage an environment, shared by all its motors.

    It is uniform between least and greatest [V]; ``env_ids`` is ``None`` for all environments.
    """
    low, high = voltage_range
    check_positive("voltage_range", low, "V")
    check_range("voltage_range", high, low, 2000.0, "V")
    if env_ids is None:
        env_ids = torch.arange(env.num_envs, device=env.device)
    motors = [item for item in env.scene[asset_cfg.name].actuators if isinstance(item, PmsmActuator)]
    if not motors:
        raise InvalidValueError("asset_cfg", asset_cfg.name, "must be an entity with PMSM actuators")
    voltage = low + (high - low) * torch.rand(len(env_ids), device=env.device)
    for motor in motors:
        motor.set_bus_voltage(env_ids, voltage)
