"""Articulated bodies: generates the motion of a leg as straight-line C++.

The articulated-body algorithm in three sweeps (Featherstone 2008, chapter 7), in moments and forces about
each link's origin:

- *forward*: velocities outward, and the accelerations that velocities alone cause, with all ``q''`` and the
  acceleration of what carries the leg at zero: angular ``alpha_i = alpha_parent + w_parent x S_i q'_i``, of
  the origin ``b_i = b_parent + K_parent r_i``, where ``K = [alpha]x + [w]x [w]x`` and ``r_i`` is its place;
- *backward*: articulated inertia ``I^A`` and bias force ``p^A`` inward, from each link's Newton-Euler
  equations ``m b + K m c`` and ``I alpha + w x I w + m c x b`` (c: centre of mass), with
  ``U = I^A S``, ``D = S^T U + armature``, ``u = tau - S^T p^A``,
  parent gets ``I^A - U D^-1 U^T`` and ``p^A + U D^-1 u``;
- *accelerate*: outward again, what comes on top of those accelerations: ``q'' = D^-1 (u - U^T a)``,
  ``a_i = X a_parent + S q''``.

With the accelerations of velocities taken apart no bias meets ``I^A``, and a massless link costs little.
Accelerations count from free fall, so gravity appears only where the world comes in: at trunk and foot.

Two things are implicit, each with the velocity in the middle of the step, ``v + h/2 a``: viscous friction of
the joints, ``D += h/2 d``, and the pad's dampers, which act on the last link like an inertia,
``f = f_0 - h/2 B (a + A_0)``. Springs are explicit: with positions at the step's ends and velocities in
between (leapfrog) they keep their energy, while an implicit spring damps by half of omega h.

Consecutive parallel joints (hip, knee, spring) share one frame, in which only their links turn.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from sprintlab.core.array_types import FloatArray
from sprintlab.engine.algebra import (
    Algebra,
    Expression,
    Matrix,
    Rotation,
    Vector,
    Writer,
    cross,
    diagonal,
    mirrored,
    skew,
)
from sprintlab.engine.tree import Leg, Link, Tree

FOOT_VALUES = 16
"""What ``leg_forward`` gives of a foot: height of its middle, velocity of the contact point (3) and of the
middle (3) in the world, places of hip (3), knee (3) and middle (3) in the body that carries the leg."""
CARRIED = ("w", "v", "alpha", "b", "x", "z", "g")
"""What a leg must know of the body that carries it, in that body's frame: angular velocity, velocity of its
origin, their rates from velocities alone, the world's axes x and z, gravity."""
SPATIAL_INERTIA = 21
_UPPER = np.triu_indices(3)


@dataclass(frozen=True)
class _Inertia:
    """Symmetric 6 x 6 in blocks: rotation, coupling and translation."""

    rotation: Matrix
    coupling: Matrix
    translation: Matrix

    def __add__(self, other: _Inertia) -> _Inertia:
        return _Inertia(
            self.rotation + other.rotation,
            self.coupling + other.coupling,
            self.translation + other.translation,
        )

    def packed(self) -> list[Expression]:
        """Its 21 numbers: rotation 6, coupling 9, translation 6."""
        return [*self.rotation[_UPPER], *self.coupling.ravel(), *self.translation[_UPPER]]


def _unpacked(values: Vector) -> _Inertia:
    rotation, translation = np.empty((2, 3, 3), dtype=object)
    rotation[_UPPER], translation[_UPPER] = values[:6], values[15:21]
    return _Inertia(mirrored(rotation), values[6:15].reshape(3, 3), mirrored(translation))


