"""Policy files: loading, inference, and the loop from a measurement to joint targets."""

from __future__ import annotations

import hashlib
import os
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sprintlab.control.action import joint_targets
from sprintlab.control.arrays import clip
from sprintlab.control.contract import (
    CONTRACT_KEY,
    ESTIMATE_TERMS,
    PolicyContract,
    check_contract,
    check_estimate,
    decode_contract,
)
from sprintlab.control.observation import (
    Measurement,
    fill_history,
    join_proprioception,
    network_input,
    observation_frame,
    push_history,
    split_proprioception,
)
from sprintlab.control.onnx_runtime import onnxruntime
from sprintlab.control.policy_graph import GraphError, check_graph
from sprintlab.control.standing import StandingHold
from sprintlab.core.errors import InvalidValueError, PolicyFileError, printable
from sprintlab.core.reading import read_bytes
from sprintlab.robots import RobotDescription

FloatArray = npt.NDArray[np.floating[Any]]

SHIPPED_POLICIES = Path(__file__).parents[1] / "policies"
"""Folder of the policies that come with the package."""

POLICY_LIMIT = 64 << 20
"""Largest policy file that is read [bytes]."""

ESTIMATE_SIZE = sum(term.size for term in ESTIMATE_TERMS)
"""Numbers of an estimate: body velocity 3 [m/s], base height 1 [m], probability of foot contact 4."""

_ELSEWHERE = "policies of other packages are judged from a rollout, see sprintlab audit --help"

_INPUT, _OUTPUT = "observation", "action"
_PREVIOUS, _ESTIMATE = "previous_estimate", "estimate"


class Decision(NamedTuple):
    """What a network gives, float32."""

    action: FloatArray  # ``(batch, joints)``
    # filtered, to be handed back at the next step ``(batch, 8)``; None for a network without an estimator
    estimate: FloatArray | None


class Policy:
    """A loaded policy file: its contract and its network. One thread at a time may use it."""

    def __init__(self, contract: PolicyContract, session: Any, digest: str) -> None:
        self.contract = contract
        self.digest = digest  # SHA-256 of the file that was read, which may be another one by now
        self.layout = contract.layout
        self._session = session

    @property
    def estimates(self) -> bool:
        """Whether the network estimates the state of the body and wants its last estimate back."""
        return self.contract.filters.estimate_cutoff_hz is not None

    def decide(self, observation: FloatArray, previous_estimate: FloatArray | None = None) -> Decision:
        """Actions and estimates for network inputs ``(batch, H * 45)``.

        ``previous_estimate`` is ``Decision.estimate`` of the step before ``(batch, 8)``; ``None``: zeros.
        """
        _check_batch("observation", observation, self.layout.input_size)
        if previous_estimate is not None and self.estimates:
            _check_batch("previous_estimate", previous_estimate, ESTIMATE_SIZE)
        inputs = {_INPUT: np.ascontiguousarray(observation, dtype=np.float32)}
        if self.estimates:
            if previous_estimate is None:
                previous_estimate = np.zeros((len(observation), ESTIMATE_SIZE), dtype=np.float32)
            inputs[_PREVIOUS] = np.ascontiguousarray(previous_estimate, dtype=np.float32)
        try:
            given = self._session.run([_OUTPUT, _ESTIMATE] if self.estimates else [_OUTPUT], inputs)
        except Exception as error:  # onnxruntime's exceptions share no other base
            raise PolicyFileError(f"the policy's network fails: {printable(error)}") from error
        return Decision(given[0], given[1] if self.estimates else None)


