"""The bus over zenoh: keys ``sprintlab/NAME/state``, ``command`` and ``fix``.

Messages are dropped rather than queued when a link is too slow, and sent at once, one by one: a late command
is worth nothing. Each end shows that it is there by a liveliness token.
"""

from __future__ import annotations

import contextlib
import json
import time
from typing import Any

import zenoh

from sprintlab.deployment.bus.address import BusAddress, BusError
from sprintlab.deployment.bus.ends import COMMAND, FIX, STATE, BusEnd, ControllerEnd, RobotEnd

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


class _ZenohEnd(BusEnd):
    """A session, the token of this end, and whether the other end's is there."""

    def __init__(self, address: BusAddress, own: str, other: str) -> None:
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

    def _take(self, channel: str) -> bytes | None:
        sample = self._subscribers[channel].try_recv()
        return None if sample is None else sample.payload.to_bytes()

    def _put(self, channel: str, content: bytes) -> None:
        with contextlib.suppress(zenoh.ZError):  # a link that is down: the other end's watchdog sees it
            self._publishers[channel].put(content)


class ZenohInterface(_ZenohEnd, ControllerEnd):
    """The controller's end over zenoh."""

    def __init__(self, address: BusAddress) -> None:
        super().__init__(address, own="controller", other="robot")
        self._subscribers = {channel: self._subscribe(channel) for channel in (STATE, FIX)}
        self._publishers = {COMMAND: self._publisher(COMMAND)}

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


class ZenohEndpoint(_ZenohEnd, RobotEnd):
    """The robot's end over zenoh."""

    def __init__(self, address: BusAddress) -> None:
        super().__init__(address, own="robot", other="controller")
        self._subscribers = {COMMAND: self._subscribe(COMMAND)}
        self._publishers = {channel: self._publisher(channel) for channel in (STATE, FIX)}
        self._session.declare_queryable(f"{self._prefix}/driven", self._tell)

    def _greet(self, address: BusAddress) -> None:
        """Look for another robot of this name."""
        if not address.place:
            time.sleep(_SETTLING)
        for _ in self._session.liveliness().get(f"{self._prefix}/alive/robot", timeout=0.5):
            raise BusError(f"a robot named {address.name!r} is on this network already")

    def _tell(self, query: Any) -> None:
        query.reply(query.key_expr, _DRIVEN if self._peer_here else _FREE)


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
