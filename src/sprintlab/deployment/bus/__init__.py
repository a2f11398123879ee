"""Ways to carry messages between a controller and a robot: shared memory, zenoh, Unitree's DDS messages."""

from sprintlab.deployment.bus.address import (
    BusAddress,
    BusError,
    leaves_this_machine,
    open_bus,
    open_endpoint,
    parse_address,
)

__all__ = ["BusAddress", "BusError", "leaves_this_machine", "open_bus", "open_endpoint", "parse_address"]
