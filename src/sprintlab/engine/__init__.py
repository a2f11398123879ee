"""Physics of a training: the policy step of all robots as one generated kernel."""

from sprintlab.engine.engine import Engine as Engine
from sprintlab.engine.options import EngineOptions as EngineOptions
from sprintlab.engine.source import PAIRS as PAIRS
