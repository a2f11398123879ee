"""Results as tables: on a terminal, in a notebook, and in ``print``."""

from __future__ import annotations

import io
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from rich.console import Console, ConsoleOptions, RenderableType
from rich.jupyter import JupyterMixin
from rich.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLAIN_WIDTH = 140
"""Columns of a table that does not go to a terminal."""


class Printed(JupyterMixin, ABC):
    """A result that prints itself: with rich, in a notebook, at the prompt and through ``print``."""

    @abstractmethod
    def tables(self) -> Iterable[RenderableType]:
        """Tables and remarks, in the order in which they are printed."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        yield from self.tables()

    def __str__(self) -> str:
        text = io.StringIO()
        Console(file=text, width=PLAIN_WIDTH, highlight=False, soft_wrap=True).print(self)
        return text.getvalue().rstrip()

    __repr__ = __str__


def plain_table(title: str, *columns: str, numbers: tuple[str, ...] = ()) -> Table:
    """A table with quiet lines; columns named in ``numbers`` are aligned to the right."""
    table = Table(
        title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, padding=(0, 2, 0, 0)
    )
    for column in columns:
        table.add_column(column, justify="right" if column in numbers else "left", header_style="dim")
    return table


def in_notebook(figure: Figure) -> Figure:
    """The figure, made to show itself as the result of a notebook's cell, whichever backend is set."""
    from sprintlab.core.theme import png_bytes

    figure.__dict__["_repr_png_"] = lambda: png_bytes(figure)
    return figure
