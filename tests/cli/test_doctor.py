"""What the doctor finds, what it advises, and its exit status; probes that take seconds are replaced."""

from __future__ import annotations

import json
from collections import namedtuple
from importlib import metadata

import pytest

from sprintlab.api import doctor


@pytest.fixture
def nothing_to_try(monkeypatch):
    """A machine with PyTorch but no GPU; OpenGL does not render."""

    def probe(code, *arguments):
        return None if code is doctor._COMPILE else "RuntimeError: no GPU here"

    monkeypatch.setattr(doctor, "_probe", probe)
    monkeypatch.setattr(doctor, "_installed", lambda package: True)
    monkeypatch.setattr(doctor.metadata, "version", metadata.version)
    monkeypatch.setattr(doctor.shutil, "which", lambda name: "/usr/bin/gcc" if name == "gcc" else None)
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("sprintlab.evaluation.video.working_gl_backend", lambda: None)


def by_name(text):
    return {finding["name"]: finding for finding in json.loads(text)["findings"]}


def test_json_only_and_no_fault_without_gpu_or_opengl(call, nothing_to_try):
    outcome = call("doctor", "--json", "--thorough")
    found = by_name(outcome.out)
    assert outcome.status == 0 and json.loads(outcome.out)["ok"] is True
    assert found["mujoco"]["state"] == "ok"
    assert found["mujoco"]["found"] == metadata.version("mujoco")
    assert found["OpenGL backend"]["state"] == "missing"
    assert "apt install" in found["OpenGL backend"]["advice"]
    assert (
        found["GPU driver"]["state"] == found["CUDA"]["state"] == found["graph capture"]["state"] == "missing"
    )
    assert all(finding["advice"] for finding in found.values() if finding["state"] != "ok")


def test_who_asks_for_training_is_told_by_the_status(call, nothing_to_try):
    outcome = call("doctor", "--training")
    assert outcome.status == 1
    assert "GPU driver: install NVIDIA's driver" in outcome.out
    found = doctor.doctor(training=True)
    assert not found.ok and {finding.name for finding in found.findings} > {"GPU driver", "mujoco"}
    assert doctor.Examination(findings=found.findings).ok and "sprintlab doctor" in str(found)


def test_a_gpu_that_pytorch_cannot_use_is_a_fault(call, nothing_to_try, monkeypatch):
    monkeypatch.setattr(doctor.shutil, "which", lambda name: f"/usr/bin/{name}")
    listed = namedtuple("Done", "returncode stdout stderr")(0, "NVIDIA H100, 580.65, 81559 MiB\n", "")
    monkeypatch.setattr(doctor.subprocess, "run", lambda *arguments, **options: listed)
    outcome = call("doctor", "--json", "--thorough")
    found = by_name(outcome.out)
    assert outcome.status == 1
    assert found["GPU driver"]["state"] == "ok"
    assert found["CUDA"] == {
        "name": "CUDA", "state": "broken", "found": "RuntimeError: no GPU here",
        "needed_for": "training on a GPU",
        "advice": "install the PyTorch build for your driver's CUDA (pytorch.org/get-started)",
    }  # fmt: skip


def test_packages_are_held_against_what_is_asked_for(monkeypatch):
    versions = {"old": "1.0", "fine": "2.5"}

    def version(name):
        if name not in versions:
            raise metadata.PackageNotFoundError(name)
        return versions[name]

    monkeypatch.setattr(doctor.metadata, "version", version)
    assert doctor.package_finding("fine", ">=2,<3", "").state == "ok"
    old = doctor.package_finding("old", ">=2,<3", "train")
    assert (old.state, old.found) == ("broken", "1.0, wanted <3,>=2") or old.found == "1.0, wanted >=2,<3"
    assert old.advice == "pip install 'old>=2,<3'"
    assert doctor.package_finding("absent", ">=2", "train").state == "missing"
    assert doctor.package_finding("absent", ">=2", "").state == "broken"


def test_every_extra_but_those_of_developers_is_looked_at():
    found = {finding.name: finding for finding in doctor.package_findings()}
    assert found["torch"].needed_for == "training"
    assert found["numpy"].needed_for == "everything"
    assert not {"pytest", "ruff", "mkdocs-material"} & set(found)


def test_a_full_or_read_only_disk_is_a_fault(tmp_path, monkeypatch):
    assert doctor.disk(tmp_path / "not" / "yet").state == "ok"
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert "is a file" in doctor.disk(tmp_path / "file").found
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(doctor.shutil, "disk_usage", lambda place: usage(1e12, 1e12, 2e8))
    full = doctor.disk(tmp_path)
    assert (full.state, full.found.split(" free")[0]) == ("broken", "0.2 GB")
    monkeypatch.setattr(doctor.os, "access", lambda place, mode: False)
    assert "read-only" in doctor.disk(tmp_path).found


def test_a_probe_tells_the_last_line_of_what_went_wrong():
    assert doctor._probe("pass") is None
    assert doctor._probe("raise ValueError('this one')") == "ValueError: this one"
    assert doctor._probe("import os; os._exit(3)") == "exit status 3"


def test_a_probe_that_hangs_is_given_up(monkeypatch):
    monkeypatch.setattr(doctor, "_PROBE_SECONDS", 0.2)
    assert doctor._probe("import time; time.sleep(60)") == "no answer in 0 s"


def test_what_helps_several_things_is_said_once(capsys):
    facts = {"state": "missing", "found": "", "needed_for": "training"}
    names = ("torch", "onnx")
    findings = tuple(doctor.Finding(name=name, advice="do this", **facts) for name in names)
    assert str(doctor.Examination(findings=findings)).splitlines()[-1] == "torch, onnx: do this"
