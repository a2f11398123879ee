"""From a source's legs to the one leg that a robot's table describes.

The table knows one left leg; its mirror image and its copies make four. A source's four legs are brought into
that leg's frames (thigh and shank straight down at zero, axes +x, +y, +y) and averaged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sprintlab.core.errors import RobotModelError
from sprintlab.robots.description import JOINTS_PER_LEG, FloatArray, point_inertia
from sprintlab.robots.importing.source import SourceLeg, SourceRobot
from sprintlab.robots.loader import LEG_NAMES

_AXES = {"abad": (1.0, 0.0, 0.0), "hip": (0.0, 1.0, 0.0), "knee": (0.0, 1.0, 0.0)}
_STRAIGHT = 0.999  # cosine between an axis and the one it must follow
_LARGEST_DROP = 0.015  # height of the hip axis below the abduction axis [m]; the table has none
_LARGEST_SPREAD = 0.05  # relative difference of a length or mass between legs
_FOOT_SHARE = 0.05  # share of the shank's mass that is called foot where the source has none of its own
_LIGHTER_FEET = 20  # that are tried, each a tenth of the one before


@dataclass(frozen=True, kw_only=True)
class FittedLink:
    """Link in a left leg's frame: mass [kg], centre of mass ``(3,)`` [m], inertia ``(3, 3)`` [kg m^2]."""

    mass: float
    center: FloatArray
    inertia: FloatArray


@dataclass(frozen=True, kw_only=True)
class JointMap:
    """How the source's joint becomes the table's: ``angle = sign * source angle + offset`` [rad]."""

    source: str
    sign: float
    offset: float


@dataclass(frozen=True, kw_only=True)
class FittedRobot:
    """The quantities of a table that a source decides; lengths [m], masses [kg], angles [rad]."""

    origin: FloatArray  # middle between the abduction axes, in the source's base frame ``(3,)``
    hip_x: float  # distances of an abduction axis from the middle
    hip_y: float  # distances of an abduction axis from the middle
    abad_offset: float  # from the abduction axis to the leg's plane
    thigh_length: float  # joint to joint, joint to foot
    shank_length: float  # joint to joint, joint to foot
    foot_radius: float  # radius and mass of the foot
    foot_mass: float  # radius and mass of the foot
    trunk: FittedLink  # mass properties; the shank without the foot
    abad: FittedLink  # mass properties; the shank without the foot
    thigh: FittedLink  # mass properties; the shank without the foot
    shank: FittedLink  # mass properties; the shank without the foot
    trunk_half_size: FloatArray  # half sizes of its collision box
    radii: tuple[float, float]  # radii of the collision shapes of thigh and shank
    ranges: dict[str, tuple[float, float]]  # lower and upper limit by joint type
    viscous_friction: dict[str, float]  # by joint type; where legs differ, the value of most legs
    dry_friction: dict[str, float]  # by joint type; where legs differ, the value of most legs
    armature: dict[str, float]  # by joint type; where legs differ, the value of most legs
    # torque limits that the source states, by joint type; where legs differ, the smallest
    efforts: dict[str, float | None]
    maps: dict[str, JointMap]  # for each of the table's 12 joints
    spread: float  # greatest relative difference between legs in lengths and masses
    unlike: tuple[str, ...]  # joints whose numbers differ between legs, with the value of each leg

    @property
    def mass(self) -> float:
        """The whole robot's [kg]."""
        leg = (self.abad, self.thigh, self.shank)
        return self.trunk.mass + 4 * (sum(link.mass for link in leg) + self.foot_mass)

    @property
    def leg_length(self) -> float:
        """Thigh and shank [m]."""
        return self.thigh_length + self.shank_length


