"""Unitree's messages over DDS, through Cyclone DDS: topics ``rt/lowcmd`` and ``rt/lowstate``.

The library carries the bytes that ``unitree_messages`` makes, and declares their types to the network. DDS
lets everybody in the network drive the robot.
"""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Callable
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException, Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct, annotations, make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from sprintlab.deployment.bus.address import BusAddress, BusError
from sprintlab.deployment.bus.ends import COMMAND, STATE, BusEnd
from sprintlab.deployment.bus.shared_memory import LockedFile, controller_lock
from sprintlab.deployment.bus.unitree_ends import UnitreeControllerEnd, UnitreeRobotEnd
from sprintlab.deployment.bus.unitree_messages import STRUCTURES

_TOPICS = {COMMAND: "rt/lowcmd", STATE: "rt/lowstate"}
_PATIENCE = 3.0  # [s] to find a robot
_SETTLING = 0.5  # [s] to hear of others
_LOOK = 0.01  # [s] between two looks at who reads the commands
_WAITING = 64  # messages that wait to be read; the oldest make room
_READING = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(_WAITING))
_OTHERS = Qos(
    Policy.Reliability.BestEffort, Policy.History.KeepLast(_WAITING), Policy.IgnoreLocal.Participant
)
_WRITING = Qos(Policy.Reliability.Reliable(0), Policy.History.KeepLast(1))
_INTERFACE = """<CycloneDDS><Domain Id="any"><General><Interfaces>
<NetworkInterface name="{name}" priority="default" multicast="default"/>
</Interfaces></General></Domain></CycloneDDS>"""
_IDL = {"u1": types.uint8, "<u2": types.uint16, "<i2": types.int16, "<u4": types.uint32, "<i4": types.int32}
_IDL |= {"<f4": types.float32}
_domains: dict[int, tuple[str, Any]] = {}


def _declared() -> dict[str, Any]:
    """Unitree's types for the library, from the same table as the bytes."""
    declared: dict[str, Any] = {}
    names = {str(structure): name for name, structure in STRUCTURES.items()}

    def idl(type_: Any) -> Any:
        if type_.subdtype is not None:
            return types.array[idl(type_.subdtype[0]), type_.subdtype[1][0]]
        return declared[names[str(type_)]] if type_.names else _IDL[type_.str.replace("|", "")]

    for name, structure in STRUCTURES.items():
        members = {field: idl(structure[field]) for field in structure.names or ()}
        made = make_idl_struct(name, f"unitree_go.msg.dds_.{name}", members)
        declared[name] = annotations.autoid("sequential")(annotations.final(made))
    return declared


def _packet(declared: Any) -> Any:
    """The declared type, with bytes in place of fields: the library takes and gives them as they are."""

    def serialize(self: Any, *_: Any, **__: Any) -> bytes:
        return self.content

    def deserialize(cls: Any, data: bytes, *_: Any, **__: Any) -> Any:
        packet = cls.__new__(cls)
        packet.content = bytes(data)
        return packet

    declared.serialize, declared.deserialize = serialize, classmethod(deserialize)
    return declared


_PACKETS = {
    channel: _packet(_declared()[name]) for channel, name in ((COMMAND, "LowCmd_"), (STATE, "LowState_"))
}


class _DdsEnd(BusEnd):
    """A participant with readers and writers of Unitree's topics."""

    def _join(self, address: BusAddress) -> None:
        self._closed = self._peer_seen = False
        self._readers: dict[str, Any] = {}
        self._writers: dict[str, Any] = {}
        self._participant = _participant(address)
        self._looked, self._peers = 0.0, 0

    def _writer(self, channel: str) -> Any:
        return DataWriter(self._participant, self._topic(channel), qos=_WRITING)

    def _reader(self, channel: str, qos: Any = _READING) -> Any:
        return DataReader(self._participant, self._topic(channel), qos=qos)

    def _topic(self, channel: str) -> Any:
        return Topic(self._participant, _TOPICS[channel], _PACKETS[channel])

    def _published(self, channel: str) -> bool:
        """Whether anybody publishes a channel in this domain."""
        found = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication).take(N=1000)
        return any(getattr(sample, "topic_name", "") == _TOPICS[channel] for sample in found)

    def _read_by_others(self) -> bool:
        """Whether anybody reads what this end writes; looked up a hundred times a second."""
        now = time.monotonic()
        if not self._closed and now - self._looked > _LOOK:
            self._looked = now
            self._peers = sum(len(writer.get_matched_subscriptions()) for writer in self._writers.values())
            self._peer_seen = self._peer_seen or self._peers > 0
        return self._peers > 0

    @property
    def peer_left(self) -> bool:
        """Whether the other end was there and is gone, in good order or not."""
        here = self._read_by_others()
        return self._closed or (self._peer_seen and not here)

    def close(self) -> None:
        """Let go of the bus; a second call does nothing."""
        if not self._closed:
            self._closed = True
            self._writers.clear()
            self._readers.clear()
            del self._participant

    def _take(self, channel: str) -> bytes | None:
        while channel in self._readers and (packets := self._readers[channel].take(N=1)):
            if isinstance(packets[0], IdlStruct):  # else a note that a writer has left
                self._note_author(packets[0].sample_info.publication_handle)
                return packets[0].content
        return None

    def _note_author(self, author: int) -> None:
        """Remember who wrote the message just taken."""

    def _put(self, channel: str, content: bytes) -> None:
        if self._closed:
            return
        packet = _PACKETS[channel].deserialize(content)
        with contextlib.suppress(DDSException):  # a link that is down: the other end's watchdog sees it
            self._writers[channel].write(packet)


