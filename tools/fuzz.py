"""Mutate the files that sprintlab reads, and see that each is read or refused in one sentence, in time.

    python tools/fuzz.py --seconds 3600 --kind log --seed 7

Every kind of file starts from good ones that this script makes. A mutation is a finding where its reader
raises anything but a ``SprintlabError`` of one line, or computes for longer than ten seconds. Findings are
kept in ``--output``.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

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
        started = time.monotonic()
        while (count == 0 or time.monotonic() - started < seconds) and (most is None or count < most):
            content = mutated(rng.choice(seeds), rng)
            path.write_bytes(content)
            count += 1
            what = trouble(kind, path)
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
    from sprintlab.control import load_policy, shipped_policies

    def read(path: Path) -> object:
        policy = load_policy(path)
        return policy.infer(np.zeros((1, policy.layout.input_size), dtype=np.float32))

    return Kind(
        name="policy", suffix=".onnx", make=_text_of(next(iter(shipped_policies().values()))), read=read
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
    return [(folder / "run.mcap").read_bytes()]


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
    "profile": _profile, "profile-toml": _profile_toml, "policy": _policy, "trajectory": _trajectory,
    "result": _result, "log": _log, "model": _model, "checkpoint": _checkpoint, "ring": _ring,
}  # fmt: skip
"""Makers of the kinds of files, by name."""


def main() -> int:
    """Fuzz for as long as told; status 1 where something was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="in all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", choices=sorted(KINDS), help="may be given several times")
    parser.add_argument("--output", type=Path, default=Path("fuzz-findings"))
    given = parser.parse_args()
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
