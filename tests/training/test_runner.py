"""Iterations, checkpoints and the way from a checkpoint to a policy file, on the CPU."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco_warp")
pytest.importorskip("rsl_rl")

import torch

from sprintlab.api.training import ScriptOptions
from sprintlab.cli.sweep import Sweep
from sprintlab.control import check_contract, load_policy
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.robots import load_robot
from sprintlab.training.runs.checkpoint import read_checkpoint, write_checkpoint
from sprintlab.training.runs.export import export_checkpoint
from sprintlab.training.runs.run import TrainOptions, keep_milestone, train
from sprintlab.training.runs.run_file import read_run_file
from sprintlab.training.runs.runner import Runner
from sprintlab.training.settings import PpoSettings, RewardWeight, SimulationSettings, TrainingSettings

SETTINGS = TrainingSettings(
    simulation=SimulationSettings(environments=16),
    ppo=PpoSettings(steps=4, epochs=1, mini_batches=2, hidden=(32, 16)),
)


@pytest.fixture(scope="module")
def runner() -> Runner:
    """Two iterations, then a curriculum that no fresh run has."""
    runner = Runner(SETTINGS, "cpu", "sprintlab train --method sprint")
    runner.iterate()
    runner.iterate()
    runner.growth.upper = 3.7
    return runner


@pytest.fixture(scope="module")
def checkpoint(runner: Runner, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "checkpoint.pt"
    runner.save(path)
    return path


def test_two_iterations_are_counted_and_finite(runner: Runner) -> None:
    assert runner.progress.iteration == 2
    assert runner.progress.environment_steps == 2 * 4 * 16
    assert len(runner.progress.log) == 2
    assert all(np.isfinite(value) for row in runner.progress.log for value in row.values())


def test_resume_goes_on_with_count_curriculum_and_networks(runner: Runner, checkpoint: Path) -> None:
    resumed = Runner(SETTINGS, "cpu", "sprintlab train --resume")
    resumed.load(read_checkpoint(checkpoint))
    assert resumed.growth.upper == 3.7
    assert float(resumed.environment.upper) == pytest.approx(3.7)
    saved, loaded = runner.learner.state_dict(), resumed.learner.state_dict()
    for name, weight in saved["actor"].items():
        assert torch.equal(weight, loaded["actor"][name]), name
    row = resumed.iterate()
    assert row["iteration"] == 3
    assert row["range_upper"] >= 3.7


def test_a_resumed_run_is_the_run_that_never_stopped(tmp_path: Path) -> None:
    straight = Runner(SETTINGS, "cpu", "one")
    straight.iterate()
    straight.save(tmp_path / "checkpoint.pt")
    straight.iterate()
    resumed = Runner(SETTINGS, "cpu", "two")
    resumed.load(read_checkpoint(tmp_path / "checkpoint.pt"))
    resumed.iterate()
    for name, value in straight.environment.state().items():
        assert torch.equal(value, resumed.environment.state()[name]), name
    for name, value in straight.learner._networks().items():
        assert torch.equal(value, resumed.learner._networks()[name]), name
    timing = {"seconds", "steps_per_second"}
    kept = [{k: v for k, v in run.progress.log[-1].items() if k not in timing} for run in (straight, resumed)]
    assert kept[0] == kept[1]


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_truncated_checkpoint_is_refused_in_one_sentence(
    checkpoint: Path, tmp_path: Path, share: float
) -> None:
    data = checkpoint.read_bytes()
    broken = tmp_path / "broken.pt"
    broken.write_bytes(data[: int(share * len(data))])
    with pytest.raises(SprintlabError, match=r"broken\.pt") as refusal:
        read_checkpoint(broken)
    assert "\n" not in str(refusal.value)


def test_a_missing_or_foreign_checkpoint_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SprintlabError, match="no such file"):
        read_checkpoint(tmp_path / "nothing.pt")
    torch.save({"weights": torch.zeros(3)}, tmp_path / "foreign.pt")
    with pytest.raises(SprintlabError, match="no sprintlab checkpoint"):
        read_checkpoint(tmp_path / "foreign.pt")


def forged_settings(**parts: object) -> TrainingSettings:
    """Settings that refuse these parts when they are made."""
    settings = copy.copy(SETTINGS)
    for name, part in parts.items():
        object.__setattr__(settings, name, part)
    return settings


@pytest.mark.parametrize("forged", ["weight", "observation", "generator"])
def test_a_forged_checkpoint_cannot_be_gone_on_from(checkpoint: Path, tmp_path: Path, forged: str) -> None:
    """Its checksum fits: what its values bring about is told in one sentence."""
    state = read_checkpoint(checkpoint)
    if forged == "weight":
        weight: Any = "x"
        rewards = replace(SETTINGS.rewards, abduction_mirror=RewardWeight(first=-1.0, second=weight))
        state["settings"] = forged_settings(rewards=rewards)
    elif forged == "observation":
        state["settings"] = forged_settings(observation=(1, 2, 3))
    else:
        kind, (first, *rest), more = state["generators"]["python"]
        state["generators"]["python"] = (kind, (-first - 1, *rest), more)
    write_checkpoint(state, tmp_path / "checkpoint.pt")
    with pytest.raises(SprintlabError, match=r"no usable checkpoint|does not fit") as refusal:
        train(TrainOptions(output=tmp_path, device="cpu", resume=True))
    assert "\n" not in str(refusal.value)


def test_an_export_is_a_policy_for_this_robot(checkpoint: Path, tmp_path: Path) -> None:
    policy = load_policy(export_checkpoint(checkpoint, tmp_path / "policy.onnx").path)
    check_contract(policy.contract, load_robot("bp2"))
    assert policy.contract.training.iterations == 2
    assert policy.contract.training.config_hash == SETTINGS.digest()
    actions = policy.infer(np.zeros((3, 450), dtype=np.float32))
    assert actions.shape == (3, 12)
    assert np.isfinite(actions).all()


def test_milestones_are_policies_on_the_way(tmp_path: Path) -> None:
    """One file at each multiple of the interval; it exports, and cannot be resumed."""
    options = TrainOptions(
        output=tmp_path, iterations=3, environments=16, device="cpu", tensorboard=False, milestones=1.0,
        settings=SETTINGS,
    )  # fmt: skip
    runner = Runner(options.full_settings(), "cpu", "test")
    kept = tmp_path / "milestones"
    for before, after, expected in ((0.0, 0.9, []), (0.9, 2.3, ["0002.pt"]), (2.3, 2.9, ["0002.pt"])):
        runner.progress.seconds = after
        keep_milestone(runner, options, before)
        assert sorted(path.name for path in kept.glob("*")) == expected
    exported = export_checkpoint(kept / "0002.pt", tmp_path / "policy.onnx")
    assert load_policy(exported.path, load_robot("bp2")).contract.training.method == "sprint"
    with pytest.raises(SprintlabError, match="holds a policy only"):
        runner.load(read_checkpoint(kept / "0002.pt"))


def test_the_steady_stage_begins_where_it_is_told_to_and_in_a_resumed_run(tmp_path: Path) -> None:
    settings = replace(SETTINGS, stages=replace(SETTINGS.stages, steady_iteration=1))
    runner = Runner(settings, "cpu", "test")

    def steady(run: Runner) -> tuple[float, bool]:
        return float(run.environment.steady), bool((run.learner.rollout.noise_scale < 1.0).any())

    assert steady(runner) == (0.0, False)
    runner.iterate()
    assert steady(runner) == (1.0, True)
    runner.save(tmp_path / "checkpoint.pt")
    resumed = Runner(settings, "cpu", "test")
    resumed.load(read_checkpoint(tmp_path / "checkpoint.pt"))
    assert steady(resumed) == (1.0, True)
    always = replace(SETTINGS, stages=replace(SETTINGS.stages, steady_iteration=None))
    assert steady(Runner(always, "cpu", "test")) == (1.0, True)
    with pytest.raises(InvalidValueError, match="steady_iteration"):
        replace(SETTINGS.stages, steady_iteration=-1)


def test_a_run_writes_file_and_policy_and_says_where_it_ends_before_its_steady_stage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    short = replace(SETTINGS, ppo=replace(SETTINGS.ppo, steps=2))
    options = {"environments": 16, "device": "cpu", "tensorboard": False, "cloud": False, "iterations": 1}
    train(TrainOptions(output=tmp_path / "short", settings=short, **options))
    assert "before its fine-tuning phase (stages.steady_iteration, 850)" in " ".join(
        capsys.readouterr().err.split()
    )
    again = read_run_file(tmp_path / "short" / "run.toml")
    state = read_checkpoint(tmp_path / "short" / "checkpoint.pt")
    assert again.full_settings() == state["settings"]
    assert again.full_settings().digest() in (tmp_path / "short" / "run.toml").read_text()
    assert load_policy(tmp_path / "short" / "policy.onnx").contract.training.iterations == 1
    from_the_start = replace(short, stages=replace(short.stages, steady_iteration=0))
    train(TrainOptions(output=tmp_path / "whole", settings=from_the_start, **options))
    assert "before its" not in capsys.readouterr().err


def test_a_training_begins_where_another_run_has_come_to(tmp_path: Path) -> None:
    options = {"environments": 16, "device": "cpu", "tensorboard": False, "cloud": False}
    first = replace(SETTINGS, ppo=replace(SETTINGS.ppo, steps=2))
    begun = train(TrainOptions(output=tmp_path / "first", settings=first, iterations=2, **options))
    second = replace(first, ppo=replace(first.ppo, entropy=0.1))
    ended = train(
        TrainOptions(output=tmp_path / "second", settings=second, iterations=3, start_from=begun, **options)
    )
    state, before = read_checkpoint(ended), read_checkpoint(begun)
    assert state["settings"].ppo.entropy == 0.1
    assert [row["iteration"] for row in state["progress"].log] == [1, 2, 3]
    assert state["progress"].log[:2] == before["progress"].log
    third = TrainOptions(
        output=tmp_path / "third", settings=second, iterations=2, start_from=begun, **options
    )
    with pytest.raises(InvalidValueError, match=r"iterations = 2 is .*checkpoint\.pt has 2 iterations"):
        train(third)


def test_a_sweep_and_a_robot_s_script_train_as_long_as_a_training_does() -> None:
    iterations = TrainOptions().iterations
    assert Sweep(out=Path("runs")).iterations == iterations
    assert ScriptOptions(output=Path("runs")).iterations == iterations
    assert (TrainOptions().settings.stages.steady_iteration or 0) < iterations


def test_the_noise_calms_down_where_it_is_told_to() -> None:
    """Floor and ceiling follow the iteration, also after a resume, and the policy's noise follows them."""
    ppo = replace(
        SETTINGS.ppo, least_std=0.4, calm_iterations=(1, 3), calm_std=0.2, initial_std=0.41, most_std=0.8
    )
    assert replace(ppo, most_std=None).noise_ceiling(9) == math.inf
    assert [ppo.noise_floor(iteration) for iteration in (0, 1, 2, 3, 9)] == pytest.approx(
        [0.4, 0.4, 0.3, 0.2, 0.2]
    )
    assert [ppo.noise_ceiling(iteration) for iteration in (0, 2, 3, 9)] == pytest.approx(
        [math.inf, 0.5, 0.2, 0.2]
    )
    runner = Runner(replace(SETTINGS, ppo=ppo), "cpu", "test")
    runner.iterate()
    with torch.no_grad():
        runner.learner.actor.std.fill_(0.1)
    runner.iterate()
    assert float(runner.learner.actor.std.detach().min()) == pytest.approx(0.4)
    runner.iterate()
    resumed = Runner(replace(SETTINGS, ppo=ppo), "cpu", "test")
    resumed.load(runner.state())
    with torch.no_grad():
        runner.learner.actor.std.fill_(0.3)
    runner.iterate()
    assert runner.learner.actor.std.tolist() == pytest.approx([0.2] * 12)
    assert float(resumed.learner.least_std) == float(runner.learner.least_std) == pytest.approx(0.2)
    rates = [float(learner.estimator_rate) for learner in (runner.learner, resumed.learner)]
    assert rates == pytest.approx(2 * [SETTINGS.estimator.calm_learning_rate])
    with pytest.raises(InvalidValueError, match="calm_std"):
        replace(ppo, calm_std=0.5)


def test_the_estimators_rate_sinks_with_the_noise() -> None:
    estimator = replace(SETTINGS.estimator, learning_rate=1e-3, calm_learning_rate=1e-5)
    assert [estimator.rate(share) for share in (0.0, 0.5, 1.0)] == pytest.approx([1e-3, 1e-4, 1e-5])
    with pytest.raises(InvalidValueError, match="calm_learning_rate"):
        replace(estimator, calm_learning_rate=0.0)
