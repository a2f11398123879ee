"""Ways to carry messages between a controller and a robot: shared memory, zenoh, DDS."""

from sprintlab.deployment.bus.address import BusAddress, BusError, open_bus, open_endpoint, parse_address

__all__ = ["BusAddress", "BusError", "open_bus", "open_endpoint", "parse_address"]
