"""Over a network zenoh takes only those who prove themselves; a stranger is refused at both ends."""

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest

from sprintlab.deployment.bus import BusError, open_bus, open_endpoint
from sprintlab.deployment.interface import JointCommand, decode, encode

zenoh = pytest.importorskip("zenoh")

from sprintlab.deployment.bus import zenoh_bus  # noqa: E402
from sprintlab.deployment.bus.zenoh_session import load_security  # noqa: E402

USERS, TLS = "transport/auth/usrpwd", "transport/link/tls"


@pytest.fixture
def place():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{free.getsockname()[1]}"


@pytest.fixture
def address(bus_name, place):
    return f"zenoh://{bus_name}@{place}"


def write_config(path, *, users=None, tls=None):
    link, auth = ({"tls": tls} if tls else {}), ({"usrpwd": users} if users else {})
    path.write_text(json.dumps({"transport": {"link": link, "auth": auth}}))
    return path


@pytest.fixture
def passwords(tmp_path):
    """Configurations of a robot, of a controller it knows, of a stranger."""
    (tmp_path / "users.txt").write_text("alice:a secret\nbob:word\n")
    robot = {"user": "robot", "password": "r", "dictionary_file": str(tmp_path / "users.txt")}
    return {
        "robot": write_config(tmp_path / "robot.json", users=robot),
        "controller": write_config(
            tmp_path / "controller.json", users={"user": "alice", "password": "a secret"}
        ),
        "stranger": write_config(tmp_path / "stranger.json", users={"user": "alice", "password": "guess"}),
    }


def openssl(*arguments):
    subprocess.run(["openssl", *arguments], check=True, capture_output=True)


def make_authority(folder, name):
    key, certificate = folder / f"{name}-ca.key", folder / f"{name}-ca.pem"
    openssl("req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", f"/CN={name}",
            "-keyout", str(key), "-out", str(certificate))  # fmt: skip
    return key, certificate


def make_certificate(folder, name, authority):
    """TLS settings of an end that this authority vouches for."""
    key, request, certificate = (folder / f"{name}.{end}" for end in ("key", "csr", "pem"))
    openssl("req", "-newkey", "rsa:2048", "-nodes", "-subj", f"/CN={name}",
            "-keyout", str(key), "-out", str(request))  # fmt: skip
    (folder / "extensions").write_text("subjectAltName=IP:127.0.0.1\n")
    openssl("x509", "-req", "-in", str(request), "-CA", str(authority[1]), "-CAkey", str(authority[0]),
            "-CAcreateserial", "-days", "2", "-extfile", str(folder / "extensions"),
            "-out", str(certificate))  # fmt: skip
    ends = {f"{end}_{part}": str(file) for end in ("listen", "connect")
            for part, file in (("certificate", certificate), ("private_key", key))}  # fmt: skip
    return {"root_ca_certificate": str(authority[1]), "enable_mtls": True, **ends}


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    if shutil.which("openssl") is None:
        pytest.skip("needs openssl")
    folder = tmp_path_factory.mktemp("tls")
    ours, theirs = make_authority(folder, "lab"), make_authority(folder, "street")
    return {
        "robot": write_config(folder / "robot.json", tls=make_certificate(folder, "robot", ours)),
        "controller": write_config(folder / "me.json", tls=make_certificate(folder, "me", ours)),
        "stranger": write_config(folder / "stranger.json", tls=make_certificate(folder, "x", theirs)),
    }


@pytest.fixture(params=["passwords", "certificates"])
def configs(request):
    return request.getfixturevalue(request.param)


def test_those_who_know_each_other_talk(address, configs):
    endpoint = open_endpoint(address, config=configs["robot"])
    interface = open_bus(address, config=configs["controller"])
    assert not endpoint.peer_left
    interface.close()
    endpoint.close()


@pytest.mark.parametrize("who", ["stranger", None])
def test_a_stranger_is_refused_by_the_robot(address, configs, who):
    endpoint = open_endpoint(address, config=configs["robot"])
    with pytest.raises(BusError, match=r"reach a robot|no robot"):
        open_bus(address, config=configs[who] if who else None)
    interface = open_bus(address, config=configs["controller"])  # which is still free
    interface.close()
    endpoint.close()


