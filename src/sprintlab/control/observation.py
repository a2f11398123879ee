"""What a policy sees: one frame of named terms per step, stacked over a short history.

Which terms is a choice of each run, and travels in the policy's contract. For a robot of twelve joints the
paper's frame ``F`` has 45 numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from sprintlab.control.arrays import Array, namespace, where_rows
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import InvalidValueError

_LARGEST_SCALE = 1e6  # what a sensor can show stays finite in 32 bits
_LONGEST_HISTORY = 1000  # frames: twenty seconds


class Signals(NamedTuple):
    """What terms of the observation are computed from; the first four are low-passed sensor readings."""

    angular_velocity: Array  # body frame [rad/s] ``(..., 3)``
    projected_gravity: Array  # unit gravity vector, body frame ``(..., 3)``
    joint_position: Array  # relative to the default pose [rad] ``(..., joints)``
    joint_velocity: Array  # [rad/s] ``(..., joints)``
    command: Array  # forward speed, sideways speed [m/s], yaw rate [rad/s] ``(..., 3)``
    previous_action: Array  # the action of the step before ``(..., joints)``


class Observable(NamedTuple):
    """A quantity that can be a term of an observation."""

    value: Callable[[Signals], Array]  # its numbers ``(..., size)``
    size: int | None  # how many; None: one per joint
    mirror: tuple[float, ...] | None  # sign of each in the mirror image; None: those of joint angles


def _signal(name: str) -> Callable[[Signals], Array]:
    """A signal as it is."""
    return lambda signals: getattr(signals, name)


OBSERVABLES = {
    "angular_velocity": Observable(_signal("angular_velocity"), 3, (-1.0, 1.0, -1.0)),
    "projected_gravity": Observable(_signal("projected_gravity"), 3, (1.0, -1.0, 1.0)),
    "command": Observable(_signal("command"), 3, (1.0, -1.0, -1.0)),
    "joint_position": Observable(_signal("joint_position"), None, None),
    "joint_velocity": Observable(_signal("joint_velocity"), None, None),
    "previous_action": Observable(_signal("previous_action"), None, None),
}
"""By the name that runs and policy files have for it: a new one changes no file that does not name it."""

Scale = float | tuple[float, ...]


def standard_terms() -> dict[str, Scale]:
    """The paper's observation, 45 numbers for twelve joints; the command per m/s, m/s and rad/s."""
    return {
        "angular_velocity": 0.25,
        "projected_gravity": 1.0,
        "command": (0.25, 1.0, 1.0),
        "joint_position": 1.0,
        "joint_velocity": 0.05,
        "previous_action": 0.5,
    }


@dataclass(frozen=True, kw_only=True)
class ObservationLayout:
    """What a run observes."""

    terms: Mapping[str, Scale] = field(default_factory=standard_terms)
    """Names of ``OBSERVABLES`` in the frame's order, each with one factor, or one for each number."""
    history_length: int = 5
    """Frames in the network input, oldest first."""

    def __post_init__(self) -> None:
        for name, scale in self.terms.items():
            if name not in OBSERVABLES:
                raise InvalidValueError("terms", name, f"one of {', '.join(OBSERVABLES)}")
            size = OBSERVABLES[name].size
            if isinstance(scale, tuple) and size is not None and len(scale) != size:
                raise InvalidValueError(f"terms.{name}", scale, f"one factor, or {size}")
            for factor in scale if isinstance(scale, tuple) else (scale,):
                check_positive(f"terms.{name}", factor)
                check_range(f"terms.{name}", factor, 0.0, _LARGEST_SCALE)
        if type(self.history_length) is not int or not 1 <= self.history_length <= _LONGEST_HISTORY:
            allowed = f"a whole number from 1 to {_LONGEST_HISTORY}"
            raise InvalidValueError("history_length", self.history_length, allowed)

    def for_joints(self, joints: int) -> Observation:
        """The observation of a robot with so many joints."""
        return Observation(layout=self, joints=joints)