class _Chain:
    """Links in a row, one of them per index, with their constants of every leg."""

    def __init__(self, algebra: Algebra, rows: list[tuple[Link, ...]]) -> None:
        self.algebra, self.rows, self.count = algebra, rows, len(rows[0])
        self.axes = [link.axis for link in rows[0]]
        self.q, self.qd = algebra.variables("q", self.count), algebra.variables("qd", self.count)
        self.tau = algebra.variables("tau", self.count)
        self.half = algebra.variable("half")
        self._turn()
        self.steps: list[tuple[Vector, list[Rotation]]] = []
        self.motions: list[dict[str, Vector]] = []
        self.turning: list[Matrix] = []
        self.coupling: list[tuple[Vector, Vector]] = []
        self.inverse: list[Expression] = []
        self.rest: list[Expression] = []

    def constant(self, name: str, index: int) -> Expression:
        """A number of one link."""
        return self.algebra.constant(np.array([getattr(row[index], name) for row in self.rows]))

    def constants(self, values: list[FloatArray]) -> Vector:
        """A vector, one per leg."""
        return np.array([self.algebra.constant(column) for column in np.array(values).T])

    def _turn(self) -> None:
        """The rotation of each joint's frame, or of its link alone within a group of parallel joints."""
        count, axes = self.count, self.axes
        parallel = [i > 0 and axes[i] == axes[i - 1] for i in range(count)] + [False]
        self.frame: list[Rotation | None] = [None] * count
        self.link: list[Rotation | None] = [None] * count
        self.grouped = [parallel[i] or parallel[i + 1] for i in range(count)]
        angle = self.q[0]
        for i in range(count):
            angle = angle + self.q[i] if parallel[i] else self.q[i]
            rotation = Rotation(axes[i], *self.algebra.sine(angle))
            (self.link if self.grouped[i] else self.frame)[i] = rotation
        self.parallel = parallel

    def forward(self, vectors: dict[str, Vector], height: Expression) -> Expression:
        """Motions of all links; turns ``vectors`` (``CARRIED``) along; the last link's height."""
        for i in range(self.count):
            place = self.constants([row[i].position for row in self.rows])
            rotations = []
            outer = self.link[i - 1] if i else None
            if outer is not None:
                place = outer.up(place)
                rotations += [] if self.parallel[i] else [outer]
            own = self.frame[i]
            rotations += [] if own is None else [own]
            height = height + vectors["z"] @ place
            vectors["v"] = vectors["v"] + cross(vectors["w"], place)
            vectors["b"] = vectors["b"] + _turning(vectors) @ place
            for rotation in rotations:
                for name, vector in vectors.items():
                    vectors[name] = rotation.down(vector)
            rate = self.algebra.zeros()
            rate[self.axes[i]] = self.qd[i]
            vectors["alpha"] = vectors["alpha"] + cross(vectors["w"], rate)
            vectors["w"] = vectors["w"] + rate
            self.steps.append((place, rotations))
            self.motions.append(dict(vectors))
            self.turning.append(_turning(vectors))
        return height

    def at_last(self, points: list[FloatArray]) -> Vector:
        """A point of the last link, one per leg, in the frame of the calculation."""
        point, link = self.constants(points), self.link[-1]
        return point if link is None else link.up(point)

    def from_root(self, point: Vector, links: int | None = None) -> Vector:
        """A point in the frame of calculation of the last link, or of the last of so many ``links``, as seen
        from the body that carries the chain."""
        for place, rotations in reversed(self.steps[:links]):
            for rotation in reversed(rotations):
                point = rotation.up(point)
            point = place + point
        return point

    def _own(self, i: int) -> tuple[_Inertia, Vector, Vector]:
        """Inertia of a link, and moment and force of the motion that velocities alone cause."""
        bodies = [row[i].body for row in self.rows]
        rotation = np.array([body.about_origin() for body in bodies])
        entries = [self.algebra.constant(column) for column in rotation.reshape(len(bodies), 9).T]
        matrix = np.array(entries).reshape(3, 3)
        lever = self.constants([body.mass * body.center for body in bodies])
        mass = self.algebra.constant(np.array([body.mass for body in bodies]))
        link = self.link[i]
        if link is not None:
            matrix, lever = link.up_symmetric(matrix), link.up(lever)
        w, alpha, b = (self.motions[i][name] for name in ("w", "alpha", "b"))
        moment = matrix @ alpha + cross(w, matrix @ w) + cross(lever, b)
        return _Inertia(matrix, skew(lever), diagonal(mass)), moment, b * mass + self.turning[i] @ lever

    def backward(self, inertia: _Inertia, moment: Vector, force: Vector) -> tuple[_Inertia, Vector, Vector]:
        """Articulated inertia and bias at the chain's root; the arguments are what acts on the last link."""
        self.coupling, self.inverse = [([], [])] * self.count, [self.half] * self.count
        self.rest = [self.half] * self.count
        for i in reversed(range(self.count)):
            own, own_moment, own_force = self._own(i)
            inertia, moment, force = inertia + own, moment + own_moment, force + own_force
            inertia, moment, force = self._through_joint(i, inertia, moment, force)
            inertia, moment, force = self._to_parent(i, inertia, moment, force)
        return inertia, moment, force

    def _through_joint(
        self, i: int, inertia: _Inertia, moment: Vector, force: Vector
    ) -> tuple[_Inertia, Vector, Vector]:
        axis, damping = self.axes[i], self.constant("damping", i)
        angular, linear = inertia.rotation[:, axis], inertia.coupling[axis]
        inverse = self.algebra.reciprocal(angular[axis] + self.constant("armature", i) + self.half * damping)
        spring = self.constant("stiffness", i) * (self.q[i] - self.constant("rest", i))
        rest = self.tau[i] - spring - damping * self.qd[i] - moment[axis]
        self.coupling[i], self.inverse[i], self.rest[i] = (angular, linear), inverse, rest
        push = inverse * rest
        moment, force = moment + angular * push, force + linear * push
        scaled, shifted = angular * inverse, linear * inverse
        reduced = _Inertia(
            mirrored(inertia.rotation - np.outer(scaled, angular)),
            inertia.coupling - np.outer(scaled, linear),
            mirrored(inertia.translation - np.outer(shifted, linear)),
        )
        return reduced, moment, force

    def _to_parent(
        self, i: int, inertia: _Inertia, moment: Vector, force: Vector
    ) -> tuple[_Inertia, Vector, Vector]:
        place, rotations = self.steps[i]
        rotation, coupling, translation = inertia.rotation, inertia.coupling, inertia.translation
        for turn in reversed(rotations):
            rotation, coupling = turn.up_symmetric(rotation), turn.up_matrix(coupling)
            translation, moment, force = turn.up_symmetric(translation), turn.up(moment), turn.up(force)
        moved = coupling.T - translation @ skew(place)
        rotation = mirrored(rotation - coupling @ skew(place) + skew(place) @ moved)
        return _Inertia(rotation, moved.T, translation), moment + cross(place, force), force

    def accelerate(self, angular: Vector, linear: Vector) -> tuple[list[Expression], Vector, Vector]:
        """``q''``, and what comes on top of the last link's motion, from that of the body that carries it."""
        joints = []
        for i in range(self.count):
            place, rotations = self.steps[i]
            linear = linear + cross(angular, place)
            for rotation in rotations:
                angular, linear = rotation.down(angular), rotation.down(linear)
            pull = self.coupling[i][0] @ angular + self.coupling[i][1] @ linear
            joints.append(self.inverse[i] * (self.rest[i] - pull))
            angular = angular.copy()
            angular[self.axes[i]] = angular[self.axes[i]] + joints[i]
        return joints, angular, linear


