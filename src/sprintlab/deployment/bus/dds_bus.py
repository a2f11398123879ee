"""The bus over DDS, through Cyclone DDS: topics ``sprintlab_NAME_state``, ``_command`` and ``_fix``.

Samples carry the bus's own bytes, best effort and without queues: a late command is worth nothing. A robot
with a DDS interface of its own (Unitree's, for one) needs a bridge that does the duties of the robot's end;
see ``sprintlab.deployment.interface``.
"""

# No ``from __future__ import annotations``: Cyclone DDS reads the type of ``Packet`` from its annotations.
import contextlib
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import sequence, uint8
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from sprintlab.deployment.bus.address import BusAddress, BusError
from sprintlab.deployment.bus.ends import COMMAND, FIX, STATE, BusEnd, ControllerEnd, RobotEnd

_PATIENCE = 3.0  # [s] to find a robot
_SETTLING = 0.5  # [s] to hear of others
_WAITING = 256  # samples that wait to be read; the oldest make room
_QOS = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(_WAITING), Policy.Durability.Volatile)


@dataclass
class Packet(IdlStruct, typename="sprintlab.Packet"):
    """A message of the bus."""

    content: sequence[uint8]  # type: ignore


def _packet(content: bytes) -> Packet:
    numbers: Any = list(content)  # at run time Cyclone's ``sequence`` is a list
    return Packet(content=numbers)


def _content(packet: Packet) -> bytes:
    numbers: Any = packet.content
    return bytes(numbers)


def open_interface(address: BusAddress, session: int, config: Path | None) -> "DdsInterface":
    """The controller's end.

    Raises:
        BusError: no robot of this name is in the domain, or another controller drives it.
    """
    _refuse_config(config)
    return DdsInterface(address, session)


def open_endpoint(address: BusAddress, config: Path | None) -> "DdsEndpoint":
    """The robot's end.

    Raises:
        BusError: a robot of this name is in the domain already.
    """
    _refuse_config(config)
    return DdsEndpoint(address)


def _refuse_config(config: Path | None) -> None:
    if config is not None:
        raise BusError("--bus-config is zenoh's; dds:// cannot keep strangers out")


class _DdsEnd(BusEnd):
    """A participant with topics of one robot."""

    def __init__(self, address: BusAddress, writes: tuple[str, ...], reads: tuple[str, ...]) -> None:
        self._closed = self._peer_seen = False
        self._name = f"sprintlab_{address.name}"
        self._participant = _participant(address)
        self._greet(address)
        self._writers = {name: DataWriter(self._participant, self._topic(name), qos=_QOS) for name in writes}
        self._readers = {name: DataReader(self._participant, self._topic(name), qos=_QOS) for name in reads}
        self._waiting: dict[str, list[bytes]] = {name: [] for name in reads}

    @property
    def peer_left(self) -> bool:
        """Whether the other end was there and is gone, in good order or not."""
        if self._closed:
            return True
        here = any(reader.get_matched_publications() for reader in self._readers.values())
        self._peer_seen = self._peer_seen or here
        return self._peer_seen and not here

    def close(self) -> None:
        """Let go of the bus; a second call does nothing."""
        if not self._closed:
            self._closed = True
            self._writers.clear()
            self._readers.clear()
            del self._participant

    def _greet(self, address: BusAddress) -> None:
        """Find out whether this end may be there."""
        raise NotImplementedError

    def _topic(self, name: str) -> Any:
        return Topic(self._participant, f"{self._name}_{name}", Packet)

    def _published(self) -> set[str]:
        """Topics of this robot that somebody publishes."""
        found = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication).take(N=1000)
        names = {sample.topic_name for sample in found if hasattr(sample, "topic_name")}
        return {name.removeprefix(f"{self._name}_") for name in names if name.startswith(f"{self._name}_")}

    def _take(self, channel: str) -> bytes | None:
        if self._closed:
            return None
        waiting = self._waiting[channel]
        if not waiting:
            samples = self._readers[channel].take(N=_WAITING)
            waiting += [_content(sample) for sample in samples if isinstance(sample, Packet)]
        return waiting.pop(0) if waiting else None

    def _put(self, channel: str, content: bytes) -> None:
        if self._closed:
            return
        with contextlib.suppress(DDSException):  # a link that is down: the other end's watchdog sees it
            self._writers[channel].write(_packet(content))


class DdsInterface(_DdsEnd, ControllerEnd):
    """The controller's end over DDS."""

    def __init__(self, address: BusAddress, session: int) -> None:
        self.session = session
        super().__init__(address, writes=(COMMAND,), reads=(STATE, FIX))

    def _greet(self, address: BusAddress) -> None:
        deadline = time.monotonic() + _PATIENCE
        while STATE not in self._published():
            if time.monotonic() > deadline:
                raise BusError(f"no robot named {address.name!r} is in the DDS domain; start it first")
            time.sleep(0.1)
        time.sleep(_SETTLING)
        if COMMAND in self._published():
            raise BusError(f"another controller drives the robot {address.name!r}")


class DdsEndpoint(_DdsEnd, RobotEnd):
    """The robot's end over DDS."""

    def __init__(self, address: BusAddress) -> None:
        super().__init__(address, writes=(STATE, FIX), reads=(COMMAND,))

    def _greet(self, address: BusAddress) -> None:
        time.sleep(_SETTLING)
        if STATE in self._published():
            raise BusError(f"a robot named {address.name!r} is in the DDS domain already")


def _participant(address: BusAddress) -> Any:
    """A participant of the domain that the address names, 0 if it names none."""
    place = address.place or "0"
    if not place.isdecimal() or int(place) > 230:
        raise BusError(f"a DDS domain is a number from 0 to 230, not {place!r}")
    try:
        return DomainParticipant(int(place))
    except DDSException as error:
        raise BusError(f"cannot join DDS domain {place}: {error}") from error
