"""``sprintlab export``: a training checkpoint as a policy file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.cli.train import require_training
from sprintlab.core.errors import SprintlabError


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write a training checkpoint as one ONNX file that carries its own contract.

    Attributes:
        checkpoint: checkpoint of a training run.
        output: the ONNX file to write.
    """

    checkpoint: tyro.conf.Positional[Path]
    output: tyro.conf.Positional[Path]

    def run(self) -> int:
        """Export; raises ``SprintlabError`` when the checkpoint is missing or the extra is not installed."""
        if not self.checkpoint.is_file():
            raise SprintlabError(f"checkpoint {self.checkpoint} does not exist")
        require_training()
        from sprintlab.training.export import export_checkpoint

        export_checkpoint(self.checkpoint, self.output)
        print(f"policy: {self.output}")
        return 0
