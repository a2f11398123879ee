"""How a number of a run is named, written and explained: the same in every table and every JSON file."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One field of ``TrialMetrics`` as people and programs read it."""

    field: str = ""  # its name in ``TrialMetrics``
    key: str  # in JSON files
    name: str  # in tables
    digits: int  # behind the point
    unit: str  # as text; empty for a ratio
    meaning: str  # half a sentence


def shown(key: str, name: str, digits: int, unit: str, meaning: str) -> Any:
    """A field of a dataclass that tables and JSON files show; the arguments are those of ``Quantity``."""
    quantity = Quantity(key=key, name=name, digits=digits, unit=unit, meaning=meaning)
    return dataclasses.field(default=math.nan, metadata={"quantity": quantity})


def shown_fields(kind: type) -> tuple[Quantity, ...]:
    """The quantities that a dataclass declares with ``shown``, in their order."""
    marked = [item for item in dataclasses.fields(kind) if "quantity" in item.metadata]
    return tuple(dataclasses.replace(item.metadata["quantity"], field=item.name) for item in marked)