class PolicyRuntime:
    """Runs a policy: filter, observation, history, network and its estimate, joint targets (not torques).

    As the contract says, a robot that is commanded to rest and is nearly at rest is held in its default pose.

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
        standing = contract.standing if policy.estimates else None
        self._standing = None if standing is None else StandingHold(standing, contract.policy_rate_hz)
        self.reset()

    def reset(self) -> None:
        """Forget filter, history, previous action, estimate and hold.

        The next step starts from its own measurement and from a zero estimate.
        """
        self._filtered: FloatArray | None = None
        if self._standing is not None:
            self._standing.reset()
        self._forget()

    def _forget(self) -> None:
        """Forget what the network has seen and done."""
        self._estimate: FloatArray | None = None
        self._history: FloatArray | None = None
        self._previous_action: FloatArray = np.zeros(self._layout.joints)

    @property
    def previous_action(self) -> FloatArray:
        """The last action, limited ``(joints,)``; zeros after a reset."""
        return self._previous_action

    @property
    def last_estimate(self) -> FloatArray | None:
        """The last estimate, filtered ``(8,)``.

        Velocity in the body frame [m/s] 3, base height [m] 1, probability of foot contact 4. ``None`` before
        the first step, and for a policy without an estimator.
        """
        return None if self._estimate is None else self._estimate[0]

    def step(self, measurement: Measurement, command: FloatArray) -> FloatArray:
        """Joint position targets [rad] ``(joints,)`` for the next policy period.

        ``command``: forward speed, sideways speed [m/s], yaw rate [rad/s] ``(3,)``. A value that is refused
        leaves the runtime's state unchanged.
        """
        joints = self._layout.joints
        for field, size in zip(Measurement._fields, (3, 3, joints, joints), strict=True):
            _check_numbers(f"measurement.{field}", getattr(measurement, field), size)
        _check_numbers("command", command, 3)
        command = np.asarray(command)
        share = self._share(measurement, command)
        frame = self._frame(measurement, command)
        if self._history is None:
            self._history = fill_history(frame, self._layout.history_length)
        else:
            self._history = push_history(self._history, frame)
        decision = self._policy.decide(network_input(self._history)[None], self._estimate)
        action, self._estimate = share * decision.action[0], decision.estimate
        limit = self._policy.contract.action_limit
        self._previous_action = clip(action, -limit, limit)
        return joint_targets(action, self._default_pose, self._action_scale, limit)

    def _share(self, measurement: Measurement, command: FloatArray) -> float:
        """How much of the action is used; a robot that is let go begins as after a reset."""
        if self._standing is None:
            return 1.0
        held = self._standing.held
        velocity = np.zeros(3) if self._estimate is None else self._estimate[0, :3]
        share = self._standing.share(command, velocity, measurement.projected_gravity)
        if held and not self._standing.held:  # the estimate of a robot that stands is wrong by up to 1.1 m/s
            self._forget()
        return share

    def _frame(self, measurement: Measurement, command: FloatArray) -> FloatArray:
        relative = measurement._replace(joint_position=measurement.joint_position - self._default_pose)
        value = join_proprioception(relative)
        self._filtered = value if self._filtered is None else self._filter.step(self._filtered, value)
        measured = split_proprioception(self._filtered)
        return observation_frame(self._layout.layout, measured, command, self._previous_action)


def load_policy(path: str | os.PathLike[str], robot: RobotDescription | None = None) -> Policy:
    """Read an ONNX policy file; with a ``robot``, refuse a policy that was not made for it.

    Raises:
        PolicyFileError: the file is missing, unreadable, truncated, without a contract, or its network
            has other inputs or outputs than its contract says.
        ContractMismatchError: observation or estimate are not what this version builds, or the robot is
            another one.
    """
    session, digest = _open_session(Path(path))
    try:
        inputs, outputs = session.get_inputs(), session.get_outputs()
        text = session.get_modelmeta().custom_metadata_map.get(CONTRACT_KEY)
    except UnicodeDecodeError as error:
        raise PolicyFileError(f"{path} is damaged: a text in it is not UTF-8") from error
    if text is None:
        raise PolicyFileError(
            f"{path} is not a sprintlab policy: its metadata has no {CONTRACT_KEY}; {_ELSEWHERE}"
        )
    try:
        contract = decode_contract(text)
    except PolicyFileError as error:
        raise PolicyFileError(f"{path} is no usable policy: {error}") from error
    if robot is not None:
        check_contract(contract, robot)
    check_estimate(contract)
    policy = Policy(contract, session, digest)
    estimate = ESTIMATE_SIZE if policy.estimates else None
    _check_tensors(path, "input", inputs, {_INPUT: policy.layout.input_size, _PREVIOUS: estimate})
    _check_tensors(path, "output", outputs, {_OUTPUT: policy.layout.joints, _ESTIMATE: estimate})
    return policy


def shipped_policy(name: str = "sprint") -> Path:
    """Path of a policy that comes with the package."""
    known = shipped_policies()
    if name not in known:
        near = get_close_matches(name, known, n=1, cutoff=0.6)
        hint = f"did you mean {near[0]}?" if near else f"there is: {', '.join(known) or 'none'}"
        raise PolicyFileError(f"no policy named {name!r} comes with the package ({hint})")
    return known[name]


def shipped_policies() -> dict[str, Path]:
    """The policies that come with the package by name."""
    return {path.stem: path for path in sorted(SHIPPED_POLICIES.glob("*.onnx"))}


def _open_session(path: Path) -> tuple[Any, str]:
    """A file's digest, and a single-threaded CPU session: a 50 Hz loop must not fight the plant for cores."""
    content = read_bytes(path, POLICY_LIMIT, what="policy file", error=PolicyFileError)
    try:
        check_graph(content)
    except GraphError as error:
        raise PolicyFileError(
            f"{path} is damaged or not a sprintlab policy: its network {error}; {_ELSEWHERE}"
        ) from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4
    # Otherwise four letters at a file's begin make it another network, in the runtime's own format.
    options.add_session_config_entry("session.load_model_format", "ONNX")
    try:
        # There is nothing to fall back to, and the runtime prints that it does.
        session = onnxruntime.InferenceSession(
            content, options, providers=["CPUExecutionProvider"], enable_fallback=False
        )
    except Exception as error:  # onnxruntime's exceptions share no other base
        raise PolicyFileError(f"{path} is damaged or no ONNX file ({type(error).__name__})") from error
    return session, hashlib.sha256(content).hexdigest()


def _check_tensors(path: object, kind: str, tensors: Any, sizes: dict[str, int | None]) -> None:
    """Refuse a network whose inputs or outputs are not these names with these sizes; without one: absent."""
    expected = {name: size for name, size in sizes.items() if size is not None}
    found = {tensor.name: (tensor.type, list(tensor.shape)) for tensor in tensors}
    right = found.keys() == expected.keys()
    for name, (element, shape) in found.items():
        batch = len(shape) == 2 and not isinstance(shape[0], int) and shape[1] == expected.get(name)
        right = right and batch and element == "tensor(float)"
    if not right:
        wanted = ", ".join(f"{name} (batch, {size}) float32" for name, size in expected.items())
        raise PolicyFileError(f"{path}: the {kind} must be {wanted}, but the file has {found}")


def _check_batch(field: str, value: FloatArray, size: int) -> None:
    if value.ndim != 2 or value.shape[1] != size:
        raise InvalidValueError(f"{field} shape", value.shape, f"(batch, {size})")


def _check_numbers(field: str, value: Any, size: int) -> None:
    if np.shape(value) != (size,):
        raise InvalidValueError(field, np.shape(value), f"must have shape ({size},)")
    if not np.isfinite(value).all():
        raise InvalidValueError(field, value, "must be finite numbers")
