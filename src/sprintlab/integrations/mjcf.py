"""Plain MuJoCo: the motor law as a control callback, and a motor as ``<dcmotor>`` with what that loses.

MuJoCo's own motor is ``tau = K (v - K omega) / R`` between a least and a greatest voltage and torque. A
permanent-magnet motor becomes one by the power-invariant transformation: ``K = sqrt(3/2) N psi``, the same
resistance, and ``sqrt(3/2)`` times the phase voltage. What has no place in it: the inductance, the
saturation, the gear's losses.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np

from sprintlab.core.errors import InvalidValueError
from sprintlab.motors import (
    Gear,
    MotorModel,
    PmsmParameters,
    drive_torque,
    no_load_speed,
    phase_voltage_limit,
    single,
)
from sprintlab.motors.arrays import Array
from sprintlab.robots import JointMotors

_POWER_INVARIANT = math.sqrt(1.5)
_SPEEDS = 401


@dataclass(frozen=True, kw_only=True)
class DcMotor:
    """MuJoCo's ``<dcmotor>`` that is nearest to a geared motor; plain numbers, motor side."""

    constant: float  # torque and back-EMF constant K [N m/A = V s/rad]
    resistance: float  # [ohm]
    voltage: float  # greatest input [V]
    peak_torque: float  # [N m]
    ratio: float  # of the gear [-]
    rotor_inertia: float  # [kg m^2]; MuJoCo makes it the joint's armature with the ratio's square

    def element(self, joint: str, name: str = "") -> str:
        """The line of MJCF for one joint (MuJoCo 3.11); its control is a voltage [V], see ``control``."""
        named = f" name={quoteattr(name)}" if name else ""
        return (
            f"<dcmotor{named} joint={quoteattr(joint)} gear='{self.ratio!r}' "
            f"motorconst='{self.constant!r} {self.constant!r}' resistance='{self.resistance!r}' "
            f"ctrlrange='{-self.voltage!r} {self.voltage!r}' saturation='{self.peak_torque!r}' "
            f"armature='{self.rotor_inertia!r}'/>"
        )

    def control(self, desired_joint_torque: Array, joint_velocity: Array) -> Array:
        """Voltage [V] with which the motor gives a joint torque [N m] at a joint velocity [rad/s], broadcast.

        MuJoCo clips it to the range of the element, and with it the torque: this is the whole envelope.
        """
        current = desired_joint_torque / (self.ratio * self.constant)
        return current * self.resistance + self.constant * self.ratio * joint_velocity


def dc_motor(motor: PmsmParameters, gear: Gear, bus_voltage: float) -> DcMotor:
    """The ``<dcmotor>`` of a geared motor on a bus [V]."""
    for name, value in (("motor", motor.peak_torque), ("gear", gear.ratio)):
        if np.ndim(value) > 0:
            raise InvalidValueError(name, value, "must be one motor: make an element for each kind")
    return DcMotor(
        constant=float(_POWER_INVARIANT * motor.pole_pairs * motor.flux_linkage),
        resistance=float(motor.stator_resistance),
        voltage=float(_POWER_INVARIANT * phase_voltage_limit(float(bus_voltage))),
        peak_torque=float(motor.peak_torque),
        ratio=float(gear.ratio),
        rotor_inertia=float(motor.rotor_inertia),
    )


def dc_motors(motors: JointMotors, joint_names: Sequence[str]) -> dict[str, DcMotor]:
    """The ``<dcmotor>`` of each joint by its name, in the names' order."""
    found = motors.ordered(joint_names)
    parts = (
        (single(found.motor, at), single(found.gear, at), found.bus_voltage) for at in range(len(joint_names))
    )
    return dict(zip(joint_names, (dc_motor(*each) for each in parts), strict=True))


def dc_motor_excess(motor: PmsmParameters, gear: Gear, bus_voltage: float) -> dict[str, float]:
    """Torque that a ``<dcmotor>`` gives and the motor does not, in shares of its peak torque on the joint.

    Over joint speeds from standstill to no load, at full torque: ``driving`` and ``braking`` are the greatest
    differences, ``driving_mean`` is that over all speeds; ``stalled`` is what saturation alone takes.
    """
    element = dc_motor(motor, gear, bus_voltage)
    speed = np.linspace(0.0, float(no_load_speed(motor, bus_voltage)) / element.ratio, _SPEEDS)
    peak = element.peak_torque * element.ratio
    given, wanted = {}, np.full(_SPEEDS, peak)
    for way, sign in (("driving", 1.0), ("braking", -1.0)):
        volts = np.clip(element.control(sign * wanted, speed), -element.voltage, element.voltage)
        simple = element.constant * (volts - element.constant * element.ratio * speed) / element.resistance
        real = drive_torque(motor, gear, sign * wanted, speed, bus_voltage).torque
        given[way] = (
            sign * (np.clip(simple, -element.peak_torque, element.peak_torque) * element.ratio - real) / peak
        )
    return {
        "driving": float(given["driving"].max()),
        "driving_mean": float(given["driving"].mean()),
        "braking": float(given["braking"].max()),
        "stalled": float(given["driving"][0]),
    }


@contextmanager
def motor_callback(
    model: mujoco.MjModel,
    wanted: Callable[[mujoco.MjData], Array],
    motors: JointMotors,
    motor_model: MotorModel = "refined",
) -> Generator[None, None, None]:
    """MuJoCo's control callback, for as long as the context lasts: every step goes through the motor law.

    For simulations that others step (a viewer, a planner). Actuators are ``<motor>``, one per hinge joint;
    MuJoCo has one callback for all simulations of a process.

    Args:
        model: that is simulated; the motors are found by the names of its actuators' joints.
        wanted: ``MjData`` -> wanted joint torques [N m] ``(n,)`` in the actuators' order, e.g. a PD loop.
        motors: by joint name, or one for all joints.
        motor_model: one of ``MOTOR_MODELS``.
    """
    joints = model.actuator_trnid[:, 0]
    dofs = model.jnt_dofadr[joints]
    own = motors.ordered([model.joint(joint).name for joint in joints])

    def control(_: mujoco.MjModel, data: mujoco.MjData) -> None:
        velocity = data.qvel[dofs]
        output = drive_torque(own.motor, own.gear, wanted(data), velocity, own.bus_voltage, motor_model)
        data.ctrl[:] = output.torque

    before = mujoco.get_mjcb_control()
    mujoco.set_mjcb_control(control)
    try:
        yield
    finally:
        mujoco.set_mjcb_control(before)