def test_a_bare_session_puts_nothing_into_the_robot(address, place, configs, bus_name):
    endpoint = open_endpoint(address, config=configs["robot"])
    config = zenoh.Config()
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/{place}"]))
    config.insert_json5("connect/timeout_ms", "1000")
    config.insert_json5("connect/exit_on_failure", "true")
    config.insert_json5("scouting/multicast/enabled", "false")
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)
    endpoint.close()


def test_a_stranger_who_poses_as_the_robot_is_refused_by_the_controller(
    address, place, configs, tmp_path, request
):
    """He lets everybody in and says that he is free."""
    config = zenoh.Config()
    stranger = json.loads(configs["stranger"].read_text())["transport"]
    kind = "tls" if stranger["link"] else "tcp"
    if stranger["link"]:
        config.insert_json5(TLS, json.dumps(stranger["link"]["tls"] | {"enable_mtls": False}))
    else:  # he knows that there is an alice, and not her password; zenoh alone would let her in
        config.insert_json5(f"{USERS}/dictionary_file", json.dumps(str(tmp_path / "users.txt")))
    config.insert_json5("listen/endpoints", json.dumps([f"{kind}/{place}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        name = address.removeprefix("zenoh://").partition("@")[0]
        queryable = session.declare_queryable(
            f"sprintlab/{name}/claim", lambda query: query.reply(query.key_expr, b"free" + bytes(32))
        )
        with pytest.raises(BusError, match=r"not the robot|reach a robot"):
            open_bus(address, config=configs["controller"])
        queryable.undeclare()


@pytest.mark.parametrize("content", [None, "", "\n\n", "alice", "alice:\n", ":secret\n"])
def test_without_users_nobody_is_let_in(address, tmp_path, content):
    """zenoh itself takes an empty file for no authentication."""
    users = tmp_path / "users.txt"
    if content is not None:
        users.write_text(content)
    section = {"user": "robot", "password": "r", "dictionary_file": str(users)}
    config = write_config(tmp_path / "robot.json", users=section)
    with pytest.raises(BusError, match="user file"):
        open_endpoint(address, config=config).close()


@pytest.mark.parametrize(
    ("section", "match"),
    [
        ({}, "neither"),
        ({"users": {"user": "robot"}}, "it is invalid"),
        ({"users": {"user": "robot", "password": "r"}}, "user file"),
        ({"users": {"user": "", "password": ""}}, "needs user and password"),
        ({"tls": {"root_ca_certificate": "ca.pem"}}, "listen_certificate"),
        (
            {"tls": {"root_ca_certificate": "a", "listen_certificate": "b", "listen_private_key": "c"}},
            "enable_mtls",
        ),
        (
            {
                "tls": {
                    "root_ca_certificate": "a",
                    "listen_certificate": "b",
                    "listen_private_key": "c",
                    "enable_mtls": True,
                    "verify_name_on_connect": False,
                }
            },
            "verify_name_on_connect",
        ),
    ],
)
def test_a_configuration_that_would_let_everybody_in_is_refused(address, tmp_path, section, match):
    with pytest.raises(BusError, match=match):
        open_endpoint(address, config=write_config(tmp_path / "robot.json", **section)).close()


@pytest.mark.parametrize("missing", ["certificate", "private_key", "root_ca_certificate"])
@pytest.mark.parametrize("end", ["listen", "connect"])
def test_tls_without_one_of_its_files_is_refused(tmp_path, end, missing):
    """Above all without an authority of one's own: whomever the system's authorities know could come."""
    names = [f"{end}_certificate", f"{end}_private_key", "root_ca_certificate"]
    left_out = next(name for name in names if name.endswith(missing))
    tls = {"enable_mtls": True} | {name: "file.pem" for name in names if name != left_out}
    with pytest.raises(BusError, match=f"needs {left_out}$"):
        load_security(write_config(tmp_path / "end.json", tls=tls), robot=end == "listen")


def test_an_error_does_not_print_passwords(address, tmp_path):
    file = tmp_path / "robot.json"
    file.write_text(json.dumps({"transport": {"auth": {"usrpwd": {"password": "a secret"}}}}))
    with pytest.raises(BusError) as caught:
        open_endpoint(address, config=file)
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize("content", ["", "{", "[1]", '{"transport": 3}', "\x00\xff"])
def test_a_file_that_is_no_configuration_is_refused_in_one_sentence(address, tmp_path, content):
    file = tmp_path / "robot.json"
    file.write_text(content)
    with pytest.raises(BusError):
        open_endpoint(address, config=file)


def test_a_place_on_the_network_needs_a_configuration(bus_name):
    for place in ("0.0.0.0:17000", "192.0.2.1:17000", "[::]:17000", "robot.local:17000"):
        with pytest.raises(BusError, match="everybody on the network"):
            open_endpoint(f"zenoh://{bus_name}@{place}")
        with pytest.raises(BusError, match="everybody on the network"):
            open_bus(f"zenoh://{bus_name}@{place}")


@pytest.mark.parametrize("place", ["127.0.0.1", "localhost", ":7447", "127.0.0.1:", "127.0.0.1:1#iface=eth0"])
def test_a_place_needs_host_and_port(bus_name, place):
    for open_end in (open_bus, open_endpoint):
        with pytest.raises(BusError, match="HOST:PORT"):
            open_end(f"zenoh://{bus_name}@{place}")


def test_claims_and_tokens_that_make_no_sense_let_nobody_in(address, place, bus_name):
    endpoint = open_endpoint(address)
    config = zenoh.Config()
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/{place}"]))
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        tokens = [
            session.liveliness().declare_token(f"sprintlab/{bus_name}/alive/controller/{name}")
            for name in ("x", "-1", "0x12", "f" * 17, "z" * 16)
        ]
        for payload in (None, b"", b"x", bytes(40), b"\xff" * 8, b"\x01" * 39):
            replies = list(session.get(f"sprintlab/{bus_name}/claim", payload=payload, timeout=5.0))
            assert [reply.ok.payload.to_bytes() for reply in replies] == [b"unknown"]
        for token in tokens:
            token.undeclare()
    interface = open_bus(address)  # still free
    with pytest.raises(BusError, match="another controller"):
        open_bus(address, session=interface.session)  # not even in the name of who drives
    interface.close()
    endpoint.close()


def test_without_a_place_the_robot_listens_on_the_loopback_interface_only(bus_name):
    before = listening()
    with (
        contextlib.closing(open_endpoint(f"zenoh://{bus_name}")),
        contextlib.closing(open_bus(f"zenoh://{bus_name}")),  # nor does a controller on any other
    ):
        opened = listening() - before
    assert opened and all(place.startswith("0100007F:") for place in opened)


def listening():
    """Local addresses of sockets of this process that listen, as the kernel prints them."""
    if not Path("/proc/self/net/tcp").exists():
        pytest.skip("needs Linux")
    own = {os.readlink(link) for link in Path("/proc/self/fd").iterdir() if link.is_symlink()}
    lines = [
        line.split()
        for table in ("tcp", "tcp6", "udp", "udp6")
        for line in Path(f"/proc/self/net/{table}").read_text().splitlines()[1:]
    ]
    return {row[1] for row in lines if f"socket:[{row[9]}]" in own}


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ('{"transport":{"auth":{"usrpwd":{"user":"a","password":"a secret"},,}}}', r"line 1, column \d+$"),
        ('{"transport":{"auth":{"usrpwd":"a secret"}}}', "expected struct UsrPwdConf$"),
    ],
)
def test_a_broken_configuration_is_refused_without_its_text(tmp_path, text, match):
    file = tmp_path / "broken.json"
    file.write_text(text)
    with pytest.raises(BusError, match=match) as refusal:
        load_security(file, robot=False)
    assert "a secret" not in str(refusal.value) and refusal.value.__suppress_context__


def test_a_configuration_that_would_end_the_process_is_refused(tmp_path):
    file = tmp_path / "deep.json"
    file.write_text("[" * 100_000)
    with pytest.raises(BusError, match="nested too deeply"):
        load_security(file, robot=False)


def test_no_other_file_is_opened_for_a_configuration(tmp_path, monkeypatch):
    """zenoh's own reading of files takes plug-ins' configurations from elsewhere, a pipe if need be."""
    os.mkfifo(tmp_path / "pipe")
    file = tmp_path / "robot.json5"
    users = {"user": "alice", "password": "a secret"}
    content = {"transport": {"auth": {"usrpwd": users}}}
    file.write_text(json.dumps({**content, "plugins": {"x": {"__config__": str(tmp_path / "pipe")}}}))
    monkeypatch.delattr(zenoh.Config, "from_file")  # which waits for ever
    assert load_security(file, robot=False).user == "alice"


def bare_session(place, mode, listen=()):
    """A stranger's own session of zenoh."""
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/{place}"]))
    config.insert_json5("listen/endpoints", json.dumps(listen))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("transport/shared_memory/enabled", "false")  # of which it would leave a file behind
    return zenoh.open(config)


def eventually(look):
    """What ``look`` finds, once it finds something."""
    deadline = time.monotonic() + 30.0
    while not (found := look()) and time.monotonic() < deadline:
        time.sleep(0.005)
    assert found
    return found


def test_before_a_controller_came_nobody_is_obeyed(address, place, bus_name, make_joint_command):
    """Session 0 is nobody's: it is not that of a controller which is not there."""
    nobodys = encode(msgspec.structs.replace(make_joint_command(1), session=0))
    with contextlib.closing(open_endpoint(address)) as endpoint, bare_session(place, "peer") as stranger:
        stranger_says = lambda: stranger.put(f"sprintlab/{bus_name}/command", nobodys)  # noqa: E731
        taken = []
        eventually(lambda: stranger_says() or taken.append(endpoint.receive_command()) or endpoint.foreign)
        assert taken == [None] * len(taken)


def test_who_asks_for_leave_and_does_not_come_keeps_nobody_out(address, place, bus_name, monkeypatch):
    """As a controller that is killed before its token shows."""
    monkeypatch.setattr(zenoh_bus, "_LEASE", 0.2)

    def another():
        with contextlib.suppress(BusError):
            return open_bus(address)

    with contextlib.closing(open_endpoint(address)), bare_session(place, "peer") as stranger:
        question = (7).to_bytes(8, "little") + bytes(32)
        (reply,) = stranger.get(f"sprintlab/{bus_name}/claim", payload=question, timeout=5.0)
        assert reply.ok.payload.to_bytes() == b"free"
        eventually(another).close()


def test_after_a_controller_left_nobody_is_obeyed_in_its_name(address, place, bus_name, make_joint_command):
    """Its session and the number of its last command are told by the robot's states: no secrets."""
    with contextlib.closing(open_endpoint(address)) as endpoint, bare_session(place, "peer") as stranger:
        controller = open_bus(address)
        session = controller.session
        say = [encode(msgspec.structs.replace(make_joint_command(n), session=session)) for n in (1, 2)]
        eventually(lambda: controller.send(decode(JointCommand, say[0])) or endpoint.receive_command())
        controller.close()
        eventually(lambda: endpoint.peer_left)
        time.sleep(2 * zenoh_bus.PARTING)
        while endpoint.receive_command():
            pass
        stranger_says = lambda: stranger.put(f"sprintlab/{bus_name}/command", say[1])  # noqa: E731
        taken = []
        eventually(lambda: stranger_says() or taken.append(endpoint.receive_command()) or endpoint.foreign)
        assert taken == [None] * len(taken)


def test_a_flood_of_tokens_does_not_bring_back_a_controller_that_left(address, place, bus_name, monkeypatch):
    """The robot's end forgets who came and went when they are too many, but not who was let in."""
    monkeypatch.setattr(zenoh_bus, "_MOST_KNOWN", 5)
    monkeypatch.setattr(zenoh_bus, "_LEASE", 600.0)
    with contextlib.closing(open_endpoint(address)) as endpoint, bare_session(place, "peer") as stranger:
        open_bus(address).close()
        eventually(lambda: endpoint.peer_left)
        alive = f"sprintlab/{bus_name}/alive/controller"
        tokens = [stranger.liveliness().declare_token(f"{alive}/{number:016x}") for number in range(1, 9)]
        eventually(lambda: 8 in endpoint._alive)
        assert endpoint.peer_left
        for token in tokens:
            token.undeclare()


def test_a_flood_of_tokens_does_not_drive_out_who_drives(address, place, bus_name, monkeypatch):
    """Nor does the robot's end keep all of them in mind."""
    monkeypatch.setattr(zenoh_bus, "_MOST_KNOWN", 5)
    with (
        contextlib.closing(open_endpoint(address)) as endpoint,
        contextlib.closing(open_bus(address)) as controller,
        bare_session(place, "peer") as stranger,
    ):
        eventually(lambda: controller.session in endpoint._alive)
        monkeypatch.setattr(zenoh_bus, "_LEASE", 0.0)
        alive = f"sprintlab/{bus_name}/alive/controller"
        tokens = [stranger.liveliness().declare_token(f"{alive}/{number:016x}") for number in range(1, 9)]
        eventually(lambda: 8 in endpoint._alive)
        assert not endpoint.peer_left
        assert len(endpoint._alive) + len(endpoint._gone) <= 6
        for token in tokens:
            token.undeclare()


def test_no_two_questions_have_one_answer(address, place, bus_name):
    """Who has heard a robot's answer could pose as the robot with it."""
    asked = []

    def answer(query):
        asked.append(query.payload.to_bytes())
        query.reply(query.key_expr, b"driven")

    config = zenoh.Config()
    config.insert_json5("listen/endpoints", json.dumps([f"tcp/{place}"]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as robot:
        queryable = robot.declare_queryable(f"sprintlab/{bus_name}/claim", answer)
        for _ in range(2):
            with pytest.raises(BusError, match="another controller"):
                open_bus(address, session=7)
        queryable.undeclare()
    assert len(asked) == 2 and asked[0][:8] == asked[1][:8]
    assert asked[0][8:] != asked[1][8:]


def test_a_user_whom_the_robot_does_not_know_is_told_nothing(address, place, bus_name, passwords):
    """He is let into the network as somebody else, and keeps nobody out."""
    config = zenoh.Config()
    config.insert_json5("connect/endpoints", json.dumps([f"tcp/{place}"]))
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5("scouting/multicast/enabled", "false")
    for name, word in (("user", "bob"), ("password", "word")):
        config.insert_json5(f"{USERS}/{name}", json.dumps(word))
    with (
        contextlib.closing(open_endpoint(address, config=passwords["robot"])),
        zenoh.open(config) as bob,
    ):
        question = (7).to_bytes(8, "little") + bytes(32) + b"carol"
        replies = list(bob.get(f"sprintlab/{bus_name}/claim", payload=question, timeout=5.0))
        assert [reply.ok.payload.to_bytes() for reply in replies] == [b"unknown"]
        open_bus(address, config=passwords["controller"]).close()


def test_the_last_command_of_a_controller_that_left_is_obeyed(address, make_joint_command, monkeypatch):
    """It damps the joints, and may still wait when the controller's token is gone."""
    monkeypatch.setattr(zenoh_bus, "PARTING", 60.0)
    with contextlib.closing(open_endpoint(address)) as endpoint:
        controller = open_bus(address)
        controller.send(msgspec.structs.replace(make_joint_command(1), session=controller.session))
        controller.close()
        eventually(lambda: endpoint.peer_left)
        eventually(endpoint.receive_command)


ENDS = {
    "robot": "from sprintlab.deployment.bus import open_endpoint as come",
    "controller": "from sprintlab.deployment.bus import open_bus as come",
}
STAY = "; import sys; end = come(sys.argv[1]); print('here', flush=True); sys.stdin.read()"


@pytest.mark.parametrize("stopped", ["robot", "controller"])
def test_leaving_an_end_that_stands_still_is_no_error(
    address, make_joint_command, make_state, monkeypatch, stopped
):
    """A robot's computer that froze ended its controller in zenoh's error, and its numbers were lost."""
    monkeypatch.setattr(zenoh_bus, "_CLOSING", 0.1)
    endpoint = open_endpoint(address) if stopped == "controller" else None
    command = [sys.executable, "-c", ENDS[stopped] + STAY, address]
    other = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        other.stdout.readline()
        bus = endpoint or open_bus(address)
        other.send_signal(signal.SIGSTOP)
        for number in range(1, 20_001):  # until nothing goes into the connection any more
            bus.publish(make_state(number)) if endpoint else bus.send(make_joint_command(number))
        begin = time.monotonic()
        bus.close()
        assert time.monotonic() - begin < 5.0
    finally:
        other.kill()
        other.communicate()


def test_a_stranger_does_not_speak_for_the_robot_nor_hears_the_controller(
    address, place, bus_name, make_state, make_joint_command, make_fix
):
    """zenoh hands on what its clients say to all others, and to them what others say."""
    prefix = f"sprintlab/{bus_name}"
    told, states = [], []
    with (
        contextlib.closing(open_endpoint(address)) as endpoint,
        contextlib.closing(open_bus(address)) as interface,
        bare_session(place, "client") as stranger,
    ):
        ear = stranger.declare_subscriber(
            f"{prefix}/command", lambda sample: told.append(str(sample.key_expr))
        )
        mouth = stranger.declare_queryable(
            f"{prefix}/claim", lambda query: query.reply(query.key_expr, b"free")
        )
        for _ in range(5):
            stranger.put(f"{prefix}/fix", encode(make_fix(999)))
            for name in ("state", "*", "**", "s$*"):
                stranger.put(f"{prefix}/{name}", encode(make_state(999)))
            interface.send(msgspec.structs.replace(make_joint_command(1), session=interface.session))
            with pytest.raises(BusError, match="another controller"):
                open_bus(address)  # whom the stranger has told that the robot is free
        eventually(
            lambda: endpoint.publish(make_state(1)) and (states.append(interface.receive()) or states[-1])
        )
        eventually(endpoint.receive_command)
        assert interface.receive_fix() is None
        ear.undeclare()
        mouth.undeclare()
    assert [state.sequence for state in states if state] == [1]
    assert f"{prefix}/command" not in told  # but his own wild cards


@pytest.mark.parametrize("mode", ["peer", "router"])
def test_no_end_is_told_where_a_stranger_listens(address, place, bus_name, make_state, mode):
    """A controller that knew would connect to him, past all that the robot's end lets through."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        own = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    with (
        contextlib.closing(open_endpoint(address)) as endpoint,
        bare_session(place, mode, [own]) as stranger,
        contextlib.closing(open_bus(address)) as interface,
    ):
        heard, until = set(), time.monotonic() + 1.0
        while time.monotonic() < until or not heard:
            stranger.put(f"sprintlab/{bus_name}/state", encode(make_state(999)))
            endpoint.publish(make_state(1))
            state = interface.receive()
            heard |= set() if state is None else {state.sequence}
            time.sleep(0.01)
    assert heard == {1}


def test_a_message_that_no_end_sends_is_not_kept(address, place, bus_name, make_joint_command):
    """zenoh alone takes messages of a gigabyte, and keeps as many as may wait to be read."""
    with contextlib.closing(open_endpoint(address)) as endpoint, bare_session(place, "peer") as stranger:
        interface = open_bus(address)
        own = msgspec.structs.replace(make_joint_command(1), session=interface.session)
        publisher = stranger.declare_publisher(f"sprintlab/{bus_name}/command")
        eventually(lambda: publisher.matching_status.matching)
        publisher.put(bytes(1 << 20))
        list(stranger.get(f"sprintlab/{bus_name}/claim", payload=b"", timeout=1.0))  # behind it
        eventually(lambda: interface.send(own) or endpoint.receive_command())
        assert endpoint.malformed == 0
        interface.close()


@pytest.mark.parametrize("place", ["/dev/zero", "pipe"])
@pytest.mark.parametrize("what", ["configuration", "user file", "connect_private_key"])
def test_a_pipe_or_a_device_is_refused_wherever_a_file_is_wanted(tmp_path, place, what):
    """Each would be read for ever, in zenoh, where not even a signal is heard."""
    if place == "pipe":
        place = str(tmp_path / "pipe")
        os.mkfifo(place)
    file = Path(place) if what == "configuration" else tmp_path / "config.json"
    if what == "user file":
        write_config(file, users={"user": "robot", "password": "r", "dictionary_file": place})
    elif what == "connect_private_key":
        names = ("connect_certificate", "connect_private_key", "root_ca_certificate")
        write_config(file, tls={"enable_mtls": True, **dict.fromkeys(names, place)})
    with pytest.raises(BusError, match="no regular file"):
        load_security(file, robot=what == "user file")
