"""``sprintlab doctor``: what is installed here, and what is missing for what."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from importlib import metadata

import tyro

from sprintlab.cli.output import plain_table, print_json, stdout_console

PACKAGES = ("sprintlab", "mujoco", "numpy", "onnxruntime", "matplotlib", "imageio-ffmpeg")
TRAINING_PACKAGES = ("torch", "warp-lang", "mujoco-warp", "rsl-rl-lib")


@dataclass(frozen=True, kw_only=True)
class Doctor:
    """Say what is installed, whether videos can be rendered and whether training is possible.

    Attributes:
        json: print JSON only.
    """

    json: tyro.conf.FlagCreatePairsOff[bool] = False

    def run(self) -> int:
        """Print the findings; nothing found missing is an error."""
        found = findings()
        if self.json:
            print_json(found)
            return 0
        table = plain_table("sprintlab doctor", "what", "found")
        for name, value in found.items():
            table.add_row(name, value or "not found")
        stdout_console().print(table)
        return 0


def installed_version(package: str) -> str | None:
    """Version of a distribution, ``None`` when it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def findings() -> dict[str, str | None]:
    """Name of what was looked for and what was found; ``None`` where there is nothing."""
    from sprintlab.evaluation.video import working_gl_backend

    found: dict[str, str | None] = {"python": platform.python_version(), "platform": platform.platform()}
    for package in (*PACKAGES, *TRAINING_PACKAGES):
        found[package] = installed_version(package)
    found["onnxruntime providers"] = _providers()
    found["OpenGL backend for videos"] = working_gl_backend()
    return found


def _providers() -> str | None:
    try:
        import onnxruntime
    except ImportError:
        return None
    return ", ".join(onnxruntime.get_available_providers())
