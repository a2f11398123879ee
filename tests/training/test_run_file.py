"""``run.toml``: what a run writes is read back as the same run; mistakes are refused by name."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("torch")

from sprintlab.cli.train import parse_training
from sprintlab.commands import AdaptiveSchedule, UniformSchedule
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.motors import HousedHeat, WindingHeat
from sprintlab.training.methods import ALL_METHODS, METHODS
from sprintlab.training.runs.options import TrainOptions
from sprintlab.training.runs.run_file import read_run_file, resumed_text, run_text
from sprintlab.training.settings import PpoSettings, SimulationSettings, StageSettings, TrainingSettings

CHANGED = TrainingSettings(
    robot="go1",
    heading_hold=False,
    simulation=SimulationSettings(heat=WindingHeat(heat_capacity=200.0)),
    stages=StageSettings(record_margin=None),
    ppo=PpoSettings(hidden=(64, 32), std_anneal=(0.1, 0.2), precision="tf32"),
)
OWN_SCHEDULE = replace(CHANGED, schedule=AdaptiveSchedule(window=0.7), actuator_model="square")


WITHOUT_FILES = [name for name, method in ALL_METHODS.items() if not method.prior]


def written(folder: Path, options: TrainOptions) -> Path:
    path = folder / "run.toml"
    path.write_text(run_text(options, options.full_settings(), "sprintlab train"), encoding="utf-8")
    return path


def written_text(folder: Path, text: str) -> Path:
    path = folder / "run.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "options",
    [
        *(TrainOptions(method=method, seed=3, environments=64) for method in WITHOUT_FILES),
        TrainOptions(robot="go1", preset="paper"),
        TrainOptions(robot="go1", settings=OWN_SCHEDULE, keep_schedule=True),
        TrainOptions(preset="paper", minutes=3.5, milestones=30.0),
        TrainOptions(settings=CHANGED, wandb="speed"),
        TrainOptions(settings=OWN_SCHEDULE, keep_schedule=True, keep_motor_model=True),
        TrainOptions(settings=replace(CHANGED, schedule=UniformSchedule()), keep_schedule=True),
    ],
)
def test_what_is_written_is_read_back_as_the_same_run(tmp_path: Path, options: TrainOptions) -> None:
    again = read_run_file(written(tmp_path, options))
    assert again.full_settings() == options.full_settings()
    assert again.full_settings().digest() == options.full_settings().digest()
    settings = options.full_settings()
    kept = replace(
        options,
        settings=settings,
        preset="sprintlab",
        robot=None,
        wandb=None,
        environments=settings.simulation.environments,
    )
    unused = {"keep_schedule": again.keep_schedule, "keep_motor_model": again.keep_motor_model}
    assert replace(again, settings=settings) == replace(kept, **unused)
    assert read_run_file(written(tmp_path, again)).full_settings() == settings


def test_a_run_that_is_taken_up_keeps_what_it_began_with(tmp_path: Path) -> None:
    begun = written(tmp_path, TrainOptions(seed=3, minutes=8.0, milestones=30.0, iterations=1600)).read_text()
    same = TrainOptions(resume=True, minutes=8.0, milestones=30.0, iterations=1600)
    assert resumed_text(begun, same, 7, "typed") == begun
    longer = resumed_text(begun, replace(same, iterations=2000), 7, "sprintlab train\x1b --resume")
    assert longer.startswith(begun.rstrip()) and "at iteration 7" in longer
    assert "# typed: sprintlab train\\x1b --resume\n# changed: iterations = 2000\n" in longer
    back = resumed_text(longer, same, 9, "typed")
    assert back.startswith(longer.rstrip()) and back.endswith("# changed: iterations = 1600\n")
    options = read_run_file(written_text(tmp_path, back))
    assert (options.iterations, options.minutes, options.seed) == (1600, 8.0, 3)


def test_a_command_line_breaks_no_run_file(tmp_path: Path) -> None:
    """That of a checkpoint is a stranger's."""
    typed = "sprintlab\x1b[2J\x00 " + "train " * 2000
    path = written_text(tmp_path, run_text(TrainOptions(), TrainOptions().full_settings(), typed))
    assert read_run_file(path).full_settings() == TrainOptions().full_settings()


def test_what_is_typed_beside_a_file_wins_and_the_names_are_the_same(tmp_path: Path) -> None:
    text = 'method = "baseline"\nseed = 4\nrobot = "go1"\n[ppo]\nsteps = 16\nlearning_rate = 1\n'
    path = written_text(tmp_path, text)
    options = parse_training(["--config", str(path)])
    settings = options.full_settings()
    assert (settings.method, settings.seed, settings.robot) == ("baseline", 4, "go1")
    assert settings.stages.first_top < TrainingSettings().stages.first_top  # scaled to the robot
    assert (settings.ppo.steps, settings.ppo.learning_rate, settings.ppo.epochs) == (16, 1.0, 4)
    typed = parse_training(["sprint", f"--config={path}", "--ppo.steps", "4", "--stages.growth", "0.2"])
    settings = typed.full_settings()
    assert (settings.method, settings.seed, settings.stages.growth) == ("sprint", 4, 0.2)
    assert (settings.ppo.steps, settings.ppo.learning_rate) == (4, 1.0)


