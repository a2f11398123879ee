"""How fast can a legged robot run before its motors, not its controller, stop it?

    import sprintlab as sl

    if __name__ == "__main__":
        run = sl.train(sl.method("acs", environments=4096), output="runs/mine")
        race = sl.race(run.policy)
        print(race)
        race.report("runs/mine-race")

Importing this loads nothing else: each name below is looked up when it is first used.
"""

from __future__ import annotations

TYPE_CHECKING = False  # as type checkers know it; typing itself takes longer to import than all of this
if TYPE_CHECKING:
    from sprintlab.api.design import design as design
    from sprintlab.api.doctor import doctor as doctor
    from sprintlab.api.drive import DriveOptions as DriveOptions
    from sprintlab.api.evaluations import evaluate as evaluate
    from sprintlab.api.limits import audit_rollout as audit_rollout
    from sprintlab.api.limits import limit as limit
    from sprintlab.api.motors import actuators as actuators
    from sprintlab.api.motors import envelope as envelope
    from sprintlab.api.motors import identify_motor as identify_motor
    from sprintlab.api.motors import motor_from_datasheet as motor_from_datasheet
    from sprintlab.api.motors import show_motor as show_motor
    from sprintlab.api.perturbations import ground as ground
    from sprintlab.api.perturbations import lap as lap
    from sprintlab.api.perturbations import robustness as robustness
    from sprintlab.api.perturbations import turning as turning
    from sprintlab.api.policies import load_policy as load_policy
    from sprintlab.api.policies import policies as policies
    from sprintlab.api.races import Race as Race
    from sprintlab.api.races import race as race
    from sprintlab.api.replays import play as play
    from sprintlab.api.replays import replay as replay
    from sprintlab.api.reports import report as report
    from sprintlab.api.results import Drawn as Drawn
    from sprintlab.api.results import Result as Result
    from sprintlab.api.robot_bus import robot_sim as robot_sim
    from sprintlab.api.robot_bus import run as run
    from sprintlab.api.robots import import_robot as import_robot
    from sprintlab.api.robots import list_robots as list_robots
    from sprintlab.api.robots import show_robot as show_robot
    from sprintlab.api.training import Training as Training
    from sprintlab.api.training import export as export
    from sprintlab.api.training import method as method
    from sprintlab.api.training import sweep as sweep
    from sprintlab.api.training import train as train
    from sprintlab.core.errors import SprintlabError as SprintlabError
    from sprintlab.motors import torque_limits as torque_limits
    from sprintlab.robots import load_robot as load_robot
    from sprintlab.robots import robot_names as robot_names
    from sprintlab.robots.importing import JointChoice as JointChoice
    from sprintlab.robots.importing import RobotChoices as RobotChoices
    from sprintlab.training.settings import TrainingSettings as TrainingSettings

__version__ = "0.1.0"

_HOMES = {
    name: home
    for home, names in {
        "api.design": "design",
        "api.doctor": "doctor",
        "api.drive": "DriveOptions",
        "api.evaluations": "evaluate",
        "api.limits": "audit_rollout limit",
        "api.motors": "actuators envelope identify_motor motor_from_datasheet show_motor",
        "api.perturbations": "ground lap robustness turning",
        "api.policies": "load_policy policies",
        "api.races": "Race race",
        "api.replays": "play replay",
        "api.reports": "report",
        "api.results": "Drawn Result",
        "api.robot_bus": "robot_sim run",
        "api.robots": "import_robot list_robots show_robot",
        "api.training": "Training export method sweep train",
        "core.errors": "SprintlabError",
        "motors": "torque_limits",
        "robots": "load_robot robot_names",
        "robots.importing": "JointChoice RobotChoices",
        "training.settings": "TrainingSettings",
    }.items()
    for name in names.split()
}
"""Where each public name lives, below this package."""
__all__ = sorted(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll] (checkers take the names above)


def __getattr__(name: str) -> object:
    """Import a public name when it is first used, and keep it."""
    from importlib import import_module

    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Public names, for completion."""
    return sorted({*globals(), *__all__})
