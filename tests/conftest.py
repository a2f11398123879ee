"""What every test shares: settings, the robot, a policy's contract, small networks, a headless browser."""

import gc
import importlib.util
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from tests.short_trials import BRIEF, shorten_trials

from sprintlab.control import (
    CONTRACT_KEY,
    LowPass,
    ObservationLayout,
    PolicyContract,
    TrainingRecord,
    encode_contract,
    make_contract,
)
from sprintlab.robots import RobotDescription, load_robot

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# WebGL without a GPU; no sandbox, because tests often run as root in a container.
FLAGS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
PATIENCE = 180_000
"""For a browser, which renders in software on a shared core [ms]."""

# One thread a process for PyTorch: tests run side by side, and its threads spend most of their time waiting.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# No deadline: machines that run tests are shared, and the first call imports libraries.
settings.register_profile(
    "sprintlab", deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("sprintlab")


def pytest_collection() -> None:
    """What is imported while tests are collected is no garbage: looking for it takes a third of that time."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Leave it out of every later search for garbage."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def _patient_logs() -> Iterator[None]:
    """A log's writer may take long where the machine is busy; the test of a stopped one waits less."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sprintlab.deployment.log.writer._PATIENCE", 120.0)
        yield


@pytest.fixture(scope="session")
def torch() -> ModuleType:
    """PyTorch; a test that asks for it is skipped where it is not installed."""
    return pytest.importorskip("torch")


@pytest.fixture(scope="session")
def load_script() -> Callable[[str], ModuleType]:
    """Imports a script by its path from the project's root; it finds its neighbours as where it is run."""

    def load(path: str) -> ModuleType:
        file = Path(__file__).parents[1] / path
        spec = importlib.util.spec_from_file_location(file.stem, file)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        with pytest.MonkeyPatch.context() as patch:
            patch.syspath_prepend(str(file.parent))
            sys.modules[file.stem] = module  # where dataclasses look up the names in annotations
            spec.loader.exec_module(module)
        return module

    return load


@pytest.fixture
def short_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    """Short trials on coarse steps, where a test is not about what they hold."""
    shorten_trials(monkeypatch.setitem)


@pytest.fixture
def brief_trials(short_trials: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Shorter still: too short to come to rest, which is for tests of the first engine."""
    shorten_trials(monkeypatch.setitem, BRIEF)


@pytest.fixture
def unlocked_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """A loop in this process locks none: all that was ever imported or mapped would become resident."""
    monkeypatch.setattr("sprintlab.deployment.controller.realtime._lock_memory", lambda: None)


@pytest.fixture
def blank_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of a race take seconds to draw: for tests that do not look at them."""
    monkeypatch.setattr("sprintlab.evaluation.report.png_bytes", lambda figure: b"picture")


@pytest.fixture(scope="session")
def robot() -> RobotDescription:
    """BP2, nominal: also the robot that the policy ``sprint`` was trained on."""
    return load_robot("bp2")


@pytest.fixture(scope="session")
def contract(robot: RobotDescription) -> PolicyContract:
    """The contract of a policy without estimator."""
    training = TrainingRecord(
        method="test",
        actuator_model="refined",
        command_line="sprintlab train --seed 3",
        config_hash="0" * 64,
        seed=3,
        iterations=10,
        environment_steps=1000,
        device="CPU",
        date="2025-01-01T00:00:00+00:00",
    )
    return make_contract(
        robot,
        layout=ObservationLayout(),
        training=training,
        software={"numpy": np.__version__},
        proprioception_filter=LowPass(),
    )


@pytest.fixture(scope="session")
def save_network() -> Callable[..., Path]:
    """Write an ONNX file.

    ``nodes`` are an operation, the names it reads and the name it makes; ``weights`` are arrays by name;
    ``inputs`` and ``outputs`` are sizes by name.
    """
    onnx = pytest.importorskip("onnx")
    helper, numpy_helper = onnx.helper, onnx.numpy_helper

    def save(
        path: Path,
        nodes: Sequence[Sequence[str]],
        weights: Mapping[str, np.ndarray],
        *,
        inputs: Mapping[str, int],
        outputs: Mapping[str, int],
        metadata: Mapping[str, str],
        batch: str | int = "batch",
    ) -> Path:
        read, made = (
            [
                helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, [batch, size])
                for name, size in sizes.items()
            ]
            for sizes in (inputs, outputs)
        )
        made_by = [helper.make_node(operation, names, [name]) for operation, *names, name in nodes]
        arrays = [
            numpy_helper.from_array(np.asarray(value, np.float32), name) for name, value in weights.items()
        ]
        graph = helper.make_graph(made_by, "policy", read, made, arrays)
        # Old versions of the format: the runtime that reads the file may be older than onnx.
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
        helper.set_model_props(model, dict(metadata))
        onnx.save(model, path)
        return path

    return save


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
def browser() -> Iterator[Any]:
    """A Chromium driven by Playwright; its own download, or one of the system.

    Pages that are drawn in software starve beside other tests: run these tests in one process (``-n 0``).
    """
    if "PYTEST_XDIST_WORKER" in os.environ:
        pytest.skip("needs the machine for itself: run tests/viewer and tests/docs with -n 0")
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Playwright: pip install playwright")
    with playwright.sync_playwright() as driver:
        try:
            opened = driver.chromium.launch(args=FLAGS)
        except playwright.Error:
            system = next(filter(None, map(shutil.which, BROWSERS)), None)
            if system is None:
                pytest.skip("needs a browser: playwright install chromium, or Chromium from the system")
            opened = driver.chromium.launch(executable_path=system, args=FLAGS, timeout=PATIENCE)
        yield opened
        opened.close()


@pytest.fixture
def tab(browser: Any) -> Iterator[Any]:
    """An empty page whose script errors fail the test."""
    page = browser.new_page(viewport={"width": 900, "height": 600})
    page.set_default_timeout(PATIENCE)
    errors: list[Any] = []
    page.on("pageerror", lambda error: errors.append(error))
    yield page
    page.close()
    assert errors == []