@dataclass(frozen=True, kw_only=True)
class Observation:
    """The observation of one robot: sizes and places of all terms."""

    layout: ObservationLayout
    """Terms and history."""
    joints: int
    """Actuated joints of the robot."""

    def size(self, name: str) -> int:
        """Numbers of a term."""
        size = OBSERVABLES[name].size
        return self.joints if size is None else size

    def scales(self, name: str) -> tuple[float, ...]:
        """The factor of each number of a term."""
        scale = self.layout.terms[name]
        return scale if isinstance(scale, tuple) else (scale,) * self.size(name)

    def place(self, name: str) -> slice:
        """Where a frame holds a term. Raises ``InvalidValueError`` where it does not."""
        start = 0
        for each in self.layout.terms:
            if each == name:
                return slice(start, start + self.size(each))
            start += self.size(each)
        raise InvalidValueError("term", name, f"one of {', '.join(self.layout.terms)}")

    @property
    def history_length(self) -> int:
        """Frames in the network input."""
        return self.layout.history_length

    @property
    def frame_size(self) -> int:
        """Numbers in one frame."""
        return sum(map(self.size, self.layout.terms))

    @property
    def sensor_sizes(self) -> dict[str, int]:
        """Numbers of each sensor, by the fields of ``Measurement``: what is noisy and low-passed."""
        return dict(zip(Measurement._fields, (3, 3, self.joints, self.joints), strict=True))

    @property
    def measured_size(self) -> int:
        """Numbers of all sensors together."""
        return sum(self.sensor_sizes.values())

    @property
    def input_size(self) -> int:
        """Numbers in the network input: frame size times history length."""
        return self.frame_size * self.history_length


class Measurement(NamedTuple):
    """What the robot's own sensors say at one policy step; for one robot without the leading dimensions."""

    angular_velocity: Array  # body frame [rad/s] ``(..., 3)``
    projected_gravity: Array  # unit gravity vector, body frame ``(..., 3)``
    joint_position: Array  # angles of the motor encoders [rad] ``(..., joints)``
    joint_velocity: Array  # [rad/s] ``(..., joints)``


def join_proprioception(parts: Measurement) -> Array:
    """All measured numbers ``(..., 6 + 2 joints)``: what the low-pass runs over."""
    xp = namespace(*parts)
    return xp.concat(tuple(parts), axis=-1)


def split_proprioception(values: Array) -> Measurement:
    """Inverse of ``join_proprioception`` (views, not copies)."""
    joints = (values.shape[-1] - 6) // 2
    return Measurement(
        values[..., 0:3], values[..., 3:6], values[..., 6 : 6 + joints], values[..., 6 + joints :]
    )


def projected_gravity(quaternion: Array, slope: Array | None = None) -> Array:
    """Unit gravity vector in the body frame ``(..., 3)`` from a unit quaternion w, x, y, z ``(..., 4)``.

    Args:
        quaternion: orientation of the body, against the ground.
        slope: angle ``(...)`` [rad] by which the ground rises along x; ``None``: it is level.
    """
    xp = namespace(quaternion)
    w, x, y, z = (quaternion[..., index] for index in range(4))
    down = (2 * (w * y - x * z), -2 * (w * x + y * z), 2 * (x * x + y * y) - 1)
    level = xp.stack(down, axis=-1)
    if slope is None:
        return level
    uphill = (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y))
    return xp.cos(slope)[..., None] * level - xp.sin(slope)[..., None] * xp.stack(uphill, axis=-1)


def observation_frame(
    layout: ObservationLayout, measured: Measurement, command: Array, previous_action: Array
) -> Array:
    """One scaled frame ``(..., F)`` of the layout's terms, made of ``Signals``."""
    signals = Signals(*measured, command, previous_action)
    parts: list[Array] = []  # not list[Array](), which PyTorch cannot compile
    for name, scale in layout.terms.items():
        value = OBSERVABLES[name].value(signals)
        if isinstance(scale, tuple):
            parts += [value[..., place : place + 1] * factor for place, factor in enumerate(scale)]
        else:
            parts.append(value * scale)
    return namespace(command).concat(parts, axis=-1)


def push_history(history: Array, frame: Array) -> Array:
    """History ``(..., H, F)`` with ``frame`` ``(..., F)`` as its newest, the oldest dropped."""
    xp = namespace(history, frame)
    return xp.concat((history[..., 1:, :], frame[..., None, :]), axis=-2)


def fill_history(frame: Array, history_length: int) -> Array:
    """History ``(..., H, F)`` of a fresh start: the first frame throughout."""
    xp = namespace(frame)
    shape = (*frame.shape[:-1], history_length, frame.shape[-1])
    return xp.broadcast_to(frame[..., None, :], shape)


def update_history(history: Array, frame: Array, reset_mask: Array) -> Array:
    """``push_history``, but rows marked in ``reset_mask`` ``(n,)`` start anew; history ``(n, H, F)``."""
    return where_rows(reset_mask, fill_history(frame, history.shape[-2]), push_history(history, frame))


def network_input(history: Array) -> Array:
    """The flattened history ``(..., H * F)``, oldest frame first."""
    xp = namespace(history)
    return xp.reshape(history, (*history.shape[:-2], history.shape[-2] * history.shape[-1]))
