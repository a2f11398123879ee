"""The bus over zenoh: keys ``sprintlab/NAME/state``, ``command`` and ``fix``.

Messages are dropped rather than queued when a link is too slow, and sent at once, one by one: a late command
is worth nothing. Each end shows that it is there by a liveliness token.
"""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable
from typing import Any

import zenoh

from sprintlab.deployment.bus.address import BusAddress, BusError
from sprintlab.deployment.interface import (
    JointCommand,
    MessageError,
    MessageType,
    PositionFix,
    RobotState,
    decode,
    encode,
)

_PATIENCE = 3.0  # [s] to find a robot
_SETTLING = 1.0  # [s] for peers to find each other by multicast
_DRIVEN, _FREE = b"driven", b"free"
_WAITING = 256  # messages that wait to be read; the oldest make room


def open_interface(address: BusAddress) -> ZenohInterface:
    """The controller's end.

    Raises:
        BusError: nobody listens at the address's place.
    """
    return ZenohInterface(address)


def open_endpoint(address: BusAddress) -> ZenohEndpoint:
    """The robot's end.

    Raises:
        BusError: the place is taken, or a robot of this name is there already.
    """
    return ZenohEndpoint(address)


class _ZenohEnd:
    """A session, the token of this end, and whether the other end's is there."""

    def __init__(self, address: BusAddress, own: str, other: str) -> None:
        self.malformed = 0
        self._prefix = f"sprintlab/{address.name}"
        self._peer_seen = self._peer_here = False
        self._closed = False
        self._session = _open_session(address, listen=own == "robot")
        try:
            self._greet(address)
            self._watch = self._session.liveliness().declare_subscriber(
                f"{self._prefix}/alive/{other}", self._notice, history=True
            )
            self._token = self._session.liveliness().declare_token(f"{self._prefix}/alive/{own}")
        except BaseException:
            self._session.close()
            raise

    @property
    def peer_left(self) -> bool:
        """Whether the other end was there and is gone, in good order or not."""
        return self._closed or (self._peer_seen and not self._peer_here)

    def close(self) -> None:
        """Let go of the bus; a second call does nothing."""
        if not self._closed:
            self._closed = True
            with contextlib.suppress(zenoh.ZError):
                self._token.undeclare()
            self._session.close()

    def _greet(self, address: BusAddress) -> None:
        """Find out whether this end may be there."""
        raise NotImplementedError

    def _notice(self, sample: Any) -> None:
        self._peer_here = sample.kind == zenoh.SampleKind.PUT
        self._peer_seen = self._peer_seen or self._peer_here

    def _publisher(self, name: str) -> Any:
        return self._session.declare_publisher(
            f"{self._prefix}/{name}",
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )

    def _subscribe(self, name: str) -> Any:
        """A queue outside Python, which fills while Python is busy; the oldest messages make room."""
        return self._session.declare_subscriber(
            f"{self._prefix}/{name}", zenoh.handlers.RingChannel(_WAITING)
        )

    def _next(self, waiting: Any, kind: type[MessageType]) -> MessageType | None:
        while (sample := waiting.try_recv()) is not None:
            try:
                return decode(kind, sample.payload.to_bytes())
            except MessageError:
                self.malformed += 1
        return None

    def _put(self, send: Callable[[bytes], None], content: bytes) -> None:
        with contextlib.suppress(zenoh.ZError):  # a link that is down: the other end's watchdog sees it
            send(content)


class ZenohInterface(_ZenohEnd):
    """The controller's end over zenoh.

    Attributes:
        malformed: messages that ``decode`` refused.
    """

    def __init__(self, address: BusAddress) -> None:
        super().__init__(address, own="controller", other="robot")
        self._states, self._fixes = self._subscribe("state"), self._subscribe("fix")
        self._commands = self._publisher("command")

    def _greet(self, address: BusAddress) -> None:
        """Ask the robot whether it is free; with multicast, peers need a moment to find each other."""
        deadline = time.monotonic() + _PATIENCE
        while time.monotonic() < deadline:
            for reply in self._session.get(f"{self._prefix}/driven", timeout=_PATIENCE):
                if reply.ok is not None and reply.ok.payload.to_bytes() == _FREE:
                    return
                raise BusError(f"another controller drives the robot {address.name!r}")
            time.sleep(0.1)
        raise BusError(f"no robot named {address.name!r} answers on zenoh; start it first")

    def receive(self) -> RobotState | None:
        """The next state in order of arrival; None if there is none left."""
        return self._next(self._states, RobotState)

    def receive_fix(self) -> PositionFix | None:
        """The newest position fix not yet read, if any."""
        newest = None
        while (fix := self._next(self._fixes, PositionFix)) is not None:
            newest = fix
        return newest

    def send(self, command: JointCommand) -> None:
        """Hand a command to the robot."""
        self._put(self._commands.put, encode(command))


class ZenohEndpoint(_ZenohEnd):
    """The robot's end over zenoh.

    Attributes:
        malformed: messages that ``decode`` refused.
    """

    def __init__(self, address: BusAddress) -> None:
        super().__init__(address, own="robot", other="controller")
        self._commands = self._subscribe("command")
        self._states, self._fixes = self._publisher("state"), self._publisher("fix")
        self._session.declare_queryable(f"{self._prefix}/driven", self._tell)

    def _greet(self, address: BusAddress) -> None:
        """Look for another robot of this name."""
        if not address.place:
            time.sleep(_SETTLING)
        for _ in self._session.liveliness().get(f"{self._prefix}/alive/robot", timeout=0.5):
            raise BusError(f"a robot named {address.name!r} is on this network already")

    def _tell(self, query: Any) -> None:
        query.reply(query.key_expr, _DRIVEN if self._peer_here else _FREE)

    def receive_command(self) -> JointCommand | None:
        """The next command in order of arrival; None if there is none left."""
        return self._next(self._commands, JointCommand)

    def publish(self, state: RobotState) -> None:
        """Send a state."""
        self._put(self._states.put, encode(state))

    def publish_fix(self, fix: PositionFix) -> None:
        """Send a position fix."""
        self._put(self._fixes.put, encode(fix))


def _open_session(address: BusAddress, listen: bool) -> Any:
    config = zenoh.Config()
    if address.place:
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5(
            "listen/endpoints" if listen else "connect/endpoints", json.dumps([f"tcp/{address.place}"])
        )
        config.insert_json5("connect/timeout_ms", "2000")
        config.insert_json5("connect/exit_on_failure", "true")
        if not listen:
            config.insert_json5("listen/endpoints", "[]")
    try:
        return zenoh.open(config)
    except (zenoh.ZError, OSError) as error:
        what = "listen at" if listen else "reach a robot at"
        where = address.place or "the network"
        raise BusError(f"cannot {what} {where}: {str(error).split(' at /')[0]}") from error
