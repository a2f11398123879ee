"""Results: plain values for programs, tables for people, and a picture where there is one."""

from __future__ import annotations

import io
import multiprocessing
import shlex
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

from sprintlab.core.errors import UnwrittenError, printable
from sprintlab.core.json_values import json_ready

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLAIN_WIDTH = 140
"""Columns of a table that does not go to a terminal."""
_NOTEBOOK = '<pre style="white-space: pre; overflow-x: auto; line-height: normal">{code}</pre>'
Progress = Callable[[str, float | None], None]
"""Called with what is being done and the share done, 0 to 1, or ``None`` where that is not known."""


def silent(what: str, share: float | None) -> None:
    """Progress that is not shown."""


class PlainConsole(Console):
    """A console that shows control characters and markup in texts, instead of obeying them."""

    def render_str(self, text: str, **options: Any) -> Text:
        """As Rich has it, with control characters shown as their codes."""
        lines = (printable(line, longest=10 * len(line)) for line in text.expandtabs().split("\n"))
        return super().render_str("\n".join(lines), **options)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Result:
    """What a function found: it prints as tables, and gives its numbers as plain values.

    Attributes:
        numbers: plain values, ready for JSON; units in the keys.
        shown: tables and remarks, in the order in which they are printed.
        found: the object of the package that measured it.
        status: exit status of the command that found it.
    """

    numbers: Any
    shown: Sequence[RenderableType]
    found: Any = None
    status: int = 0

    def to_dict(self) -> Any:
        """Plain values, ready for JSON; what is not finite is None."""
        return json_ready(self.numbers)

    def __rich_console__(self, *_: object) -> Iterator[RenderableType]:
        yield from self.shown

    def __str__(self) -> str:
        return self._printed().export_text().rstrip()

    __repr__ = __str__

    def _repr_mimebundle_(self, **_: Any) -> dict[str, str]:
        """For notebooks."""
        page = self._printed().export_html(inline_styles=True, code_format=_NOTEBOOK)
        return {"text/plain": str(self), "text/html": page}

    def _printed(self) -> Console:
        """A console that keeps what is printed; not a notebook's, which would also show it at once."""
        console = PlainConsole(
            file=io.StringIO(), width=PLAIN_WIDTH, record=True, highlight=False, markup=False,
            soft_wrap=True, force_jupyter=False,
        )  # fmt: skip
        console.print(self)
        return console


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Drawn(Result):
    """A result that also draws itself.

    Attributes:
        draw: makes the figure.
    """

    draw: Callable[[], Figure]

    def plot(self) -> Figure:
        """The result as a picture, which a notebook shows."""
        return in_notebook(self.draw())


def in_notebook(figure: Figure) -> Figure:
    """The figure, made to show itself as the result of a notebook's cell, whichever backend is set."""
    from sprintlab.core.theme import png_bytes

    figure.__dict__["_repr_png_"] = lambda: png_bytes(figure)
    return figure


def table(
    title: str,
    *columns: str,
    numbers: Sequence[str] = ("value",),
    rows: Iterable[Iterable[RenderableType]] = (),
) -> Table:
    """A table without lines; columns named in ``numbers`` are aligned to the right."""
    made = Table(
        title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, padding=(0, 2, 0, 0)
    )
    for column in columns:
        made.add_column(column, justify="right" if column in numbers else "left", header_style="dim")
    for row in rows:
        made.add_row(*row)
    return made


def styled(markup: str) -> Text:
    """A text of our own with Rich's markup; text from a file must not stand in it."""
    return Text.from_markup(markup)


@contextmanager
def kept(found: Result) -> Generator[None]:
    """Write a result's files in the block; if the disk refuses, the error carries the result.

    Raises:
        UnwrittenError: as it was raised in the block; its ``found`` is the result.
    """
    try:
        yield
    except UnwrittenError as error:
        error.found = found
        raise


def leave_to_the_parent() -> None:
    """End this process quietly if it is a worker that is still reading its parent's script.

    A script without ``if __name__ == "__main__":`` calls the same function again in every worker; the parent
    then says what is missing (``evaluation.pool``).

    Raises:
        SystemExit: this is such a worker.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise SystemExit(1)


def remark(text: str) -> None:
    """Say something on stderr, beside the result."""
    print(printable(text, longest=10 * len(text)), file=sys.stderr, flush=True)


def command_line() -> str:
    """The command as it was typed, for reports and logs."""
    name = Path(sys.argv[0]).name or "python"
    return shlex.join([name.removesuffix(".py") if name == "__main__.py" else name, *sys.argv[1:]])
