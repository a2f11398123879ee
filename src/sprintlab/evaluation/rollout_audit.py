"""What a motor says of somebody else's rollout: torque that it cannot give, over-speed, power, heat, feet.

Needs joint velocities and torques only; with feet it also tells of slip and of stances shorter than the
policy's period. Nothing is simulated: the numbers are the motor law over the recorded samples.
"""

from __future__ import annotations

import csv
import io
import itertools
import re
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from sprintlab.core.archives import read_arrays
from sprintlab.core.array_types import FloatArray
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.core.reading import read_bytes, table_number
from sprintlab.core.theme import LIGHT, set_title, themed_figure
from sprintlab.core.thinning import thinned_cloud
from sprintlab.evaluation.metrics import stances
from sprintlab.motors import (
    Gear,
    PmsmParameters,
    copper_loss,
    desaturate,
    joint_torque,
    motor_speed,
    no_load_speed,
    saturate,
    shaft_torque,
    torque_limits,
)

MARGIN = 1e-3
"""Share of the peak joint torque by which a sample may exceed the envelope: rounding of recordings."""
LARGEST_CSV = 32 << 20
"""Largest rollout in CSV that is read [bytes]."""
MOST_NUMBERS = 8_000_000
"""Most numbers of a table that is audited: 11 minutes of twelve joints at 1 kHz."""
_NUMBERS_ONLY = re.compile(r"[0-9eE+\-. \t]*")
_ROWS = 8192  # that are worked out at once
_MOST_COLUMNS = 2000  # of a CSV
_LARGEST = 1e12  # of any number, in its SI unit; seconds since 1970 are 2e9
_MOST_JOINTS, _LONGEST_NAME = 200, 100
_MOST_DRAWN = 48  # joints: of 200, a picture takes half a minute

_TABLES = (
    "joint_velocity",
    "joint_torque",
    "joint_position",
    "base_velocity",
    "foot_contact",
    "foot_velocity",
)
_SIDES = {"joint_velocity": 2, "joint_torque": 2, "base_velocity": 2, "foot_contact": 2, "foot_velocity": 3}
_READ = ("time", *(name for name in _TABLES if name != "joint_position"))  # positions are not asked for


