"""Random motors: ``st.from_type(PmsmParameters)`` draws from the whole plausible range."""

import hypothesis.strategies as st
import pytest

from sprintlab.motors import PmsmParameters


def logarithmic(low, high):
    return st.floats(0.0, 1.0).map(lambda share: low * (high / low) ** share)


@st.composite
def motors(draw):
    pole_pairs = draw(st.integers(2, 40))
    flux_linkage = draw(logarithmic(1e-3, 3e-2))
    peak_current = draw(st.floats(2.0, 200.0))
    return PmsmParameters(
        pole_pairs=pole_pairs,
        stator_resistance=draw(logarithmic(1e-2, 1.0)),
        q_axis_inductance=draw(st.one_of(st.just(0.0), logarithmic(1e-6, 3e-4))),
        flux_linkage=flux_linkage,
        peak_torque=1.5 * pole_pairs * flux_linkage * peak_current,
        saturation=draw(st.floats(0.0, 0.49)),
        rotor_inertia=1e-4,
    )


st.register_type_strategy(PmsmParameters, motors())


@pytest.fixture
def surrogate():
    """The hip motor of the surrogate robot: U12 with 1.25 times the stack."""
    return PmsmParameters(
        pole_pairs=21,
        stator_resistance=0.1163,
        q_axis_inductance=67.2e-6,
        flux_linkage=6.08e-3,
        peak_torque=15.0,
        saturation=0.15,
        rotor_inertia=6.94e-4,
    )
