"""A policy that stands still, and a way to call the command in this process."""

import copy
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from sprintlab.cli.main import main
from sprintlab.control import (
    CONTRACT_KEY,
    LowPass,
    ObservationLayout,
    TrainingRecord,
    encode_contract,
    make_contract,
)
from sprintlab.evaluation import race_files
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.race import evaluate_race
from sprintlab.evaluation.results import RaceResult
from sprintlab.robots import load_robot


class Outcome(NamedTuple):
    status: int
    out: str
    err: str


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Run ``sprintlab ARGUMENTS`` and return status, stdout and stderr."""

    def run(*arguments: object) -> Outcome:
        try:
            status = main([str(argument) for argument in arguments])
        except SystemExit as stop:
            status = int(stop.code or 0)
        captured = capsys.readouterr()
        return Outcome(status, captured.out, captured.err)

    return run


@pytest.fixture(scope="session")
def write_policy() -> Callable[..., Path]:
    """Write a policy whose action is always zero; contract fields can be replaced."""

    def write(path: Path, with_contract: bool = True, **fields: object) -> Path:
        layout = ObservationLayout()
        training = TrainingRecord(
            method="test",
            actuator_model="refined",
            command_line="none",
            config_hash="0" * 64,
            seed=0,
            iterations=0,
            environment_steps=0,
            device="none",
            date="2026-01-01T00:00:00",
        )
        contract = make_contract(
            load_robot("bp2"), layout=layout, training=training, software={}, proprioception_filter=LowPass()
        )
        size = layout.input_size
        graph = helper.make_graph(
            [helper.make_node("MatMul", ["observation", "weights"], ["action"])],
            "policy",
            [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["batch", size])],
            [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["batch", 12])],
            [numpy_helper.from_array(np.zeros((size, 12), np.float32), "weights")],
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        if with_contract:
            changed = msgspec.structs.replace(contract, **fields)
            helper.set_model_props(model, {CONTRACT_KEY: encode_contract(changed)})
        onnx.save(model, path)
        return path

    return write


@pytest.fixture(scope="session")
def policy(write_policy: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_policy(tmp_path_factory.mktemp("policy") / "still.onnx")


@pytest.fixture(scope="session")
def standing_race(policy: Path) -> RaceResult:
    settings = ProtocolSettings(trials=1, required=1)
    return evaluate_race(policy, load_robot("bp2"), top_speed=12.0, settings=settings, workers=1)


@pytest.fixture
def computed(standing_race: RaceResult, monkeypatch: pytest.MonkeyPatch) -> RaceResult:
    """The race as already computed once: what is tested is what becomes of its result."""
    result = copy.deepcopy(standing_race)
    monkeypatch.setattr(race_files, "evaluate_race", lambda *_, **__: result)
    return result
