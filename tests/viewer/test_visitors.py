"""Of what a visitor of the live page says, only what its controls and its camera say is heard."""

import math
import threading
import time

import msgspec
import pytest

pytest.importorskip("viser")

import viser
from viser import _messages
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from sprintlab.viewer import visitors
from sprintlab.viewer.live import Session
from sprintlab.viewer.page import Page, PageOptions
from sprintlab.viewer.visitors import LARGEST_MESSAGE, MOST_VISITORS, is_offered

encode = msgspec.msgpack.encode


def update(uuid="x", **updates):
    return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates}


CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1, 0.0, 0.0, 0.0),
    "position": (1.0, 0.0, 0.5),
    "look_at": (0, 0, 0),
    "up_direction": (0.0, 0.0, 1.0),
    **{"fov": 1.0, "near": 0.1, "far": 100, "image_height": 700, "image_width": 900},
}
"""After which the server takes a visitor for one."""


@pytest.mark.parametrize("said", [CAMERA, {"type": "CommandTriggerMessage", "uuid": "x"}])
def test_what_camera_and_keys_say_is_heard(said):
    assert is_offered(encode(said))


@pytest.mark.parametrize("value", [True, 3, 0.5, "Stop"])
def test_what_a_control_says_is_heard(value):
    assert is_offered(encode(update(value=value)))


@pytest.mark.parametrize(
    "content",
    [
        encode(update(__dict__={"a": 1})),
        encode(update(update_cb="x")),
        encode(update(value=0.5, props="x")),
        encode(update(value=[1.0])),
        encode({"type": "ViewerCameraMessage", "position": [1.0]}),
        encode({**CAMERA, "position": "x"}),
        encode({"type": "ShareUrlRequest"}),
        encode({"type": "FileTransferStartUpload", "source_component_uuid": "x"}),
        encode({"type": "GuiFormDirtyMessage", "uuid": "x"}),
        encode({"type": ["GuiUpdateMessage"]}),
        encode([1]),
        b"",
        b"\xff" * 100,
        b"\x91" * 60_000,
        b"\x82\xa4type\xa1\xff",
        "text",
    ],
    ids=lambda content: str(content[:24]),
)
def test_all_else_is_not(content):
    assert not is_offered(content)


@pytest.fixture
def page(robot, policy):
    page = Page(Session(robot, {"sprint": policy}), PageOptions(port=8291))
    thread = threading.Thread(target=page.run)
    thread.start()
    yield page
    page.end()
    thread.join(60.0)


def visit(page, *protocols):
    place = page.address.removeprefix("http://")
    spoken = protocols or (f"viser-v{viser.__version__}",)
    return connect(
        f"ws://{place}", subprotocols=spoken, origin=f"http://{place}", max_size=None, max_queue=None
    )


def eventually(look):
    deadline = time.monotonic() + 60.0
    while not look():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_visitor_who_speaks_to_the_server_itself_ends_nothing_and_is_not_told_of(page, capfd):
    """The first of these ended the page, the others printed tracebacks."""
    speed = page._controls._speed._impl.uuid
    paused = page._controls._paused._impl.uuid
    with visit(page) as visitor:
        visitor.send(encode(CAMERA))
        for said in (update(paused, __dict__={"a": 1}), update(speed, value="x"), {"type": "no such"}):
            visitor.send(encode(said))
        visitor.send(b"rubbish")
        visitor.send("text")
        for value in (1e308, math.nan):
            visitor.send(encode(update(speed, value=value)))
            for command in page.server.gui._command_handle_from_uuid:
                visitor.send(encode({"type": "CommandTriggerMessage", "uuid": command}))
        said = encode(update(speed, value=1.5))  # until the commands have had their turns
        eventually(lambda: visitor.send(said) or page.session.knobs.speed == 1.5)
    assert "Traceback" not in "".join(capfd.readouterr())


@pytest.mark.parametrize("protocol", ["viser-v0", "other", "viser-v" + 200 * "9"], ids=lambda name: name[:9])
def test_who_speaks_another_version_is_told_so_and_nobody_else(page, capfd, protocol):
    """Its words stood on the standard output, which a reader of the address may leave to fill up."""
    with visit(page, protocol) as visitor, pytest.raises(ConnectionClosed) as closed:
        visitor.recv(timeout=60.0)
    assert closed.value.rcvd.code == 1002  # at which the page says that it is old
    assert capfd.readouterr() == ("", "")


def test_a_large_message_takes_no_memory(page):
    with visit(page) as visitor, pytest.raises(ConnectionClosed) as closed:
        visitor.send(bytes(LARGEST_MESSAGE + 1))
        while True:
            visitor.recv(timeout=60.0)
    assert closed.value.rcvd.code == 1009


def test_more_visitors_than_memory_is_for_are_sent_away(page, monkeypatch):
    monkeypatch.setattr(visitors, "MOST_VISITORS", 1)
    assert MOST_VISITORS > 1
    with visit(page) as first:
        first.recv(timeout=60.0)
        with visit(page) as second, pytest.raises(ConnectionClosed) as closed:
            second.recv(timeout=60.0)
        assert closed.value.rcvd.code == 1013
    eventually(lambda: _gets_in(page))


def _gets_in(page):
    with visit(page) as visitor:
        try:
            return bool(visitor.recv(timeout=60.0))
        except ConnectionClosed:
            return False


def test_what_the_servers_own_messages_hold_is_what_is_asked_for():
    """Of a viser whose page said it otherwise, nothing would be heard."""
    camera = {name: value for name, value in CAMERA.items() if name != "type"}
    for said in (
        _messages.GuiUpdateMessage(uuid="x", updates={"value": 0.5}),
        _messages.CommandTriggerMessage(uuid="x"),
        _messages.ViewerCameraMessage(**camera),
    ):
        content = encode({"type": type(said).__name__, **vars(said)})
        assert is_offered(content)
        assert type(_messages.Message.deserialize(content)) is type(said)


NOT_OFFERED = {
    "buttons to hold": ["GuiButtonHoldMessage"],
    "forms": ["GuiFormDirtyMessage", "GuiFormSubmitMessage"],
    "uploads": ["FileTransferStartUpload", "FileTransferPart"],
    "what is clicked in the scene": ["SceneNodeClickMessage", "SceneNodeDragMessage", "ScenePointerMessage"],
    "scene handles": [f"TransformControls{part}Message" for part in ("DragStart", "Update", "DragEnd")],
    "the share link": ["ShareUrlRequest", "ShareUrlDisconnect"],
}
"""What viser obeys beside controls, keys and camera; the page has none of it."""


def test_all_else_that_the_server_would_obey_is_known(page):
    """A viser that obeys more, or that asks the page for more, has to be judged anew."""
    with visit(page) as visitor:
        visitor.send(encode(CAMERA))
        eventually(page.server.get_clients)
        (client,) = page.server.get_clients().values()
        ends = (page.server._websock_server, client._websock_connection)
        obeyed = {message.__name__ for end in ends for message in end._incoming_handlers}
    known = {name for names in NOT_OFFERED.values() for name in names}
    assert obeyed == known | {"GuiUpdateMessage", "CommandTriggerMessage", "ViewerCameraMessage"}
