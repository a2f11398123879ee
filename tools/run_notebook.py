"""Run a notebook's cells in this process and keep what they show, without Jupyter.

python tools/run_notebook.py examples/quickstart.ipynb

The cells run in a copy of the notebook's folder. HTML of more than 100 kB (a replay) stays out of the file: a
notebook server shows it when the cell runs.
"""

from __future__ import annotations

import ast
import base64
import io
import json
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
PICTURE_WIDTH = 760
"""Width to which pictures are reduced [pixels]: a notebook is text, and small."""
LARGEST_HTML = 100_000


def run_notebook(path: Path) -> None:
    """Execute every code cell in order and write the notebook with its outputs."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    names: dict[str, Any] = {"__name__": "__main__"}
    codes = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    home = Path.cwd()
    with tempfile.TemporaryDirectory() as copy:
        shutil.copytree(path.parent, copy, dirs_exist_ok=True)
        os.chdir(copy)
        for count, cell in enumerate(codes, start=1):
            shown = executed("".join(cell["source"]), names)
            cell["execution_count"] = count
            cell["outputs"] = [] if shown is None else [output(shown, count)]
        os.chdir(home)
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def executed(source: str, names: dict[str, Any]) -> Any:
    """Run a cell; its last expression's value, ``None`` where it ends in a statement."""
    *body, last = ast.parse(source).body
    exec(compile(ast.Module(body, []), "cell", "exec"), names)
    if isinstance(last, ast.Expr):
        return eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    exec(compile(ast.Module([last], []), "cell", "exec"), names)
    return None


def output(shown: Any, count: int) -> dict[str, Any]:
    """A value as a notebook keeps it: picture, table, or text."""
    if hasattr(shown, "_repr_png_"):
        data = {"image/png": small_picture(shown._repr_png_()), "text/plain": "<Figure>"}
    elif hasattr(shown, "_repr_mimebundle_"):
        data = {kind: text for kind, text in shown._repr_mimebundle_().items() if len(text) < LARGEST_HTML}
    else:
        data = {"text/plain": repr(shown)}
    data = {kind: text.replace(f"{ROOT}/", "") for kind, text in data.items()}
    lines = {kind: text if kind == "image/png" else text.splitlines(True) for kind, text in data.items()}
    return {"output_type": "execute_result", "execution_count": count, "metadata": {}, "data": lines}


def small_picture(png: bytes) -> str:
    """A PNG of ``PICTURE_WIDTH`` with 64 colours, base64."""
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    height = picture.height * PICTURE_WIDTH // picture.width
    small = io.BytesIO()
    picture.resize((PICTURE_WIDTH, height)).quantize(64).save(small, "PNG", optimize=True)
    return base64.b64encode(small.getvalue()).decode()


if __name__ == "__main__":
    run_notebook(Path(sys.argv[1]))
