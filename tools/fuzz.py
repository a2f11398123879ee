"""Mutate the files that sprintlab reads, and see that each is read or refused in one sentence, in time.

    python tools/fuzz.py --seconds 3600 --kind log --seed 7

Every kind of file starts from good ones that this script makes; of networks others are made up as well. A
file is a finding where its reader raises anything but a ``SprintlabError`` of one line, computes for longer
than ten seconds, or ends the process. Findings are kept in ``--output``.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import re
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sprintlab.core.errors import SprintlabError

LONGEST = 10.0
"""Time that the processor may work on reading a file [s]: a busy machine does not count."""
TOKENS = (
    b"9" * 400, b"-1", b"0", b"1e308", b"-1e308", b"1e999", b"nan", b"inf", b"18446744073709551616",
    b"9223372036854775807", b"true", b'""', b"null", b"[", b"]", b"{", b"}", b"[" * 2000, b"\x00",
    b"\xff\xfe", b"\x1b[2J", b"[red]", b"[/]", "\u202e".encode(), b"../../../etc/passwd", b"\n", b"=",
    b",", b";" * 500, b" " * 3000, b"a." * 500,
)  # fmt: skip
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of file."""

    name: str
    suffix: str
    make: Callable[[Path], list[bytes]]
    """Good files; may write into the folder."""
    read: Callable[[Path], object]
    """What a command does with such a file."""
    change: Callable[[bytes, random.Random], bytes] | None = None
    """Makes another file of a good one; ``mutated`` when left out."""
    apart: bool = False
    """Whether its reader calls what can end a process."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A file that was neither read nor refused as it should be."""

    kind: str
    content: bytes
    what: str


