"""The live page takes WebSockets of its own origin only."""

import socket

import pytest

pytest.importorskip("viser")
pytest.importorskip("websockets")

import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from sprintlab.viewer.listening import free_port
from sprintlab.viewer.origin import is_own_origin, own_origin_only


@pytest.mark.parametrize(
    ("origin", "host", "served_at", "own"),
    [
        ("http://localhost:8080", "localhost:8080", "localhost", True),
        ("http://127.0.0.1:8080", "127.0.0.1:8080", "localhost", True),
        ("http://[::1]:8080", "[::1]:8080", "localhost", True),
        ("http://robot.lab:8080", "robot.lab:8080", "robot.lab", True),
        ("http://192.0.2.7:8080", "192.0.2.7:8080", "0.0.0.0", True),
        ("http://localhost:9999", "localhost:8080", "localhost", False),
        ("http://street.example", "localhost:8080", "localhost", False),
        ("http://street.example:8080", "street.example:8080", "localhost", False),  # a name that leads here
        ("http://localhost.street.example:8080", "localhost.street.example:8080", "localhost", False),
        ("null", "localhost:8080", "localhost", False),
        ("", "localhost:8080", "localhost", False),
        ("file://", "localhost:8080", "localhost", False),
        ("http://[::1", "[::1", "localhost", False),
        ("http://[::1].example:80", "[::1].example:80", "localhost", False),
        ("http://127.0.0.1:80.example", "127.0.0.1:80.example", "localhost", False),
        ("http://127.0.0.1:80@example", "127.0.0.1:80@example", "localhost", False),
    ],
)
def test_only_the_page_itself_is_its_own_origin(origin, host, served_at, own):
    assert is_own_origin(origin, host, served_at) is own


@pytest.fixture(scope="module")
def port():
    with own_origin_only("localhost"):
        server = viser.ViserServer(host="localhost", port=free_port("localhost", 8301), verbose=False)
    yield server.get_port()
    server.stop()


def opened(port, **options):
    with connect(f"ws://localhost:{port}", subprotocols=[f"viser-v{viser.__version__}"], **options):
        return True


def test_a_name_that_is_too_long_for_a_disk_is_no_page(port):
    with socket.create_connection(("localhost", port)) as visitor:
        visitor.sendall(b"GET /" + 5000 * b"x" + b" HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert visitor.recv(100).startswith(b"HTTP/1.1 404 ")


def test_a_connection_of_the_page_is_taken(port):
    assert opened(port, origin=f"http://localhost:{port}")


@pytest.mark.parametrize("wish", ["websocket,", "WebSocket , ", ", websocket"])
def test_a_wish_written_otherwise_is_refused_all_the_same(port, wish):
    lines = [
        "GET / HTTP/1.1", f"Host: localhost:{port}", "Origin: http://street.example", f"Upgrade: {wish}",
        "Connection: Upgrade", "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
        f"Sec-WebSocket-Protocol: viser-v{viser.__version__}", "", "",
    ]  # fmt: skip
    with socket.create_connection(("localhost", port), timeout=10.0) as client:
        client.sendall("\r\n".join(lines).encode())
        assert client.recv(4096).split()[1] == b"403"


@pytest.mark.parametrize("origin", [None, "http://street.example", "http://localhost:1", "null"])
def test_a_connection_of_another_page_is_refused(port, origin):
    with pytest.raises(InvalidStatus) as caught:
        opened(port, origin=origin)
    assert caught.value.response.status_code == 403