def _turning(motion: dict[str, Vector]) -> Matrix:
    """``K = [alpha]x + [w]x [w]x``: the acceleration of a point at ``r`` of a turning body is ``K r``."""
    centripetal = np.outer(motion["w"], motion["w"])
    square = centripetal.diagonal().copy()
    centripetal[np.diag_indices(3)] = [-(square[a - 1] + square[a - 2]) for a in range(3)]
    return skew(motion["alpha"]) + centripetal


class _Functions:
    """Three generated functions that share temporaries: what a later one needs travels in ``kept``."""

    def __init__(self, algebra: Algebra) -> None:
        self._writer, self._functions = Writer(algebra), []
        self._algebra = algebra

    def add(self, head: str, results: dict[str, Iterable[Expression]]) -> None:
        """A function ``head`` that writes each list of results into the array of its name."""
        before = {f"t{index}" for index in self._writer.written}
        flat = [node for nodes in results.values() for node in nodes]
        body = self._writer.write(flat)
        ends = [
            f"{name}[{k}] = splat({self._writer.reference(node)});"
            for name, nodes in results.items()
            for k, node in enumerate(nodes)
        ]
        used = set(re.findall(r"\bt\d+\b", "\n".join(body + ends)))
        made = {f"t{index}" for index in self._writer.written} - before
        self._functions.append((head, body + ends, used & before, made))

    def text(self, prefix: str) -> tuple[str, int]:
        """The functions, and how many numbers ``kept`` holds."""
        needed = sorted(set().union(*(taken for *_, taken, _ in self._functions)), key=lambda t: int(t[1:]))
        slot = {name: index for index, name in enumerate(needed)}
        parts = []
        for head, body, taken, made in self._functions:
            takes = [f"const number {name} = kept[{slot[name]}];" for name in needed if name in taken]
            gives = [f"kept[{slot[name]}] = {name};" for name in needed if name in made]
            lines = "\n  ".join([*takes, *body, *gives])
            parts.append(f"FUNCTION void {prefix}_{head} {{\n  {lines}\n}}")
        return "\n".join(parts), len(needed)


