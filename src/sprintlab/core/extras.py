"""Packages that only an extra brings: what needs one says so in one sentence before any work."""

from __future__ import annotations

import importlib
import importlib.util
import os
from importlib import metadata
from pathlib import Path

from sprintlab.core.errors import SprintlabError


def require_package(module: str, *, extra: str, use: str) -> None:
    """Refuse where a module of an extra is not installed.

    Args:
        module: top-level name under which the package is imported, e.g. ``"viser"``.
        extra: extra of sprintlab that brings it.
        use: what needs it, as the subject of the sentence.

    Raises:
        SprintlabError: the module is not installed; the message is the command that installs it.
    """
    if importlib.util.find_spec(module) is None:
        raise SprintlabError(
            f"{use} needs the package {module}, which is not installed: pip install 'sprintlab[{extra}]'"
        )


def keep_compiled_code_private() -> None:
    """Let PyTorch keep what it compiles in the account's home, where nothing else is said.

    By itself it takes a folder of ``/tmp`` that bears the account's name. Any other account can make that
    folder first, and put its own code there, which PyTorch runs.
    """
    os.environ.setdefault("TORCHINDUCTOR_CACHE_DIR", str(Path.home() / ".cache" / "sprintlab" / "torch"))


def package_version(name: str) -> str:
    """Version of an installed package; sprintlab's own also where it runs from a source tree.

    Raises:
        importlib.metadata.PackageNotFoundError: another package is not installed.
    """
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        if name != "sprintlab":
            raise
        return str(importlib.import_module("sprintlab").__version__)
