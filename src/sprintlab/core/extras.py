"""Packages that only an extra brings: what needs one says so in one sentence before any work."""

from __future__ import annotations

import importlib.util

from sprintlab.core.errors import SprintlabError


def require_package(module: str, *, extra: str, use: str) -> None:
    """Refuse where a module of an extra is not installed.

    Args:
        module: top-level name under which the package is imported, e.g. ``"scipy"``.
        extra: of sprintlab that brings it.
        use: what needs it, as the subject of the sentence.

    Raises:
        SprintlabError: the module is not installed; the message is the command that installs it.
    """
    if importlib.util.find_spec(module) is None:
        raise SprintlabError(
            f"{use} needs the package {module}, which is not installed: pip install 'sprintlab[{extra}]'"
        )