_STATE = "const number* q, const number* qd"


def leg_source(tree: Tree, algebra: Algebra) -> str:
    """``leg_forward``, ``leg_backward`` and ``leg_accelerate``.

    Args:
        tree: the robot.
        algebra: with one value per leg; its table fills with the legs' constants.
    """
    chain = _Chain(algebra, [leg.links for leg in tree.legs])
    vectors = {name: algebra.variables(f"carrier.{name}", 3) for name in CARRIED}
    if tree.waist is None:
        vectors["alpha"] = vectors["b"] = algebra.zeros()
    height = chain.forward(vectors, algebra.variable("carrier.height"))
    foot, middle = _foot(tree.legs, chain, vectors, height)
    functions = _Functions(algebra)
    table = "const scalar* leg"
    functions.add(
        f"forward(const Carrier& carrier, {_STATE}, {table}, number* kept, number* foot)", {"foot": foot}
    )
    pad, lever, offset = _pad(chain, vectors, middle, tree.legs[0].radius)
    root = chain.backward(*pad)
    functions.add(
        f"backward(const Carrier& carrier, {_STATE}, const number* tau, {table}, number half, "
        "const number* force, number damping, number drag, number* kept, number* sum)",
        {"sum": [*root[0].packed(), *root[1], *root[2]]},
    )
    start = algebra.variables("start", 6)
    joints, angular, linear = chain.accelerate(start[:3], start[3:])
    contact = linear + cross(angular, lever) + offset
    functions.add(
        f"accelerate(const Carrier& carrier, const number* start, {table}, number* kept, number* qdd, "
        "number* contact)",
        {"qdd": joints, "contact": _world(vectors) @ contact},
    )
    text, kept = functions.text("leg")
    return f"#define KEPT {kept}\n{text}"


def _world(vectors: dict[str, Vector]) -> Matrix:
    """The world's axes in the last link's frame, row by row."""
    return np.array([vectors["x"], cross(vectors["z"], vectors["x"]), vectors["z"]])


def _foot(
    legs: tuple[Leg, ...], chain: _Chain, vectors: dict[str, Vector], height: Expression
) -> tuple[list[Expression], Vector]:
    """``FOOT_VALUES``, then the place of the foot's middle in the last link's frame."""
    middle, w, zero = chain.at_last([leg.foot for leg in legs]), vectors["w"], chain.algebra.zeros()
    lever = middle - vectors["z"] * chain.algebra.constant(legs[0].radius)
    knee = max(index for index, link in enumerate(legs[0].links) if np.any(link.position))
    values = [height + vectors["z"] @ middle]
    for point in (lever, middle):
        values += [*(_world(vectors) @ (vectors["v"] + cross(w, point)))]
    values += [*chain.from_root(zero, knee), *chain.from_root(zero), *chain.from_root(middle)]
    return values, middle