def fit_robot(source: SourceRobot) -> FittedRobot:
    """Bring a source into the table's form.

    Raises:
        RobotModelError: the legs are no left-right pairs in front and behind, differ by more than 5 %, turn
            about other axes than x, y, y, have no limits, or bend their knees forward only.
    """
    legs = _named_legs(source)
    plans = {name: _LegPlan(source, name, leg) for name, leg in legs.items()}
    lengths = np.array([plan.lengths for plan in plans.values()])
    masses = np.array([[part.mass for part in leg.parts] for leg in legs.values()])
    spread = float(
        np.max(np.ptp(np.hstack((lengths, masses)), axis=0) / np.hstack((lengths, masses)).mean(0))
    )
    if spread > _LARGEST_SPREAD:
        raise _refuse(source, f"its legs differ by {spread:.0%} in a length or mass; the table has one leg")
    front, rear = (np.mean([plans[name].hip[0] for name in pair]) for pair in (LEG_NAMES[:2], LEG_NAMES[2:]))
    abads = np.array([plan.leg.joints[0].anchor for plan in plans.values()])
    middle = (0.5 * (front + rear), abads[:, 1].mean(), abads[:, 2].mean())
    origin = np.array(middle, dtype=np.float64)
    hip_y = float(np.mean(np.abs(abads[:, 1] - origin[1])))
    names = ("abad_offset", "thigh_length", "shank_length", "foot_radius")
    mean: dict[str, float] = dict(zip(names, lengths.mean(axis=0).tolist(), strict=True))
    links = [_mean_link([plan.link(index) for plan in plans.values()]) for index in range(3)]
    foot_mass, shank = _without_foot(source, links[2], [leg.foot_mass for leg in legs.values()], mean)
    hip_x = 0.5 * float(front - rear)
    half_size = source.trunk_half_size
    return FittedRobot(
        origin=origin,
        hip_x=hip_x,
        hip_y=hip_y,
        **mean,
        foot_mass=foot_mass,
        trunk=FittedLink(
            mass=source.trunk.mass, center=source.trunk.center - origin, inertia=source.trunk.inertia
        ),
        abad=links[0],
        thigh=links[1],
        shank=shank,
        trunk_half_size=np.array((0.9 * hip_x, hip_y, 0.5 * hip_y)) if half_size is None else half_size,
        radii=_radii(legs, mean),
        ranges={joint: _range(source, plans, index) for index, joint in enumerate(JOINTS_PER_LEG)},
        viscous_friction=_of_most(legs, "damping"),
        dry_friction=_of_most(legs, "dry_friction"),
        armature=_of_most(legs, "armature"),
        efforts={joint: _effort(legs, index) for index, joint in enumerate(JOINTS_PER_LEG)},
        maps={
            f"{name}_{joint}": plan.maps[joint] for name, plan in plans.items() for joint in JOINTS_PER_LEG
        },
        spread=spread,
        unlike=_unlike(legs),
    )


def _refuse(source: SourceRobot, reason: str) -> RobotModelError:
    return RobotModelError(f"robot model {source.path}: {reason}")


def _named_legs(source: SourceRobot) -> dict[str, SourceLeg]:
    """Legs by name, in the order FL, FR, RL, RR, from where their hips are."""
    anchors = np.array([leg.joints[1].anchor for leg in source.legs])
    middle = anchors.mean(axis=0)
    named = {}
    for leg, anchor in zip(source.legs, anchors, strict=True):
        name = ("F" if anchor[0] > middle[0] else "R") + ("L" if anchor[1] > middle[1] else "R")
        named[name] = leg
    if set(named) != set(LEG_NAMES):
        raise _refuse(
            source, "its legs are not two on the left and two on the right, in front and behind (x, y)"
        )
    return {name: named[name] for name in LEG_NAMES}


class _LegPlan:
    """One leg in the frames of the table."""

    def __init__(self, source: SourceRobot, name: str, leg: SourceLeg) -> None:
        self.leg, self._source = leg, source
        self._side = 1.0 if name[1] == "L" else -1.0
        self.hip = leg.joints[1].anchor
        signs = [self._sign(index) for index in range(3)]
        abad, knee = leg.joints[0].anchor, leg.joints[2].anchor
        if abs(self.hip[2] - abad[2]) > _LARGEST_DROP:
            drop = 100.0 * (self.hip[2] - abad[2])
            raise _refuse(
                source, f"the hip axis of {name} lies {drop:.1f} cm above the abduction axis, not beside it"
            )
        thigh, shank = knee - self.hip, leg.foot - knee
        self._turns = (0.0, _angle(thigh), _angle(shank))
        self.lengths = np.array(
            (
                self._side * (leg.foot[1] - abad[1]),
                np.hypot(*thigh[[0, 2]]),
                np.hypot(*shank[[0, 2]]),
                leg.foot_radius,
            )
        )
        if self.lengths.min() <= 0.0:
            raise _refuse(source, f"the leg {name} has no length, or stands inside its abduction axis")
        self._origins = (np.array((self.hip[0], *abad[1:])), self._in_plane(self.hip), self._in_plane(knee))
        offsets = (0.0, self._turns[1], self._turns[2] - self._turns[1])
        self.maps = {
            joint: JointMap(source=leg.joints[index].name, sign=signs[index], offset=offsets[index])
            for index, joint in enumerate(JOINTS_PER_LEG)
        }

    def _in_plane(self, point: FloatArray) -> FloatArray:
        return np.array((point[0], self.leg.foot[1], point[2]))

    def _sign(self, index: int) -> float:
        joint, wanted = self.leg.joints[index], _AXES[JOINTS_PER_LEG[index]]
        cosine = float(joint.axis @ np.array(wanted))
        if abs(cosine) < _STRAIGHT:
            axis, wanted = ", ".join(f"{value:.2f}" for value in joint.axis), "xyy"[index]
            said = f"joint {index + 1} of a leg ({JOINTS_PER_LEG[index]}) turns about {wanted}"
            raise _refuse(self._source, f"joint {joint.name} turns about ({axis}); {said}")
        return 1.0 if cosine > 0 else -1.0

    def link(self, index: int) -> FittedLink:
        """A link of this leg as one of a left leg."""
        part, turn = self.leg.parts[index], self._turns[index]
        cosine, sine = np.cos(turn), np.sin(turn)
        to_link = np.array(((cosine, 0.0, -sine), (0.0, 1.0, 0.0), (sine, 0.0, cosine)))
        mirror = np.diag((1.0, self._side, 1.0)) @ to_link
        return FittedLink(
            mass=part.mass,
            center=mirror @ (part.center - self._origins[index]),
            inertia=mirror @ part.inertia @ mirror.T,
        )


