"""Mutated files of every kind are read or refused in one sentence; ``tools/fuzz.py`` does it for longer."""

from __future__ import annotations

import importlib.util
import shutil
import sys
from pathlib import Path

import pytest

_SCRIPT = Path(__file__).parents[1] / "tools" / "fuzz.py"
_SPEC = importlib.util.spec_from_file_location("fuzz_tool", _SCRIPT)
assert _SPEC is not None and _SPEC.loader is not None
fuzz_tool = importlib.util.module_from_spec(_SPEC)
sys.modules["fuzz_tool"] = fuzz_tool  # dataclasses look their module up
_SPEC.loader.exec_module(fuzz_tool)

SECONDS = 3.0
"""For each kind: less than a minute in all."""
NEEDS = {"log": "mcap", "network": "onnx", "checkpoint": "torch", "bench": "scipy"}


@pytest.mark.parametrize("name", fuzz_tool.KINDS)
def test_mutations_are_read_or_refused(name: str) -> None:
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    count = 0
    for count, finding in fuzz_tool.fuzz(fuzz_tool.KINDS[name](), SECONDS, seed=1, most=200):  # noqa: B007
        assert finding is None, finding.what
    assert count > 0


def test_the_fuzzer_notices_what_it_looks_for(tmp_path: Path) -> None:
    def read(path: Path) -> None:
        if path.read_bytes() != b"good":
            raise KeyError("a traceback")

    kind = fuzz_tool.Kind(name="k", suffix=".k", make=lambda _: [b"good"], read=read)
    found = [finding for _, finding in fuzz_tool.fuzz(kind, 1.0, most=20)]
    assert sum(finding is not None for finding in found) > 10


def test_the_fuzzer_notices_a_reader_that_ends_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", shutil.which("false"))
    kind = fuzz_tool.Kind(name="policy", suffix=".k", make=lambda _: [b"good"], read=len, apart=True)
    with fuzz_tool._Reader(kind) as look:
        assert look(Path("file")) == "the process ended with status 1"
