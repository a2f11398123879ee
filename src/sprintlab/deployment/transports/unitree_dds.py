"""Unitree's messages over DDS, through Cyclone DDS: topics ``rt/lowcmd`` and ``rt/lowstate``.

The library carries the bytes that ``unitree_messages`` makes, and declares their types to the network. DDS
lets everybody in the network drive the robot.
"""

from __future__ import annotations

import contextlib
import os
import re
import time
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, annotations, make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from sprintlab.core.errors import SprintlabError
from sprintlab.deployment.transports.address import BusAddress
from sprintlab.deployment.transports.ends import COMMAND, STATE, Carrier
from sprintlab.deployment.transports.shared_memory import FileLock, controller_lock
from sprintlab.deployment.transports.unitree_ends import UnitreeControllerEnd, UnitreeRobotEnd
from sprintlab.deployment.transports.unitree_messages import STRUCTURES

_TOPICS = {COMMAND: "rt/lowcmd", STATE: "rt/lowstate"}
_PATIENCE = 3.0  # [s] to find a robot
_SETTLING = 0.5  # [s] to hear of others
_LOOK = 0.01  # [s] between two looks at who reads what is written
_READING = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(64), Policy.IgnoreLocal.Participant)
_WRITING = Qos(Policy.Reliability.Reliable(0), Policy.History.KeepLast(1))
_INTERFACE = """<CycloneDDS><Domain Id="any"><General><Interfaces>
<NetworkInterface name="{name}" priority="default" multicast="default"/>
</Interfaces></General></Domain></CycloneDDS>"""
_IDL = {"u1": types.uint8, "<u2": types.uint16, "<i2": types.int16, "<u4": types.uint32, "<i4": types.int32}
_IDL |= {"<f4": types.float32}


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

    def deserialize(cls: Any, data: bytes, *_: Any, **__: Any) -> Any:
        packet = cls.__new__(cls)
        packet.content = bytes(data)
        return packet

    declared.serialize = lambda self, *_, **__: self.content
    declared.deserialize = classmethod(deserialize)
    return declared


_PACKETS = {
    channel: _packet(_declared()[name]) for channel, name in ((COMMAND, "LowCmd_"), (STATE, "LowState_"))
}


class _Dds(Carrier):
    """A participant with readers and writers of Unitree's topics."""

    def __init__(self, address: BusAddress) -> None:
        self._participant = _participant(address)
        self.lock: FileLock | None = None
        self._readers: dict[str, Any] = {}
        self._writers: dict[str, Any] = {}
        self._heard = self._was_heard = self._closed = False
        self._looked = 0.0

    def write_to(self, channel: str) -> Any:
        """Begin to write a channel."""
        self._writers[channel] = DataWriter(self._participant, self._topic(channel), qos=_WRITING)
        return self._writers[channel]

    def read_from(self, channel: str) -> Any:
        """Begin to read what others write to a channel."""
        self._readers[channel] = DataReader(self._participant, self._topic(channel), qos=_READING)
        return self._readers[channel]

    def published(self, channel: str) -> bool:
        """Whether anybody publishes a channel in this domain."""
        found = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication).take(N=1000)
        return any(getattr(sample, "topic_name", "") == _TOPICS[channel] for sample in found)

    def take(self, channel: str) -> bytes | None:
        while not self._closed and (packets := self._readers[channel].take(N=1)):
            if isinstance(packets[0], IdlStruct):  # else a note that a writer has left
                self.author = packets[0].sample_info.publication_handle
                return packets[0].content
        return None

    def put(self, channel: str, content: bytes) -> None:
        with contextlib.suppress(DDSException):  # a link that is down: the other end's watchdog sees it
            if not self._closed:
                self._writers[channel].write(_PACKETS[channel].deserialize(content))

    @property
    def is_heard(self) -> bool:
        now = time.monotonic()
        if not self._closed and now - self._looked > _LOOK:
            self._looked = now
            self._heard = any(writer.get_matched_subscriptions() for writer in self._writers.values())
            self._was_heard = self._was_heard or self._heard
        return self._heard

    @property
    def ready(self) -> bool:
        return self.is_heard and all(reader.get_matched_publications() for reader in self._readers.values())

    @property
    def peer_left(self) -> bool:
        return self._closed or (not self.is_heard and self._was_heard)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._writers.clear()
            self._readers.clear()
            del self._participant
        if self.lock is not None:
            self.lock.release()

    def _topic(self, channel: str) -> Any:
        return Topic(self._participant, _TOPICS[channel], _PACKETS[channel])


def controller_end(address: BusAddress, session: int) -> UnitreeControllerEnd:
    """The controller's end; ``SprintlabError`` without a robot, or where others send commands to it."""
    carrier = _Dds(address)
    try:
        carrier.lock = controller_lock("unitree.{}.{}".format(*_place(address)), address.name)
        _find_robot(carrier, address)
        carrier.read_from(COMMAND)
        states, commands = carrier.read_from(STATE), carrier.write_to(COMMAND)
        deadline = time.monotonic() + _PATIENCE  # later the checks notice what is missing
        while time.monotonic() < deadline:
            if states.get_matched_publications() and commands.get_matched_subscriptions():
                break
            time.sleep(0.01)
    except BaseException:
        carrier.close()
        raise
    return UnitreeControllerEnd(carrier, session)


def _find_robot(carrier: _Dds, address: BusAddress) -> None:
    """See that a robot is there, and no other controller in the network."""
    deadline = time.monotonic() + _PATIENCE
    while not carrier.published(STATE):
        if time.monotonic() > deadline:
            place = f" at {address.place}" if address.place else " on this machine"
            raise SprintlabError(
                f"no robot publishes rt/lowstate{place}; start it first, or name its network"
            )
        time.sleep(0.1)
    time.sleep(_SETTLING)
    if carrier.published(COMMAND):
        raise SprintlabError(
            f"another controller drives the robot {address.name!r}: a program publishes rt/lowcmd. "
            "Release the robot's own motion service, or stop the other program"
        )


def robot_end(address: BusAddress) -> UnitreeRobotEnd:
    """The robot's end; raises ``SprintlabError`` where a robot is there already."""
    carrier = _Dds(address)
    time.sleep(_SETTLING)
    if carrier.published(STATE):
        carrier.close()
        raise SprintlabError("a robot is there already: a program publishes rt/lowstate")
    carrier.read_from(COMMAND)
    carrier.write_to(STATE)
    return UnitreeRobotEnd(carrier)


def _place(address: BusAddress) -> tuple[str, int]:
    """Interface and domain of ``INTERFACE``, ``INTERFACE:DOMAIN`` or ``:DOMAIN``; else loopback and 0."""
    found = re.fullmatch("(?P<interface>[A-Za-z0-9_.-]*):?(?P<domain>[0-9]{0,3})", address.place)
    if found is None or int(found["domain"] or 0) > 230:
        raise SprintlabError(f"{address.place} is not a network interface with a DDS domain from 0 to 230")
    return found["interface"] or "lo", int(found["domain"] or 0)


def _participant(address: BusAddress) -> Any:
    interface, domain = _place(address)
    os.environ["CYCLONEDDS_URI"] = _INTERFACE.format(name=interface)  # read by the first one in a domain
    try:
        return DomainParticipant(domain)
    except DDSException as error:
        raise SprintlabError(f"cannot join DDS domain {domain} over {interface}: {error}") from error
