"""docs/how-it-works.md says what the results say."""

from __future__ import annotations

import importlib.util
from types import ModuleType

from tests.test_architecture import ROOT


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "benchmarks" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_tables_are_those_of_the_results() -> None:
    writer = load("engine_page")
    text = writer.PAGE.read_text(encoding="utf-8")
    assert writer.page(text) == text
