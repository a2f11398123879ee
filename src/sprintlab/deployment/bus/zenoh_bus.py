"""The bus over zenoh: keys ``sprintlab/NAME/state``, ``command`` and ``fix``.

Messages are dropped rather than queued when a link is too slow, and sent at once, one by one: a late command
is worth nothing. Each end shows that it is there by a liveliness token. A controller asks the robot for leave
to drive it (``claim``): the robot answers one question after the other, and one controller gets it.
"""

from __future__ import annotations

import contextlib
import hmac
import re
import secrets
import threading
import time
from pathlib import Path
from typing import Any

import zenoh

from sprintlab.core.leaving import leave
from sprintlab.deployment.bus.address import BusAddress, BusError
from sprintlab.deployment.bus.ends import COMMAND, FIX, STATE, BusEnd, ControllerEnd, RobotEnd
from sprintlab.deployment.bus.zenoh_session import Security, load_security, open_session, proof

_PATIENCE = 3.0  # [s] to find a robot
_CLOSING = 2.0  # [s] to take leave of the other end
_LEASE = 2.0  # [s] in which the token of a controller that was let in must show
PARTING = 0.1
"""Time in which the last commands of a controller are taken whose token is gone already [s]."""
_DRIVEN, _FREE, _UNKNOWN = b"driven", b"free", b"unknown"
_CHALLENGE = 32  # bytes
_SESSION = 8  # bytes
_TOKEN = re.compile(r"[0-9a-f]{16}")
_MOST_KNOWN = 10_000  # controllers that a robot keeps in mind
_WAITING = 256  # messages that wait to be read; the oldest make room


def open_interface(address: BusAddress, session: int, config: Path | None) -> ZenohInterface:
    """The controller's end.

    Raises:
        BusError: nobody listens at the address's place, the robot has a controller, or either end does not
            know the other.
    """
    return ZenohInterface(address, session, _security(config, robot=False))


def open_endpoint(address: BusAddress, config: Path | None) -> ZenohEndpoint:
    """The robot's end.

    Raises:
        BusError: the place is taken, or would be open to strangers.
    """
    return ZenohEndpoint(address, _security(config, robot=True))


def _security(config: Path | None, *, robot: bool) -> Security:
    return Security() if config is None else load_security(config, robot=robot)


class _ZenohEnd(BusEnd):
    """A session of zenoh and the token of this end."""

    def __init__(self, address: BusAddress, security: Security, token: str, *, listen: bool) -> None:
        self._prefix = f"sprintlab/{address.name}"
        self._security = security
        self._closed = False
        self._session = open_session(address, security, listen=listen)
        try:
            self._token = self._session.liveliness().declare_token(f"{self._prefix}/alive/{token}")
            self._join(address)
        except BaseException:
            _end(self._session)
            raise

    def close(self) -> None:
        """Let go of the bus; a second call does nothing."""
        if not self._closed:
            self._closed = True
            with contextlib.suppress(zenoh.ZError):
                self._token.undeclare()
            _end(self._session)

    def _join(self, address: BusAddress) -> None:
        """Find out whether this end may be there, and take its place."""
        raise NotImplementedError

    def _watch(self, tokens: str) -> Any:
        return self._session.liveliness().declare_subscriber(
            f"{self._prefix}/alive/{tokens}", self._notice, history=True
        )

    def _notice(self, sample: Any) -> None:
        """A token of the other end came or went."""
        raise NotImplementedError

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


def _end(session: Any) -> None:
    """Close a session; where the other end stands still, zenoh tries for ten seconds, and fails.

    Nobody waits for that but the end of the process, which would not survive it half done.
    """

    def close() -> None:
        with contextlib.suppress(zenoh.ZError):
            session.close()

    leave(close, _CLOSING)