def _pad(
    chain: _Chain, vectors: dict[str, Vector], middle: Vector, radius: float
) -> tuple[tuple[_Inertia, Vector, Vector], Vector, Vector]:
    """What the pad does to the last link: dampers as inertia, the rest as a force; contact point; ``A_0``.

    With ``B = drag 1 + (damping - drag) n n^T``, the force is ``f - h/2 B (a + A_0)``, where ``a`` is what
    comes on top of the contact point's motion and ``A_0 = g + b + K r`` makes it the real acceleration.
    """
    algebra, n = chain.algebra, vectors["z"]
    lever = middle - n * algebra.constant(radius)
    drag = chain.half * algebra.variable("drag")
    extra = chain.half * (algebra.variable("damping") - algebra.variable("drag"))
    offset = vectors["g"] + vectors["b"] + chain.turning[-1] @ lever
    push = _world(vectors).T @ algebra.variables("force", 3) - offset * drag - n * (extra * (n @ offset))
    arm, dragged = cross(middle, n), lever * drag
    along = arm * extra
    rotation = np.outer(along, arm) - np.outer(dragged, lever) + diagonal(dragged @ lever)
    coupling = skew(dragged) + np.outer(along, n)
    translation = np.outer(n * extra, n) + diagonal(drag)
    pad = _Inertia(mirrored(rotation), coupling, mirrored(translation))
    return (pad, -cross(lever, push), -push), lever, offset


def waist_source(tree: Tree) -> str:
    """``waist_forward``, ``waist_backward`` and ``waist_accelerate`` of a robot with a waist."""
    assert tree.waist is not None
    algebra = Algebra(1)
    chain = _Chain(algebra, [(tree.waist,)])
    vectors = {name: algebra.variables(f"carrier.{name}", 3) for name in CARRIED}
    height = chain.forward(vectors, algebra.variable("carrier.height"))
    functions = _Functions(algebra)
    functions.add(
        f"forward(const Carrier& carrier, {_STATE}, number* kept, number* rear)",
        {"rear": [x for name in CARRIED for x in vectors[name]] + [height]},
    )
    legs = algebra.variables("legs", SPATIAL_INERTIA + 6)
    root = chain.backward(_unpacked(legs[:21]), legs[21:24], legs[24:])
    functions.add(
        f"backward(const Carrier& carrier, {_STATE}, const number* tau, number half, const number* legs, "
        "number* kept, number* sum)",
        {"sum": [*root[0].packed(), *root[1], *root[2]]},
    )
    start = algebra.variables("start", 6)
    joints, angular, linear = chain.accelerate(start[:3], start[3:])
    functions.add(
        "accelerate(const number* start, const number* legs, number* kept, number* qdd, number* rear)",
        {"qdd": joints, "rear": [*angular, *linear]},
    )
    functions.add(
        "place(const number* point, number* kept, number* place)",
        {"place": chain.from_root(algebra.variables("point", 3))},
    )
    text, kept = functions.text("waist")
    return f"#define WAIST_KEPT {kept}\n{text}"


def trunk_source() -> str:
    """``trunk_solve``: the trunk's acceleration from the sum of all inertias, by ``L D L^T``.

    Translations come first: the robot's mass gives well-conditioned pivots.
    """
    algebra = Algebra(1)
    total = _unpacked(algebra.variables("sum", SPATIAL_INERTIA))
    blocks = np.block([[total.rotation, total.coupling], [total.coupling.T, total.translation]])
    order = [3, 4, 5, 0, 1, 2]
    matrix = blocks[np.ix_(order, order)]
    right = [-algebra.variable(f"sum[{SPATIAL_INERTIA + index}]") for index in order]
    solution = _solved(algebra, matrix, right)
    ordered = [solution[order.index(index)] for index in range(6)]
    functions = _Functions(algebra)
    functions.add("solve(const number* sum, number* start)", {"start": ordered})
    return functions.text("trunk")[0]


def _solved(algebra: Algebra, matrix: np.ndarray, right: list[Expression]) -> list[Expression]:
    size = len(right)
    lower = np.empty((size, size), dtype=object)
    scaled = np.empty((size, size), dtype=object)
    inverse: list[Expression] = []
    for j in range(size):
        pivot = matrix[j, j]
        for k in range(j):
            pivot = pivot - lower[j, k] * scaled[j, k]
        inverse.append(algebra.reciprocal(pivot))
        for i in range(j + 1, size):
            entry = matrix[i, j]
            for k in range(j):
                entry = entry - lower[i, k] * scaled[j, k]
            scaled[i, j], lower[i, j] = entry, entry * inverse[j]
    solution = list(right)
    for i in range(size):
        for k in range(i):
            solution[i] = solution[i] - lower[i, k] * solution[k]
    for i in reversed(range(size)):
        solution[i] = solution[i] * inverse[i]
        for k in range(i + 1, size):
            solution[i] = solution[i] - lower[k, i] * solution[k]
    return solution
