"""Fields are refused by name."""

import json
import math
import pickle

import numpy as np
import pytest

from sprintlab.core.checks import check_choice, check_finite, check_interval, check_positive, check_range
from sprintlab.core.errors import InvalidValueError, MissingValueError, SprintlabError
from sprintlab.core.extras import require_package
from sprintlab.core.json_values import json_ready


@pytest.mark.parametrize(
    "value", [math.nan, -math.inf, True, "1", None, [1.0], 10**400, 1j],
    ids=["nan", "-inf", "truth", "text", "none", "list", "huge", "complex"],
)  # fmt: skip
def test_only_finite_numbers_pass(value):
    with pytest.raises(InvalidValueError, match=r"mass = .*finite number"):
        check_finite("mass", value)


@pytest.mark.parametrize("library", ["numpy", "torch"])
def test_every_element_is_looked_at(library):
    asarray = pytest.importorskip(library).asarray
    check_finite("mass", asarray([1.0, 2.0]))
    with pytest.raises(InvalidValueError, match="mass"):
        check_finite("mass", asarray([1.0, math.nan]))
    with pytest.raises(InvalidValueError, match="mass"):
        check_positive("mass", asarray([1.0, 0.0]))
    with pytest.raises(InvalidValueError, match="mass"):
        check_range("mass", asarray([1.0, 3.0]), 0.0, 2.0)


def test_only_pairs_of_bounds_pass():
    check_interval("friction", (0.1, 2.0), 0.1, 2.0)
    for pair in ((0.5, 0.4), (0.0, 0.5), (0.5, 3.0), (0.5,), (0.5, 0.6, 0.7)):
        with pytest.raises(InvalidValueError, match="friction"):
            check_interval("friction", pair, 0.1, 2.0)


def test_choice_lists_what_could_be_chosen():
    check_choice("method", "sprint", ("sprint", "baseline"))
    with pytest.raises(
        InvalidValueError, match="method = 'spirnt' is not allowed: choose one of sprint, baseline"
    ):
        check_choice("method", "spirnt", ("sprint", "baseline"))


def test_invalid_value_crosses_a_process_border():
    error = pickle.loads(pickle.dumps(InvalidValueError("mass", -1.0, "must be positive")))
    assert (error.field, error.value, error.allowed) == ("mass", -1.0, "must be positive")
    assert (
        str(pickle.loads(pickle.dumps(MissingValueError("mass", "give one")))) == "mass is missing: give one"
    )


def test_arrays_become_lists_and_what_is_not_finite_null():
    value = {"a": np.array([[1.0, math.nan]]), "b": (np.float32(0.5), np.int64(3), np.bool_(True), -math.inf)}
    found = json_ready(value)
    assert found == {"a": [[1.0, None]], "b": [0.5, 3, True, None]}
    assert json.loads(json.dumps(found, allow_nan=False)) == found


def test_a_missing_package_is_named_with_its_extra():
    require_package("numpy", extra="play", use="this test")
    with pytest.raises(SprintlabError, match=r"this test needs the package no_such_package.*sprintlab\[play"):
        require_package("no_such_package", extra="play", use="this test")
