"""What JSON cannot say becomes what it can."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from sprintlab.core.json_values import json_ready


@pytest.mark.parametrize(
    ("value", "ready"),
    [
        ({"a": np.array([[1.0, math.nan]]), "b": (np.float32(0.5),)}, {"a": [[1.0, None]], "b": [0.5]}),
        ([np.int64(3), -0.0], [3, -0.0]),
        ([np.bool_(True), -math.inf, None, "text"], [True, None, None, "text"]),
        (np.float64(math.inf), None),
    ],
)  # fmt: skip
def test_arrays_become_lists_and_what_is_not_finite_null(value, ready):
    found = json_ready(value)
    assert found == ready and json.loads(json.dumps(found, allow_nan=False)) == ready
