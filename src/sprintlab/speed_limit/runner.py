"""A robot as the search for its fastest stride sees it: one leg in the sagittal plane, motors, mass."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from sprintlab.motors import Gear, MotorModel, PmsmParameters, joint_torque, saturate, torque_limits
from sprintlab.robots import AIR_DENSITY, KneeSpring, RobotDescription
from sprintlab.speed_limit.leg import FloatArray, PlanarLeg, planar_leg

_HALF_TURN = 2.0  # joint speed over which dry friction turns round [rad/s]


@dataclass(frozen=True, kw_only=True)
class Runner:
    """What a stride needs to know of a robot."""

    leg: PlanarLeg  # kinematics and inertia of a leg in the sagittal plane
    motors: PmsmParameters  # motors of hip and knee, each field ``(2,)``
    gear: Gear  # gears of hip and knee, each field ``(2,)``
    bus_voltage: float  # [V]
    viscous_friction: FloatArray  # viscous friction of hip and knee ``(2,)`` [N m s/rad]
    dry_friction: FloatArray  # dry friction of hip and knee ``(2,)`` [N m]
    position_limits: FloatArray  # that the stride keeps to, end stops left out ``(2, 2)`` [rad]
    mass: float  # mass of the robot [kg]
    legs: int  # number of legs that share the load
    foot_friction: float  # sliding friction coefficient
    drag_area: float  # drag coefficient times frontal area in still air [m^2]; 0 on a treadmill
    knee_spring: KneeSpring | None  # series spring between the knee's drive and the shank; None without one
    # torque limits of the motors, one of ``sprintlab.motors.MOTOR_MODELS``
    motor_model: MotorModel = "refined"

    @cached_property
    def peak_torque(self) -> FloatArray:
        """Greatest driving torque of hip and knee near standstill ``(2,)`` [N m]."""
        upper = torque_limits(self.motors, np.zeros(2), self.bus_voltage, self.motor_model)[1]
        return np.asarray(joint_torque(self.gear, saturate(self.motors, upper)))

    def joint_limits(self, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Least and greatest torque at the joints ``(..., 2)`` [N m]: envelope, saturation, gear."""
        ratio = np.asarray(self.gear.ratio)
        lower, upper = torque_limits(self.motors, velocity * ratio, self.bus_voltage, self.motor_model)
        least, greatest = (
            np.asarray(joint_torque(self.gear, saturate(self.motors, limit), velocity))
            for limit in (lower, upper)
        )
        return least, greatest

    def friction(self, velocity: FloatArray) -> FloatArray:
        """Torque that the joints' friction takes ``(..., 2)`` [N m]."""
        return self.viscous_friction * velocity + self.dry_friction * np.tanh(velocity / _HALF_TURN)

    def air_drag(self, speed: FloatArray) -> FloatArray:
        """Force with which still air holds the robot back at a speed [N]."""
        return 0.5 * AIR_DENSITY * self.drag_area * speed**2


def runner_from_robot(robot: RobotDescription) -> Runner:
    """The sagittal plane of a robot: hip and knee of its first leg stand for all; a waist is straight."""
    pick = robot.leg_joints[0, 1:]
    motors = {
        item.name: np.asarray(getattr(robot.motors, item.name))[pick] for item in fields(PmsmParameters)
    }
    zone = robot.soft_stop.zone
    return Runner(
        leg=planar_leg(robot),
        motors=PmsmParameters(**motors),
        gear=Gear(
            ratio=np.asarray(robot.gear.ratio)[pick], efficiency=np.asarray(robot.gear.efficiency)[pick]
        ),
        bus_voltage=float(robot.bus_voltage),
        viscous_friction=robot.viscous_friction[pick],
        dry_friction=robot.dry_friction[pick],
        position_limits=robot.position_limits[pick] + np.array((zone, -zone)),
        mass=robot.total_mass,
        legs=len(robot.leg_names),
        foot_friction=robot.foot_friction,
        drag_area=robot.drag_area,
        knee_spring=robot.mechanics.knee_spring,
    )
