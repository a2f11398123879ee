"""A training that begins from a policy file: its policy, at rest until critic and decoder have learned."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("mujoco_warp")

import msgspec
import onnx
import torch

from sprintlab.control import CONTRACT_KEY, encode_contract, load_policy, shipped_policy
from sprintlab.core.errors import ContractMismatchError, InvalidValueError, PolicyFileError, SprintlabError
from sprintlab.training.learner.distributed import Workers
from sprintlab.training.runs import policy_start
from sprintlab.training.runs.export import EXPORT_TOLERANCE, compare_on_random_inputs
from sprintlab.training.runs.options import TrainOptions, check_places
from sprintlab.training.runs.policy_start import begin_from_policy, read_policy_start
from sprintlab.training.runs.run import open_run
from sprintlab.training.runs.run_file import read_run_file, run_text
from sprintlab.training.runs.runner import Runner
from sprintlab.training.settings import ObservationLayout, PpoSettings, SimulationSettings, TrainingSettings

POLICY = shipped_policy("sprint")
SETTINGS = TrainingSettings(
    simulation=SimulationSettings(environments=16), ppo=PpoSettings(steps=2, epochs=1, mini_batches=1)
)
START = read_policy_start(POLICY, SETTINGS, 10**6)
BEGUN = START.policy.contract.training.iterations
OPTIONS: dict[str, Any] = {"environments": 16, "device": "cpu", "settings": SETTINGS, "iterations": BEGUN + 9}


@pytest.fixture(scope="module")
def states(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """A run with a rest of two iterations at its begin, and after each of its first three."""
    folder = tmp_path_factory.mktemp("run")
    options = TrainOptions(output=folder, start_from=POLICY, critic_iterations=2, **OPTIONS)
    check_places(options)
    runner = open_run(options, Workers(), "test")
    found = [copy.deepcopy(runner.state())]
    for _ in range(3):
        runner.iterate()
        found.append(copy.deepcopy(runner.state()))
    return found


def difference(state: dict[str, Any], other: dict[str, Any], network: str) -> set[str]:
    """Names of the network's numbers that differ."""
    first, second = state["learner"][network], other["learner"][network]
    return {name for name, value in first.items() if not torch.equal(value, second[name])}


def test_the_network_that_begins_is_the_file_s(states: list[dict[str, Any]]) -> None:
    runner = Runner(SETTINGS, "cpu", "test")
    begin_from_policy(runner, START, 0)
    assert compare_on_random_inputs(runner.learner.actor, START.policy) <= EXPORT_TOLERANCE
    assert not difference(runner.state(), states[0], "actor").difference(
        name for name in states[0]["learner"]["actor"] if "decoder" in name or "log_variance" in name
    )


def test_a_run_begins_where_the_policy_was(states: list[dict[str, Any]]) -> None:
    begun = states[0]
    assert begun["progress"].iteration == begun["blend"]["iteration"] == BEGUN
    assert begun["progress"].environment_steps == START.policy.contract.training.environment_steps
    assert begun["progress"].log == []
    assert begun["growth"]["upper"] == SETTINGS.stages.second_top
    assert begun["blend"]["progress"] == SETTINGS.stages.ramp_iterations
    assert begun["learner"]["learning_rate"] == pytest.approx(5e-4)
    assert begun["learner"]["actor"]["std"].tolist() == pytest.approx(12 * [SETTINGS.ppo.noise_floor(BEGUN)])
    assert (begun["grid_weights"] == 1.0).all()
    means = [begun["learner"][network]["normalizer.mean"] for network in ("actor", "critic")]
    assert torch.equal(*means)


def test_the_policy_rests_until_critic_and_decoder_have_learned(states: list[dict[str, Any]]) -> None:
    decoder = {name for name in states[0]["learner"]["actor"] if name.startswith("estimator.decoder.")}
    for state in states[1:3]:
        assert difference(states[0], state, "actor") == decoder
        assert {"value.0.weight", "value.6.bias"} <= difference(states[0], state, "critic")
    assert any(moment.any() for moment in states[1]["learner"]["moments"])
    assert not any(moment.any() for moment in states[2]["learner"]["moments"])
    assert states[2]["learner"]["learning_rate"] == pytest.approx(2e-4)
    after = difference(states[2], states[3], "actor")
    assert {"policy.0.weight", "policy.6.bias", "estimator.encoder.0.0.weight"} <= after
    columns = states[3]["learner"]["actor"]["policy.0.weight"][:, 69:]
    assert not columns.any()


def test_a_resumed_run_goes_on_resting(states: list[dict[str, Any]]) -> None:
    resumed = Runner(SETTINGS, "cpu", "test")
    resumed.load(copy.deepcopy(states[1]))
    for expected in states[2:]:
        resumed.iterate()
        assert not difference(resumed.state(), expected, "actor")
        assert not difference(resumed.state(), expected, "critic")


def test_the_rest_is_no_setting_and_stands_in_the_run_s_file(tmp_path: Path) -> None:
    options = TrainOptions(start_from=POLICY, critic_iterations=7, **OPTIONS)
    settings = options.full_settings()
    assert settings.digest() == TrainOptions(**OPTIONS).full_settings().digest()
    path = tmp_path / "run.toml"
    path.write_text(run_text(options, settings, "test"), encoding="utf-8")
    again = read_run_file(path)
    assert (again.critic_iterations, again.start_from) == (7, POLICY)


