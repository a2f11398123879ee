"""``sprintlab export``: a training checkpoint as a policy file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.api.training import check_export, require_training
from sprintlab.cli.output import print_json, progress_bar


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write a training checkpoint as one ONNX file that carries its own contract, checked against PyTorch.

    Attributes:
        checkpoint: checkpoint of a training run.
        output: the ONNX file to write.
        braking_power: the forward command that reaches the network falls no faster than this power for each
            kilogram of the robot [W/kg]; as it is given when left out.
        json: print JSON only.
    """

    checkpoint: tyro.conf.Positional[Path]
    output: tyro.conf.Positional[Path]
    braking_power: float | None = None
    json: bool = False

    def run(self) -> int:
        """Export.

        Raises:
            InvalidValueError: the power is out of range.
            SprintlabError: the checkpoint is missing or refused, or the extra is not installed.
        """
        require_training()
        from sprintlab.control.braking import BrakingContract

        braking = None if self.braking_power is None else BrakingContract(power=self.braking_power)
        check_export(self.checkpoint, self.output)
        from sprintlab.training.runs.export import export_checkpoint

        with progress_bar(quiet=self.json) as report:
            report("exporting", None)
            exported = export_checkpoint(self.checkpoint, self.output, braking)
        if self.json:
            print_json({**exported._asdict(), "path": str(exported.path)})
            return 0
        print(f"policy: {exported.path}")
        print(f"replayed steps: {exported.replayed}, greatest difference {exported.difference:.1e}")
        return 0
