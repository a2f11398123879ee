"""``import sprintlab as sl``: light, complete, and usable from a plain script and a notebook."""

import ast
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import sprintlab as sl
from sprintlab.core.errors import InvalidValueError, PolicyFileError, SprintlabError

ROOT = Path(__file__).resolve().parents[2]
HEAVY = ("numpy", "torch", "mujoco", "onnxruntime", "matplotlib", "rich", "msgspec", "scipy", "warp")


def run_python(*arguments, folder=ROOT):
    return subprocess.run(
        [sys.executable, *map(str, arguments)], capture_output=True, text=True, cwd=folder, check=False
    )


def test_importing_loads_nothing_else():
    code = f"""
import sys
before = set(sys.modules)
import sprintlab
loaded = {{name.partition(".")[0] for name in set(sys.modules) - before}}
assert not loaded & set({HEAVY!r}), loaded
assert loaded <= {{"sprintlab", "__future__"}}, loaded
"""
    result = run_python("-c", code)
    assert result.returncode == 0, result.stderr


def test_every_public_name_is_there_and_declared_for_type_checkers():
    assert set(sl.__all__) <= set(dir(sl))
    assert all(getattr(sl, name) is not None for name in sl.__all__)
    tree = ast.parse((ROOT / "src/sprintlab/__init__.py").read_text(encoding="utf-8"))
    guarded = next(node for node in tree.body if isinstance(node, ast.If))
    declared = {
        alias.asname or alias.name: node.module
        for node in guarded.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert declared == {name: f"sprintlab.{home}" for name, home in sl._HOMES.items()}
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        sl.nothing  # noqa: B018


def test_policies_are_found_by_name_and_no_file_hides_them(tmp_path, monkeypatch):
    found = sl.policies()
    go1 = found.to_dict()["go1-sprint"]
    assert go1["robot"] == "go1" and Path(go1["path"]).is_file() and "go1-sprint" in str(found)
    with pytest.raises(PolicyFileError, match="no policy named 'no-such'"):
        sl.load_policy("no-such")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sprint").write_bytes(b"no policy")
    assert sl.load_policy("sprint").contract.robot_name == "bp2"
    with pytest.raises(PolicyFileError, match="damaged or not a sprintlab policy"):
        sl.load_policy("./sprint")


@pytest.mark.usefixtures("short_trials", "blank_pictures")  # tests/cli/test_race.py draws a report's
def test_a_race_runs_the_robot_of_the_contract_prints_and_draws_itself(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    go2_race = sl.race("go2-sprint", top_speed=2.0, distance=2.0, trials=1, workers=1)
    numbers = go2_race.to_dict()
    assert numbers["robot"] == "go2" and numbers["trials"] == 1 and not list(tmp_path.iterdir())
    assert numbers["held_speed_m_s"] == pytest.approx(2.0, abs=0.3)
    assert f"{numbers['held_speed_m_s']:.2f}" in str(go2_race) and "audit" in repr(go2_race)
    assert go2_race.plot("gait")._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(InvalidValueError, match="torque_speed"):
        go2_race.plot("gate")
    page = go2_race.report("mine")
    assert page == Path("mine/report.html") and page.is_file() and Path("mine/replay.html").is_file()
    with pytest.raises(SprintlabError, match="exists already"):
        go2_race.report("mine")


@pytest.mark.slow
@pytest.mark.usefixtures("brief_trials", "blank_pictures")
def test_the_notebook_runs(tmp_path, monkeypatch, load_script):
    pytest.importorskip("torch")
    shutil.copytree(ROOT / "examples" / "motors", tmp_path / "motors")
    monkeypatch.chdir(tmp_path)
    notebook = json.loads((ROOT / "examples/quickstart.ipynb").read_text(encoding="utf-8"))
    codes = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] for cell in codes[1:]), "run tools/run_notebook.py"
    smaller = {
        "top_speed=3.0, distance=5.0": "top_speed=1.0, distance=0.5",
        "else 256": "else 8",
        "minutes=3": 'iterations=2, device="cpu"',
    }
    source = "\n#\n".join("".join(cell["source"]) for cell in codes)
    for full, tiny in smaller.items():
        assert source.count(full) == 1
        source = source.replace(full, tiny)
    executed, names = load_script("tools/run_notebook.py").executed, {}
    for cell in source.split("\n#\n"):
        executed(cell, names)
    assert "<pre" in names["race"]._repr_mimebundle_()["text/html"]
    assert "<iframe srcdoc=" in sl.replay([names["page"].parent])._repr_mimebundle_()["text/html"]
    assert names["settings"].reward["progress"].weight == 2.0
    assert names["run"].policy.is_file() and names["run"].to_dict()["iterations"] == 2
