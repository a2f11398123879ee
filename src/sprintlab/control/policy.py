"""Policy files: loading, inference, and the loop from a measurement to joint targets."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import onnxruntime  # pyright: ignore[reportMissingTypeStubs]

from sprintlab.control.action import joint_targets
from sprintlab.control.arrays import clip
from sprintlab.control.contract import CONTRACT_KEY, PolicyContract, check_contract, decode_contract
from sprintlab.control.observation import (
    JOINT_COUNT,
    Proprioception,
    fill_history,
    join_proprioception,
    network_input,
    observation_frame,
    push_history,
    split_proprioception,
)
from sprintlab.core.errors import InvalidValueError, PolicyFileError
from sprintlab.robots import RobotDescription

FloatArray = npt.NDArray[np.floating[Any]]

SHIPPED_POLICIES = Path(__file__).parent / "policies"
"""Folder of the policies that come with the package."""

_INPUT, _OUTPUT = "observation", "action"


class Policy:
    """A loaded policy file: its contract and its network.

    Attributes:
        contract: what the policy was made for.
        layout: the observation that it sees.
    """

    def __init__(self, contract: PolicyContract, session: Any) -> None:
        self.contract = contract
        self.layout = contract.layout
        self._session = session

    def infer(self, observation: FloatArray) -> FloatArray:
        """Actions ``(batch, 12)`` float32 for network inputs ``(batch, H * 45)``.

        Raises:
            InvalidValueError: the input has another shape.
        """
        size = self.layout.input_size
        if observation.ndim != 2 or observation.shape[1] != size:
            raise InvalidValueError("observation shape", observation.shape, f"(batch, {size})")
        inputs = {_INPUT: np.ascontiguousarray(observation, dtype=np.float32)}
        return self._session.run([_OUTPUT], inputs)[0]


class Measurement(NamedTuple):
    """What the robot's sensors say at one policy step.

    Attributes:
        angular_velocity: body frame [rad/s] ``(3,)``.
        projected_gravity: unit gravity vector, body frame ``(3,)``.
        joint_position: of the motor encoders [rad] ``(12,)``.
        joint_velocity: [rad/s] ``(12,)``.
    """

    angular_velocity: FloatArray
    projected_gravity: FloatArray
    joint_position: FloatArray
    joint_velocity: FloatArray


class PolicyRuntime:
    """Runs a policy on one robot: filter, observation, history, network, joint targets.

    Args:
        policy: the loaded policy.
        robot: the robot it shall drive.

    Raises:
        ContractMismatchError: the policy was not made for this robot.
    """

    def __init__(self, policy: Policy, robot: RobotDescription) -> None:
        check_contract(policy.contract, robot)
        contract = policy.contract
        self._policy = policy
        self._layout = policy.layout
        self._filter = contract.proprioception_filter
        self._default_pose = np.asarray(contract.default_pose)
        self._action_scale = np.asarray(contract.action_scale)
        self.reset()

    def reset(self) -> None:
        """Forget filter, history and previous action: the next step starts from its own measurement."""
        self._filtered: FloatArray | None = None
        self._history: FloatArray | None = None
        self._previous_action: FloatArray = np.zeros(JOINT_COUNT)

    @property
    def previous_action(self) -> FloatArray:
        """The last action, limited ``(12,)``; zeros after a reset."""
        return self._previous_action

    def step(self, measurement: Measurement, command: FloatArray) -> FloatArray:
        """Joint position targets [rad] ``(12,)`` for the next policy period.

        Args:
            measurement: of this step.
            command: forward speed, sideways speed [m/s], yaw rate [rad/s] ``(3,)``.

        Raises:
            InvalidValueError: a value is NaN or infinite or has the wrong shape; the runtime's state is
                then unchanged.
        """
        for field, size in zip(Measurement._fields, (3, 3, JOINT_COUNT, JOINT_COUNT), strict=True):
            _check_numbers(f"measurement.{field}", getattr(measurement, field), size)
        _check_numbers("command", command, 3)
        frame = self._frame(measurement, np.asarray(command))
        if self._history is None:
            self._history = fill_history(frame, self._layout.history_length)
        else:
            self._history = push_history(self._history, frame)
        action = self._policy.infer(network_input(self._history)[None])[0]
        limit = self._policy.contract.action_limit
        self._previous_action = clip(action, -limit, limit)
        return joint_targets(action, self._default_pose, self._action_scale, limit)

    def _frame(self, measurement: Measurement, command: FloatArray) -> FloatArray:
        relative = measurement._replace(joint_position=measurement.joint_position - self._default_pose)
        value = join_proprioception(Proprioception(*relative))
        self._filtered = value if self._filtered is None else self._filter.step(self._filtered, value)
        return observation_frame(
            self._layout,
            **split_proprioception(self._filtered)._asdict(),
            command=command,
            previous_action=self._previous_action,
        )


def load_policy(path: str | os.PathLike[str]) -> Policy:
    """Read a policy file.

    Raises:
        PolicyFileError: the file is missing, unreadable, truncated, without a contract, or its network
            has other inputs or outputs than its contract says.
        ContractMismatchError: the observation is not one that this version builds.
    """
    session = _open_session(Path(path))
    text = session.get_modelmeta().custom_metadata_map.get(CONTRACT_KEY)
    if text is None:
        raise PolicyFileError(f"{path} is no sprintlab policy: its metadata has no {CONTRACT_KEY}")
    try:
        contract = decode_contract(text)
    except PolicyFileError as error:
        raise PolicyFileError(f"{path} is no usable policy: {error}") from error
    policy = Policy(contract, session)
    _check_tensors(path, "input", session.get_inputs(), _INPUT, policy.layout.input_size)
    _check_tensors(path, "output", session.get_outputs(), _OUTPUT, JOINT_COUNT)
    return policy


def shipped_policy(name: str = "sprint") -> Path:
    """Path of a policy that comes with the package.

    Raises:
        PolicyFileError: there is none of that name; the message lists those there are.
    """
    names = sorted(path.stem for path in SHIPPED_POLICIES.glob("*.onnx"))
    if name not in names:
        known = ", ".join(names) or "none"
        raise PolicyFileError(f"no policy named {name!r} comes with the package (there is: {known})")
    return SHIPPED_POLICIES / f"{name}.onnx"


def _open_session(path: Path) -> Any:
    """A single-threaded CPU session: a 50 Hz loop must not fight the plant for cores."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise PolicyFileError(f"cannot read policy file {path}: {error.strerror or error}") from error
    runtime: Any = onnxruntime
    options = runtime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    try:
        return runtime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's exceptions share no other base
        raise PolicyFileError(f"{path} is damaged or no ONNX file ({type(error).__name__})") from error


def _check_tensors(path: object, kind: str, tensors: Any, name: str, size: int) -> None:
    found = [(tensor.name, tensor.type, list(tensor.shape)) for tensor in tensors]
    if len(found) == 1:
        found_name, found_type, shape = found[0]
        batched = len(shape) == 2 and not isinstance(shape[0], int)
        if found_name == name and found_type == "tensor(float)" and batched and shape[1] == size:
            return
    raise PolicyFileError(
        f"{path}: the {kind} must be {name} (batch, {size}) float32, but the file has {found}"
    )


def _check_numbers(field: str, value: Any, size: int) -> None:
    if np.shape(value) != (size,):
        raise InvalidValueError(field, np.shape(value), f"must have shape ({size},)")
    if not np.all(np.isfinite(value)):
        raise InvalidValueError(field, value, "must be finite numbers")
