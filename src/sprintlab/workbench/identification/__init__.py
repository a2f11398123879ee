"""From bench measurements to motor parameters, with intervals, and with what the data cannot tell."""

from sprintlab.workbench.identification.bench import COLUMNS, Bench, load_bench
from sprintlab.workbench.identification.fit import identify
from sprintlab.workbench.identification.model import OPTIONAL_UNITS, PARAMETER_UNITS
from sprintlab.workbench.identification.results import ChannelFit, Estimate, Identification

__all__ = [
    "COLUMNS",
    "OPTIONAL_UNITS",
    "PARAMETER_UNITS",
    "Bench",
    "ChannelFit",
    "Estimate",
    "Identification",
    "identify",
    "load_bench",
]
