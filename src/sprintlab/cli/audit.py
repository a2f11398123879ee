"""``sprintlab audit``: somebody else's rollout against a motor."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from sprintlab.cli.output import plain_table, print_json, show_files, stdout_console

if TYPE_CHECKING:
    from sprintlab.evaluation.rollout_audit import Rollout, RolloutVerdict


@dataclass(frozen=True, kw_only=True)
class Audit:
    """How much of a policy's torque its motors cannot give: any simulator's rollout against a motor.

    Reads CSV and NPZ (columns: docs/check-your-policy.md) and the logs of `sprintlab run` (MCAP).

    Attributes:
        rollout: the recording.
        motor: a motor file (.toml), an actuator of `sprintlab motor library`, or a robot of the package with
            each joint its own motor.
        joint: of a robot: give all joints this one's motor (abad, hip or knee).
        bus_voltage: [V]; the robot's or actuator's when left out.
        gear_ratio: the robot's or actuator's when left out; 1 for a motor file.
        gear_efficiency: likewise.
        policy_rate: decisions of the policy a second, for the stances [Hz].
        figure: torque-speed picture of every joint (.png, .pdf or .svg); none when left out.
        json: print JSON only.
    """

    rollout: tyro.conf.Positional[Path]
    motor: str
    joint: str | None = None
    bus_voltage: float | None = None
    gear_ratio: float | None = None
    gear_efficiency: float | None = None
    policy_rate: float = 50.0
    figure: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Print the verdict; raises ``SprintlabError`` for an unusable rollout or motor."""
        from sprintlab.core.files import check_figure_path

        check_figure_path(self.figure)
        from sprintlab.evaluation.rollout_audit import audit_rollout, rollout_figure

        rollout = self._named(read_rollout(self.rollout))
        motor, gear, voltage = self._motors(rollout)
        verdict = audit_rollout(rollout, motor, gear, voltage, self.policy_rate)
        if self.figure is not None:
            from sprintlab.core.theme import save_figure

            save_figure(self.figure, rollout_figure(rollout, motor, gear, voltage))
        if self.json:
            print_json({"sentence": verdict.sentence, **asdict(verdict)})
        else:
            _print(verdict, self.figure)
        return 0

    def _named(self, rollout: Rollout) -> Rollout:
        """A recording without names takes them from the robot, in its order."""
        from sprintlab.robots import load_robot, robot_names

        if rollout.joint_names or self.motor not in robot_names():
            return rollout
        names = load_robot(self.motor).joint_names
        return replace(rollout, joint_names=names) if len(names) == len(rollout.names) else rollout

    def _motors(self, rollout: Rollout) -> tuple[Any, Any, float]:
        from sprintlab.api.motors import chosen_motor
        from sprintlab.robots import load_robot, robot_names

        if self.motor in robot_names() and self.joint is None:
            robot = load_robot(self.motor)
            return robot.motors, robot.gear, self.bus_voltage or float(robot.bus_voltage)
        chosen = chosen_motor(
            self.motor, self.joint or "", self.bus_voltage, self.gear_ratio, self.gear_efficiency
        )
        return chosen.drive.motor, chosen.drive.gear, chosen.drive.bus_voltage


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


def _print(verdict: RolloutVerdict, figure: Path | None) -> None:
    console = stdout_console()
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
    console.print(table)
    console.print("power and heat: of the torque that the motor can give; heat: copper loss\n")
    for text, value in (
        ("mean forward speed", verdict.speed and f"{verdict.speed:.2f} m/s"),
        ("slip of a foot in one stance", verdict.slip is not None and f"{1000 * verdict.slip:.1f} mm"),
        ("median stance", verdict.stance is not None and f"{1000 * verdict.stance:.0f} ms"),
        ("policy periods in it", verdict.stance_periods is not None and f"{verdict.stance_periods:.1f}"),
    ):
        if value:
            console.print(f"{text}: {value}")
    console.print(verdict.sentence, style="bold", soft_wrap=True)
    show_files(figure=figure)
