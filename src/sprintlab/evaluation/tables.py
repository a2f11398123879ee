"""Errors of the estimates by speed band, as text for any table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from sprintlab.evaluation.estimates import total_band
from sprintlab.evaluation.results import EstimateBand

ESTIMATE_COLUMNS = (
    "speed [m/s]",
    "policy steps",
    "forward bias [m/s]",
    "forward error [m/s]",
    "velocity error [m/s]",
    "height error [cm]",
    "contact right [%]",
)
"""Headings of ``estimate_cells``; errors are root mean squares."""


def estimate_cells(bands: Sequence[EstimateBand]) -> Iterator[tuple[str, ...]]:
    """One row a speed band, and one for all of them, as text under ``ESTIMATE_COLUMNS``."""
    total = total_band(bands)
    rows = [(f"{band.lower:g} to {band.upper:g}", band) for band in bands]
    for name, band in rows + ([("all", total)] if total is not None else []):
        yield (
            name,
            str(band.samples),
            f"{band.forward_bias:+.2f}",
            f"{band.forward_error:.2f}",
            f"{band.velocity_error:.2f}",
            f"{100 * band.height_error:.1f}",
            f"{100 * band.contact_accuracy:.1f}",
        )
