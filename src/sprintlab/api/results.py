"""Results: plain values for programs, tables for people, and a picture where there is one."""

from __future__ import annotations

import io
import math
import multiprocessing
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from html import escape
from importlib import import_module
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
UNITS = {
    "rad2_s2": "rad²/s²", "rad2_s": "rad²/s", "rad_s": "rad/s", "m_s2": "m/s²", "m_s": "m/s", "N_m": "N m",
    "degC": "degC", "percent": "%", "us": "µs", "ms": "ms", "kg": "kg", "Hz": "Hz", "s": "s", "m": "m",
    "J": "J", "W": "W", "V": "V", "A": "A",
}  # fmt: skip
"""Ends of keys of numbers, and the units that they mean."""
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
    """What a function found: it prints as tables, and gives its numbers as plain values."""

    numbers: Any  # plain values, ready for JSON; units in the keys
    shown: Sequence[RenderableType]  # tables and remarks, in the order in which they are printed
    found: Any = None  # the object of the package that measured it
    status: int = 0  # exit status of the command that found it
    page: Path | None = None  # an HTML file that a notebook shows in place of the tables
    serve: Callable[[], None] | None = None  # goes on until Ctrl-C, as a page does on which a robot is driven

    def to_dict(self) -> Any:
        """Plain values, ready for JSON; what is not finite is None."""
        return json_ready(self.numbers)

    def run(self) -> None:
        """Go on with what ``serve`` does, until Ctrl-C or its end."""
        if self.serve is not None:
            with suppress(KeyboardInterrupt):
                self.serve()

    def __rich_console__(self, *_: object) -> Iterator[RenderableType]:
        yield from self.shown

    def __str__(self) -> str:
        return self._printed().export_text().rstrip()

    __repr__ = __str__

    def _repr_mimebundle_(self, **_: Any) -> dict[str, str]:
        """For notebooks."""
        html = self._printed().export_html(inline_styles=True, code_format=_NOTEBOOK)
        if self.page is not None:
            source = escape(self.page.read_text(encoding="utf-8"))
            html = f'<iframe srcdoc="{source}" width="100%" height="520" style="border: 0"></iframe>'
        return {"text/plain": str(self), "text/html": html}

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
    """A result that also draws itself."""

    draw: Callable[[], Figure]

    def plot(self) -> Figure:
        """The result as a picture, which a notebook shows."""
        return in_notebook(self.draw())


def drawn(place: str, *arguments: Any) -> Callable[[], Figure]:
    """Draw with the function at a place in the package, imported only then: Matplotlib takes a while."""
    module, _, name = place.rpartition(".")
    return lambda: getattr(import_module(f"sprintlab.{module}"), name)(*arguments)


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


def quantities(
    title: str,
    numbers: Mapping[str, Any],
    *others: Mapping[str, Any],
    names: Sequence[str] = ("value",),
    units: Mapping[str, str] = {},
) -> Table:
    """One row a number: its name and unit follow from its key, such as ``top_speed_m_s``.

    Mappings give a row an entry; lists of other than numbers, and what is not known, none.

    Args:
        numbers: as JSON has them.
        others: the same numbers of further columns.
        units: units of keys that do not end in theirs.
    """
    columns = [dict(_flat(each)) for each in (numbers, *others)]
    keys = dict.fromkeys(key for each in columns for key in each)
    known = [key for key in keys if any(each.get(key) is not None for each in columns)]
    rows = (
        (name, *(cell(each.get(key)) for each in columns), unit)
        for key in known
        for name, unit in (name_and_unit(key, units),)
    )
    return table(title, "quantity", *names, "unit", numbers=names, rows=rows)


def _flat(numbers: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in numbers.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{key}: ")
        elif not isinstance(value, list | tuple) or (value and all(isinstance(x, float) for x in value)):
            yield f"{before}{key}", value


def records(title: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    """One row a record, one column a key, its unit in the heading."""
    named = {key: name_and_unit(key) for key in (rows[0] if rows else ())}
    heads = {key: f"{name} [{unit}]" if unit else name for key, (name, unit) in named.items()}
    right = [head for key, head in heads.items() if isinstance(rows[0][key], int | float | None)]
    return table(
        title, *heads.values(), numbers=right, rows=([cell(row.get(key)) for key in heads] for row in rows)
    )


def name_and_unit(key: str, units: Mapping[str, str] = {}) -> tuple[str, str]:
    """A key of a number as words, and the unit at its end: top speed and m/s of ``top_speed_m_s``."""
    names, unit = list[str](), ""
    for part in key.split(": "):
        end = next((end for end in UNITS if part.endswith(f"_{end}")), "")
        names.append(part.removesuffix(f"_{end}").replace("_", " "))
        unit = UNITS[end] if end else units.get(part, unit)
    return ": ".join(names), unit


def cell(value: Any) -> RenderableType:
    """A value as it stands in a table: five significant digits, yes and no, a dash where it is not known."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(str(cell(item)) for item in value)
    if isinstance(value, float):
        return f"{round(value, 12) + 0.0:.5g}"
    return value if isinstance(value, Text) else str(value)


def styled(markup: str) -> Text:
    """A text of our own with Rich's markup; text from a file must not stand in it."""
    return Text.from_markup(markup)


VERDICTS = {True: styled("[green]pass[/]"), False: styled("[bold red]FAIL[/]")}
"""Whether an item of the audit passed."""


@contextmanager
def kept(found: Result) -> Generator[None]:
    """Write a result's files in the block; if the disk refuses, ``found`` of the error is the result."""
    try:
        yield
    except UnwrittenError as error:
        error.found = found
        raise


def exit_if_worker() -> None:
    """End this process quietly if it is a worker that is still reading its parent's script.

    A script without ``if __name__ == "__main__":`` calls the same function again in every worker; the parent
    then says what is missing (``evaluation.pool``).
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise SystemExit(1)


def remark(text: str) -> None:
    """Say something on stderr, beside the result."""
    print(printable(text, longest=10 * len(text)), file=sys.stderr, flush=True)