@dataclass(frozen=True, kw_only=True)
class Rollout:
    """What was recorded, SI units, one row a sample.

    Attributes:
        time: ``(T,)`` [s], rising.
        joint_velocity: ``(T, n)`` [rad/s].
        joint_torque: ``(T, n)`` what the policy's world put on the joints [N m].
        joint_names: one a column; ``joint 0``, ... when left out.
        base_velocity: ``(T, 2)`` or ``(T, 3)``, forward first [m/s]; ``None`` where it was not recorded.
        foot_contact: ``(T, feet)``, nonzero on the ground; ``None`` where it was not recorded.
        foot_velocity: ``(T, feet, 2 or 3)`` of the feet over the ground [m/s]; ``None`` likewise.

    Raises:
        InvalidValueError: fewer than two samples, shapes that do not fit, time that does not rise, values
            that are no finite numbers or too large, more than 200 joints, or names that do not fit.
    """

    time: FloatArray
    joint_velocity: FloatArray
    joint_torque: FloatArray
    joint_names: tuple[str, ...] = ()
    base_velocity: FloatArray | None = None
    foot_contact: FloatArray | None = None
    foot_velocity: FloatArray | None = None

    def __post_init__(self) -> None:
        _check_sizes(vars(self))
        _check_numbers("time", self.time)
        count = np.size(self.time)
        if self.time.ndim != 1 or count < 2 or not np.all(np.diff(self.time) > 0.0):
            raise InvalidValueError("time", f"{count} samples", "at least two, rising [s]")
        for name, sides in _SIDES.items():
            values = getattr(self, name)
            if values is not None:
                _check_shape(name, values, count, sides)
                _check_numbers(name, values)
        if self.joint_velocity.shape != self.joint_torque.shape:
            shapes = f"{self.joint_velocity.shape} and {self.joint_torque.shape}"
            raise InvalidValueError("joint_velocity, joint_torque", shapes, "equal shapes")
        self._check_feet()
        self._check_names()

    def _check_feet(self) -> None:
        contact, velocity = self.foot_contact, self.foot_velocity
        if contact is not None and (contact.ndim != 2 or contact.shape[1] > _MOST_JOINTS):
            raise InvalidValueError(
                "foot_contact", f"shape {contact.shape}", f"(samples, feet), at most {_MOST_JOINTS} feet"
            )
        if contact is not None and velocity is not None and velocity.shape[:-1] != contact.shape:
            shapes = f"{contact.shape} and {velocity.shape}"
            raise InvalidValueError(
                "foot_contact, foot_velocity", shapes, "(samples, feet), (samples, feet, 2)"
            )

    def _check_names(self) -> None:
        joints = self.joint_velocity.shape[1]
        if joints > _MOST_JOINTS:
            raise InvalidValueError("joints", joints, f"at most {_MOST_JOINTS}")
        if self.joint_names and len(self.joint_names) != joints:
            raise InvalidValueError(
                "joint_names", f"{len(self.joint_names)} names", f"one for each of {joints}"
            )
        if any(len(name) > _LONGEST_NAME for name in self.joint_names):
            raise InvalidValueError("joint_names", "a longer name", f"at most {_LONGEST_NAME} characters")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints, one a column."""
        joints = self.joint_velocity.shape[1]
        return self.joint_names or tuple(f"joint {index}" for index in range(joints))


def _check_sizes(arrays: Mapping[str, Any]) -> None:
    """Refuse what takes longer than 10 s and more than a few gigabytes, before it is copied."""
    for name, values in arrays.items():
        if np.size(values) > MOST_NUMBERS:
            raise InvalidValueError(
                name, f"{np.size(values)} numbers", f"at most {MOST_NUMBERS}: take a part of it"
            )


def _check_shape(name: str, values: FloatArray, count: int, sides: int) -> None:
    """Refuse a table without ``count`` rows, without columns, or with other ``sides`` than its kind has."""
    if values.ndim < 2 or len(values) != count:
        raise InvalidValueError(name, f"shape {values.shape}", f"one row for each of {count} samples")
    if values.ndim != sides or not values.size:
        allowed = "(samples, feet, 2)" if sides > 2 else "(samples, columns)"
        raise InvalidValueError(name, f"shape {values.shape}", f"{allowed}, none of them empty")


def _check_numbers(name: str, values: FloatArray) -> None:
    if not np.isfinite(values).all():
        raise InvalidValueError(name, "NaN or infinity", "finite numbers only")
    if np.abs(values).max(initial=0.0) > _LARGEST:
        raise InvalidValueError(name, "a larger number", f"at most {_LARGEST:g}")


@dataclass(frozen=True, kw_only=True)
class JointVerdict:
    """One joint of a rollout against its motor. Shares are of the recorded time [-]."""

    name: str
    impossible: float
    """Share of the samples with more torque than the motor gives at that speed."""
    v_d_only: float
    """Share with torque that the model without d-axis voltage would allow and the motor does not give."""
    largest_excess: float
    """Most torque beyond the envelope [N m]."""
    over_speed: float
    """Share of the samples beyond the no-load speed."""
    speed_ratio: float
    """Highest speed over the no-load speed [-]."""
    mechanical_power: float
    """Mean power to the joint, as far as the motor can give it [W]."""
    copper_loss: float
    """Mean heat in the winding, of the torque that the motor can give [W]."""


@dataclass(frozen=True, kw_only=True)
class RolloutVerdict:
    """A whole rollout against its motors."""

    duration: float
    """[s]"""
    joints: tuple[JointVerdict, ...]
    impossible: float
    """Share of all joints' samples with more torque than their motors give [-]."""
    impossible_moments: float
    """Share of the moments at which at least one joint asks for it [-]."""
    speed: float | None
    """Mean forward speed [m/s]."""
    slip: float | None
    """Mean way that a foot slides in one stance [m]."""
    stance: float | None
    """Median duration of a stance [s]."""
    stance_periods: float | None
    """That, over the period of the policy [-]; below 1 a stance is over before the policy can act in it."""

    @property
    def sentence(self) -> str:
        """The answer in one sentence."""
        if self.impossible == 0.0:
            return "The motors can give every torque of this rollout."
        worst = max(self.joints, key=lambda joint: joint.impossible)
        return (
            f"The policy asks for impossible torque {_percent(self.impossible)} of the time "
            f"({worst.name}: {_percent(worst.impossible)}, up to {worst.largest_excess:.1f} N m too much)."
        )


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share >= 0.1 else f"{100.0 * share:.2g} %"


