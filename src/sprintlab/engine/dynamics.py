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
from collections.abc import Callable
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
    add,
    cross,
    cross_matrix,
    dot,
    matrix_cross,
    minus,
    plus,
    scale,
    skew,
    subtract,
    times,
    transpose,
)
from sprintlab.engine.tree import Leg, Link, Tree

FOOT_VALUES = 16
"""What ``leg_forward`` gives of a foot: height of its middle, velocity of the contact point (3) and of the
middle (3) in the world, places of hip (3), knee (3) and middle (3) in the body that carries the leg."""
CARRIED = ("w", "v", "alpha", "b", "x", "z", "g")
"""What a leg must know of the body that carries it, in that body's frame: angular velocity, velocity of its
origin, their rates from velocities alone, the world's axes x and z, gravity."""
SPATIAL_INERTIA = 21
_UPPER = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]


@dataclass(frozen=True)
class _Inertia:
    """Symmetric 6 x 6 in blocks: rotation, coupling and translation."""

    rotation: Matrix
    coupling: Matrix
    translation: Matrix

    def __add__(self, other: _Inertia) -> _Inertia:
        return _Inertia(
            plus(self.rotation, other.rotation),
            plus(self.coupling, other.coupling),
            plus(self.translation, other.translation),
        )

    def packed(self) -> list[Expression]:
        """Its 21 numbers: rotation 6, coupling 9, translation 6."""
        rotation = [self.rotation[a][b] for a, b in _UPPER]
        coupling = [x for row in self.coupling for x in row]
        return [*rotation, *coupling, *(self.translation[a][b] for a, b in _UPPER)]


