"""What the benchmarks share: arguments in, JSON or tables out, one sentence where something is refused."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_json

EVALUATION_PACKAGES = ("sprintlab", "mujoco", "onnxruntime", "numpy")
"""What an evaluation runs on."""


def answer(
    parse: Callable[[], argparse.Namespace],
    measure: Callable[[argparse.Namespace], Any],
    show: Callable[[Any], None],
) -> int:
    """Measure, write what ``--output`` names, print JSON with ``--json``, else what ``show`` makes of it.

    Returns:
        0, or 2 where an argument is refused.
    """
    try:
        chosen = parse()
        with redirect_stdout(sys.stderr):  # libraries describe themselves at length
            result = measure(chosen)
        if chosen.output is not None:
            atomic_write_json(chosen.output, result)
    except SprintlabError as error:
        print(f"{Path(sys.argv[0]).stem}: {error}", file=sys.stderr)
        return 2
    if chosen.json:
        print(json.dumps(result, indent=2))
    else:
        show(result)
    return 0


def circumstances(packages: Sequence[str]) -> dict[str, Any]:
    """Versions, the command as typed, and the date of a measurement."""
    return {
        "python": sys.version.split()[0],
        "packages": {package: package_version(package) for package in packages},
        "command_line": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
    }


def package_version(package: str) -> str | None:
    """Installed version; None if it is not installed, as where the sources are run in place."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
