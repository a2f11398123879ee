"""The simulated robot that evaluation measures and deployment drives: MuJoCo C, true motor limits."""

from sprintlab.plant.drive import SuppliedDrive as SuppliedDrive
from sprintlab.plant.engines import DRAKE_TIMESTEP as DRAKE_TIMESTEP
from sprintlab.plant.engines import check_engine as check_engine
from sprintlab.plant.engines import on_engine as on_engine
from sprintlab.plant.engines import open_plant as open_plant
from sprintlab.plant.ground import Ground as Ground
from sprintlab.plant.ground import RoughGround as RoughGround
from sprintlab.plant.pad import STANCE_FORCE as STANCE_FORCE
from sprintlab.plant.pad import PadLaw as PadLaw
from sprintlab.plant.pad import Pads as Pads
from sprintlab.plant.plant import BaseState as BaseState
from sprintlab.plant.plant import MotionRecorder as MotionRecorder
from sprintlab.plant.plant import Plant as Plant
from sprintlab.plant.settings import ENGINES as ENGINES
from sprintlab.plant.settings import JOINT_NOISE as JOINT_NOISE
from sprintlab.plant.settings import NOMINAL_TRIAL as NOMINAL_TRIAL
from sprintlab.plant.settings import PlantOptions as PlantOptions
from sprintlab.plant.settings import TrialSettings as TrialSettings