def audit_rollout(
    rollout: Rollout, motor: PmsmParameters, gear: Gear, bus_voltage: float, policy_rate: float = 50.0
) -> RolloutVerdict:
    """Compare a rollout with its motors.

    Args:
        rollout: what was recorded.
        motor: of all joints, or with one element a joint, SI, motor side.
        gear: likewise.
        bus_voltage: [V].
        policy_rate: decisions a second, for the stances [Hz].

    Raises:
        InvalidValueError: the voltage or rate is not positive, or there are not as many motors as joints.
    """
    check_positive("bus_voltage", bus_voltage, "V")
    check_positive("policy_rate", policy_rate, "Hz")
    joints = rollout.joint_torque.shape[1]
    if np.size(motor.peak_torque) not in (1, joints):
        raise InvalidValueError(
            "motor", f"{np.size(motor.peak_torque)} motors", f"one, or one for each of {joints} joints"
        )
    limits = joint_envelope(motor, gear, bus_voltage, rollout.joint_velocity, "refined")
    without = joint_envelope(motor, gear, bus_voltage, rollout.joint_velocity, "simplified-dc")
    reach = MARGIN * np.asarray(joint_torque(gear, motor.peak_torque))
    excess = np.maximum(np.maximum(rollout.joint_torque - limits[1], limits[0] - rollout.joint_torque), 0.0)
    beyond = excess > reach
    allowed = (rollout.joint_torque <= without[1] + reach) & (rollout.joint_torque >= without[0] - reach)
    given = np.clip(rollout.joint_torque, limits[0], limits[1])
    shaft = desaturate(motor, shaft_torque(gear, given, rollout.joint_velocity))
    heat = np.broadcast_to(np.asarray(copper_loss(motor, shaft)), excess.shape)
    speed = np.abs(np.asarray(motor_speed(gear, rollout.joint_velocity)))
    ratio = speed / np.asarray(no_load_speed(motor, bus_voltage))
    verdicts = tuple(
        JointVerdict(
            name=name,
            impossible=float(beyond[:, joint].mean()),
            v_d_only=float((beyond[:, joint] & allowed[:, joint]).mean()),
            largest_excess=float(excess[:, joint].max()),
            over_speed=float((ratio[:, joint] > 1.0).mean()),
            speed_ratio=float(ratio[:, joint].max()),
            mechanical_power=float((given[:, joint] * rollout.joint_velocity[:, joint]).mean()),
            copper_loss=float(heat[:, joint].mean()),
        )
        for joint, name in enumerate(rollout.names)
    )
    stance = _median_stance(rollout)
    return RolloutVerdict(
        duration=float(rollout.time[-1] - rollout.time[0]),
        joints=verdicts,
        impossible=float(beyond.mean()),
        impossible_moments=float(beyond.any(axis=1).mean()),
        speed=None if rollout.base_velocity is None else float(rollout.base_velocity[:, 0].mean()),
        slip=_slip(rollout),
        stance=stance,
        stance_periods=None if stance is None else stance * policy_rate,
    )


def joint_envelope(
    motor: PmsmParameters, gear: Gear, bus_voltage: float, velocity: FloatArray, model: Any
) -> tuple[FloatArray, FloatArray]:
    """Least and greatest torque on the joints at joint velocities, saturation and gear in, same shape."""
    lower, upper = np.empty(velocity.shape), np.empty(velocity.shape)
    for start in range(0, len(velocity), _ROWS):  # in pieces that stay in the cache
        rows = slice(start, start + _ROWS)
        part = velocity[rows]
        limits = torque_limits(motor, motor_speed(gear, part), bus_voltage, model=model)
        lower[rows], upper[rows] = (joint_torque(gear, saturate(motor, limit), part) for limit in limits)
    return lower, upper


def _whole_stances(contact: FloatArray) -> NDArray[np.intp]:
    """Those of one foot that begin and end within the recording, as ``[start, end)`` samples ``(n, 2)``."""
    phases = stances(contact != 0.0)
    return phases[(phases[:, 0] > 0) & (phases[:, 1] < len(contact))]


