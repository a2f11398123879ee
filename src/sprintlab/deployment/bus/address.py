"""Where a robot is reached: one address, the same for the controller's end and the robot's end.

``shm://NAME`` is shared memory of this machine, ``unitree://NAME[@INTERFACE[:DOMAIN]]`` Unitree's messages
over DDS. Everybody in a DDS network can drive a robot in it.
"""

from __future__ import annotations

import re
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

from sprintlab.core.checks import check_choice
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.deployment.interface import new_session

if TYPE_CHECKING:
    from sprintlab.deployment.bus.ends import ControllerEnd, RobotEnd

_CARRIERS = {
    "shm": ("shared_memory", "SharedMemoryInterface", "SharedMemoryEndpoint"),
    "unitree": ("unitree_bus", "UnitreeInterface", "UnitreeEndpoint"),
}
"""Module, controller's end and robot's end."""
_ADDRESS = re.compile(r"(?P<carrier>[a-z]+)://(?P<name>[A-Za-z0-9_-]{1,64})(@(?P<place>[^\s@/]+))?")
_FORM = "an address like shm://bp2 or unitree://go2@enp2s0"


class BusError(SprintlabError):
    """The bus cannot be opened: no robot there, another controller there, or a package is missing."""


class BusAddress(NamedTuple):
    """A parsed address.

    Attributes:
        carrier: ``"shm"`` or ``"unitree"``.
        name: the robot's name.
        place: what follows ``@``; empty if nothing does.
    """

    carrier: str
    name: str
    place: str


def parse_address(address: str) -> BusAddress:
    """Take an address apart.

    Raises:
        InvalidValueError: it does not have the form ``carrier://name`` or ``carrier://name@place``.
    """
    match = _ADDRESS.fullmatch(address)
    if match is None:
        raise InvalidValueError("bus", address, _FORM)
    check_choice("bus carrier", match["carrier"], tuple(_CARRIERS))
    return BusAddress(match["carrier"], match["name"], match["place"] or "")


def leaves_this_machine(address: str) -> bool:
    """Whether a robot at this address may be anything but a simulation on this machine.

    Raises:
        InvalidValueError: the address makes no sense.
    """
    parsed = parse_address(address)
    return parsed.carrier == "unitree" and parsed.place.partition(":")[0] not in ("", "lo")


def open_bus(address: str, *, session: int | None = None) -> ControllerEnd:
    """The controller's end of a bus.

    Args:
        address: the robot's address.
        session: number that the controller's commands carry; drawn at random when left out.

    Raises:
        InvalidValueError: the address makes no sense.
        BusError: no robot is there, another controller drives it, or a package is missing.
    """
    parsed = parse_address(address)
    return _end(parsed, 1)(parsed, new_session() if session is None else session)


def open_endpoint(address: str) -> RobotEnd:
    """The robot's end of a bus.

    Raises:
        InvalidValueError: the address makes no sense.
        BusError: another robot of this name runs, or a package is missing.
    """
    parsed = parse_address(address)
    return _end(parsed, 2)(parsed)


def _end(address: BusAddress, which: int) -> Any:
    """The class of one end; the carrier's package is imported only now."""
    names = _CARRIERS[address.carrier]
    try:
        return getattr(import_module(f"sprintlab.deployment.bus.{names[0]}"), names[which])
    except ModuleNotFoundError as error:
        raise BusError(
            f"{address.carrier}:// needs the package {error.name}: pip install 'sprintlab[{address.carrier}]'"
        ) from error
