"""Log files: what comes back, what survives a crash, what is refused."""

import io
import json
import os
import select
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest

from sprintlab.deployment.interface import (
    COMMAND_BOUNDS,
    MOST_JOINTS,
    ControlTick,
    JointCommand,
    JointMode,
    PositionFix,
    RobotState,
)
from sprintlab.deployment.log import LogFacts, McapRunLog, read_log, run_log, writer
from sprintlab.deployment.log.reader import Ticks
from sprintlab.deployment.log.topics import MAGIC, LogError
from sprintlab.deployment.log.writer import write_log

mcap = pytest.importorskip("mcap")
FACTS = LogFacts(robot="bp2", contract='{"format_version": 1}', facts={"policy": "sprint"})


def tick(number, fix=False, state=True):
    values = np.full(12, 0.1 * number)
    return ControlTick(
        time=0.001 * number,
        mode="run",
        state=RobotState(
            sequence=number if state else 1,
            timestamp=number,
            joint_position=values,
            joint_velocity=-values,
            joint_torque=values,
            quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
            angular_velocity=np.zeros(3),
            bus_voltage=58.5,
        ),
        command=JointCommand(
            sequence=number,
            timestamp=number,
            mode=JointMode.SERVO,
            target_position=values,
            stiffness=values,
            damping=values,
            feedforward_torque=values,
        ),
        velocity=np.array([3.0, 0.0, 0.1]),
        targets=values,
        policy_step=number % 20 == 0,
        fix=PositionFix(sequence=number, timestamp=number, position=np.ones(3), velocity=np.ones(3))
        if fix
        else None,
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
    np.testing.assert_allclose(record.column("states", "joint_position")[:, 3], 0.1 * np.arange(1, 301))
    np.testing.assert_allclose(record.column("states", "bus_voltage"), 58.5)
    np.testing.assert_allclose(record.fix_time, [0.1, 0.2, 0.3])
    assert record.ticks[6].faults == ("state-lost",)
    assert sum(item.policy_step for item in record.ticks) == 15
    assert not list(path.parent.glob(".*"))


@pytest.mark.parametrize("number", [2**32 - 2, 2**64 - 6])
def test_a_robot_that_has_counted_far_is_logged(path, number):
    """MCAP's own numbers of messages have 32 bits, which a robot's states fill in 50 days."""
    log = McapRunLog(path, FACTS, wait=True)
    for later in range(5):
        now = tick(1 + later)
        log.write(
            msgspec.structs.replace(now, state=msgspec.structs.replace(now.state, sequence=number + later))
        )
    log.close()
    assert [state.sequence for state in read_log(path).states] == [number + later for later in range(5)]


def test_other_programs_can_read_the_ticks(path):
    from mcap.reader import make_reader

    write(path, 40)
    with path.open("rb") as file:
        reader = make_reader(file)
        messages = [json.loads(message.data) for _, _, message in reader.iter_messages("/controller/tick")]
        channels = reader.get_summary().channels.values()
    assert messages[-1]["velocity"] == [3.0, 0.0, 0.1]
    assert {channel.topic for channel in channels} == {
        "/robot/state",
        "/robot/command",
        "/robot/fix",
        "/controller/tick",
    }


def test_a_state_is_logged_once(path):
    log = McapRunLog(path, FACTS)
    for number in range(1, 11):
        log.write(tick(number, state=False))
    log.close()
    record = read_log(path)
    assert (len(record.states), len(record.ticks)) == (1, 10)


CRASH = """
import sys, time
sys.path.insert(0, {folder!r})
from pathlib import Path
from test_log import FACTS, McapRunLog, tick
log = McapRunLog(Path({path!r}), FACTS)
for number in range(1, 501):
    log.write(tick(number))
print("written", flush=True)
time.sleep(60)
"""


def test_a_log_survives_the_death_of_its_controller(path):
    code = CRASH.format(folder=os.path.dirname(__file__), path=str(path))
    controller = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    assert controller.stdout is not None
    assert controller.stdout.readline() == b"written\n"
    controller.send_signal(signal.SIGKILL)
    controller.wait()
    for _ in range(2000):
        if path.exists():
            break

        time.sleep(0.05)
    assert len(read_log(path).ticks) == 500


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_log_goes_on_when_everything_is_asked_to_end(path, number):
    """So does the run, which brings the robot down first: a session's end asks both at once."""
    log = McapRunLog(path, FACTS)
    log.write(tick(1))
    os.kill(log._writer.pid, number)
    time.sleep(0.2)
    log.write(tick(2))
    log.close()
    assert [one.time for one in read_log(path).ticks] == [tick(1).time, tick(2).time]


BEGINNING = """
import os, signal, sys
from pathlib import Path
from sprintlab.deployment.log import LogFacts, McapRunLog, run_log

def stopped(path, start=run_log._start_writer):
    writer = start(path)
    os.kill(writer.pid, signal.SIGSTOP)
    print(writer.pid, flush=True)
    return writer

if {stopped}:
    run_log._start_writer = stopped
log = McapRunLog(Path({path!r}), LogFacts(robot="bp2", contract="{{}}"))
print(log._writer.pid, flush=True)
signal.pause()
"""


@pytest.mark.parametrize("stopped", [True, False], ids=["before its writer is ready", "after"])
def test_a_run_that_is_ended_while_it_begins_leaves_no_log(path, stopped):
    """A hidden file, of a name that no later log has, would stay for ever."""
    code = BEGINNING.format(path=str(path), stopped=stopped)
    run = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    assert run.stdout is not None
    writer = int(run.stdout.readline())
    run.kill()
    run.communicate()
    os.kill(writer, signal.SIGCONT)
    for _ in range(2000):
        if not _runs(writer):
            break
        time.sleep(0.05)
    assert not list(path.parent.iterdir())


def _runs(number):
    """Whether a process is there, and not merely waited for by nobody."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_a_log_that_is_cut_off_is_read_up_to_the_cut(path):
    write(path, 3000)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 2 // 3])
    assert 100 < len(read_log(path).ticks) < 3000


def test_an_existing_file_is_not_overwritten(path):
    path.write_text("precious")
    with pytest.raises(LogError, match="exists"):
        McapRunLog(path, FACTS)
    assert path.read_text() == "precious"


def test_a_folder_that_cannot_be_written_is_refused_before_the_run(tmp_path):
    (tmp_path / "file").write_text("")
    from sprintlab.core.errors import SprintlabError

    with pytest.raises(SprintlabError, match="cannot write"):
        McapRunLog(tmp_path / "file" / "run.mcap", FACTS)


@pytest.mark.parametrize("content", [b"", b"no log at all, but long enough to be one", b"\x89MCAP0\r\n"])
def test_what_is_no_log_is_refused(path, content):
    path.write_bytes(content)
    with pytest.raises(LogError, match=r"run\.mcap"):
        read_log(path)


def test_a_log_without_a_run_is_refused(path):
    McapRunLog(path, FACTS).close()
    with pytest.raises(LogError, match=r"mcap holds no run"):
        read_log(path)


def test_a_missing_log_is_refused(path):
    with pytest.raises(LogError, match="cannot read"):
        read_log(path)


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


@pytest.mark.parametrize("count", [10, 3000])
@pytest.mark.parametrize("wait", [False, True])
def test_a_run_does_not_wait_for_ever_for_a_writer_that_was_stopped(path, monkeypatch, count, wait):
    """Its numbers come after the log is closed; the log is complete when the writer goes on."""
    monkeypatch.setattr(run_log, "_PATIENCE", 0.2)
    log = McapRunLog(path, FACTS, wait=wait)
    os.kill(log._writer.pid, signal.SIGSTOP)
    for number in range(1, count + 1):
        log.write(tick(number))
    with pytest.raises(LogError, match=f"process {log._writer.pid}, has not ended"):
        log.close()
    log.close()
    os.kill(log._writer.pid, signal.SIGCONT)
    assert log._writer.wait(60.0) == 0
    assert len(read_log(path).ticks) == count - log.dropped


@pytest.mark.parametrize("robot", ["bp2", "a" * (4 << 20)], ids=["short", "longer than a pipe"])
def test_a_run_does_not_wait_for_ever_for_a_writer_that_does_not_start(path, monkeypatch, robot):
    """It was stopped before it was ready; what cannot be logged is told before a robot moves."""
    monkeypatch.setattr(run_log, "_START_TIME", 0.2)
    started, before = [], run_log._start_writer

    def stopped(place):
        started.append(before(place))
        os.kill(started[-1].pid, signal.SIGSTOP)
        return started[-1]

    monkeypatch.setattr(run_log, "_start_writer", stopped)
    begin = time.monotonic()
    with pytest.raises(LogError, match="writer did not start"):
        McapRunLog(path, LogFacts(robot=robot, contract=FACTS.contract))
    assert time.monotonic() - begin < 5.0
    assert started[0].returncode == -signal.SIGKILL  # it would begin a log of nothing when it goes on
    assert not list(path.parent.iterdir())


def test_the_longest_step_goes_into_a_pipe_whole_or_not_at_all(path, monkeypatch):
    """A pipe may take a part of what is longer than ``PIPE_BUF``, and the rest of the log would be lost."""
    worst = -1.2345678901234567e-300
    many = np.full(MOST_JOINTS, worst)
    state = {name: many for name in ("joint_position", "joint_velocity", "joint_torque")}
    asked = {name: many for name in COMMAND_BOUNDS}
    plain = tick(1, fix=True)
    step = msgspec.structs.replace(
        plain,
        time=1234.5678901234567,
        mode="lie-down",
        state=msgspec.structs.replace(plain.state, **state),
        command=msgspec.structs.replace(plain.command, **asked),
        velocity=np.full(3, worst),
        targets=many,
        faults=("commands-unanswered",) * 100,
    )
    sent = []
    log = McapRunLog(path, FACTS, wait=True)
    monkeypatch.setattr(log, "_put", sent.append)
    log.write(step)
    monkeypatch.undo()
    log.close()
    assert 3000 < len(sent[0]) <= select.PIPE_BUF


def test_a_log_that_may_wait_drops_nothing(path):
    log = McapRunLog(path, FACTS, wait=True)
    for number in range(1, 5001):
        log.write(tick(number))
    log.close()
    assert log.dropped == 0
    assert len(read_log(path).ticks) == 5000


def full_disk_log(path, size):
    """A log whose writer may write so many bytes; it inherits the limit, this process is free of it again."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        return McapRunLog(path, FACTS, wait=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("size", [150_000, 400_000])
def test_on_a_full_disk_the_log_ends_where_the_disk_did_and_can_be_read(path, size):
    log = full_disk_log(path, size)
    for number in range(1, 20_001):
        log.write(tick(number))
    with pytest.raises(LogError, match=r"it ends before the run does: File too large"):
        log.close()
    log.close()  # a second call does nothing
    assert log.dropped > 0
    record = read_log(path)
    assert 500 < len(record.ticks) < 20_000 - 500
    assert [entry.sequence for entry in record.commands] == list(range(1, len(record.commands) + 1))
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def records_of(content):
    """Kind, place and length of each record of a whole file."""
    place = len(MAGIC)
    while place + len(MAGIC) < len(content):
        kind, length = struct.unpack_from("<BQ", content, place)
        yield kind, place, length
        place += 9 + length


def test_a_wrong_bit_hides_no_part_of_a_log(path):
    """In the kind or the length of a record it was no error: what it hid was missing without a word."""
    write(path, 600)
    content, damaged = path.read_bytes(), path.with_name("damaged.mcap")
    parts = list(records_of(content))
    (end,) = (place for kind, place, _ in parts if kind == 15)  # of the data
    places = [place for kind, place, _ in parts if kind in (4, 6, 9, 12, 15) and place <= end]
    bits = [8 * place + bit for place in places for bit in (0, 3, 7, 8, 17, 30, 71)]
    for bit in bits:
        wrong = bytearray(content)
        wrong[bit // 8] ^= 1 << bit % 8
        damaged.write_bytes(wrong)
        with pytest.raises(LogError):
            read_log(damaged)


def test_a_whole_log_that_does_not_say_where_its_data_end_is_refused(path):
    write(path)
    content = bytearray(path.read_bytes())
    content[-28] ^= 16
    path.write_bytes(content)
    with pytest.raises(LogError, match="checksum does not fit"):
        read_log(path)


def test_a_log_without_a_checksum_of_the_whole_is_read(path):
    """Those of before had none."""
    write(path)
    content = bytearray(path.read_bytes())
    (end,) = (place for kind, place, _ in records_of(content) if kind == 15)
    content[end + 9 : end + 13] = bytes(4)
    path.write_bytes(content)
    assert len(read_log(path).states) == 300


def test_a_chunk_of_zeros_is_refused_before_it_is_taken_apart(path):
    zstandard = pytest.importorskip("zstandard")
    from mcap.data_stream import RecordBuilder
    from mcap.records import Chunk

    packed = zstandard.ZstdCompressor(level=1).compress(bytes(32 << 20))  # 3.7 million empty records
    builder = RecordBuilder()
    times = {"message_start_time": 0, "message_end_time": 0}
    chunk = Chunk(compression="zstd", data=packed, uncompressed_crc=0, uncompressed_size=32 << 20, **times)
    chunk.write(builder)
    path.write_bytes(b"\x89MCAP0\r\n" + builder.end())
    with pytest.raises(LogError, match="unknown kind"):
        read_log(path)


def test_an_hour_at_1_khz_is_within_the_limits(path):
    """Its size from that of a real log: nothing but this log's length keeps it from being read."""
    from sprintlab.deployment.log import reader as limits

    write(path, 300)
    spent = limits._Reader()
    with path.open("rb") as file:
        spent.read(file)
    steps = 3_600_000
    assert steps <= limits.MOST_MESSAGES and limits.LONGEST_RUN >= 3600.0
    assert (limits.UNPACKED_LIMIT - spent._room) / 300 * steps < limits.UNPACKED_LIMIT
    assert spent._others / 300 * steps < limits._MOST_OTHERS
    assert path.stat().st_size / 300 * steps < limits.LOG_LIMIT


def test_more_messages_than_an_hour_has_are_refused(path, monkeypatch):
    write(path, 300)
    monkeypatch.setattr("sprintlab.deployment.log.reader.MOST_MESSAGES", 299)
    with pytest.raises(LogError, match="more than 299 messages of one kind"):
        read_log(path)


def mcap_file(path, *records):
    """A file of these records: kind and content."""
    body = b"".join(struct.pack("<BQ", kind, len(content)) + content for kind, content in records)
    path.write_bytes(b"\x89MCAP0\r\n" + body)


def chunk(content, compression=b"", checksum=0):
    head = struct.pack("<QQQII", 0, 0, len(content), checksum, len(compression)) + compression
    return 6, head + struct.pack("<Q", len(content)) + content


MESSAGE = struct.pack("<BQ", 5, 22) + bytes(22)


def test_a_flood_of_records_ends(path, monkeypatch):
    """Only states, fixes, commands and control steps may be many: the rest is looked at in a second."""
    monkeypatch.setattr("sprintlab.deployment.log.reader._MOST_OTHERS", 1000)
    write(path, 400)
    assert len(read_log(path).states) == 400
    text = struct.pack("<I", 1) + b"x"
    channel = struct.pack("<HH", 7, 0) + text + text + bytes(4)
    for records in (
        [(1, b"")] * 1001,
        [(4, channel)] * 1001,
        [chunk(MESSAGE * 1001)],
        [chunk(b"")] * 101,
        [chunk(MESSAGE)] * 501,
        [chunk((struct.pack("<BQ", 4, len(channel)) + channel) * 1001)],
        [chunk(struct.pack("<BQ", 3, 0) * 1001)],
        [(5, bytes(22))] * 1001,
    ):
        mcap_file(path, *records)
        with pytest.raises(LogError, match="more than 1000 records of no use"):
            read_log(path)


@pytest.mark.parametrize(
    ("records", "match"),
    [
        ([(6, bytes(20))], "shorter than its kind"),
        ([(5, bytes(3))], "shorter than its kind"),
        ([chunk(MESSAGE[:-1])], "a part of one"),
        ([chunk(b"\x05\x01")], "shorter than its kind"),
        ([chunk(struct.pack("<BQ", 5, 2**64 - 1))], "a part of one"),
        ([chunk(MESSAGE, checksum=1)], "checksum of a chunk"),
        ([chunk(MESSAGE, b"lz4")], "packed with zstd, not with lz4"),
        ([chunk(MESSAGE, b"zstd")], "cannot be unpacked"),
        ([(4, struct.pack("<HHI", 1, 0, 2**32 - 1))], "longer than its record"),
        ([(12, struct.pack("<I", 9) + b"sprintlab" + struct.pack("<I", 2**32 - 1))], "shorter than its kind"),
        ([(9, bytes(5 << 20))], "more than 4 MB"),
        ([(12, struct.pack("<I", 2) + b"\xff\xff" + bytes(4))], "utf-8"),
    ],
)
def test_records_that_no_log_holds(path, records, match):
    mcap_file(path, *records)
    with pytest.raises(LogError, match=match) as refusal:
        read_log(path)
    assert "\n" not in str(refusal.value)


def note(**facts):
    """A metadata record."""
    text = b"".join(
        struct.pack("<I", len(part)) + part for pair in facts.items() for part in map(str.encode, pair)
    )
    return 12, struct.pack("<I", 9) + b"sprintlab" + struct.pack("<I", len(text)) + text


def steps(*changes):
    """Records of control steps, each with one change of an ordinary one."""
    yield 4, struct.pack("<HHI", 1, 0, 16) + b"/controller/tick"
    sound = {"time": 1.0, "mode": "run", "velocity": [0.0] * 3, "targets": [0.0] * 12}
    sound |= {"policy_step": True, "faults": [], "compute_time": 0.0}
    for change in changes:
        yield 5, struct.pack("<HIQQ", 1, 0, 0, 0) + json.dumps(sound | change).encode()


@pytest.mark.parametrize(
    ("records", "match"),
    [
        (steps({"mode": "x" * 3_000_000}), "length <= 100"),
        (steps(*({"mode": str(number)} for number in range(1001))), "1000 modes"),
        (steps({"faults": [""] * 1001}), "length <= 1000"),
        (steps({"faults": ["x" * 101]}), "length <= 100"),
        (steps(*({"faults": [str(number)]} for number in range(1001))), "1000 kinds of faults"),
        (steps({"targets": [0] * 1_000_000}), "length <= 32"),
        ([note(**{str(number): "" for number in range(1001)})], "1000 facts"),
    ],
    ids=["long-mode", "modes", "faults-of-a-step", "long-fault", "kinds-of-faults", "targets", "facts"],
)
def test_names_and_lists_that_fill_memory_are_refused(path, records, match):
    """Packed, a few kilobytes hold millions of them."""
    mcap_file(path, *records)
    with pytest.raises(LogError, match=match) as refusal:
        read_log(path)
    assert len(str(refusal.value)) < 400


CONTRACT = 9, bytes(16) + struct.pack("<I", 13) + b"contract.json" + struct.pack("<IQ", 0, 2) + b"{}"
TWICE = b'{"time":1,"mode":"run","velocity":[0,0,0],"targets":[],"policy_step":true,"faults":[],"time" :2}'


@pytest.mark.parametrize(
    ("records", "match"),
    [
        ([*steps(), (5, struct.pack("<HIQQ", 1, 0, 0, 0) + TWICE[:-1] + b',"compute_time":0}')], "twice"),
        ([note(robot="bp2"), note(robot="go1")], "says twice what its robot was"),
        ([CONTRACT, CONTRACT], "two contracts"),
    ],
    ids=["step", "fact", "contract"],
)
def test_what_stands_twice_is_refused(path, records, match):
    """The last would count here, and the first for another reader."""
    mcap_file(path, *records)
    with pytest.raises(LogError, match=match):
        read_log(path)


def test_a_step_of_many_fields_is_refused_before_it_is_decoded(path):
    """Packed, ten kilobytes of them took gigabytes and minutes."""
    mcap_file(path, *steps({str(number): {} for number in range(1000)}))
    with pytest.raises(LogError, match="more than its fields"):
        read_log(path)


def test_names_of_faults_hold_no_control_characters():
    """They stand on the report's page."""
    ticks = Ticks()
    evil = '{"faults": ["a\\u001b[2J\\u202e"]}'
    (_, _), (_, step) = steps(json.loads(evil))
    ticks.add(0, step[22:])
    assert ticks.faults == {0: ("a\\x1b[2J\\u202e",)}


def test_faults_are_bounded_in_sum(path, monkeypatch):
    monkeypatch.setattr("sprintlab.deployment.log.reader._MOST_FAULTS", 100)
    mcap_file(path, *steps(*[{"faults": ["fall"] * 51}] * 2))
    with pytest.raises(LogError, match="too many"):
        read_log(path)


def test_columns_and_messages_are_the_same(path):
    write(path, 40)
    record = read_log(path)
    for topic in ("states", "commands", "fixes", "ticks"):
        messages = getattr(record, topic)
        for field in type(messages[0]).__struct_fields__ if len(messages) else ():
            if field == "faults":
                continue
            np.testing.assert_array_equal(
                record.column(topic, field), [getattr(message, field) for message in messages]
            )
    assert record.ticks[-1].time == 0.04 and record.states[-2:][0].sequence == 39


def test_of_two_logs_of_one_name_the_first_is_kept(path):
    first = McapRunLog(path, FACTS)
    with pytest.raises(LogError, match="is being written by another run"):
        McapRunLog(path, FACTS)
    first.write(tick(1))
    first.close()
    assert len(read_log(path).ticks) == 1
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_a_log_that_was_finished_while_another_began_is_kept(path, monkeypatch):
    """The name was still free when the other one looked."""
    monkeypatch.setattr("sprintlab.deployment.log.run_log.check_new_log", lambda path: None)
    path.write_text("finished")
    with pytest.raises(LogError, match="exists already"):
        McapRunLog(path, FACTS)
    assert path.read_text() == "finished" and not list(path.parent.glob(".*"))


@pytest.mark.parametrize("links", ["hard links", "none"])
def test_a_file_that_takes_the_logs_name_while_it_is_written_is_kept(path, links, monkeypatch):
    """The log replaced it without a word; now it has a name beside it, and says so."""
    path.with_name("run-2.mcap").write_text("older")
    frames, file = io.BytesIO(), path
    if links == "none":
        monkeypatch.setattr(os, "link", lambda *_: (_ for _ in ()).throw(PermissionError(1, "no links here")))
    monkeypatch.setattr(writer, "_write_frames", lambda *_: file.write_text("mine"))
    problem = write_log(frames, path)
    assert problem is not None and "run-3.mcap" in problem.strerror
    assert path.read_text() == "mine" and path.with_name("run-2.mcap").read_text() == "older"
    assert sorted(each.name for each in path.parent.iterdir()) == ["run-2.mcap", "run-3.mcap", "run.mcap"]


@pytest.mark.parametrize("put", [None, "mine"])
def test_a_log_whose_file_was_taken_away_says_so_and_passes_off_no_other(path, monkeypatch, put):
    """Whatever had the unfinished log's name became the log, and nobody was told."""
    unfinished = path.with_name(".run.mcap.partial")

    def take_away(*_):
        unfinished.unlink()
        if put is not None:
            unfinished.write_text(put)

    monkeypatch.setattr(writer, "_write_frames", take_away)
    problem = write_log(io.BytesIO(), path)
    assert problem is not None and "taken away" in problem.strerror
    assert {each.name: each.read_text() for each in path.parent.iterdir()} == (
        {unfinished.name: put} if put else {}
    )


def test_what_a_killed_writer_left_makes_room(path):
    for left in (b"", b"\x89MCAP0\r\n half"):
        path.with_name(".run.mcap.partial").write_bytes(left)
        write(path, 4)
        assert len(read_log(path).ticks) == 4
        path.unlink()


def test_a_foreign_file_in_place_of_the_unfinished_log_is_kept(path):
    foreign = path.with_name(".run.mcap.partial")
    foreign.write_bytes(b"a download")
    with pytest.raises(LogError, match=r"run\.mcap\.partial is no log"):
        McapRunLog(path, FACTS)
    assert foreign.read_bytes() == b"a download" and not path.exists()


@pytest.mark.parametrize("make", [lambda place: place.symlink_to("precious"), os.mkfifo, Path.mkdir])
def test_a_link_or_a_pipe_in_place_of_the_unfinished_log_is_kept(tmp_path, make):
    """In a folder that others may write to a link would lead the log over another file."""
    precious, foreign = tmp_path / "precious", tmp_path / ".run.mcap.partial"
    precious.write_text("mine")
    make(foreign)
    before = os.lstat(foreign)
    with pytest.raises(LogError, match=r"run\.mcap\.partial is no log"):
        write_log(io.BytesIO(), tmp_path / "run.mcap")
    assert precious.read_text() == "mine" and os.path.samestat(os.lstat(foreign), before)
