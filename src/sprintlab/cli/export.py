"""``sprintlab export``: a training checkpoint as a policy file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from sprintlab.cli.output import print_json, progress_bar
from sprintlab.cli.train import require_training
from sprintlab.core.errors import SprintlabError


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write a training checkpoint as one ONNX file that carries its own contract, checked against PyTorch.

    Attributes:
        checkpoint: checkpoint of a training run.
        output: the ONNX file to write.
        recording: trajectory.npz or profile.npz of a race, to be replayed through both runtimes; when left
            out, the policy runs in the plant for four seconds.
        json: print JSON only.
    """

    checkpoint: tyro.conf.Positional[Path]
    output: tyro.conf.Positional[Path]
    recording: Path | None = None
    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Export.

        Raises:
            SprintlabError: the checkpoint or the recording is missing or refused, or the extra is not
                installed.
        """
        require_training()
        self._check()
        from sprintlab.training.runs.export import export_checkpoint

        with progress_bar(quiet=self.json) as report:
            report("exporting", None)
            exported = export_checkpoint(self.checkpoint, self.output, self.recording)
        if self.json:
            print_json({**exported._asdict(), "path": str(exported.path)})
            return 0
        print(f"policy: {exported.path}")
        print(f"replayed steps: {exported.replayed}, greatest difference {exported.difference:.1e}")
        return 0

    def _check(self) -> None:
        """Refuse at once what can be seen without PyTorch, whose import takes many seconds."""
        from sprintlab.core.files import check_writable
        from sprintlab.training.runs.checkpoint import check_checkpoint

        if not self.checkpoint.is_file():
            raise SprintlabError(f"checkpoint {self.checkpoint} does not exist")
        if self.output.is_dir():
            raise SprintlabError(f"{self.output} is a folder: name the policy file to write (.onnx)")
        check_checkpoint(self.checkpoint)
        check_writable(self.output)
        if self.recording is not None:
            from sprintlab.training.runs.replay import read_recording

            read_recording(self.recording)
