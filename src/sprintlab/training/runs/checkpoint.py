"""Checkpoints: PyTorch files of tensors, numbers, texts and settings, read without running any code.

Settings are written as the import path of their class and their fields: ``torch.load`` with ``weights_only``
makes no object but these.
"""

from __future__ import annotations

import io
import pickle
import sys
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_bytes
from sprintlab.robots import RobotDescription, robot_fingerprint

CHECKPOINT_FORMAT = 5
MOST_ITERATIONS = 30_000
"""Most iterations of a run; its log holds 64 values of each."""
_NEEDED = ("settings", "config_hash", "progress", "policy")
_DAMAGED = (
    OSError, LookupError, TypeError, ValueError, AttributeError, RuntimeError, EOFError, MemoryError,
    AssertionError, zipfile.BadZipFile, pickle.UnpicklingError,
)  # fmt: skip


@dataclass
class Progress:
    """What has been done, over all sessions of a run."""

    iteration: int = 0
    environment_steps: int = 0
    seconds: float = 0.0
    log: list[dict[str, float]] = field(default_factory=list[dict[str, float]])


@dataclass(frozen=True)
class UnknownSettings:
    """Settings whose class is not imported here: enough to export the policy, not to resume the training.

    Attributes:
        path: module and name of the class.
        values: its fields.
    """

    path: str
    values: Mapping[str, Any]


def write_checkpoint(state: Mapping[str, Any], path: Path) -> None:
    """Write nested dictionaries and lists of tensors, arrays, numbers, texts and settings, in one step.

    Raises:
        SprintlabError: the disk refuses, or a value is of another type.
    """
    import torch

    content = io.BytesIO()
    torch.save({"format": CHECKPOINT_FORMAT, "state": _packed(dict(state), "state")}, content)
    atomic_write_bytes(path, content.getvalue())


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Load a checkpoint onto the CPU.

    Raises:
        SprintlabError: missing, truncated, damaged, of another format, or written by something else.
    """
    try:
        state = cast("dict[str, Any]", _unpacked(_loaded(path)))
        state["progress"] = Progress(**state["progress"])
        if not is_dataclass(state["settings"]):
            raise ValueError("it has no settings of a training")
    except _DAMAGED as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise SprintlabError(f"{path} is not a checkpoint or is damaged: {reason[:150]}") from error
    return state


def check_checkpoint(path: Path) -> set[str]:
    """Names of what a checkpoint holds. Raises as ``read_checkpoint``."""
    return set(read_checkpoint(path))


def unknown_settings(settings: object) -> list[str]:
    """Import paths of the classes within some settings that are not imported here."""
    if isinstance(settings, UnknownSettings):
        return [settings.path]
    if not is_dataclass(settings):
        return []
    return [path for item in fields(settings) for path in unknown_settings(getattr(settings, item.name))]


def check_robot(state: Mapping[str, Any], robot: RobotDescription) -> None:
    """Refuse another robot than the one that was trained: a policy would bear its name, and a run mix both.

    Args:
        state: read from a checkpoint.
        robot: the robot that its settings name now.

    Raises:
        SprintlabError: its table has changed since.
    """
    if state.get("robot_fingerprint") not in (None, robot_fingerprint(robot)):
        raise SprintlabError(
            f"the table of robot {robot.name} has changed since it was trained: put the old one back, or "
            "train the new one from the beginning"
        )


def _loaded(path: Path) -> dict[str, Any]:
    """The packed state in a file, its checksums compared."""
    if not path.is_file():
        raise SprintlabError(f"{path} is not a checkpoint: there is no such file")
    with zipfile.ZipFile(path) as archive:
        if (member := archive.testzip()) is not None:
            raise ValueError(f"the checksum of {member} does not fit; take an earlier copy")
    import torch  # takes seconds: a file of another kind is refused before

    found = torch.load(path, map_location="cpu", weights_only=True)
    if found["format"] != CHECKPOINT_FORMAT:
        raise SprintlabError(f"{path} has format {found['format']}; this version reads {CHECKPOINT_FORMAT}")
    if lacking := [name for name in _NEEDED if name not in found["state"]]:
        raise ValueError(f"it has no {', '.join(lacking)}")
    return found["state"]


def _packed(value: Any, name: str) -> Any:
    """A value in terms of what PyTorch loads without running code."""
    import torch

    if value is None or isinstance(value, bool | str | int | float):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, torch.Tensor):
        return value.detach().cpu().clone()  # a view would be saved with all that it looks at
    if isinstance(value, np.ndarray):
        return {"$array": torch.from_numpy(np.array(cast("np.ndarray[Any, Any]", value)))}
    if isinstance(value, list | tuple):
        items = [_packed(item, f"{name}.{place}") for place, item in enumerate(cast("list[Any]", value))]
        return items if isinstance(value, list) else tuple(items)
    if isinstance(value, UnknownSettings):
        return {"$class": value.path, "fields": _packed(value.values, name)}
    if isinstance(value, Progress):
        value = vars(value)
    if isinstance(value, Mapping):
        return {key: _packed(item, f"{name}.{key}") for key, item in cast("Mapping[str, Any]", value).items()}
    if is_dataclass(value) and not isinstance(value, type):
        items = {item.name: getattr(value, item.name) for item in fields(value) if item.init}
        kind = type(value)
        return {"$class": f"{kind.__module__}:{kind.__qualname__}", "fields": _packed(items, name)}
    raise SprintlabError(
        f"{name} is of {type(value).__name__}, which a checkpoint cannot keep: use numbers, texts, tuples, "
        "tensors and frozen dataclasses of these"
    )


def _unpacked(value: Any) -> Any:
    """Inverse of ``_packed``."""
    if isinstance(value, list | tuple):
        items = [_unpacked(item) for item in cast("list[Any]", value)]
        return items if isinstance(value, list) else tuple(items)
    if not isinstance(value, dict):
        return value
    entry = cast("dict[str, Any]", value)
    if "$array" in entry:
        return entry["$array"].numpy()
    known = {key: _unpacked(item) for key, item in entry.items()}
    return _settings(known["$class"], known["fields"]) if "$class" in known else known


def _settings(path: str, values: dict[str, Any]) -> Any:
    """Settings of a class by its import path; ``UnknownSettings`` where that is not imported here."""
    import sprintlab.training.settings  # noqa: F401  # all of this package's settings

    module, _, name = path.partition(":")
    found: Any = sys.modules.get(module)
    for part in name.split("."):
        found = vars(found).get(part) if hasattr(found, "__dict__") else None
    if not (isinstance(found, type) and is_dataclass(found) and found.__dataclass_params__.frozen):  # type: ignore[attr-defined]
        return UnknownSettings(path, values)
    return found(**values)
