"""Packages that only an extra brings: what needs one says so in one sentence before any work."""

from __future__ import annotations

import importlib
import importlib.util
import os
from importlib import metadata
from pathlib import Path

from sprintlab.core.errors import SprintlabError


def require_package(module: str, *, extra: str, use: str) -> None:
    """Refuse where a module, e.g. ``"viser"``, of an extra of sprintlab is not installed."""
    if importlib.util.find_spec(module) is None:
        raise SprintlabError(
            f"{use} needs the package {module}, which is not installed: pip install 'sprintlab[{extra}]'"
        )


def keep_compiled_code_private() -> None:
    """Let PyTorch keep what it compiles in the account's home: others can write to /tmp."""
    os.environ.setdefault("TORCHINDUCTOR_CACHE_DIR", str(Path.home() / ".cache" / "sprintlab" / "torch"))


def package_version(name: str) -> str:
    """Version of an installed package; ``importlib.metadata.PackageNotFoundError`` for any other.

    sprintlab's own also where it runs from a source tree.
    """
    return str(importlib.import_module(name).__version__) if name == "sprintlab" else metadata.version(name)
