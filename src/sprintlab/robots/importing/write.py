"""``import_robot``: from a model file and a few choices to a robot's folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from sprintlab.core.errors import RobotModelError
from sprintlab.core.files import atomic_directory, atomic_write_json, atomic_write_text
from sprintlab.robots.description import RobotDescription
from sprintlab.robots.importing.checks import Check, run_checks
from sprintlab.robots.importing.choices import RobotChoices
from sprintlab.robots.importing.fit import FittedRobot, fit_robot
from sprintlab.robots.importing.source import read_source
from sprintlab.robots.importing.table import robot_table, table_text
from sprintlab.robots.loader import TABLE_FILE, load_robot_file
from sprintlab.robots.model import ModelOptions, build_model

MAP_FILE, TRAINING_FILE = "joints.json", "train.py"
_SWING_HEIGHT, _TOUCHDOWN_HEIGHT = 0.13, 0.035  # of the leg's length: what 8 cm and 2 cm are to BP2's 0.63 m
_LEG_GAP, _KNEE_GAP = 0.06, 0.08  # of the leg's length
_FROUDE_FIRST, _FROUDE_SECOND = 5.8, 31.0  # v^2 / (g l) of BP2's stages, 6 and 14 m/s


@dataclass(frozen=True, kw_only=True)
class ImportedRobot:
    """What an import made.

    Attributes:
        folder: with ``parameters.toml``, ``joints.json`` and ``train.py``.
        robot: as it is read back from there.
        checks: comparisons with the source.
    """

    folder: Path
    robot: RobotDescription
    checks: tuple[Check, ...]


def import_robot(source_file: Path, choices: RobotChoices, output: Path) -> ImportedRobot:
    """Write the folder of a robot from an MJCF or URDF; nothing is left behind if anything is refused.

    Args:
        source_file: MJCF or URDF.
        choices: what it does not say.
        output: folder in which the robot's folder is put.

    Raises:
        RobotModelError: the source is no quadruped with three hinges a leg, or the folder exists.
        SprintlabError: a motor cannot be found, or the files cannot be written.
    """
    folder = output / choices.name
    if folder.exists():
        raise RobotModelError(f"{folder} exists: choose another name, or remove it")
    source = read_source(source_file, choices.foot_radius)
    fitted = fit_robot(source)
    table = robot_table(fitted, choices, source_file.name)
    with atomic_directory(folder) as draft:
        atomic_write_text(draft / TABLE_FILE, table_text(choices.name, table, source_file.name))
        robot = load_robot_file(draft / TABLE_FILE)
        build_model(robot, ModelOptions(collisions="full"))
        maps: Mapping[str, object] = {name: asdict(item) for name, item in fitted.maps.items()}
        atomic_write_json(draft / MAP_FILE, maps)
        atomic_write_text(draft / TRAINING_FILE, training_text(choices.name, robot, fitted))
        checks = run_checks(source, fitted, choices, robot)
    return ImportedRobot(folder=folder, robot=robot, checks=checks)


def training_text(name: str, robot: RobotDescription, fitted: FittedRobot) -> str:
    """A training configuration in Python: BP2's, its lengths, speeds and masses scaled to the robot."""
    leg = fitted.thigh_length + fitted.shank_length
    first, second = ((froude * 9.81 * leg) ** 0.5 for froude in (_FROUDE_FIRST, _FROUDE_SECOND))
    payload = 0.04 * robot.total_mass
    return _TEMPLATE.format(
        name=name,
        swing=robot.foot_radius + _SWING_HEIGHT * leg,
        touchdown=robot.foot_radius + _TOUCHDOWN_HEIGHT * leg,
        leg_reward=1.6 * _LEG_GAP * leg,
        leg_end=0.8 * _LEG_GAP * leg,
        knee=_KNEE_GAP * leg,
        payload=payload,
        shift=0.03 * leg,
        first=first,
        second=second,
    )


_TEMPLATE = '''"""Train a sprint policy for {name}.

    pip install 'sprintlab[train]'
    python train.py --minutes 8 --output runs/{name}
    sprintlab race runs/{name}/policy.onnx

Lengths, speeds and masses are BP2's, scaled to this robot; every choice of a run can be set here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from sprintlab.api.training import run_script, train_settings
from sprintlab.training.settings import TrainingSettings

ROBOT = Path(__file__).resolve().parent


def settings() -> TrainingSettings:
    """The training settings of {name}."""
    base = TrainingSettings(robot=str(ROBOT / "parameters.toml"))
    rewards = replace(
        base.rewards,
        foot_clearance_target={swing:.3f},
        touchdown_height={touchdown:.3f},
        leg_distance_limit={leg_reward:.3f},
    )
    randomization = replace(
        base.randomization, payload=(-{payload:.2f}, {payload:.2f}), center_of_mass={shift:.3f}
    )
    episodes = replace(base.episodes, leg_distance_limit={leg_end:.3f}, knee_clearance={knee:.3f})
    stages = replace(base.stages, first_top={first:.1f}, second_top={second:.1f})
    return replace(base, rewards=rewards, randomization=randomization, episodes=episodes, stages=stages)


@dataclass(frozen=True, kw_only=True)
class Options:
    """How long to train, where, and with how many robots side by side."""

    output: Path = Path("runs/{name}")
    minutes: float = 8.0
    environments: int = 8192
    iterations: int = 3200
    device: str = "auto"
    seed: int = 0
    resume: bool = False


def main(options: Options) -> Path:
    """Train; returns the checkpoint.

    Raises:
        SprintlabError: the extra is not installed, or an option or the output folder is refused.
    """
    return train_settings(settings(), **vars(options))


if __name__ == "__main__":
    run_script(main, Options)
'''
