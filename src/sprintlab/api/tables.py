"""Results as tables: on a terminal, in a notebook, and in ``print``."""

from __future__ import annotations

import io
from abc import ABC, abstractmethod
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.table import Table
from rich.text import Text

from sprintlab.core.errors import UnwrittenError, printable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLAIN_WIDTH = 140
"""Columns of a table that does not go to a terminal."""
_NOTEBOOK = '<pre style="white-space: pre; overflow-x: auto; line-height: normal">{code}</pre>'


class PlainConsole(Console):
    """A console on which texts are texts: names from files are shown, never obeyed as markup or codes."""

    def render_str(self, text: str, **options: Any) -> Text:
        """As Rich has it, with control characters shown as their codes."""
        lines = (printable(line, longest=len(line)) for line in text.expandtabs().split("\n"))
        return super().render_str("\n".join(lines), **options)


def styled(markup: str) -> Text:
    """A text of our own with Rich's markup; what comes from a file must not stand in it."""
    return Text.from_markup(markup)


class Printed(ABC):
    """A result that prints itself: with rich, in a notebook, at the prompt and through ``print``."""

    @abstractmethod
    def tables(self) -> Iterable[RenderableType]:
        """Tables and remarks, in the order in which they are printed."""

    @abstractmethod
    def to_dict(self) -> dict[str, Any]:
        """Plain values, ready for JSON."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        yield from self.tables()

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
            file=io.StringIO(),
            width=PLAIN_WIDTH,
            record=True,
            highlight=False,
            markup=False,
            soft_wrap=True,
            force_jupyter=False,
        )
        console.print(self)
        return console


@contextmanager
def written_for(found: Printed) -> Generator[None]:
    """Within it a result's files are written: whoever called for them gets the result all the same.

    Raises:
        UnwrittenError: as it was raised in the block; its ``found`` is the result.
    """
    try:
        yield
    except UnwrittenError as error:
        error.found = found
        raise


class Drawn(Printed):
    """A result that also draws itself."""

    @abstractmethod
    def plot(self) -> Figure:
        """The result as a picture."""


def plain_table(
    title: str,
    *columns: str,
    numbers: tuple[str, ...] = ("value",),
    rows: Iterable[Iterable[RenderableType]] = (),
) -> Table:
    """A table with quiet lines; columns named in ``numbers`` are aligned to the right."""
    table = Table(
        title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, padding=(0, 2, 0, 0)
    )
    for column in columns:
        table.add_column(column, justify="right" if column in numbers else "left", header_style="dim")
    for row in rows:
        table.add_row(*row)
    return table


def in_notebook(figure: Figure) -> Figure:
    """The figure, made to show itself as the result of a notebook's cell, whichever backend is set."""
    from sprintlab.core.theme import png_bytes

    figure.__dict__["_repr_png_"] = lambda: png_bytes(figure)
    return figure
