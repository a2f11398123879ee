"""The tables of an ablation, and the computed sections of a page; the text around them stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sprintlab.core.errors import SprintlabError
from sprintlab.core.files import atomic_write_text
from sprintlab.core.reading import read_text
from sprintlab.evaluation.estimates import ESTIMATE_COLUMNS, estimate_cells
from studies.paper.record import COLLAPSE_SPEED
from studies.paper.table import (
    CLOCK_COLUMNS,
    DETAIL_COLUMNS,
    SEED_COLUMNS,
    TABLE_COLUMNS,
    Records,
    clock_cells,
    common_speed,
    detail_cells,
    method_estimates,
    method_rows,
    order_text,
    seed_cells,
    table_cells,
)

RESULT_SECTIONS = ("methods", "details", "seeds", "clock", "estimates")
"""Sections that ``update_results_page`` writes."""


_PAGE_LIMIT = 4 << 20
"""Largest page that is read [bytes]."""


def section_marks(name: str) -> tuple[str, str]:
    """The comments that open and close section ``name``; a reader of the rendered page does not see them."""
    return f"<!-- computed: {name} -->", f"<!-- end of {name} -->"


def replace_section(page: Path, name: str, body: str) -> None:
    """Put ``body`` between the marks of section ``name``, in one step; the rest of the page stays as it is.

    Raises:
        SprintlabError: the page cannot be read or written, or has not exactly one pair of marks.
    """
    text = _marked_text(page, name)
    start, end = section_marks(name)
    before, after = text[: text.index(start)], text[text.index(end) :]
    atomic_write_text(page, f"{before}{start}\n\n{body.strip()}\n\n{after}")


def check_sections(page: Path, names: Sequence[str]) -> None:
    """Refuse a page that lacks a section, before hours of work rather than after; errors as above."""
    for name in names:
        _marked_text(page, name)


def _marked_text(page: Path, name: str) -> str:
    """The page's text, which has the marks of section ``name`` once and in order."""
    text = read_text(page, _PAGE_LIMIT, what="page")
    start, end = section_marks(name)
    if text.count(start) != 1 or text.count(end) != 1 or text.index(start) > text.index(end):
        raise SprintlabError(f"{page} must have one {start!r} and after it one {end!r}")
    return text


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; cells are text."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


@dataclass(frozen=True, kw_only=True)
class TextTable:
    """A table for a terminal or a page.

    Attributes:
        name: of its section on a page.
        title: heading.
        columns: headings of the columns.
        rows: cells as text.
        note: how to read it.
    """

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str

    def markdown(self) -> str:
        """The table and its note, in Markdown."""
        return f"{markdown_table(self.columns, self.rows)}\n\n{self.note}"


def result_tables(grouped: Records) -> list[TextTable]:
    """Every table of an ablation: Table II, what stands behind it, each seed, the estimates."""
    rows = method_rows(grouped)
    everything = [record for group in grouped.values() for record in group]
    tables = [
        TextTable(
            name="methods",
            title="Table II",
            columns=TABLE_COLUMNS,
            rows=tuple(table_cells(row) for row in rows),
            note=f"{TABLE_NOTE} {order_text(rows)}".strip(),
        ),
        TextTable(
            name="details",
            title="Where each policy holds most, raw command",
            columns=DETAIL_COLUMNS,
            rows=tuple(detail_cells(row) for row in rows),
            note=_detail_note(common_speed(everything)),
        ),
        TextTable(
            name="seeds",
            title="Every policy",
            columns=SEED_COLUMNS,
            rows=tuple(seed_cells(record) for record in everything),
            note=SEED_NOTE,
        ),
        TextTable(
            name="clock",
            title="The policy's clock",
            columns=CLOCK_COLUMNS,
            rows=tuple(clock_cells(record) for record in everything),
            note=CLOCK_NOTE,
        ),
    ]
    return [*tables, *_estimate_tables(grouped)]


TABLE_NOTE = (
    "Speeds in m/s, times in s; interquartile mean over the seeds and its 95 % bootstrap "
    "interval (of three seeds, the mean). Sprint faster: probability that a seed of sprint beats one "
    "of this method. Most held: the most over all commands v* that nine of ten trials complete; at the "
    "highest v* a policy may hold less. J, 100 m and audit: where most is held. Ours is a surrogate robot: "
    f"compare orders and ratios. Collapse: less than {COLLAPSE_SPEED:g} m/s held."
)
SEED_NOTE = (
    "v*: the highest commanded speed that enough trials completed; max velocity: what is held there. "
    "Fastest: the most that was held, and at which of the commands that passed: there the 100 m are run. "
    "A time with a fall: it fell behind the line. Audit: what failed, if anything."
)
CLOCK_NOTE = (
    "Held speed in m/s with the policy's clock at its own rate, at two others, and with uneven periods; "
    "raw command. 100 %: a stride always takes the same number of policy steps; 0 %: the same time."
)
ESTIMATE_NOTE = (
    "Root mean square errors of the filtered estimate, as the policy used it, against the simulator; raw "
    "trials at the fastest speed of each seed, by the true forward speed. In a flight gait feet are in the "
    "air most of the time: who always said flight would be right as often as one minus the duty factor."
)


def _detail_note(speed: float | None) -> str:
    if speed is None:
        return "There is no speed that every policy passed."
    return f"J in rad²/s. Common speed: {speed:g} m/s, the highest that every policy passed and was tried at."


def _estimate_tables(grouped: Records) -> list[TextTable]:
    """One table a method whose policies estimate."""
    bands = {method: method_estimates(group) for method, group in grouped.items()}
    return [
        TextTable(
            name=f"estimates-{method}",
            title=f"Estimates of {method}",
            columns=ESTIMATE_COLUMNS,
            rows=tuple(estimate_cells(found)),
            note=ESTIMATE_NOTE,
        )
        for method, found in bands.items()
        if found
    ]


def update_results_page(page: Path, grouped: Records) -> None:
    """Put every table between the marks of the page; the estimates of all methods share one section.

    Raises:
        SprintlabError: the page cannot be read or written, or lacks a section's marks.
    """
    sections: dict[str, list[str]] = {name: [] for name in RESULT_SECTIONS}
    for table in result_tables(grouped):
        title = f"**{table.title}**\n\n" if table.name.startswith("estimates") else ""
        sections[table.name.split("-")[0]].append(f"{title}{table.markdown()}")
    for name, parts in sections.items():
        replace_section(page, name, "\n\n".join(parts) or "No policy with an estimator yet.")
