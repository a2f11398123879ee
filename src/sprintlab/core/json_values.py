"""What JSON can say of a value."""

from __future__ import annotations

import math
from typing import Any, cast


def json_ready(value: Any) -> Any:
    """Arrays become lists, NumPy's numbers plain ones, and what is not finite null."""
    if hasattr(value, "tolist"):  # an array or a number of NumPy, which need not be imported for this
        value = value.tolist()
    if isinstance(value, dict):
        return {key: json_ready(item) for key, item in cast("dict[str, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [json_ready(item) for item in cast("list[Any]", value)]
    return None if isinstance(value, float) and not math.isfinite(value) else value
