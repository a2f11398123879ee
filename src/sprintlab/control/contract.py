"""The policy contract: everything that must be the same on both sides of a policy file.

It travels as JSON in the ONNX metadata under ``CONTRACT_KEY``; the runtime compares it with
the robot before the first step.
"""

from __future__ import annotations

import re
from typing import Any, cast

import msgspec
import numpy as np

from sprintlab.control.filters import LowPass
from sprintlab.control.observation import OBSERVABLES, Observation, ObservationLayout
from sprintlab.control.standing import StandingContract
from sprintlab.core.checks import check_finite, check_positive, check_range
from sprintlab.core.errors import ContractMismatchError, InvalidValueError, PolicyFileError
from sprintlab.core.reading import parse_json
from sprintlab.robots import RobotDescription, robot_fingerprint, robot_motors

CONTRACT_KEY = "sprintlab_contract"
FORMAT_VERSION = 2
HISTORY_ORDER = "oldest-first"
POLICY_RATE_HZ = 50.0
MOTOR_RATE_HZ = 1000.0
ACTION_LIMIT = 10.0
_LARGEST_ACTION = 1e6  # far beyond every joint, and finite in 32 bits

Vector = tuple[float, ...]
Interval = tuple[float, float]


def check_vector(field: str, vector: Vector, size: int) -> None:
    """Refuse a vector of another length or with a number that is not finite."""
    if len(vector) != size:
        raise InvalidValueError(field, vector, f"{size} numbers, one a joint")
    for value in vector:
        check_finite(field, value)