def _unpacked(values: list[Expression]) -> _Inertia:
    coupling = [values[6 + 3 * row : 9 + 3 * row] for row in range(3)]
    rotation, translation = (
        _symmetric(lambda a, b, six=six: six[_UPPER.index((a, b))]) for six in (values[:6], values[15:21])
    )
    return _Inertia(rotation, coupling, translation)


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
        return [self.algebra.constant(column) for column in np.array(values).T]

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
            height = height + dot(vectors["z"], place)
            vectors["v"] = add(vectors["v"], cross(vectors["w"], place))
            vectors["b"] = add(vectors["b"], times(_turning(vectors), place))
            for rotation in rotations:
                for name, vector in vectors.items():
                    vectors[name] = rotation.down(vector)
            rate = [self.qd[i] if k == self.axes[i] else self.algebra.constant(0.0) for k in range(3)]
            vectors["alpha"] = add(vectors["alpha"], cross(vectors["w"], rate))
            vectors["w"] = add(vectors["w"], rate)
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
            point = add(place, point)
        return point

    def _own(self, i: int) -> tuple[_Inertia, Vector, Vector]:
        """Inertia of a link, and moment and force of the motion that velocities alone cause."""
        bodies = [row[i].body for row in self.rows]
        rotation = np.array([body.about_origin() for body in bodies])
        matrix = [[self.algebra.constant(rotation[:, a, b]) for b in range(3)] for a in range(3)]
        lever = self.constants([body.mass * body.center for body in bodies])
        mass = self.algebra.constant(np.array([body.mass for body in bodies]))
        link = self.link[i]
        if link is not None:
            matrix, lever = link.up_symmetric(matrix), link.up(lever)
        zero, (w, alpha, b) = (
            self.algebra.constant(0.0),
            (self.motions[i][name] for name in ("w", "alpha", "b")),
        )
        moment = add(add(times(matrix, alpha), cross(w, times(matrix, w))), cross(lever, b))
        force = add(scale(mass, b), times(self.turning[i], lever))
        diagonal = [[mass if a == c else zero for c in range(3)] for a in range(3)]
        return _Inertia(matrix, skew(lever), diagonal), moment, force

    def backward(self, inertia: _Inertia, moment: Vector, force: Vector) -> tuple[_Inertia, Vector, Vector]:
        """Articulated inertia and bias at the chain's root; the arguments are what acts on the last link."""
        self.coupling, self.inverse = [([], [])] * self.count, [self.half] * self.count
        self.rest = [self.half] * self.count
        for i in reversed(range(self.count)):
            own, own_moment, own_force = self._own(i)
            inertia, moment, force = inertia + own, add(moment, own_moment), add(force, own_force)
            inertia, moment, force = self._through_joint(i, inertia, moment, force)
            inertia, moment, force = self._to_parent(i, inertia, moment, force)
        return inertia, moment, force

    def _through_joint(
        self, i: int, inertia: _Inertia, moment: Vector, force: Vector
    ) -> tuple[_Inertia, Vector, Vector]:
        axis, damping = self.axes[i], self.constant("damping", i)
        angular = [inertia.rotation[k][axis] for k in range(3)]
        linear = inertia.coupling[axis]
        inverse = self.algebra.reciprocal(angular[axis] + self.constant("armature", i) + self.half * damping)
        spring = self.constant("stiffness", i) * (self.q[i] - self.constant("rest", i))
        rest = self.tau[i] - spring - damping * self.qd[i] - moment[axis]
        self.coupling[i], self.inverse[i], self.rest[i] = (angular, linear), inverse, rest
        push = inverse * rest
        moment, force = add(moment, scale(push, angular)), add(force, scale(push, linear))
        scaled = scale(inverse, angular), scale(inverse, linear)
        reduced = _Inertia(
            _reduced(inertia.rotation, scaled[0], angular),
            minus(inertia.coupling, [[a * b for b in linear] for a in scaled[0]]),
            _reduced(inertia.translation, scaled[1], linear),
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
        moved = minus(transpose(coupling), matrix_cross(translation, place))
        rotation = plus(minus(rotation, matrix_cross(coupling, place)), cross_matrix(place, moved))
        for a, b in ((1, 0), (2, 0), (2, 1)):
            rotation[a][b] = rotation[b][a]
        return _Inertia(rotation, transpose(moved), translation), add(moment, cross(place, force)), force

    def accelerate(self, angular: Vector, linear: Vector) -> tuple[list[Expression], Vector, Vector]:
        """``q''``, and what comes on top of the last link's motion, from that of the body that carries it."""
        joints = []
        for i in range(self.count):
            place, rotations = self.steps[i]
            linear = add(linear, cross(angular, place))
            for rotation in rotations:
                angular, linear = rotation.down(angular), rotation.down(linear)
            pull = dot(self.coupling[i][0], angular) + dot(self.coupling[i][1], linear)
            joints.append(self.inverse[i] * (self.rest[i] - pull))
            angular = list(angular)
            angular[self.axes[i]] = angular[self.axes[i]] + joints[i]
        return joints, angular, linear


def _turning(motion: dict[str, Vector]) -> Matrix:
    """``K = [alpha]x + [w]x [w]x``: the acceleration of a point at ``r`` of a turning body is ``K r``."""
    w, turned = motion["w"], skew(motion["alpha"])
    square = [[w[a] * w[b] for b in range(3)] for a in range(3)]
    inward = [-(square[a - 1][a - 1] + square[a - 2][a - 2]) for a in range(3)]
    return plus(turned, [[square[a][b] if a != b else inward[a] for b in range(3)] for a in range(3)])


def _reduced(matrix: Matrix, first: Vector, second: Vector) -> Matrix:
    """``matrix - first second^T``, which is symmetric."""
    return _symmetric(lambda a, b: matrix[a][b] - first[a] * second[b])


def _symmetric(entry: Callable[[int, int], Expression]) -> Matrix:
    """A symmetric matrix from its upper triangle."""
    upper = {(a, b): entry(a, b) for a, b in _UPPER}
    return [[upper[min(a, b), max(a, b)] for b in range(3)] for a in range(3)]


class _Functions:
    """Three generated functions that share temporaries: what a later one needs travels in ``kept``."""

    def __init__(self, algebra: Algebra) -> None:
        self._writer, self._functions = Writer(algebra), []
        self._algebra = algebra

    def add(self, head: str, results: dict[str, list[Expression]]) -> None:
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
        vectors["alpha"] = vectors["b"] = [algebra.constant(0.0)] * 3
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
    contact = add(add(linear, cross(angular, lever)), offset)
    functions.add(
        f"accelerate(const Carrier& carrier, const number* start, {table}, number* kept, number* qdd, "
        "number* contact)",
        {"qdd": joints, "contact": [dot(axis, contact) for axis in _world(vectors)]},
    )
    text, kept = functions.text("leg")
    return f"#define KEPT {kept}\n{text}"


def _world(vectors: dict[str, Vector]) -> list[Vector]:
    """The world's axes in the last link's frame."""
    return [vectors["x"], cross(vectors["z"], vectors["x"]), vectors["z"]]


def _foot(
    legs: tuple[Leg, ...], chain: _Chain, vectors: dict[str, Vector], height: Expression
) -> tuple[list[Expression], Vector]:
    """``FOOT_VALUES``, then the place of the foot's middle in the last link's frame."""
    middle = chain.at_last([leg.foot for leg in legs])
    lever = subtract(middle, scale(chain.algebra.constant(legs[0].radius), vectors["z"]))
    velocity = add(vectors["v"], cross(vectors["w"], lever))
    center = add(vectors["v"], cross(vectors["w"], middle))
    axes, zero = _world(vectors), [chain.algebra.constant(0.0)] * 3
    knee = max(index for index, link in enumerate(legs[0].links) if np.any(link.position))
    values = [height + dot(vectors["z"], middle)]
    values += [dot(axis, velocity) for axis in axes]
    values += [dot(axis, center) for axis in axes]
    values += chain.from_root(zero, knee) + chain.from_root(zero) + chain.from_root(middle)
    return values, middle


def _pad(
    chain: _Chain, vectors: dict[str, Vector], middle: Vector, radius: float
) -> tuple[tuple[_Inertia, Vector, Vector], Vector, Vector]:
    """What the pad does to the last link: dampers as inertia, the rest as a force; contact point; ``A_0``.

    With ``B = drag 1 + (damping - drag) n n^T``, the force is ``f - h/2 B (a + A_0)``, where ``a`` is what
    comes on top of the contact point's motion and ``A_0 = g + b + K r`` makes it the real acceleration.
    """
    algebra, n = chain.algebra, vectors["z"]
    lever = subtract(middle, scale(algebra.constant(radius), n))
    drag = chain.half * algebra.variable("drag")
    extra = chain.half * (algebra.variable("damping") - algebra.variable("drag"))
    offset = add(vectors["g"], add(vectors["b"], times(chain.turning[-1], lever)))
    push = [algebra.constant(0.0)] * 3
    for value, axis in zip(algebra.variables("force", 3), _world(vectors), strict=True):
        push = add(push, scale(value, axis))
    push = subtract(push, add(scale(drag, offset), scale(extra * dot(n, offset), n)))
    arm = cross(middle, n)
    along, dragged = scale(extra, arm), scale(drag, lever)
    rotation = _symmetric(lambda a, b: along[a] * arm[b] - dragged[a] * lever[b])
    square = dot(dragged, lever)
    for a in range(3):
        rotation[a][a] = rotation[a][a] + square
    coupling = plus(skew(dragged), [[along[a] * n[b] for b in range(3)] for a in range(3)])
    normal = scale(extra, n)
    translation = _symmetric(lambda a, b: normal[a] * n[b] + (drag if a == b else 0.0))
    pad = _Inertia(rotation, coupling, translation)
    return (pad, [-x for x in cross(lever, push)], [-x for x in push]), lever, offset


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
    blocks = np.block(
        [
            [np.array(total.rotation), np.array(total.coupling)],
            [np.array(transpose(total.coupling)), np.array(total.translation)],
        ]
    )
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
