"""The house rules: floors, no PyTorch below training, short functions, no code in ``__init__``."""

import ast
import re
import subprocess
import sys
from pathlib import Path

from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports

ROOT = Path(__file__).resolve().parents[1]
SOURCE = ROOT / "src" / "sprintlab"
FILES = sorted(SOURCE.rglob("*.py"))
BASE_PACKAGES = ["core", "motors", "robots", "control", "commands", "plant", "evaluation", "viewer"]
BASE_PACKAGES += ["api", "cli"]
LONGEST_FUNCTION = 100  # lines

IMPORT_WITHOUT_LEARNING = """
import importlib, pkgutil, sys
for name in ("torch", "warp", "mujoco_warp", "rsl_rl", "tensordict", "onnxscript"):
    sys.modules[name] = None  # importing it now raises ImportError
seen = 0
for name in sys.argv[1:]:
    package = importlib.import_module("sprintlab." + name)
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        importlib.import_module(module.name)
        seen += 1
print(seen)
"""


def test_every_package_keeps_to_its_floor():
    status = lint_imports(config_filename=str(ROOT / "pyproject.toml"), cache_dir=None)
    assert status == EXIT_STATUS_SUCCESS


def test_base_packages_import_without_the_training_extra():
    """All in one process: what one has imported without the extra, the next may have."""
    command = [sys.executable, "-c", IMPORT_WITHOUT_LEARNING, *BASE_PACKAGES]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert int(result.stdout) > 10 * len(BASE_PACKAGES)


def test_no_function_is_long():
    functions = [
        (path.relative_to(SOURCE), node)
        for path in FILES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    ]
    assert not [(str(path), f.name) for path, f in functions if f.end_lineno - f.lineno >= LONGEST_FUNCTION]


def test_init_files_only_pass_names_on():
    """But for the front door, which looks its names up when they are used: tests/api/test_front_door.py."""
    allowed = (ast.Import, ast.ImportFrom, ast.Assign, ast.AnnAssign, ast.Expr)
    for path in set(SOURCE.rglob("__init__.py")) - {SOURCE / "__init__.py"}:
        for statement in ast.parse(path.read_text(encoding="utf-8")).body:
            assert isinstance(statement, allowed), path
            assert not isinstance(statement, ast.Assign) or statement.targets[0].id.startswith("__"), path


def test_what_the_architecture_page_points_to_is_there():
    page = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    answers = page[page.index("## Where is what") : page.index("## What flows where")]
    named = re.findall(r"`((?:[a-z_]+\.)+[A-Za-z_]+)`", answers)
    found = [name for name in named if not name.startswith("sl.")]
    assert len(found) >= 10
    for name in found:
        folder, _, last = name.rpartition(".")
        if (SOURCE / name.replace(".", "/")).with_suffix(".py").is_file():
            continue
        place = SOURCE / folder.replace(".", "/")
        text = (place / "__init__.py" if place.is_dir() else place.with_suffix(".py")).read_text("utf-8")
        assert re.search(rf"\b{last}\b", text), name
