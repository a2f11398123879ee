"""From bench measurements to motor parameters, with intervals, and with what the data cannot tell."""

from sprintlab.workbench.identification.bench import Bench as Bench
from sprintlab.workbench.identification.bench import behind_gear as behind_gear
from sprintlab.workbench.identification.bench import load_bench as load_bench
from sprintlab.workbench.identification.fit import identify as identify
from sprintlab.workbench.identification.model import OPTIONAL_UNITS as OPTIONAL_UNITS
from sprintlab.workbench.identification.model import PARAMETER_UNITS as PARAMETER_UNITS
from sprintlab.workbench.identification.results import ChannelFit as ChannelFit
from sprintlab.workbench.identification.results import Identification as Identification
from sprintlab.workbench.identification.transients import is_log as is_log
from sprintlab.workbench.identification.transients import rested as rested
