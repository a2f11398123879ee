"""``limit`` and ``audit_rollout``: what motors allow a robot, and what a recording asks of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from sprintlab.api.motors import chosen_motor
from sprintlab.api.results import Drawn, Progress, silent, table
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_range
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.reading import check_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.evaluation.rollout_audit import RolloutVerdict
    from sprintlab.evaluation.rollouts import Rollout
    from sprintlab.speed_limit import SpeedLimit

FACTS = {
    # field of StrideFacts: (what it is, format, unit)
    "frequency": ("stride frequency", ".2f", "Hz"),
    "duty": ("duty factor", ".3f", ""),
    "step": ("way over a standing foot", ".3f", "m"),
    "peak_force": ("peak force on a foot", ".2f", "body weights"),
    "impact": ("impulse taken at touchdown", ".0%", ""),
    "hip_speed": ("hip, greatest speed over no-load speed", ".2f", ""),
    "knee_speed": ("knee, greatest speed over no-load speed", ".2f", ""),
    "hip_full": ("hip, share of the stride at its limit", ".0%", ""),
    "knee_full": ("knee, share of the stride at its limit", ".0%", ""),
    "positive_power": ("mean driving power, all drives", ".0f", "W"),
    "mechanical_power": ("mean power less braking", ".0f", "W"),
    "copper_loss": ("mean heat in the windings", ".0f", "W"),
    "envelope_power": ("greatest power of the envelopes", ".0f", "W"),
    "cost_of_transport": ("cost of transport", ".2f", ""),
}


@checked
def limit(
    robot: str | Path = "bp2",
    *,
    factors: Sequence[float] = (0.9, 1.1),
    quick: bool = False,
    starts: int = 6,
    max_stride: float | None = None,
    min_duty: float | None = None,
    seed: int = 0,
    results: Path | str | None = None,
    progress: Progress = silent,
) -> Drawn:
    """Estimate from above how fast a robot can run, from its motors and legs alone.

    Args:
        robot: name of a robot, or the path of its folder or table.
        factors: factors on bus voltage, gear ratio, leg length and mass; none: no sensitivities.
        quick: only the limit and its stride: no causes, no sensitivities.
        starts: random strides to begin from; more find a little more.
        max_stride: highest stride frequency that counts [Hz]; what the motors allow when left out.
        min_duty: lowest share of a stride in which a foot stands; what the motors allow when left out.
        seed: seed of the random strides.
        results: folder whose result.json files, at most 16 MB, say what trained policies reach; results,
            where there is one, when left out.
        progress: called with what is being done and the share done.

    Raises:
        SprintlabError: an unknown robot, a bad option, no such folder, or too many results.
    """
    if results is not None:
        check_folder(results)
    from sprintlab.robots import load_robot
    from sprintlab.speed_limit import LIMITS_TO_LIFT, SearchSettings, speed_limit, trained_speeds

    def draw() -> Figure:
        from sprintlab.speed_limit import runner_from_robot
        from sprintlab.speed_limit.figure import limit_figure

        return limit_figure(found, runner_from_robot(described))

    described = load_robot(robot)
    found = speed_limit(
        described,
        settings=SearchSettings(starts=starts, seed=seed, max_stride=max_stride, min_duty=min_duty),
        factors=() if quick else factors,
        causes=() if quick else tuple(LIMITS_TO_LIFT),
        trained=trained_speeds(Path(results or "results"), described.name),
        progress=progress,
    )
    numbers = {
        "robot": found.robot,
        "speed_limit_m_s": found.speed,
        "cause": found.cause,
        "stride": asdict(found.facts),
        "limit_without": [asdict(item) for item in found.lifted],
        "sensitivities": [asdict(item) for item in found.sensitivities],
        "trained": [asdict(item) for item in found.trained],
    }
    stopped = [] if found.cause is None else [f"What stops it: {found.cause}."]
    return Drawn(numbers=numbers, shown=[_limit_table(found), *stopped], found=found, draw=draw)


def _limit_table(limit: SpeedLimit) -> Table:
    made = table(f"Speed limit of {limit.robot}", "quantity", "value", "unit")
    made.add_row("speed limit (upper estimate)", f"{limit.speed:.2f}", "m/s")
    for item in limit.trained:
        made.add_row(f"policy {item.policy} holds", f"{item.speed:.2f}", "m/s")
    for field, (what, style, unit) in FACTS.items():
        made.add_row(what, format(getattr(limit.facts, field), style), unit)
    for item in limit.lifted:
        sign = "" if item.bounded else "> "
        made.add_row(f"limit without {item.cause}", f"{sign}{item.speed:.2f}", "m/s")
    for item in limit.sensitivities:
        made.add_row(f"limit with {item.quantity} x {item.factor:g}", f"{item.speed:.2f}", "m/s")
    return made


@checked
def audit_rollout(
    rollout: Path | str,
    *,
    motor: str,
    joint: str | None = None,
    bus_voltage: float | None = None,
    gear_ratio: float | None = None,
    gear_efficiency: float | None = None,
    policy_rate: float = 50.0,
) -> Drawn:
    """How much of a policy's torque its motors cannot give: any simulator's rollout against a motor.

    Reads CSV and NPZ (columns: docs/check-your-policy.md) and the logs of `sprintlab run` (MCAP). A robot's
    motors are matched to the recording's joint names, in any order.

    Args:
        rollout: the recording.
        motor: a motor file or a data sheet (.toml), an actuator of `sprintlab motor library`, or a robot of
            the package with each joint its own motor.
        joint: of a robot: give all joints this one's motor (abad, hip or knee).
        bus_voltage: [V]; the robot's or actuator's when left out, needed for a file.
        gear_ratio: the robot's, actuator's or data sheet's when left out; 1 for a motor file.
        gear_efficiency: likewise.
        policy_rate: decisions of the policy per second, for the stances [Hz].

    Raises:
        SprintlabError: the recording or the motor cannot be used, or its joint names fit no motor.
    """
    import numpy as np

    from sprintlab.evaluation.rollout_audit import audit_rollout as audit
    from sprintlab.motors.voltage import check_bus_voltage
    from sprintlab.robots import JointMotors, robot_motors, robot_names

    def draw() -> Figure:
        from sprintlab.evaluation.rollout_audit import rollout_figure

        return rollout_figure(recorded, motors.ordered(recorded.names))

    if bus_voltage is not None:
        check_bus_voltage(bus_voltage)
    check_range("policy_rate", policy_rate, 1.0, 10_000.0, "Hz")
    recorded, assumed = _read_rollout(Path(rollout)), ()
    if motor in robot_names() and joint is None:
        motors = robot_motors(motor)
        given = {"ratio": gear_ratio, "efficiency": gear_efficiency}
        gear = replace(motors.gear, **{name: value for name, value in given.items() if value is not None})
        motors = replace(motors, gear=gear, bus_voltage=bus_voltage or motors.bus_voltage)
        if not recorded.joint_names:
            count, names = len(recorded.names), ", ".join(motors.names)
            if count != len(motors.names):
                allowed = f"needed: {count} columns cannot be those of {names}"
                raise InvalidValueError("joint_names", None, allowed)
            recorded, assumed = replace(recorded, joint_names=motors.names), motors.names
    else:
        drive = chosen_motor(
            motor,
            joint or "",
            bus_voltage=bus_voltage,
            gear_ratio=gear_ratio,
            gear_efficiency=gear_efficiency,
        ).drive
        motors = JointMotors(motor=drive.motor, gear=drive.gear, bus_voltage=drive.bus_voltage)
    verdict = audit(recorded, motors, policy_rate)
    numbers = {"sentence": verdict.sentence, "assumed_order": assumed, **asdict(verdict)}
    gears = " and ".join(f"{ratio:g}" for ratio in sorted({*np.ravel(motors.gear.ratio).tolist()}))
    title = f"{verdict.duration:.1f} s against motors at {motors.bus_voltage:g} V, gear {gears}"
    shown: list[RenderableType] = [*_verdict_shown(title, verdict, assumed), *_feet(recorded, verdict)]
    return Drawn(
        numbers=numbers, shown=[*shown, Text(verdict.sentence, style="bold")], found=verdict, draw=draw
    )


def _read_rollout(path: Path) -> Rollout:
    """A rollout from CSV, NPZ or the log of a run (MCAP), whose joints are its robot's."""
    from sprintlab.evaluation.rollouts import Rollout, load_rollout
    from sprintlab.robots import load_robot, robot_names

    if path.suffix.lower() == ".onnx":
        raise SprintlabError(
            f"{path} is a policy, not a rollout: sprintlab race judges a policy of this package; "
            "record a rollout of any other (docs/check-your-policy.md)"
        )
    if path.suffix.lower() != ".mcap":
        return load_rollout(path)
    from sprintlab.deployment.log import read_log

    record = read_log(path)
    robot = record.facts["robot"]
    return Rollout(
        time=record.state_time,
        joint_velocity=record.column("states", "joint_velocity"),
        joint_torque=record.column("states", "joint_torque"),
        joint_names=load_robot(robot).joint_names if robot in robot_names() else (),
    )


