"""Where a robot is reached: one address, the same for the controller's end and the robot's end.

``shm://NAME``, ``zenoh://NAME[@HOST:PORT]`` and ``unitree://NAME[@INTERFACE[:DOMAIN]]``: what carries each,
and between which machines, stands in ``docs/deployment.md``.

What is not this machine needs zenoh's TLS, or user and password (``zenoh_session``). DDS has no such check
here: everybody in a DDS network can drive a robot in it.
"""

from __future__ import annotations

import ipaddress
import os
import re
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from sprintlab.core.checks import check_choice
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.deployment.interface import RobotEndpoint, RobotInterface, new_session

_CARRIERS = {"shm": "shared_memory", "zenoh": "zenoh_bus", "unitree": "unitree_bus"}
_ADDRESS = re.compile(r"(?P<carrier>[a-z]+)://(?P<name>[A-Za-z0-9_-]{1,64})(@(?P<place>[^\s@/]+))?")
_FORM = "an address like shm://bp2, zenoh://bp2@127.0.0.1:7447 or unitree://go2@enp2s0"


class BusError(SprintlabError):
    """The bus cannot be opened: nobody there, somebody else there, or a package is missing."""


class BusAddress(NamedTuple):
    """A parsed address.

    Attributes:
        carrier: ``"shm"``, ``"zenoh"`` or ``"unitree"``.
        name: of the robot.
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
    host = parsed.place.rpartition(":")[0].strip("[]") if parsed.carrier == "zenoh" else ""
    if parsed.carrier == "unitree":
        return parsed.place.partition(":")[0] not in ("", "lo")
    return bool(host) and host != "localhost" and not _is_loopback(host)


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def open_bus(
    address: str, *, session: int | None = None, config: str | os.PathLike[str] | None = None
) -> RobotInterface:
    """The controller's end of a bus.

    Args:
        address: of the robot.
        session: of the controller's commands: the robot's end takes no other; drawn at random when left out.
        config: a file in zenoh's format that says how both ends recognize each other.

    Raises:
        InvalidValueError: the address makes no sense.
        BusError: no robot is there, another controller has it, an end does not know the other, or a package
            is missing.
    """
    parsed = parse_address(address)
    chosen = new_session() if session is None else session
    return _carrier(parsed).open_interface(parsed, chosen, None if config is None else Path(config))


def open_endpoint(address: str, *, config: str | os.PathLike[str] | None = None) -> RobotEndpoint:
    """The robot's end of a bus; ``config`` as in ``open_bus``.

    Raises:
        InvalidValueError: the address makes no sense.
        BusError: another robot of this name runs, or a package is missing.
    """
    parsed = parse_address(address)
    return _carrier(parsed).open_endpoint(parsed, None if config is None else Path(config))


def _carrier(address: BusAddress) -> Any:
    """The module that speaks for a carrier; its package is imported only now."""
    try:
        return import_module(f"sprintlab.deployment.bus.{_CARRIERS[address.carrier]}")
    except ModuleNotFoundError as error:
        raise BusError(
            f"{address.carrier}:// needs the package {error.name}: pip install 'sprintlab[{address.carrier}]'"
        ) from error