class ZenohInterface(_ZenohEnd, ControllerEnd):
    """The controller's end over zenoh."""

    def __init__(self, address: BusAddress, session: int, security: Security) -> None:
        self.session = session
        self._robot_left = False
        super().__init__(address, security, f"controller/{session:016x}", listen=False)

    @property
    def peer_left(self) -> bool:
        """Whether the robot that let this end in is gone, in good order or not.

        One that was restarted is found again by zenoh, but has let nobody in: it obeys none of the commands.
        """
        return self._closed or self._robot_left

    def _join(self, address: BusAddress) -> None:
        """Ask the robot for leave to drive it."""
        self._subscribers = {channel: self._subscribe(channel) for channel in (STATE, FIX)}
        self._watcher = self._watch("robot")  # before it answers: it may be restarted right after that
        self._claim(address)  # from then on the robot speaks, and the subscriptions are known there
        self._publishers = {COMMAND: self._publisher(COMMAND)}

    def _claim(self, address: BusAddress) -> None:
        challenge = secrets.token_bytes(_CHALLENGE)
        question = self.session.to_bytes(_SESSION, "little") + challenge + self._security.user.encode()
        deadline = time.monotonic() + _PATIENCE
        while time.monotonic() < deadline:
            for reply in self._session.get(f"{self._prefix}/claim", payload=question, timeout=_PATIENCE):
                if reply.ok is not None:
                    self._judge(address, reply.ok.payload.to_bytes(), challenge)
                    return
            time.sleep(0.1)
        raise BusError(f"no robot named {address.name!r} answers on zenoh; start it first")

    def _judge(self, address: BusAddress, answer: bytes, challenge: bytes) -> None:
        """Take the robot's answer, if it is the robot's."""
        if answer == _DRIVEN:
            raise BusError(f"another controller drives the robot {address.name!r}")
        security = self._security
        expected = _FREE + (proof(security.password, challenge) if security.user else b"")
        if not hmac.compare_digest(answer, expected):
            raise BusError(
                f"who answers for the robot {address.name!r} does not know the password of "
                f"{security.user!r}: it is not the robot"
            )

    def _notice(self, sample: Any) -> None:
        self._robot_left = self._robot_left or sample.kind == zenoh.SampleKind.DELETE


class ZenohEndpoint(_ZenohEnd, RobotEnd):
    """The robot's end over zenoh."""

    def __init__(self, address: BusAddress, security: Security) -> None:
        self._lock = threading.Lock()  # zenoh asks and tells from threads of its own
        self._alive: set[int] = set()
        self._gone: set[int] = set()
        self._holder = 0
        self._granted_at, self._parted_at = -_LEASE, -PARTING
        super().__init__(address, security, "robot", listen=True)

    @property
    def peer_left(self) -> bool:
        """Whether the controller that was let in is gone, in good order or not."""
        return self._closed or (self._holder != 0 and not self._held())

    @property
    def ready(self) -> bool:
        """Whether a controller was let in: what is published before reaches nobody."""
        return self._holder != 0

    def _join(self, address: BusAddress) -> None:
        del address  # a second robot cannot listen at the same place
        self._watcher = self._watch("controller/*")
        self._subscribers = {COMMAND: self._subscribe(COMMAND)}
        self._publishers = {channel: self._publisher(channel) for channel in (STATE, FIX)}
        self._queryable = self._session.declare_queryable(f"{self._prefix}/claim", self._answer)

    def _admitted(self, session: int) -> bool:
        """Whether the controller of this session was let in, and is there: its number is no secret."""
        parting = time.monotonic() - self._parted_at < PARTING
        return session == self._holder != 0 and (parting or self._held())

    def _held(self) -> bool:
        """Whether the controller that was let in is still there, or so new that its token may not show."""
        fresh = time.monotonic() - self._granted_at < _LEASE and self._holder not in self._gone
        return self._holder in self._alive or (self._holder != 0 and fresh)

    def _notice(self, sample: Any) -> None:
        name = str(sample.key_expr).rpartition("/")[2]
        if not _TOKEN.fullmatch(name):
            return
        session = int(name, 16)
        with self._lock:
            if len(self._alive) + len(self._gone) > _MOST_KNOWN:  # somebody floods: keep who drives
                self._alive &= {self._holder}
                self._gone &= {self._holder}
            if sample.kind == zenoh.SampleKind.PUT:
                self._alive.add(session)
            else:
                self._alive.discard(session)
                self._gone.add(session)
                if session == self._holder:
                    self._parted_at = time.monotonic()

    def _answer(self, query: Any) -> None:
        """One question after the other: two that come at once do not both get leave."""
        question = query.payload.to_bytes() if query.payload is not None else b""
        session = int.from_bytes(question[:_SESSION], "little")
        challenge = question[_SESSION : _SESSION + _CHALLENGE]
        user = question[_SESSION + _CHALLENGE :].decode(errors="replace")
        query.reply(query.key_expr, self._grant(session, challenge, user))

    def _grant(self, session: int, challenge: bytes, user: str) -> bytes:
        users = self._security.users
        if session == 0 or len(challenge) != _CHALLENGE or (users and user not in users):
            return _UNKNOWN
        with self._lock:
            if session in self._gone or self._held():
                return _DRIVEN
            self._holder, self._granted_at = session, time.monotonic()
        return _FREE + (proof(users[user], challenge) if users else b"")
