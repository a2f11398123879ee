import math
import pickle

import pytest

from sprintlab.core.checks import check_choice, check_finite, check_interval, check_positive, check_range
from sprintlab.core.errors import InvalidValueError


@pytest.mark.parametrize(
    "value", [math.nan, math.inf, -math.inf, True, "1", None, [1.0], 10**400, 1j],
    ids=["nan", "inf", "-inf", "truth", "text", "none", "list", "huge", "complex"],
)  # fmt: skip
def test_what_is_no_finite_number_is_refused(value):
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


@pytest.mark.parametrize(
    "pair", [(0.5, 0.4), (0.0, 0.5), (0.5, 3.0), (0.5, math.inf), (0.5,), (0.5, 0.6, 0.7)]
)
def test_what_is_no_pair_of_bounds_is_refused(pair):
    check_interval("friction", (0.1, 2.0), 0.1, 2.0)
    with pytest.raises(InvalidValueError, match="friction"):
        check_interval("friction", pair, 0.1, 2.0)


@pytest.mark.parametrize("value", [-1e-12, 1.0 + 1e-12, math.nan])
def test_outside_a_range_is_refused(value):
    with pytest.raises(InvalidValueError, match="share"):
        check_range("share", value, 0.0, 1.0)


def test_choice_lists_what_could_be_chosen():
    check_choice("method", "sprint", ("sprint", "baseline"))
    with pytest.raises(
        InvalidValueError, match="method = 'spirnt' is not allowed: choose one of sprint, baseline"
    ):
        check_choice("method", "spirnt", ("sprint", "baseline"))


def test_invalid_value_crosses_a_process_border():
    error = pickle.loads(pickle.dumps(InvalidValueError("mass", -1.0, "must be positive")))
    assert (error.field, error.value, error.allowed) == ("mass", -1.0, "must be positive")