def _median_stance(rollout: Rollout) -> float | None:
    """Median duration of a stance [s]; ``None`` where no whole one was recorded."""
    if rollout.foot_contact is None:
        return None
    phases = [_whole_stances(foot) for foot in rollout.foot_contact.T]
    spans = np.diff(rollout.time[np.concatenate([np.empty((0, 2), dtype=int), *phases])])
    return float(np.median(spans)) if len(spans) else None


def _slip(rollout: Rollout) -> float | None:
    """Mean way that a foot slides in a stance [m]; ``None`` where feet were not recorded."""
    if rollout.foot_contact is None or rollout.foot_velocity is None:
        return None
    step = np.diff(rollout.time, append=rollout.time[-1])
    way = np.linalg.norm(rollout.foot_velocity[..., :2], axis=-1) * step[:, None]
    total, count = 0.0, 0
    for foot in range(way.shape[1]):
        phases = _whole_stances(rollout.foot_contact[:, foot])
        if len(phases):  # sums from each touchdown to the lift-off, between them those of the flights
            total += float(np.add.reduceat(way[:, foot], phases.ravel())[::2].sum())
            count += len(phases)
    return total / count if count else None


# --- files --------------------------------------------------------------------------------------------------


def load_rollout(path: str | Path) -> Rollout:
    """Read a rollout from CSV or NPZ.

    NPZ: the arrays of ``Rollout`` by name. CSV: a header with ``time`` and, for every table, columns whose
    names begin with the table's, e.g. ``joint_velocity_FL_hip`` or ``joint_velocity_0``; feet have
    ``foot_velocity_FL_x`` and ``foot_velocity_FL_y``.

    Raises:
        SprintlabError: missing, too large, damaged, or another kind of file.
        InvalidValueError: a table is missing, or holds what ``Rollout`` refuses.
    """
    path = Path(path)
    if path.suffix.lower() == ".npz":
        arrays = read_arrays(path, (*_READ, "joint_names"), wanted="no rollout (NPZ)")
        names = tuple(map(str, arrays.pop("joint_names", np.array([])).ravel()))
        return rollout_of(arrays, names)
    if path.suffix.lower() == ".csv":
        return _from_csv(read_bytes(path, LARGEST_CSV, what="rollout").decode("utf-8", "replace"), path)
    raise SprintlabError(f"{path}: a rollout is a .csv, .npz or .mcap file")


def rollout_of(arrays: Mapping[str, Any], names: Sequence[str] = ()) -> Rollout:
    """A rollout from arrays by name.

    Raises:
        InvalidValueError: time, velocities or torques are missing, or are refused by ``Rollout``.
    """
    missing = [name for name in ("time", "joint_velocity", "joint_torque") if name not in arrays]
    if missing:
        given = ", ".join(sorted(arrays)) or "none"
        raise InvalidValueError("columns", given, f"{' and '.join(missing)} must be among them")
    _check_sizes(arrays)
    try:
        with np.errstate(over="ignore"):  # what becomes infinite is refused
            found = {n: np.asarray(arrays[n], dtype=float) for n in arrays if n != "joint_position"}
    except (TypeError, ValueError) as error:
        raise InvalidValueError("rollout", "text", "numbers only") from error
    return Rollout(joint_names=tuple(names), **found)


def _from_csv(text: str, path: Path) -> Rollout:
    try:
        header, table = _table(text, path)
    except csv.Error as error:
        raise SprintlabError(f"{path} is no CSV file: {error}") from error
    except ValueError as error:
        raise SprintlabError(f"{path} is not a table of numbers: {error}") from error
    columns = {
        name: [at for at, head in enumerate(header) if head.startswith(f"{name}_")] for name in _TABLES
    }
    arrays = {name: table[:, chosen] for name, chosen in columns.items() if chosen}
    if "time" in header:
        arrays["time"] = table[:, header.index("time")]
    if "foot_velocity" in arrays:
        feet = len(columns["foot_contact"]) or len(columns["foot_velocity"]) // 2
        if not feet or len(columns["foot_velocity"]) % feet:
            raise SprintlabError(f"{path}: the columns of foot_velocity are not as many for every foot")
        arrays["foot_velocity"] = arrays["foot_velocity"].reshape(len(table), feet, -1)
    names = [header[at].removeprefix("joint_velocity_") for at in columns["joint_velocity"]]
    return rollout_of(arrays, names)


