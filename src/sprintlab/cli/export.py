"""``sprintlab export``: a training checkpoint as a policy file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from sprintlab.api.training import check_export, require_training
from sprintlab.cli.output import print_json, progress_bar

if TYPE_CHECKING:
    from sprintlab.control.pace import PaceContract


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write a training checkpoint as one ONNX file that carries its own contract, checked against PyTorch.

    Attributes:
        checkpoint: checkpoint of a training run.
        output: the ONNX file to write.
        braking_power: the forward command that reaches the network falls no faster than this power for each
            kilogram of the robot [W/kg]; as it is given when left out.
        lead: the forward command that reaches the network runs no further ahead of the estimated speed [m/s],
            and falls as with the default of --braking-power; as far as it is given when left out.
        turning_speed: the network is asked for more than the commanded yaw rate, for twice as much at this
            forward speed [m/s], and a loop on the gyroscope adds what is still missing; without, for the one
            that is commanded.
        json: print JSON only.
    """

    checkpoint: tyro.conf.Positional[Path]
    output: tyro.conf.Positional[Path]
    braking_power: float | None = None
    lead: float | None = None
    turning_speed: float | None = None
    json: bool = False

    def run(self) -> int:
        """Export.

        Raises:
            InvalidValueError: the power, the lead or the speed is out of range.
            SprintlabError: the checkpoint is missing or refused, or the extra is not installed.
        """
        require_training()
        from sprintlab.control.turning import TurningContract

        pace, speed = self._pace(), self.turning_speed
        turning = None if speed is None else TurningContract(doubling_speed=speed)
        check_export(self.checkpoint, self.output)
        from sprintlab.training.runs.export import export_checkpoint

        with progress_bar(quiet=self.json) as report:
            report("exporting", None)
            exported = export_checkpoint(self.checkpoint, self.output, pace, turning)
        if self.json:
            print_json({**exported._asdict(), "path": str(exported.path)})
            return 0
        print(f"policy: {exported.path}")
        print(f"replayed steps: {exported.replayed}, greatest difference {exported.difference:.1e}")
        return 0

    def _pace(self) -> PaceContract | None:
        from sprintlab.control.pace import PaceContract

        given = {"power": self.braking_power, "lead": self.lead}
        chosen = {name: value for name, value in given.items() if value is not None}
        return PaceContract(**chosen) if chosen else None
