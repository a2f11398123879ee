"""What a policy sees: one frame per step, stacked over a short history.

For a robot of twelve joints a frame ``F`` has 45 numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from sprintlab.control.arrays import Array, namespace, where_rows
from sprintlab.core.checks import check_positive, check_range
from sprintlab.core.errors import InvalidValueError

_LARGEST_SCALE = 1e6  # what a sensor can show stays finite in 32 bits
_LONGEST_HISTORY = 1000  # frames: twenty seconds


class TermSpecification(NamedTuple):
    """One term of the observation: contract, buffers, networks and draws derive from it."""

    name: str
    """As in the contract, and as the argument of ``observation_frame``."""
    size: int | None
    """Numbers; ``None``: one per joint."""
    noise: str | None
    """Amplitude in the training's randomization; ``None``: not measured, so neither noisy nor filtered."""


OBSERVATION_TERMS = (
    TermSpecification("angular_velocity", 3, "angular_velocity_noise"),
    TermSpecification("projected_gravity", 3, "gravity_noise"),
    TermSpecification("command", 3, None),
    TermSpecification("joint_position", None, "joint_position_noise"),
    TermSpecification("joint_velocity", None, "joint_velocity_noise"),
    TermSpecification("previous_action", None, None),
)
"""The observation, in the order of the frame. Command: forward, sideways speed, yaw rate."""
MEASURED_TERMS = tuple(term for term in OBSERVATION_TERMS if term.noise is not None)
"""What sensors say, in the order of ``Proprioception``."""


class ObservationTerm(NamedTuple):
    """One term of the frame: its name, and the factor of each of its numbers ``(size,)``."""

    name: str
    scales: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class ObservationLayout:
    """Order, scales and history of the observation.

    Attributes:
        angular_velocity_scale: scale of the body angular velocity, per rad/s.
        projected_gravity_scale: scale of the unit gravity vector in the body frame.
        command_scale: scales of forward speed (per m/s), sideways speed (per m/s), yaw rate (per rad/s).
        joint_position_scale: scale of the joint position minus the default pose, per rad.
        joint_velocity_scale: scale of the joint velocity, per rad/s.
        previous_action_scale: scale of the previous action.
        history_length: frames in the network input, oldest first.

    Raises:
        InvalidValueError: a scale is not positive or above 1e6, ``command_scale`` has not three entries, or
            the history is no positive whole number.
    """

    angular_velocity_scale: float = 0.25
    projected_gravity_scale: float = 1.0
    command_scale: tuple[float, float, float] = (0.25, 1.0, 1.0)
    joint_position_scale: float = 1.0
    joint_velocity_scale: float = 0.05
    previous_action_scale: float = 0.5
    history_length: int = 5

    def __post_init__(self) -> None:
        if len(self.command_scale) != 3:
            raise InvalidValueError("command_scale", self.command_scale, "three scales: vx, vy, yaw rate")
        for term in self.for_joints(1).terms:
            for scale in term.scales:
                check_positive(f"{term.name} scale", scale)
                check_range(f"{term.name} scale", scale, 0.0, _LARGEST_SCALE)
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
    """Scales and history."""
    joints: int
    """Actuated joints of the robot."""

    @property
    def terms(self) -> tuple[ObservationTerm, ...]:
        """The terms in the order in which the frame holds them."""
        found: list[ObservationTerm] = []
        for term in OBSERVATION_TERMS:
            scale: float | tuple[float, ...] = getattr(self.layout, f"{term.name}_scale")
            size = self.size(term)
            found.append(
                ObservationTerm(term.name, tuple(scale) if isinstance(scale, tuple) else (scale,) * size)
            )
        return tuple(found)

    def size(self, term: TermSpecification) -> int:
        """Numbers of a term."""
        return self.joints if term.size is None else term.size

    def place(self, name: str) -> slice:
        """Where a frame holds a term."""
        start = 0
        for term in OBSERVATION_TERMS:
            if term.name == name:
                return slice(start, start + self.size(term))
            start += self.size(term)
        raise InvalidValueError("term", name, "one of " + ", ".join(term.name for term in OBSERVATION_TERMS))

    @property
    def history_length(self) -> int:
        """Frames in the network input."""
        return self.layout.history_length

    @property
    def frame_size(self) -> int:
        """Numbers in one frame."""
        return sum(self.size(term) for term in OBSERVATION_TERMS)

    @property
    def measured_size(self) -> int:
        """Numbers that come from sensors: those that are noisy and low-passed."""
        return sum(self.size(term) for term in MEASURED_TERMS)

    @property
    def input_size(self) -> int:
        """Numbers in the network input: frame size times history length."""
        return self.frame_size * self.history_length


class Proprioception(NamedTuple):
    """What the robot's own sensors say.

    Attributes:
        angular_velocity: body frame [rad/s] ``(..., 3)``.
        projected_gravity: unit gravity vector, body frame ``(..., 3)``.
        joint_position: relative to the default pose [rad] ``(..., joints)``.
        joint_velocity: [rad/s] ``(..., joints)``.
    """

    angular_velocity: Array
    projected_gravity: Array
    joint_position: Array
    joint_velocity: Array


def join_proprioception(parts: Proprioception) -> Array:
    """All measured numbers ``(..., 6 + 2 joints)``: what the low-pass runs over."""
    xp = namespace(*parts)
    return xp.concat(tuple(parts), axis=-1)


def split_proprioception(values: Array) -> Proprioception:
    """Inverse of ``join_proprioception`` (views, not copies)."""
    joints = (values.shape[-1] - 6) // 2
    return Proprioception(
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
    layout: ObservationLayout,
    *,
    angular_velocity: Array,
    projected_gravity: Array,
    command: Array,
    joint_position: Array,
    joint_velocity: Array,
    previous_action: Array,
) -> Array:
    """One scaled frame ``(..., F)`` in the order of ``OBSERVATION_TERMS``.

    Args:
        layout: order and scales.
        angular_velocity: body frame [rad/s] ``(..., 3)``.
        projected_gravity: unit gravity vector, body frame ``(..., 3)``.
        command: forward speed, sideways speed [m/s], yaw rate [rad/s] ``(..., 3)``.
        joint_position: relative to the default pose [rad] ``(..., joints)``.
        joint_velocity: [rad/s] ``(..., joints)``.
        previous_action: the action of the step before ``(..., joints)``.
    """
    xp = namespace(angular_velocity, command, joint_position)
    scaled_command = [command[..., i : i + 1] * scale for i, scale in enumerate(layout.command_scale)]
    parts = (
        angular_velocity * layout.angular_velocity_scale,
        projected_gravity * layout.projected_gravity_scale,
        *scaled_command,
        joint_position * layout.joint_position_scale,
        joint_velocity * layout.joint_velocity_scale,
        previous_action * layout.previous_action_scale,
    )
    return xp.concat(parts, axis=-1)


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
