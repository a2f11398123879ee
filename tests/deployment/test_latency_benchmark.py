"""The benchmark of the controller's latency, in one process: it says of what it measured how many steps."""

import hashlib
import json
import subprocess
import sys
from pathlib import Path

import pytest

from sprintlab.control import shipped_policy

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "controller_latency.py"


def run(*arguments):
    return subprocess.run(
        [sys.executable, str(SCRIPT), "--no-real-time", "--json", *arguments],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def test_steps_of_a_run_are_counted_and_the_policy_is_named():
    done = run("--cores", "1", "--minutes", "0.01")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    controller = result["controller"]
    assert controller["end"] == "run" and result["cores"] == 1
    assert abs(controller["steps"] - 600) <= 1 and abs(controller["policy_steps"] - 30) <= 1
    assert all(controller["microseconds"][name]["p50"] > 0 for name in ("policy_step", "compute"))
    assert result["policy"]["sha256"] == hashlib.sha256(shipped_policy().read_bytes()).hexdigest()


def test_more_cores_than_there_are_is_refused(load_script, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", [SCRIPT.name, "--cores", "100000"])
    with pytest.raises(SystemExit, match="2"):
        load_script("benchmarks/controller_latency.py").main()
    assert "--cores must be from 1" in capsys.readouterr().err
