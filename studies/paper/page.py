"""``python -m studies.paper page``: the study's page, whole, from the committed results."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING

from studies.paper.plan import PAPER_PRESET, RESULTS

if TYPE_CHECKING:
    from studies.paper.answers import Evidence
    from studies.paper.record import EvaluationRecord

    Grouped = dict[str, list[EvaluationRecord]]

FIGURES = {
    "methods": "The most that is held: every seed, a method's mean, and the paper's number.",
    "learning": "Speed of the fastest robots in training over time, each with the motor of its own training: "
    "mean and range over the seeds.",
    "worlds-no-envelope": "A policy that was trained without limits, with that motor and with the real one.",
    "sprint": "Speeds, hind hips and hind knees in training and over 100 m, of `sprint` and of a policy that "
    "was trained without limits.",
}
"""Pictures that the page shows where they were drawn, and how to read them."""
MORE_FIGURES = {
    "envelopes": "What each motor can give under the three models.",
    "worlds-baseline": "`baseline` with the motor of its training and with the real one.",
    "worlds-simplified-dc": "`simplified-dc` with the motor of its training and with the real one.",
    "worlds-flux-weakening": "`flux-weakening` with the motor of its training and with the real one.",
    "worlds-hound": "`hound` with the motor of its training and with the real one.",
    "command-modes": "`sprint` under four ways of changing the command.",
    "estimate": "What `sprint` estimates of its own body over 100 m, and what the simulator knows.",
}
"""Those that a reader opens."""


@dataclass(frozen=True, kw_only=True)
class Page:
    """Write the study's page from the results that there are; what is not trained is left out by name.

    Attributes:
        results: folder of the committed results, with the paper's preset in a folder of its own.
        out: the page.
        figures: folder of the pictures, made by ``python -m studies.paper figures``.
    """

    results: Path = RESULTS
    out: Path = Path("docs/study.md")
    figures: Path = Path("docs/figures")

    def run(self) -> int:
        """Read, write.

        Raises:
            SprintlabError: the results are no folder, one is damaged, or the disk refuses.
        """
        from sprintlab.core.files import atomic_write_text, check_writable_file
        from sprintlab.core.reading import check_folder

        check_folder(self.results)  # without it the page would lose its results
        check_writable_file(self.out)
        pictures, more = self._pictures(FIGURES), self._pictures(MORE_FIGURES)
        atomic_write_text(self.out, page_text(self.results, pictures, more))
        print(self.out)
        return 0

    def _pictures(self, captions: Mapping[str, str]) -> list[str]:
        """The pictures that there are, in Markdown, as seen from the page, each with its caption."""
        found = {self.figures / f"{name}.png": caption for name, caption in captions.items()}
        return [
            f"![{path.stem}]({Path(os.path.relpath(path, self.out.parent)).as_posix()})\n\n{caption}"
            for path, caption in found.items()
            if path.is_file()
        ]


def page_text(results: Path, pictures: Sequence[str] = (), more: Sequence[str] = ()) -> str:
    """The whole page in Markdown; errors as in ``read_evaluation``.

    Args:
        results: folder of the committed results.
        pictures: in Markdown, to show.
        more: in Markdown, to fold.
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
    parts += pictures
    if more:
        parts.append(_folded("More figures", "\n\n".join(more)))
    if known.own_motors:
        parts.append(
            _folded("With the motor of the training, and with the real one", own_motors_table(known))
        )
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
    from studies.paper.own_motor import own_motor_records
    from studies.paper.runs import find_runs
    from studies.paper.table import method_rows
    from studies.paper.variants import variant_speeds

    kept = find_runs(results) if grouped else []
    return Evidence(
        rows={row.method: row for row in method_rows(grouped)},
        literal={row.method: row for row in method_rows(literal)},
        variants=variant_speeds(kept),
        comparators=tuple(COMPARATORS),
        own_motors=own_motor_records(kept),
        literal_own_motors=own_motor_records(find_runs(results / PAPER_PRESET)) if literal else {},
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


def own_motors_table(known: Evidence) -> str:
    """Speeds of the kept policies with both motors, and what they ask for that the real one lacks."""
    from sprintlab.evaluation.quantities import number
    from studies.paper.pages import markdown_table
    from studies.paper.record import number as value

    columns = ("method", "motor in training", "v*", "held with it", "held with the real one")
    joints = tuple(dict.fromkeys(name for found in known.own_motors.values() for name in found.impossible))
    rows = [
        [
            method,
            found.motor_model,
            f"{found.top_speed:g}",
            number(value(found.held_speed_own), 2),
            number(value(found.held_speed_refined), 2),
            *(_share(found.impossible.get(name)) for name in joints),
        ]
        for method, found in known.own_motors.items()
    ]
    heads = (*columns, *(f"impossible: {name}" for name in joints))
    note = "One nominal trial each of the kept policy, at the command at which it holds most [m/s]."
    return f"{markdown_table(heads, rows)}\n\n{note}"


def _share(value: float | None) -> str:
    return "-" if value is None else f"{100.0 * value:.1f} %"


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
