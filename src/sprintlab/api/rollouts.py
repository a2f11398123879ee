"""``audit_rollout``: somebody else's rollout against a motor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType
from rich.text import Text

from sprintlab.api.motors import chosen_motor
from sprintlab.api.tables import Drawn, in_notebook, plain_table
from sprintlab.core.arguments import checked
from sprintlab.core.checks import check_range

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sprintlab.evaluation.rollout_audit import Rollout, RolloutVerdict
    from sprintlab.motors import Gear, PmsmParameters


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AuditedRollout(Drawn):
    """How much of a rollout's torque the motors cannot give, joint by joint."""

    rollout: Rollout
    """The recording."""
    verdict: RolloutVerdict
    """Shares, powers and stances."""
    motor: PmsmParameters
    """One motor, or one per joint."""
    gear: Gear
    """Likewise."""
    bus_voltage: float
    """[V]"""

    def to_dict(self) -> dict[str, Any]:
        """The verdict, and what it says in one sentence."""
        return {"sentence": self.verdict.sentence, **asdict(self.verdict)}

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
        table = plain_table(f"{verdict.duration:.1f} s against the motor", "joint", *columns, numbers=columns)
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
        yield "power and heat: of the torque that the motor can give; heat: copper loss\n"
        for text, value in (
            ("mean forward speed", verdict.speed and f"{verdict.speed:.2f} m/s"),
            ("slip of a foot in one stance", verdict.slip is not None and f"{1000 * verdict.slip:.1f} mm"),
            ("median stance", verdict.stance is not None and f"{1000 * verdict.stance:.0f} ms"),
            ("policy periods in it", verdict.stance_periods is not None and f"{verdict.stance_periods:.1f}"),
        ):
            if value:
                yield f"{text}: {value}"
        yield Text(verdict.sentence, style="bold")

    def plot(self) -> Figure:
        """Torque over speed of every joint, with its envelope."""
        from sprintlab.evaluation.rollout_audit import rollout_figure

        return in_notebook(rollout_figure(self.rollout, self.motor, self.gear, self.bus_voltage))


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

    Reads CSV and NPZ (columns: docs/check-your-policy.md) and the logs of `sprintlab run` (MCAP).

    Args:
        rollout: the recording.
        motor: a motor file or a data sheet (.toml), an actuator of `sprintlab motor library`, or a robot of
            the package with each joint its own motor.
        joint: of a robot: give all joints this one's motor (abad, hip or knee).
        bus_voltage: [V]; the robot's or actuator's when left out.
        gear_ratio: the robot's or actuator's when left out; 1 for a motor file.
        gear_efficiency: likewise.
        policy_rate: decisions of the policy a second, for the stances [Hz].

    Raises:
        SprintlabError: the recording or the motor cannot be used.
    """
    from sprintlab.evaluation.rollout_audit import audit_rollout as audit
    from sprintlab.motors.voltage import check_bus_voltage
    from sprintlab.robots import load_robot, robot_names

    if bus_voltage is not None:
        check_bus_voltage(bus_voltage)
    check_range("policy_rate", policy_rate, 1.0, 10_000.0, "Hz")
    recorded = read_rollout(Path(rollout))
    robot = load_robot(motor) if motor in robot_names() else None
    if robot is not None and not recorded.joint_names and len(robot.joint_names) == len(recorded.names):
        recorded = replace(recorded, joint_names=robot.joint_names)
    if robot is not None and joint is None:
        motors, gear, voltage = robot.motors, robot.gear, bus_voltage or float(robot.bus_voltage)
    else:
        drive = chosen_motor(motor, joint or "", bus_voltage, gear_ratio, gear_efficiency).drive
        motors, gear, voltage = drive.motor, drive.gear, drive.bus_voltage
    verdict = audit(recorded, motors, gear, voltage, policy_rate)
    return AuditedRollout(rollout=recorded, verdict=verdict, motor=motors, gear=gear, bus_voltage=voltage)


def read_rollout(path: Path) -> Rollout:
    """A rollout from CSV, NPZ or the log of a run (MCAP).

    Raises:
        SprintlabError: as ``load_rollout`` and ``read_log``.
    """
    from sprintlab.evaluation.rollout_audit import Rollout, load_rollout

    if path.suffix.lower() != ".mcap":
        return load_rollout(path)
    from sprintlab.deployment.log import read_log

    record = read_log(path)
    return Rollout(
        time=record.state_time,
        joint_velocity=record.column("states", "joint_velocity"),
        joint_torque=record.column("states", "joint_torque"),
    )
