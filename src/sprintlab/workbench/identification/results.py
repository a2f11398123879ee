"""What an identification hands back: estimates with intervals, the fit of each channel, warnings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.array_types import FloatArray
from sprintlab.core.errors import SprintlabError
from sprintlab.motors.parameters import PmsmParameters
from sprintlab.workbench.identification.bench import Bench
from sprintlab.workbench.identification.model import NEUTRAL, shaft_torque


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """One parameter."""

    name: str  # a key of ``PARAMETER_UNITS``
    value: float | None  # SI; ``None`` where the data say nothing
    half_width: float | None  # half width of the 95 % interval; ``None`` where nothing was fitted
    determined: bool  # the interval is narrow enough to use the value
    reason: str = ""  # why it is not determined, or that it was held


@dataclass(frozen=True, kw_only=True)
class ChannelFit:
    """How one measured quantity was met."""

    name: str  # name of the channel
    unit: str  # unit of the values
    rows: NDArray[np.int64]  # (m,) rows of the bench
    measured: FloatArray  # (m,) as measured
    predicted: FloatArray  # (m,) by the fitted model
    noise: float  # standard deviation of the residuals without outliers
    explained: float  # share of the measured variance that the model explains, without outliers


@dataclass(frozen=True, kw_only=True)
class Identification:
    """What a bench tells about a motor."""

    bench: Bench  # the data
    pole_pairs: int  # N
    peak_current: float  # amplitude to which the saturation refers [A]
    estimates: dict[str, Estimate]  # one a parameter, by name
    channels: tuple[ChannelFit, ...]  # fit of each measured quantity
    outliers: NDArray[np.int64]  # (k,) lines of the file that were set aside
    singular_values: FloatArray  # singular values of the scaled Jacobian, largest first
    warnings: tuple[str, ...]  # what a reader must know before using the values
    trustworthy: bool  # ``False`` where a warning means that the fit is no description of the data

    @property
    def torque_constant(self) -> float:
        """Torque per ampere before saturation, ``1.5 N psi`` [N m/A]."""
        flux = self.estimates["flux_linkage"].value
        return 1.5 * self.pole_pairs * (flux or 0.0)

    def torque(self, bench: Bench) -> FloatArray:
        """Torque on the shaft [N m] ``(n,)`` that the fit predicts for the rows of another bench.

        Friction is left out where the fit could not tell it.
        """
        known = {name: found.value for name, found in self.estimates.items() if found.value is not None}
        return shaft_torque(NEUTRAL | known, self.pole_pairs, self.peak_current, bench)

    def motor(self, base: PmsmParameters | None = None, rotor_inertia: float | None = None) -> PmsmParameters:
        """The identified motor; what the bench does not determine comes from ``base``.

        Raises:
            SprintlabError: the fit is not trustworthy, or a parameter is neither determined nor in ``base``.
        """
        if not self.trustworthy:
            raise SprintlabError(
                "the fit does not describe the bench, no motor is made of it: see the warnings"
            )
        values: dict[str, float] = {}
        for name in ("stator_resistance", "q_axis_inductance", "flux_linkage", "saturation"):
            found = self.estimates[name]
            if found.determined and found.value is not None:
                values[name] = found.value
            elif base is None:
                raise SprintlabError(
                    f"the bench does not determine {name} ({found.reason}): give a base motor"
                )
            else:
                values[name] = float(getattr(base, name))
        fitted = self.estimates.get("rotor_inertia")
        if rotor_inertia is None and fitted is not None and fitted.determined:
            rotor_inertia = fitted.value
        if rotor_inertia is None and base is not None:
            rotor_inertia = base.rotor_inertia
        if rotor_inertia is None:
            raise SprintlabError("a steady bench does not show the rotor's inertia: give it, or a base motor")
        return PmsmParameters(
            pole_pairs=self.pole_pairs,
            peak_torque=1.5 * self.pole_pairs * values["flux_linkage"] * self.peak_current,
            rotor_inertia=rotor_inertia,
            **values,
        )
