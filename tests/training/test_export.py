"""Exports are checked against PyTorch, and refused where the runtimes differ."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from tests.training.small import small_settings

from sprintlab.control import OBSERVABLES, Observable, load_policy, shipped_policy
from sprintlab.core.errors import ContractMismatchError, PolicyFileError, SprintlabError
from sprintlab.robots import load_robot
from sprintlab.robots.loader import robot_table_path
from sprintlab.training.learner.distributed import Workers
from sprintlab.training.runs import export
from sprintlab.training.runs.export import export_checkpoint
from sprintlab.training.runs.run import TrainOptions, open_run
from sprintlab.training.runs.runner import Runner

SETTINGS = small_settings(environments=16, steps=4, hidden=(32, 16))


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The checkpoint of a policy that has not learned anything yet."""
    runner = Runner(SETTINGS, "cpu", "sprintlab train --method acs")
    path = tmp_path_factory.mktemp("training") / "model.pt"
    runner.save(path)
    return path


@pytest.mark.parametrize("symmetric", [True, False])
def test_an_export_warns_of_nothing(symmetric, tmp_path):
    """Neither of a shape that was traced as a constant nor of constants that were not folded."""
    path = tmp_path / "model.pt"
    Runner(replace(SETTINGS, ppo=replace(SETTINGS.ppo, symmetric=symmetric)), "cpu", "test").save(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", torch.jit.TracerWarning)
        warnings.filterwarnings("error", "Constant folding")
        export_checkpoint(path, tmp_path / "policy.onnx")


def test_a_term_of_ones_own_travels_in_the_contract(tmp_path, monkeypatch):
    """Policies without it run on; where it is not known, those with it are refused by its name."""
    monkeypatch.setitem(OBSERVABLES, "turn", Observable(lambda x: x.angular_velocity[..., 2:], 1, (-1.0,)))
    terms = {**SETTINGS.observation.terms, "turn": 0.5}
    settings = replace(SETTINGS, observation=replace(SETTINGS.observation, terms=terms))
    runner = Runner(settings, "cpu", "sprintlab train")
    runner.iterate()
    runner.save(tmp_path / "model.pt")
    path = export_checkpoint(tmp_path / "model.pt", tmp_path / "policy.onnx").path
    assert load_policy(path, load_robot("bp2")).layout.frame_size == 46
    load_policy(shipped_policy(), load_robot("bp2"))
    monkeypatch.delitem(OBSERVABLES, "turn")
    with pytest.raises(ContractMismatchError, match="turn"):
        load_policy(path)


def test_a_network_that_differs_is_refused_and_nothing_is_written(checkpoint, tmp_path, monkeypatch):
    sound = export._onnx_bytes

    def slightly_other(network, input_size):
        with torch.no_grad():
            for parameter in network.parameters():
                parameter.mul_(1.001)
        data = sound(network, input_size)
        with torch.no_grad():
            for parameter in network.parameters():
                parameter.div_(1.001)
        return data

    monkeypatch.setattr(export, "_onnx_bytes", slightly_other)
    with pytest.raises(PolicyFileError, match=r"differs from the network's by .*, allowed 1e-04"):
        export_checkpoint(checkpoint, tmp_path / "policy.onnx")
    assert not (tmp_path / "policy.onnx").exists()


def test_no_policy_bears_the_name_of_a_robot_that_was_changed_after_the_training(tmp_path):
    """Its contract told of the new masses, and the new robot took a policy that had never moved it."""
    table = tmp_path / "robot" / "parameters.toml"
    table.parent.mkdir()
    table.write_bytes(robot_table_path("bp2").read_bytes())
    options = TrainOptions(output=tmp_path, device="cpu", resume=True)
    runner = Runner(replace(SETTINGS, robot=str(table)), "cpu", "")
    runner.save(tmp_path / "checkpoint.pt")
    open_run(options, Workers())
    text = table.read_text(encoding="utf-8")
    table.write_text(
        text.replace("total_mass = { value = 36.5", "total_mass = { value = 38.0"), encoding="utf-8"
    )
    for work in (
        lambda: export_checkpoint(tmp_path / "checkpoint.pt", tmp_path / "policy.onnx"),
        lambda: open_run(options, Workers()),
    ):
        with pytest.raises(SprintlabError, match="has changed since it was trained"):
            work()
    assert not (tmp_path / "policy.onnx").exists()
