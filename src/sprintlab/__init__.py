"""How fast can a legged robot run before its motors, not its controller, stop it?

    import sprintlab as sl

    if __name__ == "__main__":
        run = sl.train(sl.method("sprint", environments=4096), "runs/mine")
        race = sl.race(run.policy)
        print(race)
        race.report("runs/mine-race")

Importing this loads nothing else: each name below is looked up when it is first used.
"""

from __future__ import annotations

TYPE_CHECKING = False  # as type checkers know it; typing itself takes longer to import than all of this
if TYPE_CHECKING:
    from sprintlab.api.actuators import Actuators as Actuators
    from sprintlab.api.actuators import actuators as actuators
    from sprintlab.api.doctor import Examination as Examination
    from sprintlab.api.doctor import doctor as doctor
    from sprintlab.api.drive import DriveOptions as DriveOptions
    from sprintlab.api.envelopes import Envelope as Envelope
    from sprintlab.api.envelopes import envelope as envelope
    from sprintlab.api.evaluations import Evaluation as Evaluation
    from sprintlab.api.evaluations import evaluate as evaluate
    from sprintlab.api.grounds import Grounds as Grounds
    from sprintlab.api.grounds import ground as ground
    from sprintlab.api.identification import IdentifiedMotor as IdentifiedMotor
    from sprintlab.api.identification import identify_motor as identify_motor
    from sprintlab.api.importing import RobotImport as RobotImport
    from sprintlab.api.importing import import_robot as import_robot
    from sprintlab.api.learning import Learning as Learning
    from sprintlab.api.learning import learning as learning
    from sprintlab.api.limits import Limit as Limit
    from sprintlab.api.limits import limit as limit
    from sprintlab.api.live import play as play
    from sprintlab.api.motors import ChosenMotor as ChosenMotor
    from sprintlab.api.motors import chosen_motor as chosen_motor
    from sprintlab.api.policies import load_policy as load_policy
    from sprintlab.api.policies import policies as policies
    from sprintlab.api.races import Race as Race
    from sprintlab.api.races import race as race
    from sprintlab.api.replay import ReplayPage as ReplayPage
    from sprintlab.api.replay import replay as replay
    from sprintlab.api.robot_runs import DrivenRun as DrivenRun
    from sprintlab.api.robot_runs import RobotRun as RobotRun
    from sprintlab.api.robot_simulations import RobotSimulation as RobotSimulation
    from sprintlab.api.robot_simulations import SimulatedRun as SimulatedRun
    from sprintlab.api.robustness import Robustness as Robustness
    from sprintlab.api.robustness import robustness as robustness
    from sprintlab.api.rollouts import AuditedRollout as AuditedRollout
    from sprintlab.api.rollouts import audit_rollout as audit_rollout
    from sprintlab.api.run_reports import RunReport as RunReport
    from sprintlab.api.run_reports import report_run as report_run
    from sprintlab.api.search import SearchOptions as SearchOptions
    from sprintlab.api.steering import Lap as Lap
    from sprintlab.api.steering import Turning as Turning
    from sprintlab.api.steering import lap as lap
    from sprintlab.api.steering import turning as turning
    from sprintlab.api.training import Training as Training
    from sprintlab.api.training import export as export
    from sprintlab.api.training import method as method
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
        "api.actuators": "Actuators actuators",
        "api.doctor": "Examination doctor",
        "api.drive": "DriveOptions",
        "api.envelopes": "Envelope envelope",
        "api.evaluations": "Evaluation evaluate",
        "api.grounds": "Grounds ground",
        "api.identification": "IdentifiedMotor identify_motor",
        "api.importing": "RobotImport import_robot",
        "api.learning": "Learning learning",
        "api.limits": "Limit limit",
        "api.live": "play",
        "api.motors": "ChosenMotor chosen_motor",
        "api.policies": "load_policy policies",
        "api.races": "Race race",
        "api.replay": "ReplayPage replay",
        "api.robot_runs": "DrivenRun RobotRun",
        "api.robot_simulations": "RobotSimulation SimulatedRun",
        "api.robustness": "Robustness robustness",
        "api.rollouts": "AuditedRollout audit_rollout",
        "api.run_reports": "RunReport report_run",
        "api.search": "SearchOptions",
        "api.steering": "Lap Turning lap turning",
        "api.training": "Training export method train",
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