class TermContract(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One term of the observation frame: its name and the factor of each of its numbers."""

    name: str
    scales: Vector


class ObservationContract(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Terms of a frame in order, and how frames are stacked."""

    terms: tuple[TermContract, ...]
    history_length: int  # frames in the network input
    history_order: str = HISTORY_ORDER


class FilterContract(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Low-pass filters in front of the network."""

    proprioception_cutoff_hz: float  # on angular velocity, gravity, joint position and velocity [Hz]
    # on the estimate inside the network [Hz]; None for a policy without one. A network with one has a second
    # input, its own last estimate, which the runtime hands back
    estimate_cutoff_hz: float | None = None

    def __post_init__(self) -> None:
        check_positive("proprioception_cutoff_hz", self.proprioception_cutoff_hz, "Hz")
        if self.estimate_cutoff_hz is not None:
            check_positive("estimate_cutoff_hz", self.estimate_cutoff_hz, "Hz")


class EstimateTerm(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One term of an estimate: its name and how many numbers it has."""

    name: str
    size: int


ESTIMATE_TERMS = (
    EstimateTerm(name="body_velocity", size=3),
    EstimateTerm(name="base_height", size=1),
    EstimateTerm(name="foot_contact", size=4),
)
"""What an estimator tells, in order: velocity in the body frame [m/s], height of the trunk over the ground
[m], probability that a foot touches the ground."""


class MotorTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Motors and gears, one entry a joint (12), and the bus; units as in ``PmsmParameters``, ``Gear``."""

    pole_pairs: Vector
    stator_resistance: Vector
    q_axis_inductance: Vector
    flux_linkage: Vector
    peak_torque: Vector
    saturation: Vector
    rotor_inertia: Vector
    gear_ratio: Vector
    gear_efficiency: Vector
    bus_voltage: float


class TrainingRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the policy came to be: enough to make it again."""

    method: str  # name of the training method
    actuator_model: str  # motor model in training, one of ``sprintlab.motors.MOTOR_MODELS``
    command_line: str  # as typed
    config_hash: str  # SHA-256 of the whole configuration
    seed: int  # for every random generator
    iterations: int  # policy updates
    environment_steps: int  # policy steps of all environments together
    device: str  # the accelerator, in words
    date: str  # end of the training, ISO 8601

    def __post_init__(self) -> None:
        if re.fullmatch("[0-9a-f]{64}", self.config_hash) is None:
            raise InvalidValueError("training.config_hash", self.config_hash, "64 hexadecimal digits")


class PolicyContract(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a policy was made for; joints in policy order, SI units."""

    format_version: int = FORMAT_VERSION
    robot_name: str
    joint_names: tuple[str, ...]  # actuated joints
    default_pose: Vector  # joint positions of a zero action [rad]
    action_scale: Vector  # radians for an action of one
    action_limit: float  # greatest magnitude of an action that is used
    stiffness: Vector  # proportional gains [N m/rad]
    damping: Vector  # derivative gains [N m s/rad]
    observation: ObservationContract
    filters: FilterContract
    policy_rate_hz: float
    motor_rate_hz: float  # rate of the motor loop that the policy is meant for
    motors: MotorTable
    robot_fingerprint: str  # hash of the whole robot description, masses and lengths included
    software: dict[str, str]  # versions of the packages that made the policy
    training: TrainingRecord
    # Optional: files that do not tell have None.
    position_limits: tuple[Interval, ...] | None = None  # lowest and highest position of each joint [rad]
    estimate: tuple[EstimateTerm, ...] | None = None  # terms of the network's estimate in order
    standing: StandingContract | None = None  # when the robot is held in its default pose; None: never

    def __post_init__(self) -> None:
        joints = len(self.joint_names)
        if self.position_limits is not None:
            for end in (0, 1):
                limits = tuple(interval[end] for interval in self.position_limits)
                check_vector("position_limits", limits, joints)
        for field in ("default_pose", "action_scale", "stiffness", "damping"):
            check_vector(field, getattr(self, field), joints)
        for field in MotorTable.__struct_fields__:
            if field != "bus_voltage":
                check_vector(f"motors.{field}", getattr(self.motors, field), joints)
        for field in ("action_limit", "policy_rate_hz", "motor_rate_hz"):
            check_positive(field, getattr(self, field))
        check_range("action_limit", self.action_limit, 0.0, _LARGEST_ACTION)

    @property
    def layout(self) -> Observation:
        """The observation with this contract's joints, scales and history."""
        return layout_from_contract(self.observation, len(self.joint_names))

    @property
    def proprioception_filter(self) -> LowPass:
        """The low-pass on proprioception at the policy's rate."""
        return LowPass(cutoff_hz=self.filters.proprioception_cutoff_hz, rate_hz=self.policy_rate_hz)


def observation_contract(layout: Observation) -> ObservationContract:
    """What the contract says of an observation."""
    terms = tuple(TermContract(name=name, scales=layout.scales(name)) for name in layout.layout.terms)
    return ObservationContract(terms=terms, history_length=layout.history_length)


def layout_from_contract(observation: ObservationContract, joints: int) -> Observation:
    """Inverse of ``observation_contract``."""
    _require_equal("observation.history_order", observation.history_order, HISTORY_ORDER, "this version")
    for term in observation.terms:
        if term.name not in OBSERVABLES:
            _require_equal("observation.terms", term.name, list(OBSERVABLES), "this version")
    terms = {
        term.name: term.scales[0] if len(set(term.scales)) == 1 else term.scales for term in observation.terms
    }
    layout = ObservationLayout(terms=terms, history_length=observation.history_length).for_joints(joints)
    for term in observation.terms:
        size = layout.size(term.name)
        _require_equal(f"observation.{term.name} numbers", len(term.scales), size, "this version")
    return layout


def robot_section(robot: RobotDescription) -> dict[str, Any]:
    """The fields of a contract that a robot decides, in the order in which they are compared."""
    return {
        "robot_name": robot.name,
        "joint_names": tuple(robot.joint_names),
        "default_pose": _vector(robot.default_pose),
        "action_scale": _vector(robot.action_scale),
        "stiffness": _vector(robot.stiffness),
        "damping": _vector(robot.damping),
        "motors": _motor_table(robot),
        "position_limits": tuple(tuple(pair) for pair in robot.position_limits.tolist()),
        "robot_fingerprint": robot_fingerprint(robot),
    }


def make_contract(
    robot: RobotDescription,
    *,
    layout: ObservationLayout,
    training: TrainingRecord,
    software: dict[str, str],
    proprioception_filter: LowPass,
    estimate_filter: LowPass | None = None,
) -> PolicyContract:
    """The contract of a policy trained for ``robot``; its rate is that of the proprioception's low-pass.

    ``estimate_filter`` is the low-pass inside the network, ``None`` without an estimator.
    """
    return PolicyContract(
        **robot_section(robot),
        action_limit=ACTION_LIMIT,
        observation=observation_contract(layout.for_joints(len(robot.joint_names))),
        filters=FilterContract(
            proprioception_cutoff_hz=proprioception_filter.cutoff_hz,
            estimate_cutoff_hz=None if estimate_filter is None else estimate_filter.cutoff_hz,
        ),
        estimate=None if estimate_filter is None else ESTIMATE_TERMS,
        standing=None if estimate_filter is None else StandingContract(),
        policy_rate_hz=proprioception_filter.rate_hz,
        motor_rate_hz=MOTOR_RATE_HZ,
        software=software,
        training=training,
    )


def check_contract(contract: PolicyContract, robot: RobotDescription) -> None:
    """Refuse a policy that was not made for ``robot``, or that this version would run differently.

    The ``ContractMismatchError`` names the first field that differs, with both values.
    """
    _require_equal("format_version", contract.format_version, FORMAT_VERSION, "this version")
    _require_equal("policy_rate_hz", contract.policy_rate_hz, POLICY_RATE_HZ, "this version")
    _require_equal("motor_rate_hz", contract.motor_rate_hz, MOTOR_RATE_HZ, "this version")
    layout_from_contract(contract.observation, len(contract.joint_names))
    check_estimate(contract)
    for field, value in robot_section(robot).items():
        _compare_robot_field(field, getattr(contract, field), value, robot)


def check_estimate(contract: PolicyContract) -> None:
    """Refuse an estimate whose terms are not those of this version, or that no filter belongs to."""
    if contract.estimate is None:
        return
    known = ESTIMATE_TERMS if contract.filters.estimate_cutoff_hz is not None else ()
    here, there = ([f"{term.name} {term.size}" for term in terms] for terms in (contract.estimate, known))
    _require_equal("estimate", here, there, "this version")


def encode_contract(contract: PolicyContract) -> str:
    """JSON text for the ONNX metadata."""
    return msgspec.json.encode(contract).decode("utf-8")


def decode_contract(text: str) -> PolicyContract:
    """Inverse of ``encode_contract``."""
    try:
        content = parse_json(text, finite=True)
        version = msgspec.convert(content, _Header).format_version
        if version != FORMAT_VERSION:
            raise PolicyFileError(
                f"its contract has format {version}, this version reads format {FORMAT_VERSION}"
            )
        return msgspec.convert(content, PolicyContract)
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise PolicyFileError(f"its contract cannot be read: {error}") from error


class _Header(msgspec.Struct, frozen=True):
    format_version: int


def _vector(values: Any) -> Vector:
    return tuple(float(value) for value in np.asarray(values, dtype=np.float64).reshape(-1))


def _motor_table(robot: RobotDescription) -> MotorTable:
    columns = robot_motors(robot).parameters(robot.joint_names)
    table: dict[str, Any] = {name: _vector(column) for name, column in columns.items()}
    table["bus_voltage"] = float(robot.bus_voltage)
    return MotorTable(**table)


def _compare_robot_field(field: str, value: Any, expected: Any, robot: RobotDescription) -> None:
    """Compare one field of ``robot_section``; in a motor table or a vector, name the entry that differs."""
    owner = f"robot {robot.name}"
    if value is None:
        return  # a field that the file does not tell
    if isinstance(expected, MotorTable):
        for column in MotorTable.__struct_fields__:
            name = f"motors.{column}"
            _compare_robot_field(name, getattr(value, column), getattr(expected, column), robot)
    elif isinstance(expected, tuple) and field != "joint_names":
        for joint, here, there in zip(robot.joint_names, value, cast("Vector", expected), strict=True):
            _require_equal(f"{field}[{joint}]", here, there, owner)
    else:
        _require_equal(field, value, cast("object", expected), owner)


def _require_equal(field: str, value: object, expected: object, owner: str) -> None:
    if value != expected:
        raise ContractMismatchError(f"{field} differs: the policy has {value!r}, {owner} has {expected!r}")
