"""From bench measurements to motor parameters, with intervals, and with what the data cannot tell."""

from sprintlab.workbench.identification.bench import COLUMNS, Bench, behind_gear, load_bench
from sprintlab.workbench.identification.fit import identify
from sprintlab.workbench.identification.model import OPTIONAL_UNITS, PARAMETER_UNITS
from sprintlab.workbench.identification.results import ChannelFit, Estimate, Identification
from sprintlab.workbench.identification.transients import WINDOW, is_log, rested

__all__ = [
    "COLUMNS",
    "OPTIONAL_UNITS",
    "PARAMETER_UNITS",
    "WINDOW",
    "Bench",
    "ChannelFit",
    "Estimate",
    "Identification",
    "behind_gear",
    "identify",
    "is_log",
    "load_bench",
    "rested",
]