def mutated(content: bytes, rng: random.Random) -> bytes:
    """One file with one to four random changes."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        place = rng.randrange(len(data) + 1)
        change = rng.randrange(8)
        if change == 0 and data:
            data[place % len(data)] ^= 1 << rng.randrange(8)
        elif change == 1:
            data[place:place] = rng.choice(TOKENS)
        elif change == 2:
            del data[place : place + rng.choice((1, 4, 8, 100, 5000))]
        elif change == 3:
            data = data[:place]
        elif change == 4:
            data[place:place] = data[place : place + rng.choice((1, 8, 100, 2000))]
        elif change == 5:
            size = rng.choice((1, 2, 4, 8))
            value = rng.choice((0, 1, 2**31 - 1, 2**63 - 1, 2**64 - 1, 2**32 - 1, rng.getrandbits(64)))
            data[place : place + size] = (value & (1 << 8 * size) - 1).to_bytes(size, "little")
        elif numbers := list(_NUMBER.finditer(bytes(data[:200_000]))):
            chosen = rng.choice(numbers)
            data[chosen.start() : chosen.end()] = rng.choice(TOKENS)
    return bytes(data)


def fuzz(
    kind: Kind, seconds: float, seed: int = 0, most: int | None = None
) -> Iterator[tuple[int, Finding | None]]:
    """Read mutated files until the time is up; yields a running count, and what was found."""
    rng, count = random.Random(seed), 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seeds = kind.make(folder)
        path = folder / f"fuzzed{kind.suffix}"
        for content in seeds:
            path.write_bytes(content)
            kind.read(path)  # good files are read, or the fuzzing would say nothing
        change, started = kind.change or mutated, time.monotonic()
        with _Reader(kind) as look:
            while (count == 0 or time.monotonic() - started < seconds) and (most is None or count < most):
                content = change(rng.choice(seeds), rng)
                path.write_bytes(content)
                count += 1
                what = look(path)
                yield count, None if what is None else Finding(kind=kind.name, content=content, what=what)


def trouble(kind: Kind, path: Path) -> str | None:
    """What is wrong with the way in which a file is read; None where nothing is."""
    started = _worked()
    try:
        kind.read(path)
    except SprintlabError as error:
        if "\n" in str(error).strip():
            return f"a refusal of several lines: {error!r}"
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return "".join(traceback.format_exception(error))
    spent = _worked() - started
    return f"it took {spent:.1f} s" if spent > LONGEST else None


class _Reader:
    """``trouble`` of a kind, in a process of its own where the kind is read ``apart``."""

    def __init__(self, kind: Kind) -> None:
        self._kind = kind
        self._child: subprocess.Popen[str] | None = None

    def __enter__(self) -> _Reader:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def __call__(self, path: Path) -> str | None:
        if not self._kind.apart:
            return trouble(self._kind, path)
        if self._child is None:
            command = [sys.executable, __file__, "--read", self._kind.name]
            self._child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._child.stdin is not None and self._child.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            print(path, file=self._child.stdin, flush=True)
        answer = self._child.stdout.readline()
        return json.loads(answer) if answer else f"the process ended with status {self._end()}"

    def _end(self) -> int | None:
        child, self._child = self._child, None
        if child is not None:
            with contextlib.suppress(BrokenPipeError):
                child.communicate()
            child.wait()
        return None if child is None else child.returncode


def read_apart(kind: Kind) -> None:
    """Say what is wrong with each of the files whose names come down standard input."""
    for line in sys.stdin:
        print(json.dumps(trouble(kind, Path(line.removesuffix("\n")))), flush=True)


def _worked() -> float:
    """Processor time of this process and of those that it started and that ended [s]."""
    return sum(os.times()[:4])


# --- kinds of files ---------------------------------------------------------------------------------------


def _text_of(*paths: Path) -> Callable[[Path], list[bytes]]:
    return lambda _folder: [path.read_bytes() for path in paths]


def _motor() -> Kind:
    from sprintlab.motors import load_motor, save_motor
    from sprintlab.motors.actuator_library import library_motors, load_library_motor

    def make(folder: Path) -> list[bytes]:
        save_motor(load_library_motor(library_motors()[0]).motor, folder / "motor.toml")
        return [(folder / "motor.toml").read_bytes()]

    return Kind(name="motor", suffix=".toml", make=make, read=load_motor)


def _supply() -> Kind:
    from sprintlab.motors import load_supply

    text = (
        b"[battery]\nseries_cells = 14\ninternal_resistance = 0.05\ncapacity = 10.0\n"
        b"[heat]\nheat_capacity = 90.0\nhousing_heat_capacity = 400.0\nhousing_thermal_resistance = 0.5\n"
        b"[i2t]\ncontinuous_current = [20.0, 25.0]\npeak_duration = 2.0\n"
    )
    return Kind(name="supply", suffix=".toml", make=lambda _: [text], read=load_supply)


def _datasheet() -> Kind:
    from sprintlab.workbench.datasheet_file import load_datasheet

    text = (
        b'[datasheet]\nname = "m"\npole_pairs = 21\nconnection = "star"\n'
        b'resistance = { value = "0.19 ohm", between = "lines" }\n'
        b'kv = { value = "100 rpm/V", voltage = "dc" }\npeak_torque = "30 N m"\n'
    )
    return Kind(name="datasheet", suffix=".toml", make=lambda _: [text], read=load_datasheet)


def _robot() -> Kind:
    from sprintlab.robots import ModelOptions, build_model, load_robot, robot_names
    from sprintlab.robots.loader import robot_table_path

    def read(path: Path) -> object:
        return build_model(load_robot(path), ModelOptions())

    return Kind(
        name="robot", suffix=".toml", make=_text_of(*(robot_table_path(n) for n in robot_names())), read=read
    )


def _bench() -> Kind:
    from sprintlab.workbench.identification import identify, load_bench

    rng = np.random.default_rng(0)
    rows = [b"speed [rad/s],iq [A],torque [N m],vq [V],vd [V]"]
    for speed in (50.0, 150.0, 250.0):
        for current in (2.0, 10.0, 20.0, 30.0):
            torque = 1.5 * 21 * 0.01 * current + 1e-3 * rng.normal()
            v_q, v_d = 0.1 * current + 21 * speed * 0.01, -21 * speed * 1e-4 * current
            rows.append(f"{speed},{current},{torque:.5f},{v_q:.5f},{v_d:.5f}".encode())

    def read(path: Path) -> object:
        return identify(load_bench(path), pole_pairs=21)

    return Kind(name="bench", suffix=".csv", make=lambda _: [b"\n".join(rows) + b"\n"], read=read)


def _profile() -> Kind:
    from sprintlab.deployment.sources.profile import load_velocity_table

    text = b"time,forward,yaw_rate\n0,0,0\n2.5,6.0,0.1\n9,6,0\n"
    return Kind(name="profile", suffix=".csv", make=lambda _: [text], read=load_velocity_table)


def _profile_toml() -> Kind:
    from sprintlab.deployment.sources.profile import load_velocity_table

    text = b"[[segment]]\nduration = 2.0\nforward = 1.5\n[[segment]]\nduration = 1.0\nyaw_rate = 0.2\n"
    return Kind(name="profile-toml", suffix=".toml", make=lambda _: [text], read=load_velocity_table)


def _policy() -> Kind:
    from sprintlab.control import load_policy, shipped_policy

    def read(path: Path) -> object:
        policy = load_policy(path)
        return policy.infer(np.zeros((1, policy.layout.input_size), dtype=np.float32))

    def make(folder: Path) -> list[bytes]:
        """With and without a calibration, a pace and a turning loop in its contract."""
        return [shipped_policy(name).read_bytes() for name in ("sprint", "go1-sprint")]

    return Kind(name="policy", suffix=".onnx", make=make, read=read, apart=True)


def _network() -> Kind:
    """Policies whose contract is good, and whose network is made up at random."""
    policy = _policy()
    return Kind(
        name="network", suffix=".onnx", make=policy.make, read=policy.read, change=_made_up, apart=True
    )


# What operators are given: a letter for each tensor (f floats, i whole numbers, b truth values, * any), and
# the values that their attributes choose among.
_FEW = (0, 1, -1, 2, 7, -8, 2**31, -(2**63))
_ONE_FOR_ONE = (
    "Abs Celu Cos Elu Erf Exp Gelu HardSigmoid HardSwish LeakyRelu Log LogSoftmax Mish Neg Reciprocal Relu "
    "Selu Sigmoid Sign Sin Softmax Softplus Softsign Sqrt Tanh Floor Ceil Round"
)
_TWO_TO_ONE = "Add Sub Mul Div Pow Min Max Sum Mean PRelu Equal Less Greater LessOrEqual And Or MatMul"
_OPERATORS: dict[str, tuple[str, dict[str, tuple[object, ...]]]] = {
    **dict.fromkeys(_ONE_FOR_ONE.split(), ("f", {})),
    **dict.fromkeys(_TWO_TO_ONE.split(), ("**", {})),
    **dict.fromkeys(("ReduceMean", "ReduceSum", "ReduceMax", "ReduceMin"), (
        "*i", {"keepdims": (0, 1, 2), "axes": ([0], [1], [0, 1], [], [-9]), "noop_with_empty_axes": (0, 1)},
    )),
    "Softmax": ("f", {"axis": _FEW}), "LogSoftmax": ("f", {"axis": _FEW}), "Identity": ("*", {}),
    "Clip": ("fff", {}), "Not": ("b", {}), "Where": ("b**", {}), "Flatten": ("*", {"axis": _FEW}),
    "LayerNormalization": ("fff", {"axis": _FEW, "epsilon": (0.0, -1.0, 1e38)}),
    "BatchNormalization": ("fffff", {"training_mode": (0, 1), "epsilon": (0.0, 1e38)}),
    "Cast": ("*", {"to": (1, 2, 3, 6, 7, 8, 9, 10, 11, 16, 99)}), "Shape": ("*", {"start": _FEW}),
    "Gemm": ("fff", {"transA": (0, 1, 2), "transB": (0, 1), "alpha": (0.0, 1e38)}),
    "Constant": ("", {"value_int": _FEW, "value_ints": ([], [1, 12], [-1]), "value_float": (0.5, 1e38)}),
    "Gather": ("*i", {"axis": _FEW}), "Unsqueeze": ("*i", {"axes": ([0], [1, 1], [])}),
    "Squeeze": ("*i", {"axes": ([0], [1], [])}), "Concat": ("**", {"axis": _FEW}),
    "ConstantOfShape": ("i", {}), "Expand": ("*i", {}), "Tile": ("*i", {}), "Slice": ("*iiii", {}),
    "Reshape": ("*i", {"allowzero": (0, 1)}), "Transpose": ("*", {"perm": ([0, 1], [1, 0], [0, 0], [2])}),
    "Split": ("*i", {"axis": _FEW, "num_outputs": (1, 2, 3), "split": ([6, 6], [12], [-1, 13])}),
    "Loop": ("ib*", {}), "GRU": ("fff", {"hidden_size": _FEW}), "Einsum": ("ff", {"equation": ("ij,jk",)}),
    "Pad": ("*i", {"mode": ("wrap", "edge")}), "TopK": ("fi", {"axis": _FEW}), "NonZero": ("*", {}),
}  # fmt: skip


def _made_up(good: bytes, rng: random.Random) -> bytes:
    """A policy file whose network is a few operators at random before one that fits; at times damaged."""
    import onnx
    from onnx import TensorProto, helper

    known = {"f": ["observation", "previous_estimate"], "i": list[str](), "b": list[str]()}
    tensors = [_tensor(rng, f"t{number}", known) for number in range(rng.choice((4, 8, 12)))]
    nodes = [_node(rng, number, known) for number in range(rng.choice((1, 1, 1, 2, 3, 6)))]
    made = [name for node in nodes for name in node.output if name]
    used = [helper.make_node("Cast", [name], [f"cast {name}"], to=TensorProto.FLOAT) for name in made]
    used += [
        helper.make_node("ReduceMax", [f"cast {name}"], [f"most {name}"], keepdims=0) for name in made
    ]  # fmt: skip
    used.append(helper.make_node("Sum", [f"most {name}" for name in made] or ["t0"], ["all"]))
    for name, size in (("action", 12), ("estimate", 8)):
        tensors.append(helper.make_tensor(f"w {name}", TensorProto.FLOAT, [450, size], [0.0] * 450 * size))
        used.append(helper.make_node("Gemm", ["observation", f"w {name}"], [f"raw {name}"]))
        used.append(helper.make_node("Add", [f"raw {name}", "all"], [name]))
    policy = onnx.load_from_string(good)
    graph = helper.make_graph(
        nodes + used, "g", [*policy.graph.input], [*policy.graph.output], tensors,
        value_info=[_told(rng, name) for name in made if rng.random() < 0.1],
    )  # fmt: skip
    opset = helper.make_opsetid("", rng.choice((7, 11, 13, 17, 17, 18, 20, 21)))
    model = helper.make_model(graph, opset_imports=[opset], ir_version=rng.choice((6, 8, 8, 10)))
    model.metadata_props.extend(policy.metadata_props)
    content = model.SerializeToString()
    return mutated(content, rng) if rng.random() < 0.05 else content


def _shape(rng: random.Random) -> list[int]:
    return rng.choice(([], [1], [12], [1, 12], [12, 12], [450, 12], [0], [2, 0, 3], [1] * 9, [3, 1, 2]))


def _tensor(rng: random.Random, name: str, known: dict[str, list[str]]) -> Any:
    """Numbers that are there from the start."""
    from onnx import TensorProto, helper

    kind = rng.choice("ffiiib")
    known[kind].append(name)
    shape = rng.choice(([], [1], [2], [3])) if kind == "i" else _shape(rng)
    draw = {"f": lambda: rng.choice((0.0, 1.0, -1e38)), "i": lambda: rng.choice(_FEW), "b": lambda: True}[
        kind
    ]
    count = int(np.prod(shape))
    type_ = {"f": TensorProto.FLOAT, "i": rng.choice((TensorProto.INT64, TensorProto.INT32)), "b": 9}[kind]
    values = [
        min(max(draw(), -(2**31)), 2**31 - 1) if type_ == TensorProto.INT32 else draw() for _ in range(count)
    ]
    return helper.make_tensor(name, type_, shape, values)


def _node(rng: random.Random, number: int, known: dict[str, list[str]]) -> Any:
    """An operator on what is known, or on what it should not have; what it makes is known after it."""
    from onnx import AttributeProto, helper

    operator = rng.choice(list(_OPERATORS))
    letters, choices = _OPERATORS[operator]
    everything = [name for names in known.values() for name in names]
    inputs = [rng.choice(known.get(letter) or everything) for letter in letters]
    inputs = inputs[: rng.choice((len(inputs), len(inputs), 1))]
    if inputs and rng.random() < 0.1:
        inputs[rng.randrange(len(inputs))] = rng.choice(("", "nowhere", f"n{number}", *everything))
    chosen = [name for name in choices if rng.random() < 0.5]
    values = {name: rng.choice(choices[name]) for name in chosen}
    outputs = [
        f"n{number}" if place == 0 else f"n{number}.{place}"
        for place in range(rng.choice((1, 1, 1, 1, 1, 1, 1, 2, 3)))
    ]
    if rng.random() < 0.05:
        outputs[rng.randrange(len(outputs))] = rng.choice(("", "observation", "action", "t0"))
    known["i" if operator in ("Shape", "NonZero") else "f"] += [name for name in outputs if name]
    node = helper.make_node(operator, inputs, outputs)
    for name, value in values.items():
        list_of = AttributeProto.INTS if isinstance(value, list) else None
        node.attribute.append(helper.make_attribute(name, value, attr_type=list_of))
    return node


def _told(rng: random.Random, name: str) -> Any:
    """What a file says of a tensor within it, true or not."""
    from onnx import helper

    return helper.make_tensor_value_info(
        name, rng.choice((1, 7, 9, 10)), rng.choice((_shape(rng), ["batch"]))
    )


def _recording(folder: Path) -> list[bytes]:
    time_, count = np.arange(0.0, 1.0, 0.002), 500
    joints = {
        name: np.zeros((count, 12))
        for name in (
            "joint_velocity", "joint_torque", "motor_torque", "torque_lower", "torque_upper", "joint_position"
        )
    }  # fmt: skip
    qpos = np.zeros((count, 23))
    qpos[:, 3] = 1.0
    more = {"velocity": np.zeros((count, 2)), "command": np.zeros((count, 3)), "qpos": qpos}
    found = []
    for save in (np.savez, np.savez_compressed):
        save(folder / "t.npz", time=time_, angular_velocity=np.zeros((count, 3)), **more, **joints)
        found.append((folder / "t.npz").read_bytes())
    return found


def _trajectory() -> Kind:
    from sprintlab.evaluation.operating_points import load_operating_points
    from sprintlab.viewer.replay import load_arrays

    def read(path: Path) -> object:
        return load_arrays(path), load_operating_points(path, (0, 3))

    return Kind(name="trajectory", suffix=".npz", make=_recording, read=read)


def _result() -> Kind:
    from sprintlab.api.replay import race_result, replay_text

    text = (
        b'{"robot": "bp2", "policy": "sprint", "time_100m_s": 10.5, "top_speed_command_m_s": 12.0, '
        b'"audit": {"passed": true}}'
    )

    def read(path: Path) -> object:
        return replay_text(path, "bp2", race_result(path))

    return Kind(name="result", suffix=".json", make=lambda _: [text], read=read)


def _log() -> Kind:
    from sprintlab.deployment.log import read_log

    return Kind(name="log", suffix=".mcap", make=_log_files, read=read_log)


def _log_files(folder: Path) -> list[bytes]:
    import io

    import msgspec

    from sprintlab.deployment.interface import JointCommand, JointMode, PositionFix, RobotState, encode
    from sprintlab.deployment.log.run_log import LogFacts
    from sprintlab.deployment.log.topics import (
        COMMAND,
        END,
        FIX,
        START,
        STATE,
        TICK,
        TOPICS,
        Frame,
        TickRecord,
        pack,
    )
    from sprintlab.deployment.log.writer import write_log

    joints, three = np.zeros(12), np.zeros(3)
    frames = [
        Frame(START, 0, 0, msgspec.json.encode(LogFacts(robot="bp2", contract="{}", facts={"policy": "p"})))
    ]
    for n in range(1, 200):
        now = n * 1_000_000
        state = RobotState(
            sequence=n, timestamp=now, joint_position=joints, joint_velocity=joints, joint_torque=joints,
            quaternion=np.array([1.0, 0, 0, 0]), angular_velocity=three, bus_voltage=58.0,
        )  # fmt: skip
        command = JointCommand(
            sequence=n, timestamp=now, mode=JointMode.SERVO, target_position=joints, stiffness=joints,
            damping=joints, feedforward_torque=joints,
        )  # fmt: skip
        fix = PositionFix(sequence=n, timestamp=now, position=three, velocity=three)
        tick = TickRecord(
            time=1e-3 * n, mode="run", velocity=(0.0, 0.0, 0.0), targets=(0.0,) * 12, policy_step=True,
            faults=(), compute_time=1e-4,
        )  # fmt: skip
        contents = {STATE: encode(state), COMMAND: encode(command), FIX: encode(fix)}
        contents[TICK] = msgspec.json.encode(tick)
        frames += [Frame(TOPICS.index(topic), now, n, content) for topic, content in contents.items()]
    frames.append(Frame(END, 0, 0, b"0"))
    stream = io.BytesIO(b"".join(pack(frame) for frame in frames))
    write_log(stream, folder / "run.mcap")
    whole = (folder / "run.mcap").read_bytes()
    return [whole, *[whole[:-1]] * 2]  # of a file that was cut off no checksum of the whole is compared


def _model() -> Kind:
    from sprintlab.robots.importing import read_source

    legs = "".join(
        f'<body name="{leg}a" pos="{x} {y} 0"><joint name="{leg}1" axis="1 0 0" range="-1 1" limited="true"/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/><body name="{leg}b">'
        f'<joint name="{leg}2" axis="0 1 0" range="-2 2" limited="true"/><inertial pos="0 0 -.1" mass="1" '
        f'diaginertia="0.01 0.01 0.01"/><body name="{leg}c" pos="0 0 -.2"><joint name="{leg}3" axis="0 1 0" '
        f'range="-2 2" limited="true"/><inertial pos="0 0 -.1" mass=".3" diaginertia="0.002 0.002 0.002"/>'
        f'<geom type="sphere" size=".02" pos="0 0 -.2"/></body></body></body>'
        for leg, x, y in (("fl", 0.2, 0.1), ("fr", 0.2, -0.1), ("rl", -0.2, 0.1), ("rr", -0.2, -0.1))
    )
    text = (
        '<mujoco><worldbody><body name="trunk"><freejoint/><inertial pos="0 0 0" mass="10" '
        f'diaginertia="0.1 0.3 0.3"/>{legs}</body></worldbody></mujoco>'
    )
    return Kind(name="model", suffix=".xml", make=lambda _: [text.encode()], read=read_source)


def _checkpoint() -> Kind:
    import torch

    from sprintlab.training.runs.checkpoint import read_checkpoint, write_checkpoint
    from sprintlab.training.settings import TrainingSettings

    def make(folder: Path) -> list[bytes]:
        state = {
            "settings": TrainingSettings(), "config_hash": "0" * 64, "command_line": "", "device": "CPU",
            "versions": {}, "date": "", "learner": {"actor": {"w": torch.zeros(40)}},
            "progress": {"iteration": 1, "environment_steps": 8, "seconds": 1.0, "log": [{"reward": 1.0}]},
        }  # fmt: skip
        write_checkpoint(state, folder / "c.pt")
        return [(folder / "c.pt").read_bytes()]

    def read(path: Path) -> object:
        _mend(path)
        return read_checkpoint(path)

    return Kind(name="checkpoint", suffix=".pt", make=make, read=read)


def _mend(path: Path) -> None:
    """A checksum that fits, in two of three files: a stranger can write one, and only then it is read on."""
    from sprintlab.training.runs.checkpoint import _checksum

    content = path.read_bytes()
    told = re.search(rb'"sha256": "([0-9a-f]{64})"', content)
    if told is not None and len(content) % 3:
        blank = content[: told.start(1)] + b"0" * 64 + content[told.end(1) :]
        fitting = _checksum(blank).encode()
        path.write_bytes(content[: told.start(1)] + fitting + content[told.end(1) :])


def _ring() -> Kind:
    from sprintlab.deployment.bus.ring import RingReader, RingWriter, ring_size

    def read(path: Path) -> object:
        content = path.read_bytes()[: ring_size(8, 20)].ljust(ring_size(8, 20), b"\0")
        memory = memoryview(bytearray(content))
        reader, writer = RingReader(memory, 8, 20), RingWriter(memory, 8, 20)
        for number in range(20):
            writer.write(bytes([number]) * 20)
            reader.read()
        return reader.lost

    return Kind(name="ring", suffix=".bin", make=lambda _: [bytes(range(256)) * 2, bytes(400)], read=read)


KINDS: dict[str, Callable[[], Kind]] = {
    "motor": _motor, "supply": _supply, "datasheet": _datasheet, "robot": _robot, "bench": _bench,
    "profile": _profile, "profile-toml": _profile_toml, "policy": _policy, "network": _network,
    "trajectory": _trajectory, "result": _result, "log": _log, "model": _model, "checkpoint": _checkpoint,
    "ring": _ring,
}  # fmt: skip
"""Makers of the kinds of files, by name."""


def main() -> int:
    """Fuzz for as long as told; status 1 where something was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", choices=sorted(KINDS), help="may be given several times")
    parser.add_argument("--output", type=Path, default=Path("fuzz-findings"))
    parser.add_argument("--read", choices=sorted(KINDS), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.read is not None:
        read_apart(KINDS[given.read]())
        return 0
    chosen = given.kind or list(KINDS)
    found = 0
    for name in chosen:
        count, kept = 0, 0
        for count, finding in fuzz(KINDS[name](), given.seconds / len(chosen), given.seed):
            if finding is not None:
                given.output.mkdir(parents=True, exist_ok=True)
                (given.output / f"{name}-{count}").write_bytes(finding.content)
                (given.output / f"{name}-{count}.txt").write_text(finding.what, encoding="utf-8")
                kept += 1
        print(f"{name}: {count} mutations, {kept} findings", flush=True)
        found += kept
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
