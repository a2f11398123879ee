"""``python -m studies.paper page``: the study's page, whole, from the committed results."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING

from studies.paper.plan import PAPER_PRESET, RESULTS

if TYPE_CHECKING:
    from studies.paper.answers import Evidence
    from studies.paper.record import EvaluationRecord

    Grouped = dict[str, list[EvaluationRecord]]


@dataclass(frozen=True, kw_only=True)
class Page:
    """Write the study's page from the results that there are; what is not trained is left out by name.

    Attributes:
        results: folder of the committed results, with the paper's preset in a folder of its own.
        out: the page.
    """

    results: Path = RESULTS
    out: Path = Path("docs/study.md")

    def run(self) -> int:
        """Read, write.

        Raises:
            SprintlabError: the results are no folder, one is damaged, or the disk refuses.
        """
        from sprintlab.core.files import atomic_write_text, check_writable_file
        from sprintlab.core.reading import check_folder

        check_folder(self.results)  # without it the page would lose its results
        check_writable_file(self.out)
        atomic_write_text(self.out, page_text(self.results))
        print(self.out)
        return 0


def page_text(results: Path) -> str:
    """The whole page in Markdown; errors as in ``read_evaluation``.

    Args:
        results: folder of the committed results.
    """
    from studies.paper.answers import answers, confirmed
    from studies.paper.pages import result_tables

    grouped, literal = _grouped(results), _grouped(results / PAPER_PRESET)
    known = evidence(results, grouped, literal)
    main, *others = result_tables(grouped)
    titled = [f"**{item.question}** {item.text}" for item in answers(known)]
    parts = [
        "# The study of the six methods",
        confirmed(known.rows),
        *titled,
        _remarks(grouped),
        _missing(known),
        REPEAT,
    ]
    if grouped:
        parts += ["## Methods", main.markdown()]
    parts += ["## The paper's Table III and ours", reported_table(known)]
    if literal:
        parts.append(_folded("The paper's reward table to the letter", result_tables(literal)[0].markdown()))
    if known.variants:
        parts.append(_folded("Other editions, Drake, flux weakening", variants_table(known)))
    parts += [_folded(table.title, table.markdown()) for table in others if table.rows]
    return "\n\n".join(part for part in parts if part) + "\n"


REMARKS = Path(__file__).parent / "remarks.md"
REPEAT = (
    "All numbers, settings and one policy of each method (its median seed's, where that is left): "
    "`studies/paper/results`. How to train, evaluate and draw it again: `studies/paper/README.md`."
)


def evidence(results: Path, grouped: Grouped, literal: Grouped) -> Evidence:
    """What the answers are made from."""
    from sprintlab.training.methods import COMPARATORS
    from studies.paper.answers import Evidence
    from studies.paper.runs import find_runs
    from studies.paper.table import method_rows
    from studies.paper.variants import variant_speeds

    kept = find_runs(results) if grouped else []
    return Evidence(
        rows={row.method: row for row in method_rows(grouped)},
        literal={row.method: row for row in method_rows(literal)},
        variants=variant_speeds(kept),
        comparators=tuple(COMPARATORS),
    )


def reported_table(known: Evidence) -> str:
    """The paper's Table III, reported numbers marked, and our row below; in Markdown."""
    from studies.paper.pages import markdown_table
    from studies.paper.paper import REFERENCE_METHOD, REPORTED

    rows = [
        [name, *("-" if speed is None else f"{speed:g}" for speed in speeds), "reported"]
        for name, *speeds in REPORTED
    ]
    ours = known.rows.get(REFERENCE_METHOD)
    if ours is not None:
        speed = ours.most_held.text(2)
        rows.append([f"surrogate of BP2, `{REFERENCE_METHOD}`", speed, "-", "measured by us"])
    return markdown_table(("robot", "simulation [m/s]", "outdoors [m/s]", ""), rows)


def variants_table(known: Evidence) -> str:
    """The most that the kept policy of each method holds in every variant, in Markdown."""
    from sprintlab.evaluation.quantities import number
    from studies.paper.pages import markdown_table
    from studies.paper.variants import VARIANTS

    rows = [
        [method, *(number(speeds.get(name, float("nan")), 2) for name in VARIANTS)]
        for method, speeds in known.variants.items()
    ]
    note = "The most that the kept policy holds, raw command [m/s]; trained on the nominal robot."
    columns = ("method", *(variant.title for variant in VARIANTS.values()))
    return f"{markdown_table(columns, rows)}\n\n{note}"


def _remarks(grouped: Grouped) -> str:
    """What the numbers mean, in the words of whoever looked at them; none where there are no numbers."""
    return REMARKS.read_text(encoding="utf-8").strip() if grouped else ""


def _grouped(folder: Path) -> Grouped:
    """Records by method, the paper's first; methods without any are left out."""
    from studies.paper.runs import by_method, committed_records, find_runs

    if not folder.is_dir() or not any(folder.glob("*/seed-*/evaluation.json")):
        return {}
    grouped = by_method(committed_records(find_runs(folder)))
    return {method: records for method, records in grouped.items() if records}


def _missing(known: Evidence) -> str:
    """Names of the study's methods that have no row yet."""
    from studies.paper.plan import study_trainings

    trainings = study_trainings()
    lacking: dict[str, list[str]] = {}
    for rows, preset in ((known.rows, "sprintlab"), (known.literal, PAPER_PRESET)):
        names = dict.fromkeys(each.method for each in trainings if each.preset == preset)
        lacking[preset] = [f"`{name}`" for name in names if name not in rows]
    parts = [f"with preset `{preset}` {', '.join(names)}" for preset, names in lacking.items() if names]
    return f"Not evaluated yet: {'; '.join(parts)}." if parts else ""


def _folded(title: str, body: str) -> str:
    """A part that a reader opens."""
    return f'??? info "{title}"\n\n{indent(body, "    ")}'