def _verdict_shown(title: str, verdict: RolloutVerdict, assumed: Sequence[str]) -> Iterator[RenderableType]:
    """One row per joint, then the whole robot."""
    columns = (
        "impossible", "past v_d = 0 too", "most too much", "over-speed", "speed / no-load", "power", "heat"
    )  # fmt: skip
    rows = (
        (
            joint.name,
            f"{joint.impossible:.1%}",
            f"{joint.impossible - joint.v_d_only:.1%}",
            f"{joint.largest_excess:.1f} N m",
            f"{joint.over_speed:.1%}",
            f"{joint.speed_ratio:.2f}",
            f"{joint.mechanical_power:.0f} W",
            f"{joint.copper_loss:.0f} W",
        )
        for joint in verdict.joints
    )
    yield table(title, "joint", *columns, numbers=columns, rows=rows)
    yield "power and heat: of the torque that the motor can give; heat: copper loss"
    if assumed:
        yield f"joint_names was not recorded; assumed order of joints: {', '.join(assumed)}"
    if verdict.speed is not None:
        yield f"mean forward speed: {verdict.speed:.2f} m/s"


def _feet(rollout: Rollout, verdict: RolloutVerdict) -> Iterator[str]:
    """Stance and slip, or why there is neither."""
    if rollout.foot_contact is None:
        yield "stance and slip: foot_contact was not recorded"
        return
    if verdict.unused_feet:
        yield f"never on the ground: {', '.join(verdict.unused_feet)}"
    if verdict.stance is None or verdict.stance_periods is None:
        yield "stance and slip: no foot both touches down and lifts off"
        return
    yield f"median stance: {1000 * verdict.stance:.0f} ms"
    yield f"policy periods in it: {verdict.stance_periods:.1f}"
    if verdict.slip is not None:
        yield f"slip of a foot in one stance: {1000 * verdict.slip:.1f} mm"
