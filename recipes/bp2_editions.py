"""Write the parameter tables of the BP2 editions anew from their choices in ``sprintlab.robots.surrogate``.

    python recipes/bp2_editions.py

Rows that do not follow from a choice (geometry, stops, gains, friction) are bp2's own: edit them there, then
run this.
"""

from __future__ import annotations

from pathlib import Path

from sprintlab import robots
from sprintlab.core.files import atomic_write_text
from sprintlab.robots.surrogate import EDITIONS, surrogate_table, table_text

_ENDS = {"bp2": "nominal", "bp2-weak": "weak end of the uncertainties", "bp2-strong": "strong end"}
HEADING = """# BP2 surrogate, second edition, {end}.
# Nothing of BP2's geometry, springs or motors is public: this is a set of stated assumptions. Motor and gears
# were chosen by the speed limits that follow from them, before any training (docs/speed-limit.md); the rest
# is derived from published machines. Written by recipes/bp2_editions.py.
#
# Each entry: value, SI unit, uncertainty, basis. Frames: x forward, y left, z up; links are given for a left
# leg, the right one mirrors y. Motor quantities are on the motor's side of the gear."""


def text_of(name: str) -> str:
    """The table of an edition as it stands in the package."""
    return table_text(surrogate_table(EDITIONS[name], name), HEADING.format(end=_ENDS[name]))


def main() -> None:
    """Write the tables that differ."""
    for name in EDITIONS:
        path = Path(robots.__file__).parent / name / "parameters.toml"
        text = text_of(name)
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(exist_ok=True)
            atomic_write_text(path, text)
            print(f"wrote {path}")


if __name__ == "__main__":
    main()
