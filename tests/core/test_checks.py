import math
import pickle

import numpy as np
import pytest

from sprintlab.core import errors
from sprintlab.core.checks import check_choice, check_finite, check_interval, check_positive, check_range
from sprintlab.core.errors import InvalidValueError, SprintlabError


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


def test_bounds_of_a_range_are_allowed():
    check_range("share", 0.0, 0.0, 1.0)
    check_range("share", 1, 0.0, 1.0)


@pytest.mark.parametrize("value", [-1e-12, 1.0 + 1e-12, math.nan])
def test_outside_a_range_is_refused(value):
    with pytest.raises(InvalidValueError, match="share"):
        check_range("share", value, 0.0, 1.0)


def test_message_names_field_value_and_what_is_allowed():
    with pytest.raises(InvalidValueError) as caught:
        check_range("motor.inductance", 0.08, 0.0, 0.01, "H")
    assert str(caught.value) == "motor.inductance = 0.08 is not allowed: must lie in [0, 0.01] H"
    assert (caught.value.field, caught.value.value) == ("motor.inductance", 0.08)


@pytest.mark.parametrize("value", [0, -1.0])
def test_positive_refuses_zero_and_less(value):
    with pytest.raises(InvalidValueError, match="greater than 0 kg"):
        check_positive("mass", value, "kg")


def test_choice_lists_what_could_be_chosen():
    check_choice("method", "sprint", ("sprint", "baseline"))
    with pytest.raises(
        InvalidValueError, match="method = 'spirnt' is not allowed: choose one of sprint, baseline"
    ):
        check_choice("method", "spirnt", ("sprint", "baseline"))


def test_invalid_value_crosses_a_process_border():
    error = pickle.loads(pickle.dumps(InvalidValueError("mass", -1.0, "must be positive")))
    assert (error.field, error.value, error.allowed) == ("mass", -1.0, "must be positive")


@pytest.mark.parametrize(
    "name",
    ["PolicyFileError", "ContractMismatchError", "RobotModelError", "SimulationError", "InvalidValueError"],
)
def test_one_except_clause_catches_every_error(name):
    assert issubclass(getattr(errors, name), SprintlabError)


@pytest.mark.filterwarnings("error")
def test_an_infinite_element_is_refused_without_a_warning():
    with pytest.raises(InvalidValueError, match="finite"):
        check_finite("mass", np.array([1.0, math.inf]))
