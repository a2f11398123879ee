"""From bench measurements to motor parameters, with intervals, and with what the data cannot tell."""

from sprintlab.motors.identification.bench import COLUMNS, Bench, load_bench
from sprintlab.motors.identification.fit import identify
from sprintlab.motors.identification.model import PARAMETER_UNITS
from sprintlab.motors.identification.results import ChannelFit, Estimate, Identification

__all__ = [
    "COLUMNS",
    "PARAMETER_UNITS",
    "Bench",
    "ChannelFit",
    "Estimate",
    "Identification",
    "identify",
    "load_bench",
]
