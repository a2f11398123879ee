"""Where a robot is reached: one address, the same for the controller's end and the robot's end.

``shm://NAME`` is shared memory of this machine, ``unitree://NAME[@INTERFACE[:DOMAIN]]`` Unitree's messages
over DDS, in whose network everybody can drive the robot.
"""

from __future__ import annotations

import re
import secrets
from typing import TYPE_CHECKING, Any, NamedTuple

from sprintlab.core.checks import check_choice
from sprintlab.core.errors import InvalidValueError
from sprintlab.core.extras import require_package

if TYPE_CHECKING:
    from sprintlab.deployment.transports.ends import ControllerEnd, RobotEnd

_ADDRESS = re.compile(r"(?P<carrier>[a-z]+)://(?P<name>[A-Za-z0-9_-]{1,64})(@(?P<place>[^\s@/]+))?")


class BusAddress(NamedTuple):
    """A parsed address: ``"shm"`` or ``"unitree"``, the robot's name, and what follows ``@``."""

    carrier: str
    name: str
    place: str


def parse_address(address: str) -> BusAddress:
    """Take an address apart; raises ``InvalidValueError`` where it is not one."""
    match = _ADDRESS.fullmatch(address)
    if match is None:
        raise InvalidValueError("bus", address, "an address like shm://bp2 or unitree://go2@enp2s0")
    check_choice("bus carrier", match["carrier"], ("shm", "unitree"))
    return BusAddress(match["carrier"], match["name"], match["place"] or "")


def leaves_this_machine(address: str) -> bool:
    """Whether a robot at this address may be anything but a simulation on this machine."""
    parsed = parse_address(address)
    return parsed.carrier == "unitree" and parsed.place.partition(":")[0] not in ("", "lo")


def open_bus(address: str, *, session: int | None = None) -> ControllerEnd:
    """The controller's end of a bus, whose commands carry ``session``, by itself a random number.

    Raises ``SprintlabError`` where no robot is, another controller drives it, or a package is missing.
    """
    parsed = parse_address(address)
    return _transport(parsed).controller_end(parsed, session or new_session())


def open_endpoint(address: str) -> RobotEnd:
    """The robot's end of a bus; raises as ``open_bus``, and where another robot of this name runs."""
    parsed = parse_address(address)
    return _transport(parsed).robot_end(parsed)


def new_session() -> int:
    """A random number that tells one controller from every other, 1 to 2**64 - 1."""
    return secrets.randbelow(2**64 - 1) + 1


def _transport(address: BusAddress) -> Any:
    """The module that makes both ends."""
    if address.carrier == "unitree":
        require_package("cyclonedds", extra="unitree", use="unitree://")
        from sprintlab.deployment.transports import unitree_dds

        return unitree_dds
    from sprintlab.deployment.transports import shared_memory

    return shared_memory
