"""The motor law as a clamping stage of Newton's actuators (Newton 1.8, experimental there).

Newton's actuators know no gear ratio; this stage does: the drive's wanted joint torque goes down the gear,
into the voltage limit, through saturation, and up again with the gear's losses. The law is that of
``motors.drive_torque`` in a second form, a Warp kernel, because Newton captures its actuators in CUDA graphs;
a test proves the two equal on random inputs.
"""

from __future__ import annotations

# Warp rewrites kernels from their source; their types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportMissingImports=false
from dataclasses import fields
from typing import Any

import numpy as np
import warp as wp
from newton.actuators import ClampingBase

from sprintlab.core.checks import check_choice, check_positive
from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import TURNING_SPEED, PmsmParameters, phase_voltage_limit

MODELS = ("refined", "simplified-dc")
"""Voltage limits that the stage has."""

_VOLTAGE_PER_BUS = phase_voltage_limit(1.0)
_PARAMETERS = (
    *(item.name for item in fields(PmsmParameters) if item.name != "rotor_inertia"),
    "gear_ratio",
    "gear_efficiency",
    "bus_voltage",
)


@wp.kernel
def _motor_law(
    velocities: wp.array(dtype=float),
    velocity_indices: wp.array(dtype=wp.uint32),
    pole_pairs: wp.array(dtype=float),
    stator_resistance: wp.array(dtype=float),
    q_axis_inductance: wp.array(dtype=float),
    flux_linkage: wp.array(dtype=float),
    peak_torque: wp.array(dtype=float),
    saturation: wp.array(dtype=float),
    gear_ratio: wp.array(dtype=float),
    gear_efficiency: wp.array(dtype=float),
    bus_voltage: wp.array(dtype=float),
    wanted: wp.array(dtype=float),
    given: wp.array(dtype=float),
):
    """Joint torque of one motor; formulas and their reasons stand in ``motors.envelope``."""
    i = wp.tid()
    velocity = velocities[velocity_indices[i]]
    ratio, peak, resistance = gear_ratio[i], peak_torque[i], stator_resistance[i]
    electrical_speed = pole_pairs[i] * ratio * velocity
    constant = 1.5 * pole_pairs[i] * flux_linkage[i]
    reactance = electrical_speed * q_axis_inductance[i]
    back_emf = electrical_speed * flux_linkage[i]
    voltage = bus_voltage[i] * wp.static(_VOLTAGE_PER_BUS)
    impedance_squared = resistance * resistance + reactance * reactance
    left = impedance_squared * voltage * voltage - reactance * back_emf * reactance * back_emf
    middle = -constant * resistance * back_emf / impedance_squared
    half_width = constant * wp.sqrt(wp.max(left, 0.0)) / impedance_squared
    lower = wp.clamp(middle - half_width, -peak, peak)
    upper = wp.clamp(middle + half_width, -peak, peak)
    torque = wp.clamp(wanted[i] / ratio, lower, upper)
    torque = torque * (1.0 - saturation[i] * wp.abs(torque) / peak)
    exponent = wp.sign(torque) * wp.tanh(velocity / wp.static(TURNING_SPEED))
    given[i] = torque * ratio * wp.pow(gear_efficiency[i], exponent)


class PmsmClamping(ClampingBase):
    """A geared permanent-magnet motor between a drive's wanted torque and the joint.

    Registered as ``(PmsmClamping, {"motor": motor, "gear": gear, "bus_voltage": 48.0})``, with ``"model"``
    one of ``MODELS``. Every parameter is an array with one value an actuator; change them in place.
    """

    @classmethod
    def resolve_arguments(cls, args: dict[str, Any]) -> dict[str, Any]:
        """Numbers of one actuator out of motor, gear and bus voltage.

        Raises:
            InvalidValueError: something is missing or unknown, several motors in one, a bad voltage or model.
        """
        for name in ("motor", "gear", "bus_voltage"):
            if name not in args:
                raise InvalidValueError(f"PmsmClamping.{name}", None, "must be given")
        check_choice(
            "PmsmClamping", sorted(set(args) - {"motor", "gear", "bus_voltage", "model"}) or "", ("",)
        )
        check_choice("model", args.get("model", "refined"), MODELS)
        check_positive("bus_voltage", args["bus_voltage"], "V")
        motor, gear = args["motor"], args["gear"]
        for name, value in (("motor", motor.peak_torque), ("gear", gear.ratio)):
            if np.ndim(value) > 0:
                raise InvalidValueError(name, value, "must be one motor: register each kind of its own")
        own = {
            "gear_ratio": gear.ratio,
            "gear_efficiency": gear.efficiency,
            "bus_voltage": args["bus_voltage"],
        }
        numbers = {name: float(own[name] if name in own else getattr(motor, name)) for name in _PARAMETERS}
        if args.get("model") == "simplified-dc":
            numbers["q_axis_inductance"] = 0.0
        return numbers

    def __init__(self, **parameters: Any) -> None:
        """Arrays of floats ``(n,)``, one for each name that ``resolve_arguments`` gives."""
        for name in _PARAMETERS:
            setattr(self, name, parameters[name])

    def modify_forces(
        self,
        src_forces: Any,
        dst_forces: Any,
        positions: Any,
        velocities: Any,
        pos_indices: Any,
        vel_indices: Any,
        device: Any = None,
    ) -> None:
        """Wanted joint torques [N m] into those that the motors give, both ``(n,)``."""
        wp.launch(
            _motor_law,
            dim=len(src_forces),
            inputs=[velocities, vel_indices, *(getattr(self, name) for name in _PARAMETERS), src_forces],
            outputs=[dst_forces],
            device=device,
        )
