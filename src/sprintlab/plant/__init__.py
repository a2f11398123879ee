"""The simulated robot that evaluation measures and deployment drives: MuJoCo C, true motor limits."""

from sprintlab.plant.drive import PreparedDrive, SuppliedDrive, SupplyState
from sprintlab.plant.plant import BaseState, JointDrive, MotionRecorder, Plant, PlantOptions
from sprintlab.plant.settings import TrialSettings

__all__ = [
    "BaseState",
    "JointDrive",
    "MotionRecorder",
    "Plant",
    "PlantOptions",
    "PreparedDrive",
    "SuppliedDrive",
    "SupplyState",
    "TrialSettings",
]
