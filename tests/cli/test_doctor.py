"""What the doctor finds, what it advises, and its exit status; probes that take seconds are replaced."""

from __future__ import annotations

import json

import pytest

from sprintlab.api import doctor


@pytest.fixture
def no_gpu(monkeypatch):
    """A machine with PyTorch but no GPU."""

    def probe(code, advice):
        works = code is doctor._COMPILE
        return ("ok", "compiled", "") if works else ("broken", "RuntimeError: no GPU here", advice)

    monkeypatch.setattr(doctor, "_probe", probe)
    monkeypatch.setattr(doctor.metadata, "version", lambda package: "1.0")
    monkeypatch.setattr(doctor.shutil, "which", lambda name: "/usr/bin/gcc" if name == "gcc" else None)
    monkeypatch.delenv("CC", raising=False)


def by_name(text):
    return {finding["name"]: finding for finding in json.loads(text)["findings"]}


@pytest.mark.usefixtures("no_gpu")
def test_what_is_not_installed_is_no_fault_unless_training_is_asked_for(call):
    outcome = call("doctor", "--json")
    assert outcome.status == 0 and json.loads(outcome.out)["ok"] is True
    assert by_name(outcome.out)["CUDA"]["state"] == "not tried"
    found = by_name(call("doctor", "--json", "--training").out)
    assert (found["mujoco"]["state"], found["mujoco"]["found"]) == ("ok", "1.0")
    assert found["torch.compile"]["found"] == "compiled"
    for name in ("GPU driver", "CUDA"):
        assert found[name]["state"] == "missing"
    assert all(finding["advice"] for finding in found.values() if finding["state"] != "ok")
    assert found["torch"]["needed_for"] == "training" and found["numpy"]["needed_for"] == "everything"
    assert not {"pytest", "ruff", "mkdocs-material"} & set(found)
    outcome = call("doctor", "--training")
    assert outcome.status == 1 and "GPU driver: install NVIDIA's driver" in outcome.out
