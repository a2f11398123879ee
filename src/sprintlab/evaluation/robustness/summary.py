"""What the sprints of a study amount to."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from sprintlab.core.checks import check_range
from sprintlab.core.json_values import json_ready
from sprintlab.evaluation.robustness.draws import ALL, CAUSES, NOMINAL
from sprintlab.evaluation.robustness.study import Piece

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
"""Of the held speed of the sprints that stayed upright."""

_NORMAL_95 = 1.959963984540054  # quantile of the normal distribution for a two-sided 95 %


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Two-sided 95 % interval of a share (Wilson 1927): sensible at 0 and at 1, unlike the normal one.

    Raises:
        InvalidValueError: no trials, or more successes than trials.
    """
    check_range("trials", trials, 1, 10**9)
    check_range("successes", successes, 0, trials)
    share, squared = successes / trials, _NORMAL_95**2
    middle = (share + squared / (2 * trials)) / (1 + squared / trials)
    half = _NORMAL_95 / (1 + squared / trials)
    half *= math.sqrt(share * (1 - share) / trials + squared / (4 * trials**2))
    return max(0.0, middle - half), min(1.0, middle + half)


def summarize(pieces: Sequence[Piece]) -> dict[str, Any]:
    """The numbers of a study, JSON-ready.

    Speeds are those of sprints that stayed upright and reached the hold. ``causes`` are in the order of what
    they cost: change of the mean held speed against the nominal robot of the same seeds.
    """
    together, nominal = _group(pieces, ALL), _group(pieces, NOMINAL)
    causes = [_cause(cause, _group(pieces, cause), nominal) for cause in CAUSES]
    return json_ready(
        {
            **_shares(together),
            "held_speed_quantiles_m_s": dict(
                zip((f"{quantile:g}" for quantile in QUANTILES), _quantiles(together), strict=True)
            ),
            "finished": sum(piece["time_s"] is not None for piece in together),
            "left_lane": sum(piece["left_lane"] for piece in together),
            "falls": dict(Counter(piece["fall_reason"] for piece in together if not piece["upright"])),
            "nominal": {**_shares(nominal), "held_speed_m_s": _mean(held_speeds(nominal))},
            "causes": sorted(
                (row for row in causes if row["trials"]),
                key=lambda row: row["change_m_s"] if math.isfinite(row["change_m_s"]) else -math.inf,
            ),
        }
    )


def held_speeds(pieces: Sequence[Piece]) -> list[float]:
    """Held speeds [m/s] of the sprints that stayed upright and came so far."""
    return [piece["held_speed_m_s"] for piece in pieces if piece["upright"] and _known(piece)]


def _known(piece: Piece) -> bool:
    return piece["held_speed_m_s"] is not None


def _group(pieces: Sequence[Piece], group: str) -> list[Piece]:
    return [piece for piece in pieces if piece["group"] == group]


def _shares(pieces: Sequence[Piece]) -> dict[str, Any]:
    upright = sum(piece["upright"] for piece in pieces)
    lower, upper = wilson_interval(upright, len(pieces)) if pieces else (math.nan, math.nan)
    return {
        "trials": len(pieces),
        "upright": upright,
        "share_upright": upright / len(pieces) if pieces else math.nan,
        "interval_95": [lower, upper],
    }


def _quantiles(pieces: Sequence[Piece]) -> list[float]:
    speeds = held_speeds(pieces)
    return np.quantile(speeds, QUANTILES).tolist() if speeds else [math.nan] * len(QUANTILES)


def _cause(cause: str, alone: Sequence[Piece], nominal: Sequence[Piece]) -> dict[str, Any]:
    """What one cause costs: means over the seeds at which both it and the nominal robot stayed upright."""
    reference = {piece["seed"]: piece["held_speed_m_s"] for piece in nominal if piece["upright"]}
    changes = [
        piece["held_speed_m_s"] - reference[piece["seed"]]
        for piece in alone
        if piece["upright"] and _known(piece) and reference.get(piece["seed"]) is not None
    ]
    return {
        "cause": cause,
        **_shares(alone),
        "change_m_s": _mean(changes),
        "worst_change_m_s": min(changes, default=math.nan),
    }


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else math.nan
