"""Ways to carry messages between a controller and a robot: shared memory, Unitree's DDS messages."""

from sprintlab.deployment.transports.address import leaves_this_machine as leaves_this_machine
from sprintlab.deployment.transports.address import open_bus as open_bus
from sprintlab.deployment.transports.address import open_endpoint as open_endpoint
from sprintlab.deployment.transports.address import parse_address as parse_address
