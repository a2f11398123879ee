"""``audit_rollout``: somebody else's rollout against a motor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from sprintlab.api.motors import chosen_motor
from sprintlab.api.tables import Drawn, in_notebook, plain_table
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_range
from sprintlab.core.errors import InvalidValueError, SprintlabError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.evaluation.rollout_audit import RolloutVerdict
    from sprintlab.evaluation.rollouts import Rollout
    from sprintlab.robots import JointMotors


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AuditedRollout(Drawn):
    """How much of a rollout's torque the motors cannot give, joint by joint."""

    rollout: Rollout
    """The recording."""
    verdict: RolloutVerdict
    """Shares, powers and stances."""
    motors: JointMotors
    """One motor, or one per joint in the order of the recording's columns."""
    assumed_order: tuple[str, ...] = ()
    """Joints that the columns were taken for, where the recording names none."""

    def to_dict(self) -> dict[str, Any]:
        """The verdict, what it says in one sentence, and the order of joints that was assumed, if one was."""
        return {
            "sentence": self.verdict.sentence,
            "assumed_order": self.assumed_order,
            **asdict(self.verdict),
        }

    def tables(self) -> Iterator[RenderableType]:
        """One row per joint, then the whole robot and the sentence."""
        verdict = self.verdict
        columns = (
            "impossible",
            "past v_d = 0 too",
            "most too much",
            "over-speed",
            "speed / no-load",
            "power",
            "heat",
        )
        gears = " and ".join(f"{ratio:g}" for ratio in np.unique(self.motors.gear.ratio))
        title = f"{verdict.duration:.1f} s against motors at {self.motors.bus_voltage:g} V, gear {gears}"
        table = plain_table(title, "joint", *columns, numbers=columns)
        for joint in verdict.joints:
            table.add_row(
                joint.name,
                f"{joint.impossible:.1%}",
                f"{joint.impossible - joint.v_d_only:.1%}",
                f"{joint.largest_excess:.1f} N m",
                f"{joint.over_speed:.1%}",
                f"{joint.speed_ratio:.2f}",
                f"{joint.mechanical_power:.0f} W",
                f"{joint.copper_loss:.0f} W",
            )
        yield table
        yield "power and heat: of the torque that the motor can give; heat: copper loss"
        if self.assumed_order:
            yield f"joint_names was not recorded; assumed order of joints: {', '.join(self.assumed_order)}"
        if verdict.speed is not None:
            yield f"mean forward speed: {verdict.speed:.2f} m/s"
        yield from self._feet()
        yield Text(verdict.sentence, style="bold")

    def _feet(self) -> Iterator[str]:
        """Stance and slip, or why there is neither."""
        verdict = self.verdict
        if self.rollout.foot_contact is None:
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

    def plot(self) -> Figure:
        """Torque over speed of every joint, with its envelope."""
        from sprintlab.evaluation.rollout_audit import rollout_figure

        return in_notebook(rollout_figure(self.rollout, self.motors))


@checked
def audit_rollout(
    rollout: Path | str,
    motor: str,
    *,
    joint: str | None = None,
    bus_voltage: float | None = None,
    gear_ratio: float | None = None,
    gear_efficiency: float | None = None,
    policy_rate: float = 50.0,
) -> AuditedRollout:
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
    from sprintlab.evaluation.rollout_audit import audit_rollout as audit
    from sprintlab.motors.voltage import check_bus_voltage
    from sprintlab.robots import JointMotors, robot_motors, robot_names

    if bus_voltage is not None:
        check_bus_voltage(bus_voltage)
    check_range("policy_rate", policy_rate, 1.0, 10_000.0, "Hz")
    recorded, assumed = read_rollout(Path(rollout)), ()
    if motor in robot_names() and joint is None:
        motors = robot_motors(motor)
        given = {"ratio": gear_ratio, "efficiency": gear_efficiency}
        gear = replace(motors.gear, **{name: value for name, value in given.items() if value is not None})
        motors = replace(motors, gear=gear, bus_voltage=bus_voltage or motors.bus_voltage)
        if not recorded.joint_names:
            if len(recorded.names) != len(motors.names):
                allowed = (
                    f"needed: {len(recorded.names)} columns cannot be those of {', '.join(motors.names)}"
                )
                raise InvalidValueError("joint_names", None, allowed)
            recorded = replace(recorded, joint_names=motors.names)
            assumed = motors.names
    else:
        drive = chosen_motor(motor, joint or "", bus_voltage, gear_ratio, gear_efficiency).drive
        motors = JointMotors(motor=drive.motor, gear=drive.gear, bus_voltage=drive.bus_voltage)
    verdict = audit(recorded, motors, policy_rate)
    motors = motors.ordered(recorded.names)
    return AuditedRollout(rollout=recorded, verdict=verdict, motors=motors, assumed_order=assumed)


def read_rollout(path: Path) -> Rollout:
    """A rollout from CSV, NPZ or the log of a run (MCAP), whose joints are its robot's.

    Raises:
        SprintlabError: a policy file, or as ``load_rollout`` and ``read_log``.
    """
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
