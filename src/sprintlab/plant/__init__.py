"""The simulated robot that evaluation measures and deployment drives: MuJoCo C, true motor limits."""

from sprintlab.plant.drive import PreparedDrive, SuppliedDrive, SupplyState
from sprintlab.plant.engines import DRAKE_TIMESTEP, check_engine, on_engine, open_plant
from sprintlab.plant.ground import Ground, RoughGround
from sprintlab.plant.plant import (
    ENGINES,
    BaseState,
    BlindRecorder,
    JointDrive,
    MotionRecorder,
    Plant,
    PlantOptions,
    foot_table,
)
from sprintlab.plant.settings import TrialSettings

__all__ = [
    "DRAKE_TIMESTEP",
    "ENGINES",
    "BaseState",
    "BlindRecorder",
    "Ground",
    "JointDrive",
    "MotionRecorder",
    "Plant",
    "PlantOptions",
    "PreparedDrive",
    "RoughGround",
    "SuppliedDrive",
    "SupplyState",
    "TrialSettings",
    "check_engine",
    "foot_table",
    "on_engine",
    "open_plant",
]
