"""Iterations, checkpoints and the way from a checkpoint to a policy file, on the CPU."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.training.small import small_settings

from sprintlab.control import load_policy
from sprintlab.core.errors import InvalidValueError, SprintlabError
from sprintlab.robots import load_robot
from sprintlab.training.learner.annealing import annealed
from sprintlab.training.runs.checkpoint import Progress, read_checkpoint
from sprintlab.training.runs.export import actor_from_checkpoint, export_checkpoint
from sprintlab.training.runs.options import RunLength
from sprintlab.training.runs.run import TrainOptions, keep_milestone, train
from sprintlab.training.runs.runner import Runner
from sprintlab.training.settings import TrainingSettings
from sprintlab.training.settings_text import read_settings

SETTINGS = small_settings(environments=16, steps=4, hidden=(32, 16))


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The checkpoint of a run of two iterations."""
    runner = Runner(SETTINGS, "cpu", "sprintlab train --method acs")
    runner.iterate()
    runner.iterate()
    path = tmp_path_factory.mktemp("run") / "checkpoint.pt"
    runner.save(path)
    return path


def test_two_iterations_are_counted_and_finite(checkpoint: Path) -> None:
    progress = read_checkpoint(checkpoint)["progress"]
    assert (progress.iteration, progress.environment_steps, len(progress.log)) == (2, 2 * 4 * 16, 2)
    assert all(np.isfinite(value) for row in progress.log for value in row.values())


def test_a_resumed_run_has_everything_but_the_robots(tmp_path: Path) -> None:
    runner = Runner(SETTINGS, "cpu", "one")
    runner.begin(RunLength(iterations=5, seconds=60.0))
    runner.iterate()
    runner.growth.upper = 3.7  # a curriculum that no new run has
    runner.save(tmp_path / "checkpoint.pt")
    resumed = Runner(SETTINGS, "cpu", "two")
    resumed.load(read_checkpoint(tmp_path / "checkpoint.pt"))
    described = {"settings", "command_line", "date"}
    pairs = [(run.state().items(), run) for run in (runner, resumed)]
    first, second = ({k: v for k, v in items if k not in described} for items, _ in pairs)
    torch.testing.assert_close(first.pop("learner"), second.pop("learner"), rtol=0.0, atol=0.0)
    for name, value in first.items():
        same = torch.equal if isinstance(value, torch.Tensor) else lambda a, b: str(a) == str(b)
        assert same(value, second[name]), name
    assert float(resumed.environment.upper) == pytest.approx(3.7) and resumed.iterate()["iteration"] == 2


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
    assert load_policy(exported.path, load_robot("bp2")).contract.training.method == "acs"
    with pytest.raises(SprintlabError, match="holds a policy only"):
        runner.load(read_checkpoint(kept / "0002.pt"))


def test_the_phases_of_a_run_follow_what_ends_it_first() -> None:
    length = RunLength(iterations=100, seconds=60.0)
    shares = [
        length.share(Progress(iteration=k, seconds=t))
        for k, t in ((0, 0.0), (50, 6.0), (10, 45.0), (7, 90.0))
    ]
    assert shares == [0.0, 0.5, 0.75, 1.0]
    assert RunLength(seconds=60.0).share(Progress(iteration=10**6, seconds=15.0)) == 0.25


def test_fine_tuning_begins_at_its_share_of_the_run_and_in_a_resumed_run(tmp_path: Path) -> None:
    settings = replace(SETTINGS, stages=replace(SETTINGS.stages, steady_share=0.5))

    def made() -> Runner:
        run = Runner(settings, "cpu", "test")
        run.begin(RunLength(iterations=2))
        return run

    def steady(run: Runner) -> tuple[float, bool]:
        return float(run.environment.steady), bool((run.learner.rollout.noise_scale < 1.0).any())

    runner = made()
    assert steady(runner) == (0.0, False)
    runner.iterate()
    assert steady(runner) == (1.0, True)
    runner.save(tmp_path / "checkpoint.pt")
    resumed = made()
    resumed.load(read_checkpoint(tmp_path / "checkpoint.pt"))
    assert steady(resumed) == (1.0, True)
    with pytest.raises(InvalidValueError, match="steady_share"):
        replace(SETTINGS.stages, steady_share=-1.0)


def test_what_is_exported_is_the_mean_of_the_weights(monkeypatch) -> None:
    """The plain mean at first, then one that forgets."""
    monkeypatch.setattr("sprintlab.training.runs.runner.AVERAGED_OVER", 2)
    runner, weights = Runner(SETTINGS, "cpu", "test"), []
    for _ in range(3):
        runner.iterate()
        weights.append(runner.learner.actor.state_dict()["policy.layers.2.weight"].clone())
    expected = 0.5 * (0.5 * (weights[0] + weights[1]) + weights[2])
    torch.testing.assert_close(runner.mean["policy.layers.2.weight"], expected)
    exported = actor_from_checkpoint(runner.state()).state_dict()["policy.layers.2.weight"]
    torch.testing.assert_close(exported, expected)


def test_the_range_opens_beyond_its_gate_only_while_feet_and_gears_hold(monkeypatch) -> None:
    runner = Runner(SETTINGS, "cpu", "test")
    assert runner.chances is not None
    runner.chances.shares = [1.0] * len(runner.chances.shares)
    for upper, may in ((11.9, True), (12.0, False)):
        runner.growth.upper = upper
        assert runner._may_open() is may
    runner.chances.shares = [0.0] * len(runner.chances.shares)
    assert runner._may_open()


def test_a_run_writes_file_and_policy(tmp_path: Path) -> None:
    short = replace(SETTINGS, ppo=replace(SETTINGS.ppo, steps=2))
    options = {"environments": 16, "device": "cpu", "tensorboard": False, "iterations": 1}
    train(TrainOptions(output=tmp_path / "short", settings=short, **options))
    again = read_settings(tmp_path / "short" / "run.toml", TrainingSettings())
    assert again == read_checkpoint(tmp_path / "short" / "checkpoint.pt")["settings"]
    assert again.digest() in (tmp_path / "short" / "run.toml").read_text()
    policy = load_policy(tmp_path / "short" / "policy.onnx", load_robot("bp2"))
    assert policy.contract.training.iterations == 1
    assert policy.contract.training.config_hash == again.digest()


def test_noise_divergence_and_the_estimators_rate_sink_between_their_shares_of_the_run() -> None:
    shares = (0.0, 0.5, 0.71, 0.92, 1.0)
    least, most, divergence, rate = zip(*map(annealed, shares), strict=True)
    assert least == pytest.approx([0.25, 0.25, 0.185, 0.12, 0.12])
    assert most == pytest.approx([math.inf, math.inf, 0.27, 0.12, 0.12])
    assert divergence[0] == pytest.approx(0.01) and divergence[-1] == pytest.approx(0.002)
    assert rate[::2] == pytest.approx([1e-3, 10**-3.5, 1e-4])
    runner = Runner(SETTINGS, "cpu", "test")
    for share, floor in ((0.0, 0.25), (1.0, 0.12)):
        assert runner.share == share
        with torch.no_grad():
            runner.learner.actor.std.fill_(0.1)
        runner.iterate()
        assert float(runner.learner.actor.std.detach().min()) == pytest.approx(floor)
        runner.begin(RunLength(iterations=1))
    assert float(runner.learner.desired_kl) == pytest.approx(0.002)
    assert float(runner.learner.estimator_rate) == pytest.approx(1e-4)
