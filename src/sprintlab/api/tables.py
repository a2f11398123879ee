"""Results as tables on a terminal and in a notebook."""

from __future__ import annotations

from rich.table import Table


def plain_table(title: str, *columns: str, numbers: tuple[str, ...] = ()) -> Table:
    """A table with quiet lines; columns named in ``numbers`` are aligned to the right."""
    table = Table(
        title=title, title_justify="left", title_style="bold", box=None, pad_edge=False, padding=(0, 2, 0, 0)
    )
    for column in columns:
        table.add_column(column, justify="right" if column in numbers else "left", header_style="dim")
    return table
