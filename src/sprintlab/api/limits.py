"""``limit`` and ``audit_rollout``: what motors allow a robot, and what a recording asks of them."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from sprintlab import speed_limit as limits
from sprintlab.api.motors import chosen_motor
from sprintlab.api.results import Drawn, Progress, drawn, quantities, records, silent
from sprintlab.core.arguments import checked
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.deployment import log as logs
from sprintlab.evaluation.rollouts import Rollout, load_rollout
from sprintlab.motors.voltage import check_bus_voltage
from sprintlab.robots import JointMotors, load_robot, robot_motors, robot_names

UNITS = {
    "frequency": "Hz", "step": "m", "peak_force": "body weights", "positive_power": "W", "copper_loss": "W",
    "mechanical_power": "W", "envelope_power": "W", "hottest_loss": "W", "duration": "s", "speed": "m/s",
    "slip": "m", "stance": "s",
}  # fmt: skip
"""Units of a stride's and a rollout's numbers by their names."""


@checked
def limit(
    robot: str | Path = "bp2",
    *,
    quick: bool = False,
    starts: int = 6,
    max_stride: float | None = None,
    min_duty: float | None = None,
    progress: Progress = silent,
) -> Drawn:
    """Estimate how fast a robot can run at most, from its motors and legs alone.

    Example: sprintlab limit bp2 --max-stride 5.5 --min-duty 0.12

    Args:
        robot: name of a robot, or the path of its folder or table.
        quick: only the limit and its stride: no causes, no sensitivities.
        starts: random strides from which the search begins; with more it finds slightly higher speeds.
        max_stride: highest stride frequency that counts [Hz]; what the motors allow when left out.
        min_duty: lowest share of a stride in which a foot stands; what the motors allow when left out.
    """
    described = load_robot(robot)
    found = limits.speed_limit(
        described,
        settings=limits.SearchSettings(starts=starts, max_stride=max_stride, min_duty=min_duty),
        quick=quick,
        progress=progress,
    )
    numbers = {
        "robot": found.robot,
        "speed_limit_m_s": found.speed,
        "cause": found.cause,
        "stride": asdict(found.facts),
        "limit_without": [asdict(item) for item in found.lifted],
        "sensitivities": [asdict(item) for item in found.sensitivities],
    }
    shown: list[RenderableType] = [quantities("Speed limit (estimate)", numbers, units=UNITS)]
    for title in ("limit_without", "sensitivities"):
        if numbers[title]:
            shown.append(records(f"\n{title.replace('_', ' ')}, speeds in m/s", numbers[title]))
    draw = drawn("speed_limit.figure.limit_figure", found, limits.runner_from_robot(described))
    return Drawn(numbers=numbers, shown=shown, found=found, draw=draw)


@checked
def audit_rollout(
    rollout: Path | str,
    *,
    motor: str,
    joint: str | None = None,
    bus_voltage: float | None = None,
    gear_ratio: float | None = None,
    gear_efficiency: float | None = None,
) -> Drawn:
    """Check how much of a rollout's torque a motor could not give; any simulator may have recorded it.

    A robot's motors are matched to the recording's joint names, in any order.
    Example: sprintlab audit rollout.npz --motor go1 --figure rollout.png

    Args:
        rollout: CSV or NPZ (columns: docs/check-your-policy.md), or a log of sprintlab run (MCAP).
        motor: a motor file, a data sheet, an actuator of the library, or a robot with all its motors.
        joint: joint whose motor all joints of the robot get (abad, hip or knee).
    """
    from sprintlab.evaluation.rollout_audit import audit_rollout as audit

    if bus_voltage is not None:
        check_bus_voltage(bus_voltage)
    recorded, assumed = _read_rollout(Path(rollout)), ()
    if motor in robot_names() and joint is None:
        motors = robot_motors(motor)
        given = {"ratio": gear_ratio, "efficiency": gear_efficiency}
        gear = replace(motors.gear, **{name: value for name, value in given.items() if value is not None})
        motors = replace(motors, gear=gear, bus_voltage=bus_voltage or motors.bus_voltage)
        if not recorded.joint_names:
            count, names = len(recorded.names), ", ".join(motors.names)
            if count != len(motors.names):
                allowed = f"the recording must name its joints: it has {count}, and {motor} has {names}"
                raise InvalidValueError("joint_names", None, allowed)
            recorded, assumed = replace(recorded, joint_names=motors.names), motors.names
    else:
        drive = chosen_motor(motor, joint or "", bus_voltage, gear_ratio, gear_efficiency).drive
        motors = JointMotors(motor=drive.motor, gear=drive.gear, bus_voltage=drive.bus_voltage)
    verdict = audit(recorded, motors)
    numbers = {"sentence": verdict.sentence, "assumed_order": assumed, **asdict(verdict)}
    gears = " and ".join(f"{ratio:g}" for ratio in sorted({*np.ravel(motors.gear.ratio).tolist()}))
    whole = {name: value for name, value in numbers.items() if name != "sentence"}
    shown: list[RenderableType] = [
        records(f"Motors at {motors.bus_voltage:g} V, gear {gears}: shares, N m and W", numbers["joints"]),
        quantities("\nThe whole rollout", whole, units=UNITS),
    ]
    if assumed:
        shown.append(f"joint_names was not recorded; assumed order of joints: {', '.join(assumed)}")
    if recorded.foot_contact is None:
        shown.append("stance and slip: foot_contact was not recorded")
    if verdict.unused_feet:
        shown.append(f"never on the ground: {', '.join(verdict.unused_feet)}")
    shown.append(Text(verdict.sentence, style="bold"))
    draw = drawn("evaluation.rollout_audit.rollout_figure", recorded, motors.ordered(recorded.names))
    return Drawn(numbers=numbers, shown=shown, found=verdict, draw=draw)


def _read_rollout(path: Path) -> Rollout:
    """A rollout from CSV, NPZ or the log of a run (MCAP), whose joints are its robot's."""
    if path.suffix.lower() == ".onnx":
        raise SprintlabError(
            f"{path} is a policy, not a rollout: sprintlab race judges a policy of this package; "
            "record a rollout of any other (docs/check-your-policy.md)"
        )
    if path.suffix.lower() != ".mcap":
        return load_rollout(path)
    record = logs.read_log(path)
    robot = record.facts["robot"]
    return Rollout(
        time=record.states.time,
        joint_velocity=record.column("states", "joint_velocity"),
        joint_torque=record.column("states", "joint_torque"),
        joint_names=load_robot(robot).joint_names if robot in robot_names() else (),
    )
