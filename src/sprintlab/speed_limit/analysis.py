"""The speed limit of a robot: what stops it, and how it moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sprintlab.core.constants import GRAVITY
from sprintlab.motors import Gear, copper_loss, desaturate, shaft_torque
from sprintlab.robots import RobotDescription
from sprintlab.speed_limit.leg import FloatArray, PlanarLink
from sprintlab.speed_limit.runner import Runner, runner_from_robot
from sprintlab.speed_limit.search import Fastest, SearchSettings, fastest_stride
from sprintlab.speed_limit.stride import GROUPS, STANCE_POINTS, Stride, evaluate

Progress = Callable[[str, float | None], None]

_WITHOUT_CEILING = 2.0  # times the limit: how far to look for the next limit when one is taken away
_FULL = 0.98  # a drive works at its limit when it gives more than this share of what it can

FACTORS = (0.9, 1.1)
"""By which the quantities of ``scalings`` are scaled, one at a time."""
LIMITS_TO_LIFT: dict[str, tuple[str, ...]] = {
    "hip torque": ("hip in stance", "hip in swing"),
    "knee torque": ("knee in stance", "knee in swing"),
    "hip torque in stance": ("hip in stance",),
    "hip torque in swing": ("hip in swing",),
    "knee torque in stance": ("knee in stance",),
    "knee torque in swing": ("knee in swing",),
    "joint range and leg length": ("joint range", "leg length"),
    "friction on the ground": ("friction",),
    "the drag of the air": (),
}
"""What is taken away, one at a time, to see what stops the robot: groups of limits, or the air's drag."""


@dataclass(frozen=True, kw_only=True)
class Lifted:
    """The limit when one of its causes is gone."""

    cause: str  # a key of ``LIMITS_TO_LIFT``
    speed: float  # limit without it [m/s]
    bounded: bool  # False where even twice the limit was possible


@dataclass(frozen=True, kw_only=True)
class Sensitivity:
    """The limit of a robot with one quantity scaled."""

    quantity: str  # a key of ``scalings``
    factor: float  # on the quantity
    speed: float  # limit then [m/s]


@dataclass(frozen=True, kw_only=True)
class StrideFacts:
    """What the fastest stride is like."""

    frequency: float  # [Hz]
    duty: float  # share of the stride in which a foot is on the ground
    step: float  # way of the trunk over a standing foot [m]
    peak_force: float  # greatest vertical force on one foot, in weights of the robot
    impact: float  # share of the vertical impulse that comes at touchdown
    hip_speed: float  # greatest speed of the hip's drive over its no-load speed
    knee_speed: float  # the same for the knee's
    hip_full: float  # share of the stride in which the hip's drive gives all it can
    knee_full: float  # the same for the knee's
    mechanical_power: float  # mean of all drives, braking subtracted [W]
    positive_power: float  # mean of all drives, driving only [W]
    copper_loss: float  # mean heat in all windings [W]
    hottest_loss: float  # mean heat in one winding, of a hip or a knee, the greater of both [W]
    envelope_power: float  # greatest mechanical power of all hips and knees together [W]
    cost_of_transport: float  # electrical energy per weight and way


@dataclass(frozen=True, kw_only=True)
class SpeedLimit:
    """The whole answer."""

    robot: str  # its name
    speed: float  # estimate of the top speed [m/s]
    # what stops the robot: the limit whose absence lets it run fastest; None where none was lifted
    cause: str | None
    facts: StrideFacts  # facts of the fastest stride
    stride: Stride  # the fastest stride, a batch of one
    lifted: tuple[Lifted, ...]  # the limit without each cause, in the order of ``LIMITS_TO_LIFT``
    sensitivities: tuple[Sensitivity, ...]  # the limit with one quantity scaled


