"""Clips of exams are rendered beside the training."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image
from tensorboard.backend.event_processing import event_accumulator

from sprintlab.training.runs import clip as clip_module
from sprintlab.training.runs.clip import Clips, write_gif
from sprintlab.training.runs.progress import Board

WAIT = 600.0


def rendering(code: str) -> list[str]:
    """An interpreter that runs this instead of the renderer: its last arguments are those of the renderer."""
    return [sys.executable, "-c", code]


def test_a_clip_is_rendered_beside_the_training_and_lies_in_tensorboard(tmp_path: Path, monkeypatch) -> None:
    pictures = [Image.fromarray(np.full((9, 16, 3), shade, np.uint8)) for shade in (0, 90, 250)]
    write_gif(pictures, tmp_path / "made.gif")
    with Image.open(tmp_path / "made.gif") as found:
        assert found.n_frames == 3 and found.info["duration"] == 40
    code = f"import os, sys; os.renames({str(tmp_path / 'made.gif')!r}, sys.argv[-2])"
    monkeypatch.setattr(clip_module, "new_interpreter", lambda: rendering(code))
    clips = Clips(tmp_path, "bp2")
    clips.begin(np.zeros((10, 7)), 600)
    clips.begin(np.zeros((10, 7)), 1200)  # one at a time
    clip = clips.finished(WAIT)
    assert clip == tmp_path / "clips" / "000600.gif" and clips.finished() is None
    board = Board(tmp_path, "bp2", 0)
    board._add_clip(clip)
    board.close()
    events = event_accumulator.EventAccumulator(str(tmp_path / "tensorboard"))
    events.Reload()
    assert [image.step for image in events.Images("exam/clip")] == [600]
