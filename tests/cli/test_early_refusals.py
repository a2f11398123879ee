"""What cannot work is refused before PyTorch is imported and before any work; doctor answers at once."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import sprintlab

SOURCE = Path(sprintlab.__file__).parents[1]
WITHOUT_TORCH = (
    "import sys\n"
    "class Refuse:\n"
    "    def find_spec(self, name, path=None, target=None):\n"
    "        if name.partition('.')[0] in ('torch', 'warp', 'mujoco_warp'):\n"
    "            raise SystemExit(f'imported {name}')\n"
    "import importlib.util\n"
    "importlib.util.find_spec = lambda name, *rest: object()\n"
    "sys.meta_path.insert(0, Refuse())\n"
    "from sprintlab.cli.main import main\n"
    "sys.exit(main(sys.argv[1:]))\n"
)


def answer(*words: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """The command line in a process that ends as soon as PyTorch is imported."""
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_TORCH, *map(str, words)],
        capture_output=True, text=True, cwd=cwd, env={**os.environ, "PYTHONPATH": str(SOURCE)},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["train", "gallop"], "method"),
        (["train", "sprint", "--minutes", "-1"], "minutes"),
        (["train", "sprint", "--robot", "nodog"], "nodog"),
        (["train", "sprint", "--resume", "--output", "none"], "nothing to resume"),
        (["train", "sprint", "--start-from", "none.pt"], "none.pt"),
        (["train", "sprint", "--start-from", "junk.pt"], "junk.pt"),
        (["train", "sprint", "--device", "gpu"], "device"),
        (["train", "sprint", "--output", "file/run"], "cannot write"),
        (["export", "none.pt", "policy.onnx"], "none.pt"),
        (["export", "junk.pt", "policy.onnx"], "junk.pt"),
        (["learning", "none"], "none"),
        (["learning", "junk.pt"], "junk.pt"),
        (["race", "--top-speed", "1e9"], "top_speed"),
        (["race", "--top-speed", "nan"], "top_speed"),
        (["race", "--out", "file/run"], "cannot write"),
        (["race", "--workers", "0"], "workers"),
        (["robustness", "--trials", "0"], "trials"),
        (["robustness", "--distance", "-5"], "distance"),
        (["evaluate", "sprint", "--out", "file/numbers.json"], "cannot write"),
        (["report", "none.mcap", "--out", "lost"], "lost exists already"),
        (["report", "none.mcap", "--out", "file/report"], "cannot write"),
        (["race", "--out", "lost"], "lost exists already"),
    ],
)
def test_refused_before_any_work(tmp_path: Path, words: list[str], said: str) -> None:
    (tmp_path / "junk.pt").write_bytes(b"no checkpoint")
    (tmp_path / "file").write_text("")
    (tmp_path / "lost").symlink_to("nowhere")
    done = answer(*words, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, ""), done
    assert done.stderr.startswith("sprintlab: ") and done.stderr.count("\n") == 1
    assert said in done.stderr
    assert sorted(os.listdir(tmp_path)) == ["file", "junk.pt", "lost"]


def test_doctor_imports_nothing_that_takes_long(tmp_path: Path) -> None:
    done = answer("doctor", "--json", cwd=tmp_path)
    assert '"not tried"' in done.stdout and "imported" not in done.stderr + done.stdout


def test_versions_are_known_without_installed_metadata(monkeypatch) -> None:
    from importlib import metadata

    from sprintlab.core.extras import package_version

    real = metadata.version

    def version(name: str) -> str:
        if name == "sprintlab":
            raise metadata.PackageNotFoundError(name)
        return real(name)

    monkeypatch.setattr(metadata, "version", version)
    assert package_version("sprintlab") == sprintlab.__version__


def test_a_race_from_a_source_tree_names_its_versions(monkeypatch, tmp_path: Path) -> None:
    from importlib import metadata

    from sprintlab.core.extras import package_version
    from sprintlab.evaluation import race_files

    def missing(name: str) -> str:
        if name == "sprintlab":
            raise metadata.PackageNotFoundError(name)
        return "1"

    monkeypatch.setattr(metadata, "version", missing)
    assert [package_version(name) for name in race_files.SOFTWARE].count(sprintlab.__version__) == 1
