"""Log files: what comes back, what survives a crash, what is refused."""

import json
import os
import select
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.deployment.messages import make_command, make_fix, make_state

from sprintlab.deployment.log import LogError, LogFacts, McapRunLog, read_log
from sprintlab.deployment.messages import ControlTick, JointMode

mcap = pytest.importorskip("mcap")
FACTS = LogFacts(robot="bp2", contract='{"format_version": 1}', facts={"policy": "sprint"})


def tick(number, fix=False, state=True):
    values = np.full(12, 0.1 * number)
    return ControlTick(
        time=0.001 * number,
        mode="run",
        state=make_state(number if state else 1, joint_position=values),
        command=make_command(number),
        velocity=np.array([3.0, 0.0, 0.1]),
        targets=values,
        policy_step=number % 20 == 0,
        fix=make_fix(number) if fix else None,
        faults=("state-lost",) if number == 7 else (),
        compute_time=1e-4,
    )


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.mcap"


def write(path, count=300):
    log = McapRunLog(path, FACTS, wait=True)  # a busy machine's writer is slower than these ticks come
    for number in range(1, count + 1):
        log.write(tick(number, fix=number % 100 == 0))
    log.close()
    log.close()
    assert log.dropped == 0


def test_everything_comes_back(path):
    write(path)
    record = read_log(path)
    assert record.facts == {"robot": "bp2", "policy": "sprint", "ticks dropped": "0"}
    assert record.contract == '{"format_version": 1}'
    np.testing.assert_allclose(record.states.time, 0.001 * np.arange(1, 301), atol=1e-9)
    np.testing.assert_array_equal(record.column("states", "joint_position")[:, 3], 0.1 * np.arange(1, 301))
    np.testing.assert_array_equal(record.column("commands", "mode"), [JointMode.SERVO] * 300)
    np.testing.assert_allclose(record.fixes.time, [0.1, 0.2, 0.3])
    assert record.column("fixes", "velocity").shape == (3, 3)
    assert record.column("ticks", "faults")[6] == ("state-lost",) and not record.column("ticks", "faults")[7]
    assert record.column("ticks", "policy_step").sum() == 15
    assert set(record.column("ticks", "mode")) == {"run"}
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_other_programs_can_read_every_topic_by_its_schema(path):
    from mcap.reader import make_reader

    write(path, 100)
    with path.open("rb") as file:
        found = {}
        for schema, channel, message in make_reader(file).iter_messages():
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            found[channel.topic] = json.loads(schema.data)["properties"], json.loads(message.data)
    assert found.keys() == {"/robot/state", "/robot/command", "/robot/fix", "/controller/tick"}
    kinds = {"array": list, "integer": int, "number": (int, float), "string": str, "boolean": bool}
    for properties, message in found.values():
        assert properties.keys() == message.keys()
        for name, value in message.items():
            assert isinstance(value, kinds[properties[name]["type"]])


CRASH = """
import sys
sys.path.insert(0, {root!r})
from pathlib import Path
from tests.deployment.log.test_log import FACTS, McapRunLog, tick
log = McapRunLog(Path({path!r}), FACTS, wait=True)
for number in range(1, 501):
    log.write(tick(number))
print(log._writer.pid, flush=True)
sys.stdin.read()
"""


def test_a_log_survives_the_death_of_its_controller(path):
    code = CRASH.format(root=str(Path(__file__).parents[3]), path=str(path))
    words = [sys.executable, "-c", code]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as controller:
        writer = os.pidfd_open(int(controller.stdout.readline()))
        controller.kill()
    select.select([writer], [], [])  # until it has ended
    os.close(writer)
    assert len(read_log(path).ticks.time) == 500


def test_a_wrong_bit_and_another_file_are_noticed(path):
    write(path)
    content = path.read_bytes()
    wrong = [b"", b"no log at all", b"\x89MCAP0\r\n and no more"]
    for place in range(20, len(content) // 2, len(content) // 40):
        wrong.append(content[:place] + bytes([content[place] ^ 8]) + content[place + 1 :])
    for damaged in wrong:
        path.write_bytes(damaged)
        with pytest.raises(LogError, match=r"run\.mcap"):
            read_log(path)


def test_what_the_writer_cannot_take_is_dropped_and_counted(path):
    log = McapRunLog(path, FACTS)
    os.kill(log._writer.pid, signal.SIGSTOP)
    for number in range(1, 3001):
        log.write(tick(number))
    assert log.dropped > 0
    os.kill(log._writer.pid, signal.SIGCONT)
    log.close()
    record = read_log(path)
    assert len(record.ticks.time) == 3000 - log.dropped
    assert record.facts["ticks dropped"] == str(log.dropped)


def test_on_a_full_disk_the_log_ends_where_the_disk_did_and_can_be_read(path):
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (600_000, before[1]))  # the writer inherits it
    try:
        log = McapRunLog(path, FACTS, wait=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    for number in range(1, 20_001):
        log.write(tick(number))
    with pytest.raises(LogError, match=r"ends before the run does: File too large"):
        log.close()
    commands = read_log(path).column("commands", "sequence")
    assert 500 < len(commands) < 20_000 - 500
    assert commands.tolist() == list(range(1, len(commands) + 1))