def speed_limit(
    robot: RobotDescription,
    *,
    settings: SearchSettings | None = None,
    quick: bool = False,
    progress: Progress = lambda what, share: None,
) -> SpeedLimit:
    """Upper estimate of a robot's top speed from its motors and its legs, without any training.

    Args:
        robot: the robot.
        settings: how hard to search.
        quick: without causes and sensitivities.
        progress: called with what is searched for and the share done.

    Raises:
        SimulationError: the motors cannot carry the robot at any speed.
    """
    settings, runner = settings or SearchSettings(), runner_from_robot(robot)
    beside = replace(
        settings, starts=max(2, settings.starts // 2)
    )  # a similar robot's stride is a good start
    causes = () if quick else tuple(LIMITS_TO_LIFT)
    variants = [] if quick else [(name, factor) for name in scalings(runner) for factor in FACTORS]
    progress("speed limit", None)
    best, lifted, sensitivities = fastest_stride(runner, settings), list[Lifted](), list[Sensitivity]()
    for cause in causes:
        progress(f"without {cause}", len(lifted) / (len(causes) + len(variants)))
        lifted.append(_lift(runner, beside, best, cause))
    for name, factor in variants:
        done = len(lifted) + len(sensitivities)
        progress(f"{name} x {factor:g}", done / (len(causes) + len(variants)))
        speed = fastest_stride(scalings(runner)[name](factor), beside, near=(best,)).speed
        sensitivities.append(Sensitivity(quantity=name, factor=factor, speed=speed))
    stride = evaluate(runner, best.parameters[None], best.speed)
    return SpeedLimit(
        robot=robot.name,
        speed=best.speed,
        cause=max(lifted, key=lambda item: item.speed).cause if lifted else None,
        facts=stride_facts(runner, stride, best.speed),
        stride=stride,
        lifted=tuple(lifted),
        sensitivities=tuple(sensitivities),
    )


def _lift(runner: Runner, settings: SearchSettings, best: Fastest, cause: str) -> Lifted:
    kept = [group for group in GROUPS if group not in LIMITS_TO_LIFT[cause]]
    if cause == "the drag of the air":
        runner = replace(runner, drag_area=0.0)
    ceiling = _WITHOUT_CEILING * best.speed
    found = fastest_stride(runner, settings, groups=kept, near=(best,), ceiling=ceiling)
    return Lifted(cause=cause, speed=found.speed, bounded=found.bounded)


def scalings(runner: Runner) -> dict[str, Callable[[float], Runner]]:
    """Robots that differ from ``runner`` in one quantity, by the quantity's name.

    A gear takes the reflected rotor inertia along; a longer leg keeps its masses; mass goes on the trunk.
    """

    def geared(factor: float) -> Runner:
        gear = Gear(ratio=factor * np.asarray(runner.gear.ratio), efficiency=runner.gear.efficiency)
        return replace(runner, gear=gear, leg=replace(runner.leg, armature=factor**2 * runner.leg.armature))

    def stretched(factor: float) -> Runner:
        links = {name: _stretched(getattr(runner.leg, name), factor) for name in ("thigh", "shank")}
        return replace(runner, leg=replace(runner.leg, **links))

    choices: dict[str, Callable[[float], Runner]] = {
        "bus voltage": lambda factor: replace(runner, bus_voltage=factor * runner.bus_voltage),
        "gear ratio": geared,
        "leg length": stretched,
        "mass": lambda factor: replace(runner, mass=factor * runner.mass),
    }
    spring = runner.knee_spring
    if spring is not None:
        choices["knee spring"] = lambda factor: replace(
            runner, knee_spring=replace(spring, stiffness=factor * spring.stiffness)
        )
    return choices


def _stretched(link: PlanarLink, factor: float) -> PlanarLink:
    return replace(
        link,
        length=factor * link.length,
        center_x=factor * link.center_x,
        center_z=factor * link.center_z,
        inertia=factor**2 * link.inertia,
    )


def stride_facts(runner: Runner, stride: Stride, speed: float) -> StrideFacts:
    """Numbers of one stride (a batch of one)."""
    period, duty = float(stride.period[0]), float(stride.duty[0])
    velocity, torque = stride.velocity[0], stride.torque[0]
    power = runner.legs * torque * velocity
    heat = _mean(stride, _copper(runner, torque, velocity))
    peak = runner.peak_torque
    room = np.minimum(stride.upper[0] - torque, torque - stride.lower[0])
    full = _mean(stride, (room < (1.0 - _FULL) * peak).astype(float))
    fastest = np.abs(velocity).max(axis=0) / _no_load(runner)
    weight = runner.mass * GRAVITY
    mechanical, loss = float(_mean(stride, power.sum(-1))), runner.legs * float(heat.sum())
    return StrideFacts(
        frequency=1.0 / period,
        duty=duty,
        step=speed * duty * period,
        peak_force=float(stride.force[0, :, 1].max()) / weight,
        impact=float(stride.impact[0]),
        hip_speed=float(fastest[0]),
        knee_speed=float(fastest[1]),
        hip_full=float(full[0]),
        knee_full=float(full[1]),
        mechanical_power=mechanical,
        positive_power=float(_mean(stride, np.maximum(power, 0.0).sum(-1))),
        copper_loss=loss,
        hottest_loss=float(heat.max()),
        envelope_power=runner.legs * float(_envelope_power(runner).sum()),
        cost_of_transport=(mechanical + loss) / (weight * speed),
    )


def _mean(stride: Stride, values: FloatArray) -> FloatArray:
    """Mean over the stride's time of values at its points ``(p, ...)``."""
    time = stride.time[0]
    halves = [slice(0, STANCE_POINTS), slice(STANCE_POINTS, None)]
    total = sum(np.trapezoid(values[half], time[half], axis=0) for half in halves)
    return np.asarray(total / stride.period[0])


def _copper(runner: Runner, torque: FloatArray, velocity: FloatArray) -> FloatArray:
    """Heat in the windings of hip and knee for their torques and velocities ``(p, 2)`` [W]."""
    on_shaft = shaft_torque(runner.gear, torque, velocity)
    return np.asarray(copper_loss(runner.motors, desaturate(runner.motors, on_shaft)))


def _no_load(runner: Runner) -> FloatArray:
    """Joint speed beyond which the envelope gives no driving torque ``(2,)`` [rad/s]."""
    speeds = _speeds(runner)
    upper = runner.joint_limits(speeds)[1]
    return np.array([speeds[:, joint][upper[:, joint] > 0.0].max() for joint in (0, 1)])


def _envelope_power(runner: Runner) -> FloatArray:
    """Greatest mechanical power of hip and knee ``(2,)`` [W]."""
    speeds = _speeds(runner)
    return (runner.joint_limits(speeds)[1] * speeds).max(axis=0)


def _speeds(runner: Runner) -> FloatArray:
    """Joint speeds ``(2000, 2)`` [rad/s] from standstill beyond any no-load speed."""
    motors, ratio = runner.motors, np.asarray(runner.gear.ratio)
    back_emf = np.asarray(motors.pole_pairs) * np.asarray(motors.flux_linkage) * ratio
    return np.linspace(0.0, 1.0, 2000)[:, None] * runner.bus_voltage / back_emf
