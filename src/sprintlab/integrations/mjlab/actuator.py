"""The motor law as an mjlab actuator: PD torque, gear, voltage limit, saturation, in one stateless law.

The law is mjlab's ``control_law`` contract, so that groups of joints with different motors are computed
together (``mjlab.actuator.fused_group``). Groups are fused by type: each motor model has a type of its own.
With I²t the level is one more parameter tensor, which the law itself advances: mjlab calls it once a step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cache
from typing import Any, ClassVar, NamedTuple, cast

import numpy as np
import torch
from mjlab.actuator import ActuatorCmd, IdealPdActuator, IdealPdActuatorCfg
from mjlab.actuator.actuator import TransmissionType
from mjlab.actuator.pd_actuator import pd_torque
from mjlab.managers.scene_entity_config import SceneEntityCfg

from sprintlab.core.checks import check_choice, check_positive, check_range
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    MOTOR_MODELS,
    Gear,
    I2tLimit,
    MotorModel,
    MotorValues,
    PmsmParameters,
    drive_torque,
    i2t_decay,
    i2t_drive,
    i2t_time_constant,
    reflected_inertia,
)

_MOTOR_FIELDS = tuple(item.name for item in fields(PmsmParameters))
_OWN_PARAMETERS = (*_MOTOR_FIELDS, "gear_ratio", "gear_efficiency", "bus_voltage")
_I2T_PARAMETERS = ("continuous_current", "i2t_level", "i2t_decay")  # in the order of ``i2t_drive``


@dataclass(kw_only=True)
class PmsmActuatorCfg(IdealPdActuatorCfg):
    """A geared permanent-magnet motor behind a PD loop.

    ``armature`` left at ``None`` becomes the rotor's reflected inertia, ``effort_limit`` (on the torque that
    the PD loop wants) left at infinity the motor's peak torque times the gear ratio. Passive friction stays
    where mjlab has it: ``frictionloss`` and ``viscous_damping``.

    Raises:
        InvalidValueError: several motors in one group, an unknown model, a bad voltage, or a transmission
            that is no joint.
    """

    motor: PmsmParameters
    """Parameters of every motor of the group, plain numbers."""
    gear: Gear
    """Its gear, plain numbers."""
    bus_voltage: float
    """DC bus [V]; see ``randomize_bus_voltage``."""
    model: MotorModel = "refined"
    """Which voltage limit holds: one of ``MOTOR_MODELS``."""
    i2t: I2tLimit | None = None
    """How the drive cuts overloads back, plain numbers; ``None``: the peak current may flow for ever."""

    def __post_init__(self) -> None:
        """Check what mjlab does not, and fill in what follows from motor and gear."""
        check_choice("model", self.model, MOTOR_MODELS)
        check_positive("bus_voltage", self.bus_voltage, "V")
        for name, value in (("motor", self.motor.peak_torque), ("gear", self.gear.ratio)):
            if np.ndim(value) > 0:
                raise InvalidValueError(name, value, "must be one motor: give each kind a group of its own")
        if self.i2t is not None and np.ndim(i2t_time_constant(self.i2t, self.motor)) > 0:
            raise InvalidValueError(
                "i2t", self.i2t, "must be of one motor: give each kind a group of its own"
            )
        if self.transmission_type != TransmissionType.JOINT:
            raise InvalidValueError("transmission_type", self.transmission_type.value, "must be joint")
        if self.armature is None:
            self.armature = float(reflected_inertia(self.gear, self.motor.rotor_inertia))
        if math.isinf(self.effort_limit):
            # The wanted torque, before the gear's losses: with them the motor could never reach its peak.
            self.effort_limit = float(self.motor.peak_torque * self.gear.ratio)
        super().__post_init__()

    def build(self, entity: Any, target_ids: list[int], target_names: list[str]) -> PmsmActuator:
        """The actuator of this group, of the type that stands for ``model``."""
        return actuator_type(self.model, self.i2t is not None)(self, entity, target_ids, target_names)


class PmsmActuator(IdealPdActuator[PmsmActuatorCfg]):
    """Joint torque of a geared motor; every parameter is a tensor ``(environments, joints)``.

    The parameters carry the names of ``PmsmParameters``' fields, and ``gear_ratio``, ``gear_efficiency`` and
    ``bus_voltage``. Change them in place only: mjlab makes them views of the fused group's tensors.
    """

    model: ClassVar[MotorModel] = "refined"
    limited: ClassVar[bool] = False
    param_names = (*IdealPdActuator.param_names, *_OWN_PARAMETERS)

    @classmethod
    def control_law(  # pyright: ignore[reportIncompatibleMethodOverride]  # mjlab calls it on the type
        cls, params: dict[str, torch.Tensor], cmd: ActuatorCmd
    ) -> torch.Tensor:
        """Torque on the joints [N m] ``(environments, joints)``: the PD torque through ``drive_torque``."""
        limit = params["force_limit"]
        desired = torch.clamp(pd_torque(params["stiffness"], params["damping"], cmd), -limit, limit)
        motor = cast("PmsmParameters", MotorValues(*(params[name] for name in _MOTOR_FIELDS)))
        gear = cast("Gear", _GearTensors(params["gear_ratio"], params["gear_efficiency"]))
        asked = (desired, cmd.vel, params["bus_voltage"], cls.model)
        if not cls.limited:
            return drive_torque(motor, gear, *asked).torque
        continuous, level, decay = (params[name] for name in _I2T_PARAMETERS)
        output, level = i2t_drive(motor, gear, continuous, level, decay, *asked)
        params["i2t_level"].copy_(level)
        return output.torque

    def initialize(self, mj_model: Any, model: Any, data: Any, device: str) -> None:
        """Lay out the parameters as tensors, one value an environment and joint."""
        super().initialize(mj_model, model, data, device)
        shape = (data.nworld, len(self.target_names))
        values = {name: getattr(self.cfg.motor, name) for name in _MOTOR_FIELDS}
        values["gear_ratio"] = self.cfg.gear.ratio
        values["gear_efficiency"] = self.cfg.gear.efficiency
        values["bus_voltage"] = self.cfg.bus_voltage
        if self.cfg.i2t is not None:
            values["continuous_current"] = self.cfg.i2t.continuous_current
            values["i2t_decay"] = i2t_decay(self.cfg.i2t, self.cfg.motor, mj_model.opt.timestep)
            values["i2t_level"] = 0.0
        for name, value in values.items():
            setattr(self, name, torch.full(shape, float(value), dtype=torch.float, device=device))

    def reset(self, env_ids: torch.Tensor | slice | None = None) -> None:
        """As mjlab's; the drives of those environments are cold again."""
        super().reset(env_ids)
        if self.limited:
            self.i2t_level[slice(None) if env_ids is None else env_ids] = 0.0

    def set_bus_voltage(self, env_ids: torch.Tensor | slice, voltage: torch.Tensor) -> None:
        """Set the bus voltage [V] of some environments; ``voltage`` is ``(environments,)`` or with joints."""
        self.bus_voltage[env_ids] = voltage.unsqueeze(-1) if voltage.ndim == 1 else voltage


