"""Wheel and sdist hold what the package needs; the wheel runs away from the sources.

``make package-test`` does the same in an empty environment, with every dependency installed anew.
"""

import json
import os
import re
import subprocess
import sys
import tarfile
import zipfile
from functools import cache
from pathlib import Path

import pytest

pytest.importorskip("hatchling", reason="needs hatchling: pip install hatchling")

ROOT = Path(__file__).resolve().parents[2]
DATA = {
    "sprintlab/policies/go1-sprint.onnx",
    "sprintlab/policies/go2-sprint.onnx",
    "sprintlab/policies/sprint.onnx",
    "sprintlab/evaluation/templates/report.html.j2",
    "sprintlab/py.typed",
    "sprintlab/robots/bp2/parameters.toml",
    "sprintlab/viewer/templates/replay.html.j2",
    "sprintlab/viewer/templates/replay.js",
}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Folder with wheel and sdist."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "hatchling", "build", "-d", str(folder)]
    environment = {**os.environ, "SPRINTLAB_URL": "https://forge.example/lab/sprintlab"}
    made = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    return folder


@pytest.fixture(scope="module")
def installed(built, tmp_path_factory):
    """Run ``sprintlab`` from the unpacked wheel, in a folder of its own; the same command once."""
    place, folder = tmp_path_factory.mktemp("site"), tmp_path_factory.mktemp("work")
    with zipfile.ZipFile(next(built.glob("*.whl"))) as wheel:
        wheel.extractall(place)

    @cache
    def run(*arguments, **variables):
        environment = {**os.environ, "PYTHONPATH": str(place), "SOURCE": str(place), **variables}
        start = "import sys, sprintlab; assert sprintlab.__file__.startswith(sys.argv.pop(1))"
        start += "; from sprintlab.cli.main import main; sys.exit(main())"
        command = [sys.executable, "-c", start, str(place), *arguments]
        return subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, check=False
        )

    return run


def test_wheel_holds_data_and_nothing_foreign(built):
    with zipfile.ZipFile(next(built.glob("*.whl"))) as wheel:
        names = wheel.namelist()
        metadata = wheel.read(next(name for name in names if name.endswith("METADATA"))).decode()
    assert set(names) >= DATA
    assert all(re.match(r"sprintlab(/|-[\d.]+\.dist-info/)", name) for name in names)
    assert not [name for name in names if "__pycache__" in name or name.endswith(".pyc")]
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert "Requires-Python: <3.14,>=3.10" in metadata
    assert "Project-URL: Repository, https://forge.example/lab/sprintlab" in metadata
    assert next(built.glob("*.whl")).stat().st_size < 10e6
    required = re.findall(r"^Requires-Dist: ([\w-]+)(?!.*extra ==)", metadata, re.MULTILINE)
    assert {"numpy", "scipy"} <= set(required) and not {"torch", "viser"} & set(required)


def test_sdist_holds_sources_and_tests(built):
    with tarfile.open(next(built.glob("*.tar.gz"))) as sdist:
        names = {name.split("/", 1)[1] for name in sdist.getnames() if "/" in name}
    assert {f"src/{name}" for name in DATA} <= names
    assert {"LICENSE", "README.md", "constraints.txt", "docs/motors.md"} <= names
    hidden = {name for name in names if name.startswith(".")} - {".gitignore"}
    assert not hidden and not [name for name in names if name.startswith(("runs/", "build/"))]
    assert next(built.glob("*.tar.gz")).stat().st_size < 30e6


def test_every_source_file_is_in_the_wheel(built):
    with zipfile.ZipFile(next(built.glob("*.whl"))) as wheel:
        packed = set(wheel.namelist())
    listed = subprocess.run(
        ["git", "ls-files", "src/sprintlab"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode != 0:
        pytest.skip("not a git checkout")
    assert {line.removeprefix("src/") for line in listed.stdout.split()} <= packed


def test_installed_wheel_answers(installed):
    shown = installed("motor", "show", "bp2", "hip", "--json")
    assert shown.returncode == 0, shown.stderr
    assert json.loads(shown.stdout)["no_load_speed"] > 100.0
    refused = installed("motor", "show", "no-such-robot")
    assert refused.returncode == 2
    assert len(refused.stderr.splitlines()) == 1
