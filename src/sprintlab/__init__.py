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
    from sprintlab.api.actuators import Actuators, actuators
    from sprintlab.api.doctor import Examination, doctor
    from sprintlab.api.drive import DriveOptions
    from sprintlab.api.envelopes import Envelope, envelope
    from sprintlab.api.evaluations import Evaluation, evaluate
    from sprintlab.api.grounds import Grounds, ground
    from sprintlab.api.identification import IdentifiedMotor, identify_motor
    from sprintlab.api.learning import Learning, learning
    from sprintlab.api.limits import Limit, limit
    from sprintlab.api.live import play
    from sprintlab.api.motors import ChosenMotor, chosen_motor
    from sprintlab.api.policies import load_policy, policies
    from sprintlab.api.races import Race, race
    from sprintlab.api.replay import ReplayPage, replay
    from sprintlab.api.robot_runs import DrivenRun, RobotRun
    from sprintlab.api.robot_simulations import RobotSimulation, SimulatedRun
    from sprintlab.api.robustness import Robustness, robustness
    from sprintlab.api.rollouts import AuditedRollout, audit_rollout
    from sprintlab.api.run_reports import RunReport, report_run
    from sprintlab.api.search import SearchOptions
    from sprintlab.api.steering import Lap, Turning, lap, turning
    from sprintlab.api.training import Training, export, method, train
    from sprintlab.core.errors import SprintlabError
    from sprintlab.motors import torque_limits
    from sprintlab.robots import load_robot, robot_names
    from sprintlab.training.settings import TrainingSettings

__version__ = "0.1.0"

__all__ = [
    "Actuators",
    "AuditedRollout",
    "ChosenMotor",
    "DriveOptions",
    "DrivenRun",
    "Envelope",
    "Evaluation",
    "Examination",
    "Grounds",
    "IdentifiedMotor",
    "Lap",
    "Learning",
    "Limit",
    "Race",
    "ReplayPage",
    "RobotRun",
    "RobotSimulation",
    "Robustness",
    "RunReport",
    "SearchOptions",
    "SimulatedRun",
    "SprintlabError",
    "Training",
    "TrainingSettings",
    "Turning",
    "actuators",
    "audit_rollout",
    "chosen_motor",
    "doctor",
    "envelope",
    "evaluate",
    "export",
    "ground",
    "identify_motor",
    "lap",
    "learning",
    "limit",
    "load_policy",
    "load_robot",
    "method",
    "play",
    "policies",
    "race",
    "replay",
    "report_run",
    "robot_names",
    "robustness",
    "torque_limits",
    "train",
    "turning",
]

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
        "training.settings": "TrainingSettings",
    }.items()
    for name in names.split()
}
"""Where each public name lives, below this package."""


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
