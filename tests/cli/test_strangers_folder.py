"""A command that is started in a stranger's folder runs no Python that lies there."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import sprintlab
from sprintlab.core.reading import read_toml

SCRIPT = """
import os, sys
from pathlib import Path
from sprintlab.api.doctor import doctor
from sprintlab.deployment.log import LogFacts, McapRunLog
from sprintlab.evaluation.pool import WorkerProcesses
from sprintlab.evaluation.video import working_gl_backend

if __name__ == "__main__":
    os.chdir(sys.argv[1])
    McapRunLog(Path("../run.mcap"), LogFacts(robot="bp2", contract="{}")).close()
    with WorkerProcesses(2) as processes:
        assert list(processes.map(abs, [-1, 2])) == [1, 2]
    working_gl_backend()
    doctor()
"""


@pytest.mark.skipif(sys.version_info < (3, 11), reason="Python 3.10 cannot be told where not to look")
def test_what_the_package_starts_for_a_script_of_ones_own_imports_nothing_from_there_either(
    tmp_path: Path,
) -> None:
    """The log's writer, worker processes and probes ran a struct.py that lay there."""
    pytest.importorskip("mcap")
    (tmp_path / "script.py").write_text(SCRIPT)
    strange = tmp_path / "strange"
    strange.mkdir()
    for module in ("struct", "multiprocessing", "mujoco", "torch"):
        (strange / f"{module}.py").write_text(f"open('{module} ran', 'w').close()")
    before = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    subprocess.run([sys.executable, tmp_path / "script.py", strange], env=before, check=True)
    assert not list(strange.glob("* ran"))


DRAWS = """
import sys
from sprintlab.cli.status import exit_status

def work():
    from matplotlib import rcParams
    from sprintlab.core import theme
    return int(rcParams["text.usetex"])

sys.exit(exit_status("command", work))
"""


def test_no_matplotlib_is_used_that_evaluates_the_settings_in_the_working_folder() -> None:
    """It reads ./matplotlibrc; up to 3.10.8 its color cycle was evaluated, and could run anything."""
    project = read_toml(Path(__file__).parents[2] / "pyproject.toml")["project"]
    (matplotlib,) = (each for each in map(Requirement, project["dependencies"]) if each.name == "matplotlib")
    assert "3.10.8" not in matplotlib.specifier


@pytest.mark.skipif(sys.platform == "win32", reason="makes a pipe and a link")
@pytest.mark.parametrize("kind", ["pipe", "link"])
def test_what_somebody_put_into_the_folder_of_temporary_files_stops_no_policy(
    tmp_path: Path, kind: str
) -> None:
    """ONNX Runtime read and wrote ``.ses`` there, and told its maker of every policy that was loaded."""
    letter, place = tmp_path / "letter", tmp_path / ".ses"
    letter.write_text("precious")
    if kind == "pipe":
        os.mkfifo(place)
    else:
        place.symlink_to(letter)
    environment = {name: value for name, value in os.environ.items() if name != "ORT_DISABLE_TELEMETRY"}
    home = tmp_path / "home"
    environment |= {"TMPDIR": str(tmp_path), "HOME": str(home), "XDG_CACHE_HOME": str(home)}
    code = "from sprintlab.control import load_policy, shipped_policy; load_policy(shipped_policy())"
    subprocess.run([sys.executable, "-c", code], env=environment, timeout=60, check=True)
    assert letter.read_text() == "precious" and place.exists() and not home.exists()


def test_the_package_imports_onnx_runtime_in_one_place() -> None:
    """Where it is kept quiet: what is imported elsewhere first would speak."""
    found = [
        path.name
        for path in Path(sprintlab.__file__).parent.rglob("*.py")
        if re.search(r"^\s*(import|from) onnxruntime", path.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert found == ["onnx_runtime.py"]
