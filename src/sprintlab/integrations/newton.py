"""The motor law as a clamping stage of Newton's actuators (Newton 1.8, experimental there).

Newton's actuators know no gear ratio; this stage does: the drive's wanted joint torque goes down the gear,
into the voltage limit, through saturation, and up again with the gear's losses. The law is that of
``motors.drive_torque`` in a second form, a Warp kernel, because Newton captures its actuators in CUDA graphs;
a test proves the two equal on random inputs.
"""

from __future__ import annotations

# Warp rewrites kernels from their source; their types are Warp's, not Python's.
# pyright: reportInvalidTypeForm=false, reportMissingImports=false
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import warp as wp
from newton.actuators import ClampingBase

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import TURNING_SPEED, PmsmParameters, phase_voltage_limit
from sprintlab.robots import JointMotors

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

    Registered as ``pmsm_clampings`` gives it. Every parameter is an array with one value per actuator; change
    them in place.
    """

    @classmethod
    def resolve_arguments(cls, args: dict[str, Any]) -> dict[str, Any]:
        """Numbers of one actuator, by the names of ``JointMotors.parameters``."""
        if set(args) != set(_PARAMETERS):
            raise InvalidValueError("PmsmClamping", ", ".join(args), f"needs {', '.join(_PARAMETERS)}")
        return {name: float(args[name]) for name in _PARAMETERS}

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


def pmsm_clampings(
    joint_names: Sequence[str], motors: JointMotors
) -> dict[str, tuple[type[PmsmClamping], dict[str, float]]]:
    """What ``ModelBuilder.add_actuator(..., clamping=[...])`` takes for each joint, by its name."""
    values = motors.parameters(joint_names)
    return {
        joint: (PmsmClamping, {name: float(values[name][at]) for name in _PARAMETERS})
        for at, joint in enumerate(joint_names)
    }
