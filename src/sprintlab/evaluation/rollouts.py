"""A recorded rollout of any simulator or robot, and its files (CSV, NPZ)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.core.archives import read_arrays, read_columns
from sprintlab.core.array_types import Array, FloatArray
from sprintlab.core.checks import check_finite
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.robots.joint_motors import check_unique

_TABLES = ("joint_velocity", "joint_torque", "base_velocity", "foot_contact", "foot_velocity")
_NAMES = ("joint_names", "foot_names")


@dataclass(frozen=True, kw_only=True)
class Rollout:
    """What was recorded, SI units, one row per sample; what was not recorded is empty or ``None``.

    Raises:
        InvalidValueError: fewer than two samples, shapes that do not fit, time that does not rise, numbers
            that are not finite, or names that are repeated or not as many as the columns.
    """

    time: FloatArray  # (T,) [s], rising
    joint_velocity: FloatArray  # (T, n) [rad/s]
    joint_torque: FloatArray  # (T, n) what the simulator put on the joints [N m]
    joint_names: tuple[str, ...] = ()  # one per column
    base_velocity: FloatArray | None = None  # (T, 2 or 3) forward first [m/s]
    foot_contact: FloatArray | None = None  # (T, feet) nonzero on the ground
    foot_velocity: FloatArray | None = None  # (T, feet, 2 or 3) over the ground [m/s]
    foot_names: tuple[str, ...] = ()  # one per foot

    def __post_init__(self) -> None:
        for name in ("time", *_TABLES):
            if (values := getattr(self, name)) is not None:
                check_finite(name, values)
        if self.time.ndim != 1 or len(self.time) < 2 or not np.all(np.diff(self.time) > 0.0):
            raise InvalidValueError("time", f"{np.size(self.time)} samples", "at least two, rising [s]")
        self._check_shapes()
        joints, feet = self.joint_velocity.shape[1], _columns(self.foot_contact)
        for field, count in (("joint_names", joints), ("foot_names", feet)):
            names = getattr(self, field)
            if names and len(names) != count:
                raise InvalidValueError(field, f"{len(names)} names", f"one for each of {count}")
            check_unique(names)

    def _check_shapes(self) -> None:
        samples, joints, feet = len(self.time), _columns(self.joint_velocity), _columns(self.foot_contact)
        shapes: dict[str, tuple[tuple[int, ...], ...]] = {
            "joint_velocity": ((samples, joints),),
            "joint_torque": ((samples, joints),),
            "base_velocity": ((samples, 2), (samples, 3)),
            "foot_contact": ((samples, feet),),
            "foot_velocity": ((samples, feet, 2), (samples, feet, 3)),
        }
        for name, allowed in shapes.items():
            values = getattr(self, name)
            if values is not None and (values.shape not in allowed or not values.size):
                fitting = f"must have shape {' or '.join(map(str, allowed))}, none empty"
                raise InvalidValueError(name, f"shape {values.shape}", fitting)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints, one per column; ``joint 0``, ... where they were not recorded."""
        return self.joint_names or tuple(f"joint {at}" for at in range(self.joint_velocity.shape[1]))


def _columns(values: FloatArray | None) -> int:
    return 0 if values is None or values.ndim < 2 else values.shape[1]


def load_rollout(path: str | Path) -> Rollout:
    """Read a rollout from CSV or NPZ.

    NPZ: the arrays of ``Rollout`` by name. CSV: a header with ``time`` and, for every table, columns whose
    names begin with the table's, e.g. ``joint_velocity_FL_hip``; feet have ``foot_velocity_FL_x`` and
    ``foot_velocity_FL_y``. Columns belong together by name, in any order; ``joint_velocity_0`` has no name.

    Raises:
        SprintlabError: missing, too large, damaged, or another kind of file.
        InvalidValueError: a table is missing, or holds what ``Rollout`` refuses.
    """
    path = Path(path)
    if path.suffix.lower() == ".npz":
        found = read_arrays(path, ("time", *_TABLES, *_NAMES), wanted="no rollout (NPZ)")
        names = {name: tuple(map(str, found.pop(name).ravel())) for name in _NAMES if name in found}
    elif path.suffix.lower() == ".csv":
        found, names = _csv_tables(path)
    else:
        raise SprintlabError(f"{path}: a rollout is a .csv, .npz or .mcap file")
    if missing := [name for name in ("time", "joint_velocity", "joint_torque") if name not in found]:
        given = ", ".join(sorted(found)) or "none"
        raise InvalidValueError("columns", given, f"{' and '.join(missing)} must be among them")
    if texts := [name for name, values in found.items() if values.dtype.kind not in "biuf"]:
        raise InvalidValueError(texts[0], "text", "numbers only")
    numbers: dict[str, Any] = {name: values.astype(float) for name, values in found.items()}
    return Rollout(**{**numbers, **names})


def _csv_tables(path: Path) -> tuple[dict[str, Array], dict[str, tuple[str, ...]]]:
    """Tables by name, and the names of joints and feet."""
    columns = read_columns(path, "rollout")

    def names_in(table: str) -> tuple[str, ...]:
        heads = (head for head in columns if head.startswith(f"{table}_"))
        return tuple(head.removeprefix(f"{table}_") for head in heads)

    joints, feet, moving = map(names_in, ("joint_velocity", "foot_contact", "foot_velocity"))
    ways = tuple(f"{foot}_{axis}" for foot in feet for axis in "xy") if moving else ()
    torques = names_in("joint_torque")
    if joints and torques and set(joints) != set(torques):
        allowed = f"the names of joint_velocity: {', '.join(joints)}"
        raise InvalidValueError("joint_torque", ", ".join(torques), allowed)
    if moving and not (ways and set(ways) <= set(moving)):
        raise SprintlabError(f"{path}: foot_velocity needs columns _x and _y for every foot of foot_contact")
    taken = {
        "joint_velocity": joints,
        "joint_torque": joints if torques else (),
        "base_velocity": names_in("base_velocity"),
        "foot_contact": feet,
        "foot_velocity": ways,
    }
    arrays: dict[str, Array] = {"time": columns["time"]} if "time" in columns else {}
    for table, names in taken.items():
        if names:
            arrays[table] = np.stack([columns[f"{table}_{name}"] for name in names], axis=1)
    if moving:
        arrays["foot_velocity"] = arrays["foot_velocity"].reshape(-1, len(feet), 2)
    named = all(not name.isdigit() for name in joints)
    return arrays, {"joint_names": joints if named else (), "foot_names": feet}
