"""Log files: what comes back, what survives a crash, what is refused."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest
from tests.deployment.messages import make_command, make_fix, make_state

from sprintlab.deployment.interface import ControlTick, JointMode
from sprintlab.deployment.log import LogError, LogFacts, McapRunLog, read_log, run_log

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
    assert len(record.states) == len(record.commands) == len(record.ticks) == 300
    np.testing.assert_allclose(record.state_time, 0.001 * np.arange(1, 301), atol=1e-9)
    np.testing.assert_array_equal(record.column("states", "joint_position")[:, 3], 0.1 * np.arange(1, 301))
    np.testing.assert_array_equal(record.column("commands", "mode"), JointMode.SERVO)
    np.testing.assert_allclose(record.column("states", "bus_voltage"), 60.0)
    np.testing.assert_allclose(record.fix_time, [0.1, 0.2, 0.3])
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
    assert found["/controller/tick"][1]["velocity"] == [3.0, 0.0, 0.1]


def test_a_state_is_logged_once_and_an_absurd_fix_never(path):
    log = McapRunLog(path, FACTS)
    for number in range(1, 11):
        made = tick(number, state=False, fix=True)
        log.write(
            msgspec.structs.replace(made, fix=msgspec.structs.replace(made.fix, position=np.full(3, np.nan)))
        )
    log.close()
    record = read_log(path)
    assert (len(record.states), len(record.fixes), len(record.ticks)) == (1, 0, 10)


CRASH = """
import sys, time
sys.path.insert(0, {root!r})
from pathlib import Path
from tests.deployment.log.test_log import FACTS, McapRunLog, tick
log = McapRunLog(Path({path!r}), FACTS)
for number in range(1, 501):
    log.write(tick(number))
print("written", log._writer.pid, flush=True)
time.sleep(60)
"""


def test_a_log_survives_the_death_of_its_controller(path):
    code = CRASH.format(root=str(Path(__file__).parents[3]), path=str(path))
    controller = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    writer = int(controller.stdout.readline().split()[1])
    controller.send_signal(signal.SIGKILL)
    controller.communicate()
    for _ in range(2000):
        try:
            os.kill(writer, 0)
        except ProcessLookupError:
            break
        with open(f"/proc/{writer}/stat") as file:
            if file.read().rpartition(")")[2].split()[0] == "Z":
                break
        time.sleep(0.05)
    assert len(read_log(path).ticks) == 500


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


def test_an_existing_file_is_not_overwritten(path, monkeypatch):
    path.write_text("precious")
    for _ in range(2):
        with pytest.raises(LogError, match="exists"):
            McapRunLog(path, FACTS)
        monkeypatch.setattr(run_log, "check_new_log", lambda path: None)  # it came after the check
    assert path.read_text() == "precious"


def test_a_run_that_ends_before_its_first_step_leaves_no_log(path):
    McapRunLog(path, FACTS).close()
    assert not path.exists()


def test_without_the_package_the_extra_is_named(path, monkeypatch):
    monkeypatch.setattr("sprintlab.deployment.log.run_log.find_spec", lambda name: None)
    with pytest.raises(LogError, match=r"sprintlab\[log\]"):
        McapRunLog(path, FACTS)


def test_what_the_writer_cannot_take_is_dropped_and_counted(path):
    log = McapRunLog(path, FACTS)
    os.kill(log._writer.pid, signal.SIGSTOP)
    for number in range(1, 3001):
        log.write(tick(number))
    assert log.dropped > 0
    os.kill(log._writer.pid, signal.SIGCONT)
    log.close()
    record = read_log(path)
    assert len(record.ticks) == 3000 - log.dropped
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
    assert log.dropped > 0
    commands = read_log(path).column("commands", "sequence")
    assert 500 < len(commands) < 20_000 - 500
    assert commands.tolist() == list(range(1, len(commands) + 1))
