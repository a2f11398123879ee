"""Computed sections of a Markdown page: written between two marks, the text around them stays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_text


def section_marks(name: str) -> tuple[str, str]:
    """The comments that open and close section ``name``; a reader of the rendered page does not see them."""
    return f"<!-- computed: {name} -->", f"<!-- end of {name} -->"


def replace_section(page: Path, name: str, body: str) -> None:
    """Put ``body`` between the marks of section ``name``, in one step; the rest of the page stays as it is.

    Raises:
        SprintlabError: the page cannot be read or written, or has not exactly one pair of marks.
    """
    try:
        text = page.read_text(encoding="utf-8")
    except OSError as error:
        raise SprintlabError(f"cannot read {page}: {error.strerror or error}") from error
    start, end = section_marks(name)
    if text.count(start) != 1 or text.count(end) != 1 or text.index(start) > text.index(end):
        raise SprintlabError(f"{page} must have one {start!r} and after it one {end!r}")
    before, after = text[: text.index(start)], text[text.index(end) :]
    atomic_write_text(page, f"{before}{start}\n\n{body.strip()}\n\n{after}")


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; cells are text."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