class _GearTensors(NamedTuple):
    """``Gear`` without its checks."""

    ratio: torch.Tensor
    efficiency: torch.Tensor


def actuator_type(model: MotorModel, limited: bool = False) -> type[PmsmActuator]:
    """The actuator type of a motor model, with I²t or without; at every call the same: groups fuse.

    Raises:
        InvalidValueError: the model is unknown.
    """
    check_choice("model", model, MOTOR_MODELS)
    return _actuator_type(model, limited)


@cache
def _actuator_type(model: MotorModel, limited: bool) -> type[PmsmActuator]:
    words = model.title().replace("-", "") + ("I2t" if limited else "")
    names = PmsmActuator.param_names + (_I2T_PARAMETERS if limited else ())
    own = {"model": model, "limited": limited, "param_names": names, "__doc__": PmsmActuator.__doc__}
    return type(f"Pmsm{words}Actuator", (PmsmActuator,), own)


_ROBOT = SceneEntityCfg("robot")


def randomize_bus_voltage(
    env: Any,
    env_ids: torch.Tensor | None,
    voltage_range: tuple[float, float],
    asset_cfg: SceneEntityCfg = _ROBOT,
) -> None:
    """An mjlab event: one bus voltage an environment, shared by all its motors.

    Args:
        env: mjlab's environment.
        env_ids: which environments; all if ``None``.
        voltage_range: least and greatest voltage [V], uniform.
        asset_cfg: the entity whose motors are meant.

    Raises:
        InvalidValueError: the range is not positive or not ordered, or the entity has no such motor.
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
