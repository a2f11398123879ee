"""Checkpoints: PyTorch files of tensors, numbers and texts, read without running any code.

The settings are JSON: what ``training.settings_text`` makes of them.
"""

from __future__ import annotations

import io
import json
import pickle
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_bytes
from sprintlab.core.reading import parse_json, refused_as_damaged
from sprintlab.robots import RobotDescription, robot_fingerprint
from sprintlab.training.settings import TrainingSettings
from sprintlab.training.settings_text import from_plain, to_plain

CHECKPOINT_FORMAT = 8
MOST_ITERATIONS = 30_000
"""Most iterations of a run; its log holds 64 values of each."""


@dataclass
class Progress:
    """What has been done, over all sessions of a run."""

    iteration: int = 0
    environment_steps: int = 0
    seconds: float = 0.0
    log: list[dict[str, float]] = field(default_factory=list[dict[str, float]])


def write_checkpoint(state: Mapping[str, Any], path: Path) -> None:
    """Write nested dictionaries and lists of tensors, numbers, texts and settings, in one step."""
    import torch

    content = io.BytesIO()
    torch.save({"format": CHECKPOINT_FORMAT, "state": _packed(dict(state))}, content)
    atomic_write_bytes(path, content.getvalue())


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Load a checkpoint onto the CPU."""
    if not path.is_file():
        raise SprintlabError(f"{path} is not a checkpoint: there is no such file")
    try:
        with refused_as_damaged(path, "is not a checkpoint or is damaged"):
            state = _loaded(path)
            state["progress"] = Progress(**state["progress"])
            state["settings"] = from_plain(TrainingSettings, parse_json(state["settings"]))
    except (OSError, EOFError, AssertionError, zipfile.BadZipFile, pickle.UnpicklingError) as error:
        raise SprintlabError(f"{path} is not a checkpoint or is damaged") from error
    return state


def check_robot(state: Mapping[str, Any], robot: RobotDescription) -> None:
    """Refuse a robot whose table has changed since the training. Raises ``SprintlabError``.

    A policy would bear its name, and a run mix both.
    """
    if state["robot_fingerprint"] != robot_fingerprint(robot):
        raise SprintlabError(
            f"the table of robot {robot.name} has changed since it was trained: put the old one back, or "
            "train the new one from the beginning"
        )


def _loaded(path: Path) -> dict[str, Any]:
    """The packed state in a file, its checksums compared."""
    with zipfile.ZipFile(path) as archive:
        if (member := archive.testzip()) is not None:
            raise ValueError(f"the checksum of {member} does not fit; take an earlier copy")
    import torch  # takes seconds: a file of another kind is refused before

    found = torch.load(path, map_location="cpu", weights_only=True)
    if found["format"] != CHECKPOINT_FORMAT:
        raise SprintlabError(f"{path} has format {found['format']}; this version reads {CHECKPOINT_FORMAT}")
    return found["state"]


def _packed(value: Any) -> Any:
    """A value in terms of what PyTorch loads without running code."""
    import torch

    if isinstance(value, torch.Tensor):
        return value.detach().cpu().clone()  # a view would be saved with all that it looks at
    if isinstance(value, TrainingSettings):
        return json.dumps(to_plain(value))
    if isinstance(value, Progress):
        return vars(value)
    if isinstance(value, list):
        return [_packed(item) for item in cast("list[Any]", value)]
    if isinstance(value, Mapping):
        return {key: _packed(item) for key, item in cast("Mapping[str, Any]", value).items()}
    return value