def _table(text: str, path: Path) -> tuple[list[str], FloatArray]:
    """Names and numbers of a CSV file, row by row: all of its cells as texts take a hundred times its size.

    Raises:
        SprintlabError: too few rows, too many columns, one twice, or rows of another length than the header.
        ValueError: a cell holds no number; names line and column.
    """
    rows = csv.reader(io.StringIO(text))
    header = [name.strip() for name in next(rows, [])]
    if len(header) > _MOST_COLUMNS or len(set(header)) < len(header):
        raise SprintlabError(f"{path} has more than {_MOST_COLUMNS} columns, or one of them twice")
    numbers = array("d")
    for row in filter(None, rows):
        if len(row) != len(header):
            raise SprintlabError(f"{path}: every row needs {len(header)} numbers, as the header has names")
        plain = _NUMBERS_ONLY.fullmatch("".join(row))  # of such signs float makes nothing else, and fast
        try:
            numbers.extend(map(float, row) if plain else _row(header, row, rows.line_num))
        except ValueError:
            _row(header, row, rows.line_num)  # says where
            raise
    if not header or len(numbers) < 2 * len(header):
        raise SprintlabError(f"{path} holds no header and two samples")
    table = np.frombuffer(numbers).reshape(-1, len(header))
    if not (finite := np.isfinite(table).all(axis=1)).all():
        rows = csv.reader(io.StringIO(text))  # up to the row of that number, blank lines not counted
        row = next(itertools.islice(filter(None, rows), 1 + int(finite.argmin()), None))
        _row(header, row, rows.line_num)
    return header, table


def _row(header: Sequence[str], row: Sequence[str], line: int) -> list[float]:
    """The numbers of a row; the first cell without a finite one is told with its line and column."""
    return [table_number(cell, name, line) for name, cell in zip(header, row, strict=True)]


# --- picture ------------------------------------------------------------------------------------------------


def rollout_figure(rollout: Rollout, motor: PmsmParameters, gear: Gear, bus_voltage: float) -> Figure:
    """Torque over speed of every joint on what its motor gives; red is what it does not.

    Raises:
        InvalidValueError: more than 48 joints, each of which is a picture of its own.
    """
    joints = rollout.joint_torque.shape[1]
    check_range("joints of a figure", joints, 1, _MOST_DRAWN)
    columns = min(joints, 4)
    rows = -(-joints // columns)
    figure, axes = themed_figure(LIGHT, (3.0 * columns + 0.6, 2.6 * rows + 0.4), rows, columns)
    limits = joint_envelope(motor, gear, bus_voltage, rollout.joint_velocity, "refined")
    reach = MARGIN * np.asarray(joint_torque(gear, motor.peak_torque))
    beyond = (rollout.joint_torque > limits[1] + reach) | (rollout.joint_torque < limits[0] - reach)
    top = 1.08 * max(
        float(np.abs(rollout.joint_velocity).max()),
        float(np.max(no_load_speed(motor, bus_voltage) / np.asarray(gear.ratio))),
    )
    grid = np.repeat(np.linspace(-top, top, 401)[:, None], joints, axis=1)
    lower, upper = joint_envelope(motor, gear, bus_voltage, grid, "refined")
    for joint, axis in enumerate(axes):
        if joint >= joints:
            axis.remove()
            continue
        axis.fill_between(grid[:, joint], lower[:, joint], upper[:, joint], color=LIGHT.envelope, linewidth=0)
        for mask, color in ((~beyond[:, joint], LIGHT.inside), (beyond[:, joint], LIGHT.on_limit)):
            cloud = thinned_cloud(rollout.joint_velocity[mask, joint], rollout.joint_torque[mask, joint])
            axis.scatter(*cloud, s=2.5, color=color, alpha=0.5, linewidths=0, rasterized=True)
        set_title(axis, rollout.names[joint], LIGHT)
        share = _percent(float(beyond[:, joint].mean()))
        axis.set_title(f"{share} impossible", loc="right", fontsize=8, color=LIGHT.muted)
        axis.set_xlabel("joint speed [rad/s]")
        if joint % columns == 0:
            axis.set_ylabel("joint torque [N m], recorded;\nfilled: after saturation, gear")
    return figure