class Interface(_DdsEnd, UnitreeControllerEnd):
    """The controller's end over DDS.

    Raises:
        BusError: no robot is there, or another program sends commands to it.
    """

    def __init__(self, address: BusAddress, session: int) -> None:
        super().__init__(session)
        self._lock: LockedFile | None = None
        self._join(address)
        try:
            self._lock = controller_lock("unitree.{}.{}".format(*_place(address)), address.name)
            self._find_robot(address)
            self._readers = {STATE: self._reader(STATE), COMMAND: self._reader(COMMAND, _OTHERS)}
            self._wait_for(self._readers[STATE].get_matched_publications)
            self._writers = {COMMAND: self._writer(COMMAND)}
            self._wait_for(self._writers[COMMAND].get_matched_subscriptions)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Let go of the bus; a second call does nothing."""
        super().close()
        if self._lock is not None:
            self._lock.release()

    @property
    def read_by_robot(self) -> bool:
        """Whether anybody but this end reads the commands."""
        return self._read_by_others()

    def _wait_for(self, matched: Callable[[], list[int]]) -> None:
        """Give the network time to connect a reader or a writer; the checks notice what is missing then."""
        deadline = time.monotonic() + _PATIENCE
        while not matched() and time.monotonic() < deadline:
            time.sleep(0.01)

    def _find_robot(self, address: BusAddress) -> None:
        """See that a robot is there, and no other controller in the network."""
        deadline = time.monotonic() + _PATIENCE
        while not self._published(STATE):
            if time.monotonic() > deadline:
                place = f" at {address.place}" if address.place else " on this machine"
                raise BusError(f"no robot publishes rt/lowstate{place}; start it first, or name its network")
            time.sleep(0.1)
        time.sleep(_SETTLING)
        if self._published(COMMAND):
            raise BusError(
                f"another controller drives the robot {address.name!r}: a program publishes rt/lowcmd. "
                "Release the robot's own motion service, or stop the other program"
            )


class Endpoint(_DdsEnd, UnitreeRobotEnd):
    """The robot's end over DDS; raises ``BusError`` where a robot is there already."""

    def __init__(self, address: BusAddress) -> None:
        super().__init__()
        self._join(address)
        time.sleep(_SETTLING)
        if self._published(STATE):
            self.close()
            raise BusError("a robot is there already: a program publishes rt/lowstate")
        self._readers = {COMMAND: self._reader(COMMAND)}
        self._writers = {STATE: self._writer(STATE)}

    @property
    def ready(self) -> bool:
        """Whether a controller hears the states, and its commands are heard."""
        return self._read_by_others() and bool(self._readers[COMMAND].get_matched_publications())

    def _note_author(self, author: int) -> None:
        self._author = author


def _place(address: BusAddress) -> tuple[str, int]:
    """Interface and domain of ``INTERFACE``, ``INTERFACE:DOMAIN`` or ``:DOMAIN``; else loopback and 0."""
    found = re.fullmatch("(?P<interface>[A-Za-z0-9_.-]*):?(?P<domain>[0-9]{0,3})", address.place)
    if found is None or int(found["domain"] or 0) > 230:
        raise BusError(f"{address.place} is not a network interface with a DDS domain from 0 to 230")
    return found["interface"] or "lo", int(found["domain"] or 0)


def _participant(address: BusAddress) -> Any:
    interface, domain = _place(address)
    try:
        if domain not in _domains:
            _domains[domain] = interface, Domain(domain, _INTERFACE.format(name=interface))
        if _domains[domain][0] != interface:
            raise BusError(f"this process speaks DDS domain {domain} over {_domains[domain][0]} already")
        return DomainParticipant(domain)
    except DDSException as error:
        raise BusError(f"cannot join DDS domain {domain} over {interface}: {error}") from error
