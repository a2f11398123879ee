"""``sprintlab audit``: somebody else's rollout against a motor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.rollouts import audit_rollout
from sprintlab.cli.output import arguments, draw, show


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
        found = audit_rollout(**arguments(self))
        draw(found, self.figure)
        show(found, self, soft_wrap=True, figure=self.figure)
        return 0