def _angle(link: FloatArray) -> float:
    """Angle about +y from straight down of a vector in the sagittal plane [rad]."""
    return float(np.arctan2(-link[0], -link[2]))


def _mean_link(links: list[FittedLink]) -> FittedLink:
    return FittedLink(
        mass=float(np.mean([link.mass for link in links])),
        center=np.mean([link.center for link in links], axis=0),
        inertia=np.mean([link.inertia for link in links], axis=0),
    )


def _without_foot(
    source: SourceRobot, shank: FittedLink, own: list[float | None], lengths: dict[str, float]
) -> tuple[float, FittedLink]:
    """Foot mass, and the shank without it: together they weigh and turn as the source's shank."""
    known = [mass for mass in own if mass]
    foot_mass = float(np.mean(known)) if len(known) == len(own) else _FOOT_SHARE * shank.mass
    for _ in range(_LIGHTER_FEET):
        rest = _without(shank, foot_mass, lengths)
        if np.linalg.eigvalsh(rest.inertia).min() > 0.0:
            return foot_mass, rest
        foot_mass *= 0.1  # the source's shank holds no such foot: a lighter one
    raise _refuse(source, "no body can have the inertia of its shanks")


def _without(shank: FittedLink, foot_mass: float, lengths: dict[str, float]) -> FittedLink:
    """A shank from whose end a foot was taken."""
    place = np.array((0.0, 0.0, -lengths["shank_length"]))
    mass = shank.mass - foot_mass
    center = (shank.mass * shank.center - foot_mass * place) / mass
    inertia = (
        shank.inertia
        - mass * point_inertia(center - shank.center)
        - foot_mass * point_inertia(place - shank.center)
    )
    inertia = inertia - 0.4 * foot_mass * lengths["foot_radius"] ** 2 * np.eye(3)
    return FittedLink(mass=mass, center=center, inertia=inertia)


def _radii(legs: dict[str, SourceLeg], lengths: dict[str, float]) -> tuple[float, float]:
    """Collision radii of thigh and shank; without shapes a twelfth and a twentieth of their lengths."""
    defaults = (lengths["thigh_length"] / 12.0, lengths["shank_length"] / 20.0)
    stated = [leg.radii for leg in legs.values()]
    first, second = (
        max((radii[index] or 0.0) for radii in stated) or default for index, default in enumerate(defaults)
    )
    return first, second


def _range(source: SourceRobot, plans: dict[str, _LegPlan], index: int) -> tuple[float, float]:
    """Range that all four legs have; that of abduction is made its own mirror image."""
    joint = JOINTS_PER_LEG[index]
    low, high = -np.inf, np.inf
    for plan in plans.values():
        limits, mapped = plan.leg.joints[index].limits, plan.maps[joint]
        if limits is None:
            raise _refuse(source, f"joint {mapped.source} has no limits")
        ends = sorted(mapped.sign * limits + mapped.offset)
        low, high = max(low, ends[0]), min(high, ends[1])
        if joint == "abad":
            low, high = max(low, -ends[1]), min(high, -ends[0])
    if joint == "knee":
        high = min(high, -0.05)  # a straight knee has no inverse
    if low >= high:
        bend = "; its knees must bend backward" if joint == "knee" else ""
        raise _refuse(source, f"no {joint} angle is possible on all four legs{bend}")
    return float(low), float(high)


def _of_most(legs: dict[str, SourceLeg], field: str) -> dict[str, float]:
    """A number of the source by joint type: that of most legs, the first of equally many."""
    found: dict[str, float] = {}
    for index, joint in enumerate(JOINTS_PER_LEG):
        values = [float(getattr(leg.joints[index], field)) for leg in legs.values()]
        found[joint] = max(values, key=values.count)
    return found


def _unlike(legs: dict[str, SourceLeg]) -> tuple[str, ...]:
    """What differs between legs, e.g. ``knee effort: FL 50, FR 35, RL 50, RR 50``."""
    found: list[str] = []
    for index, joint in enumerate(JOINTS_PER_LEG):
        for field in ("effort", "damping", "dry_friction", "armature"):
            values = {name: getattr(leg.joints[index], field) for name, leg in legs.items()}
            if len(set(values.values())) > 1:
                each = (f"{leg} {'none' if value is None else f'{value:g}'}" for leg, value in values.items())
                found.append(f"{joint} {field.replace('_', ' ')}: {', '.join(each)}")
    return tuple(found)


def _effort(legs: dict[str, SourceLeg], index: int) -> float | None:
    stated = [leg.joints[index].effort for leg in legs.values()]
    return min((value for value in stated if value is not None), default=None)
