"""A policy that stands still, and a way to call the command in this process."""

import copy
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
import pytest

from sprintlab.cli.main import main
from sprintlab.control import CONTRACT_KEY, PolicyContract, encode_contract
from sprintlab.evaluation import race_files
from sprintlab.evaluation.protocol import ProtocolSettings
from sprintlab.evaluation.race import evaluate_race
from sprintlab.evaluation.results import RaceResult
from sprintlab.robots import RobotDescription


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
def write_policy(contract: PolicyContract, save_network: Callable[..., Path]) -> Callable[..., Path]:
    """Write a policy whose action is always zero; contract fields can be replaced."""

    def write(path: Path, with_contract: bool = True, **fields: object) -> Path:
        changed = msgspec.structs.replace(contract, **fields)
        size = contract.layout.input_size
        return save_network(
            path,
            [("MatMul", "observation", "weights", "action")],
            {"weights": np.zeros((size, 12))},
            inputs={"observation": size},
            outputs={"action": 12},
            metadata={CONTRACT_KEY: encode_contract(changed)} if with_contract else {},
        )

    return write


@pytest.fixture(scope="session")
def policy(write_policy: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_policy(tmp_path_factory.mktemp("policy") / "still.onnx")


@pytest.fixture(scope="session")
def standing_race(policy: Path, robot: RobotDescription) -> RaceResult:
    settings = ProtocolSettings(trials=1, required=1, hold=1.0)
    return evaluate_race(policy, robot, top_speed=2.0, distance=1.0, settings=settings, workers=1)


@pytest.fixture
def computed(standing_race: RaceResult, monkeypatch: pytest.MonkeyPatch) -> RaceResult:
    """The race as already computed once: what is tested is what becomes of its result."""
    result = copy.deepcopy(standing_race)
    monkeypatch.setattr(race_files, "evaluate_race", lambda *_, **__: result)
    return result