def test_a_part_of_several_kinds_is_chosen_in_file_and_command_line_alike(tmp_path: Path) -> None:
    path = written_text(
        tmp_path,
        'keep_schedule = true\n[schedule]\nkind = "fixed-acceleration-schedule"\n[simulation.heat]\n',
    )
    in_file = parse_training(["--config", str(path)]).full_settings()
    words = ["--keep-schedule", "schedule:fixed-acceleration-schedule", "simulation.heat:winding-heat"]
    assert in_file == parse_training(words).full_settings()
    assert in_file.simulation.heat == WindingHeat()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "[ppo]\nstepps = 3",
            "ppo.stepps = 3 is not allowed: there is no such setting, did you mean ppo.steps?",
        ),
        ("enviroments = 3", "did you mean environments?"),
        ("banana = 3", "choose among method, robot, preset"),
        ("[ppo]\nsteps = 1.5", "ppo.steps = 1.5 is not allowed: must be a whole number"),
        ("[ppo]\nsteps = true", "ppo.steps = True is not allowed: must be a whole number"),
        ("[ppo]\nsteps = 0", "ppo.steps = 0 is not allowed: must lie in [1, 10000]"),
        ('[ppo]\nprecision = "fp8"', "ppo.precision = 'fp8' is not allowed: choose one of tf32, bfloat16"),
        ("ppo = 3", "ppo = 3 is not allowed: must be a table of steps"),
        (
            "[randomization]\nfriction = [0.5]",
            "randomization.friction = [0.5] is not allowed: must be a list of 2",
        ),
        ("[simulation.heat]\nheat_capacity = -1.0", "simulation.heat.heat_capacity = -1.0 is not allowed"),
        ("[simulation]\nenvironments = 3", "write environments at the top"),
        (
            '[schedule]\nkind = "slow"',
            "schedule.kind = 'slow' is not allowed: choose one of adaptive-schedule",
        ),
        ("[schedule]\nkind = [1, 2]", "schedule.kind = [1, 2] is not allowed: choose one of"),
        ("[schedule]\nkind = {}", "schedule.kind = {} is not allowed: choose one of"),
        ("[schedule]\nwindow = 0.5", "write keep_schedule = true"),
        ('actuator_model = "square"', "write keep_motor_model = true"),
        ("seed = -1", "seed = -1 is not allowed"),
        ("milestones = 1", "milestones = 1.0 is not allowed: 60 minutes may keep 1000 policies"),
        ("minutes = 1e9\niterations = 30000\nmilestones = 1e6", "minutes may keep 1000 policies"),
        ('method = "gallop"', "method = 'gallop' is not allowed: choose one of baseline"),
        ("resume = true", "must be typed: --resume"),
        ('output = "/etc/cron.d"', "must be typed: --output FOLDER"),
        ('output = "../../.ssh"', "must be typed: --output FOLDER"),
        ('wandb = "a-strangers/project"', "must be typed: --wandb PROJECT"),
        ("[settings.ppo]\nsteps = 3", "its parts stand in the file themselves"),
    ],
)
def test_a_file_is_refused_by_field_value_and_what_is_allowed(tmp_path: Path, text: str, words: str) -> None:
    path = written_text(tmp_path, text + "\n")
    with pytest.raises(InvalidValueError) as refusal:
        parse_training(["--config", str(path)])
    assert words in str(refusal.value) and str(path) in str(refusal.value)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--config"], "--config takes one file"),
        (["--config="], "--config takes one file"),
        (["--config", "a.toml", "--config", "b.toml"], "--config takes one file"),
        (["--config", "nowhere.toml"], "cannot read run file nowhere.toml"),
    ],
)
def test_a_missing_file_is_refused(words: list[str], message: str) -> None:
    with pytest.raises(SprintlabError, match=message):
        parse_training(words)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["sprint", "schedule:uniform-schedule"], "--keep-schedule keeps yours"),
        (["sprint", "schedule:adaptive-schedule", "--schedule.window", "2"], "method sprint decides it"),
        (["sprint", "--actuator-model", "square"], "--keep-motor-model keeps yours"),
    ],
)
def test_what_the_method_would_replace_is_refused_where_it_is_typed(words: list[str], named: str) -> None:
    with pytest.raises(InvalidValueError, match=named):
        parse_training(words)
    kept = parse_training([words[0], "--keep-schedule", "--keep-motor-model", *words[1:]])
    assert kept.full_settings().schedule == kept.settings.schedule


def test_a_schedule_that_is_kept_begins_with_that_of_the_methods(tmp_path: Path) -> None:
    """What a file does not name was zero for two rounds of trainings: no ramps, nobody asked backward."""
    for head in ("", 'kind = "adaptive-schedule"\n'):
        path = written_text(tmp_path, f"keep_schedule = true\n[schedule]\n{head}keeps_rest = true\n")
        kept = parse_training(["--config", str(path)]).full_settings().schedule
        assert kept == replace(METHODS["sprint"].schedule, keeps_rest=True)
        path.unlink()


def test_a_file_that_is_not_toml_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SprintlabError, match="is not a TOML file"):
        parse_training(["--config", str(written_text(tmp_path, "method: sprint\n"))])


def test_the_example_of_the_page_is_read(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "train.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```toml\n(method = .*?)^```", page, re.MULTILINE | re.DOTALL)
    settings = read_run_file(written_text(tmp_path, block)).full_settings()
    assert (settings.robot, settings.ppo.precision) == ("go1", "tf32")


def test_the_training_world_knows_one_thermal_node():
    heat = HousedHeat(housing_heat_capacity=80.0, housing_thermal_resistance=1.5)
    with pytest.raises(InvalidValueError, match="heat = 'with a housing'"):
        SimulationSettings(heat=heat)