OTHER_WIDTHS = replace(SETTINGS, ppo=replace(SETTINGS.ppo, hidden=(64, 32)))
OTHER_LATENT = replace(SETTINGS, estimator=replace(SETTINGS.estimator, latent=8))
OTHER_HISTORY = replace(SETTINGS, observation=ObservationLayout(history_length=5))


@pytest.mark.parametrize(
    ("changes", "error", "words"),
    [
        ({"robot": "go1"}, ContractMismatchError, "robot"),
        ({"settings": OTHER_WIDTHS}, SprintlabError, r"policy\.0\.weight is \(512, 69\), but \(64, 69\)"),
        ({"settings": OTHER_LATENT}, SprintlabError, r"mean_head\.weight is \(16, 128\), but \(8, 128\)"),
        ({"settings": OTHER_HISTORY}, SprintlabError, "observation"),
        ({"iterations": BEGUN}, InvalidValueError, f"has {BEGUN} iterations already"),
        ({"start_from": Path("none.onnx")}, SprintlabError, r"none\.onnx"),
    ],
)
def test_what_does_not_fit_is_refused_before_the_run(
    tmp_path: Path, changes: dict[str, Any], error: type[SprintlabError], words: str
) -> None:
    options = TrainOptions(output=tmp_path / "run", **{**OPTIONS, "start_from": POLICY, **changes})
    with pytest.raises(error, match=words) as refusal:
        check_places(options)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("name", ["normalizer.mean", "estimator.mean_head.bias", "normalizer.variance"])
def test_a_network_without_one_of_the_names_is_refused(tmp_path: Path, name: str) -> None:
    """It runs as before, under another name; of the variance, its divisor is computed and no constant."""
    model = onnx.load_from_string(POLICY.read_bytes())
    nodes, initializers = model.graph.node, {each.name: each for each in model.graph.initializer}
    divisor = next(node.input[1] for node in nodes if node.output[0] == "/normalizer/Div_output_0")
    old = name if name in initializers else divisor
    for node in nodes:
        node.input[:] = ["other" if word == old else word for word in node.input]
    if name in initializers:
        initializers[name].name = "other"
    else:
        nodes.insert(0, onnx.helper.make_node("Identity", [divisor], ["other"]))
    path = tmp_path / "policy.onnx"
    path.write_bytes(model.SerializeToString())
    with pytest.raises(SprintlabError, match=f"its network has no {name}"):
        read_policy_start(path, SETTINGS, 10**6)


@pytest.mark.parametrize(
    "other",
    [b"", POLICY.read_bytes()[:-100], shipped_policy("go1-sprint").read_bytes()],
    ids=["empty", "cut", "another"],
)
def test_a_file_that_changes_while_it_is_read_is_refused(
    tmp_path: Path, monkeypatch: Any, other: bytes
) -> None:
    """Cut short meanwhile it ended in a traceback; and what has taken its place was checked by nobody."""
    path = tmp_path / "policy.onnx"
    path.write_bytes(POLICY.read_bytes())

    def load(*given: Any) -> Any:
        policy = load_policy(*given)
        path.write_bytes(other)
        return policy

    monkeypatch.setattr(policy_start, "load_policy", load)
    with pytest.raises(PolicyFileError, match="has changed since it was read"):
        read_policy_start(path, SETTINGS, 10**6)


@pytest.mark.parametrize(("name", "count"), [("iterations", -1), ("environment_steps", 2**64 - 1)])
def test_counts_with_which_no_run_could_go_on_are_refused(tmp_path: Path, name: str, count: int) -> None:
    """Beyond 64 bits a checkpoint is not read again: the whole training would be lost."""
    contract = START.policy.contract
    training = msgspec.structs.replace(contract.training, **{name: count})
    text = encode_contract(msgspec.structs.replace(contract, training=training))
    model = onnx.load_from_string(POLICY.read_bytes())
    onnx.helper.set_model_props(model, {CONTRACT_KEY: text})
    path = tmp_path / "policy.onnx"
    path.write_bytes(model.SerializeToString())
    with pytest.raises(InvalidValueError, match=f"training.{name}"):
        read_policy_start(path, SETTINGS, 10**6)


def test_settings_that_change_what_the_weights_mean_are_refused() -> None:
    estimator = replace(SETTINGS.estimator, velocity_scale=1.0)
    runner = Runner(replace(SETTINGS, estimator=estimator), "cpu", "test")
    with pytest.raises(SprintlabError, match="does something else with these settings"):
        begin_from_policy(runner, START, 0)


@pytest.mark.parametrize(
    ("count", "begun"), [(-1, POLICY), (10**6 + 1, POLICY), (7, None), (7, Path("checkpoint.pt"))]
)
def test_a_rest_is_not_endless_and_only_after_a_policy_file(count: int, begun: Path | None) -> None:
    with pytest.raises(InvalidValueError, match="critic_iterations"):
        TrainOptions(critic_iterations=count, start_from=begun)
