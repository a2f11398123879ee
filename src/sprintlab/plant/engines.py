"""The physics engines that a plant can stand on, and the choice among them."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec

from sprintlab.core.errors import SprintlabError
from sprintlab.plant.plant import Plant
from sprintlab.plant.settings import PlantOptions, TrialSettings
from sprintlab.robots import RobotDescription

DRAKE_TIMESTEP = 0.0005
"""Time step of the second engine [s]."""


def open_plant(robot: RobotDescription, options: PlantOptions, settings: TrialSettings) -> Plant:
    """A robot on the engine that the options name.

    Raises:
        SprintlabError: the engine is not installed.
        RobotModelError: the robot's model does not compile.
    """
    if options.engine == "mujoco":
        return Plant(robot, options, settings)
    check_engine(options.engine)
    from sprintlab.plant.drake.engine import DrakePlant

    return DrakePlant(robot, options, settings)


def on_engine(options: PlantOptions, engine: str) -> PlantOptions:
    """The same plant on another engine, with that engine's time step.

    Raises:
        InvalidValueError: there is no such engine.
        SprintlabError: the engine is not installed.
    """
    chosen = replace(options, engine=engine)
    if engine != "drake":
        return chosen
    check_engine(engine)
    return replace(chosen, timestep=DRAKE_TIMESTEP, contact_time_constant=2.0 * DRAKE_TIMESTEP)


def check_engine(engine: str) -> None:
    """Refuse an engine that is not installed.

    Raises:
        SprintlabError: the message says how to install it.
    """
    if engine != "drake" or find_spec("pydrake") is not None:
        return
    raise SprintlabError(
        "the second engine needs the package drake, for Linux and macOS: pip install 'sprintlab[drake]'"
    )
