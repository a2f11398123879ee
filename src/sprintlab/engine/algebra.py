"""Symbolic arithmetic that writes straight-line C++: the generator's only tool.

An expression is a node of a directed acyclic graph. Equal expressions are one node (hash consing), and zeros,
ones and constants vanish while the graph is built, so that the written code holds only what the robot's
structure really has: Featherstone (2008), *Rigid Body Dynamics Algorithms*, section 10.4.

A constant has one value per leg, because one thread runs the same code for any leg: where all legs agree it
is written as a literal, else as an entry of the legs' table, ``leg[k]``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sprintlab.core.array_types import FloatArray

_ZERO = 1e-14
_FORMATS = {
    "+": "{} + {}",
    "-": "{} - {}",
    "*": "{} * {}",
    "negate": "-{}",
    "reciprocal": "reciprocal({})",
}


class Expression:
    """One node: an operation on other nodes, a constant or a variable. Made by an ``Algebra`` only."""

    __slots__ = ("algebra", "arguments", "index", "operation", "values")

    def __init__(
        self, algebra: Algebra, operation: str, arguments: tuple[Expression, ...], values: tuple
    ) -> None:
        self.algebra, self.operation, self.arguments, self.values = algebra, operation, arguments, values
        self.index = algebra.count()

    def is_constant(self, value: float | None = None) -> bool:
        """Whether it is a constant and, if asked, ``value`` on every leg."""
        return self.operation == "constant" and (value is None or all(x == value for x in self.values))

    def _of_values(self, values: FloatArray) -> Expression:
        return self.algebra.constant(values)

    def _array(self) -> FloatArray:
        return np.array(self.values)

    def _wrap(self, other: Expression | float) -> Expression:
        return other if isinstance(other, Expression) else self.algebra.constant(other)

    def __add__(self, other: Expression | float) -> Expression:
        other = self._wrap(other)
        if self.is_constant(0.0) or other.is_constant(0.0):
            return other if self.is_constant(0.0) else self
        if self.is_constant() and other.is_constant():
            return self._of_values(self._array() + other._array())
        if other.operation == "negate":
            return self - other.arguments[0]
        if self.operation == "negate":
            return other - self.arguments[0]
        first, second = sorted((self, other), key=lambda node: node.index)
        return self.algebra.node("+", first, second)

    __radd__ = __add__

    def __neg__(self) -> Expression:
        if self.is_constant():
            return self._of_values(-self._array())
        if self.operation == "negate":
            return self.arguments[0]
        if self.operation == "-":
            return self.arguments[1] - self.arguments[0]
        return self.algebra.node("negate", self)

    def __sub__(self, other: Expression | float) -> Expression:
        other = self._wrap(other)
        if other.is_constant(0.0):
            return self
        if self.is_constant(0.0):
            return -other
        if self is other:
            return self.algebra.constant(0.0)
        if self.is_constant() and other.is_constant():
            return self._of_values(self._array() - other._array())
        if other.operation == "negate":
            return self + other.arguments[0]
        return self.algebra.node("-", self, other)

    def __rsub__(self, other: float) -> Expression:
        return self._wrap(other) - self

    def __mul__(self, other: Expression | float) -> Expression:
        other = self._wrap(other)
        if self.is_constant(0.0) or other.is_constant(0.0):
            return self.algebra.constant(0.0)
        if self.is_constant() and other.is_constant():
            return self._of_values(self._array() * other._array())
        if self.is_constant():
            return other * self
        if other.is_constant():
            return self._scaled(other)
        if self.operation == "negate":
            return -(self.arguments[0] * other)
        if other.operation == "negate":
            return -(self * other.arguments[0])
        first, second = sorted((self, other), key=lambda node: node.index)
        return self.algebra.node("*", first, second)

    __rmul__ = __mul__

    def _scaled(self, factor: Expression) -> Expression:
        if factor.is_constant(1.0):
            return self
        if factor.values[0] < 0.0:
            return -(self * self._of_values(-factor._array()))
        if self.operation == "negate":
            return -(self.arguments[0] * factor)
        return self.algebra.node("*", self, factor)


class Algebra:
    """All nodes of one generated function.

    Args:
        legs: values that every constant has.
    """

    def __init__(self, legs: int) -> None:
        self.legs = legs
        self.table: list[FloatArray] = []
        self._nodes: dict[tuple, Expression] = {}
        self._count = 0

    def count(self) -> int:
        """A number that no other node has."""
        self._count += 1
        return self._count

    def node(self, operation: str, *arguments: Expression, values: tuple = ()) -> Expression:
        """The one node of this operation on these arguments."""
        key = (operation, values, *(argument.index for argument in arguments))
        if key not in self._nodes:
            self._nodes[key] = Expression(self, operation, arguments, values)
        return self._nodes[key]

    def constant(self, value: float | FloatArray) -> Expression:
        """One number, or one per leg ``(legs,)``."""
        values = np.broadcast_to(np.asarray(value, dtype=float), (self.legs,))
        values = np.where(np.abs(values) < _ZERO, 0.0, values)
        return self.node("constant", values=tuple(round(float(x), 15) for x in values))

    def variable(self, name: str) -> Expression:
        """What the C++ code around the function calls ``name``."""
        return self.node("variable", values=(name,))

    def variables(self, name: str, count: int) -> NDArray[np.object_]:
        """``name[0]`` to ``name[count - 1]``."""
        return np.array([self.variable(f"{name}[{index}]") for index in range(count)])

    def zeros(self) -> Vector:
        """A vector of zeros."""
        return np.array([self.constant(0.0)] * 3)

    def sine(self, angle: Expression) -> tuple[Expression, Expression]:
        """Sine and cosine of an angle."""
        return self.node("sin", angle), self.node("cos", angle)

    def reciprocal(self, value: Expression) -> Expression:
        """``1 / value``."""
        return self.node("reciprocal", value)

    def leg_constant(self, values: FloatArray) -> str:
        """Name of an entry of the legs' table; the same for equal values."""
        for index, row in enumerate(self.table):
            for sign, mark in ((1.0, ""), (-1.0, "-")):
                if np.allclose(row, sign * values, rtol=1e-13, atol=0.0):
                    return f"({mark}leg[{index}])" if mark else f"leg[{index}]"
        self.table.append(values)
        return f"leg[{len(self.table) - 1}]"


class Writer:
    """Writes nodes as C++ statements, each once; node ``i`` becomes the variable ``t{i}``."""

    def __init__(self, algebra: Algebra) -> None:
        self._algebra = algebra
        self.written: set[int] = set()

    def reference(self, node: Expression) -> str:
        """What the code calls a node: a literal, a name, or its variable."""
        if node.operation == "variable":
            return str(node.values[0])
        if node.operation != "constant":
            return f"t{node.index}"
        if node.is_constant(node.values[0]):
            return f"S({node.values[0]!r})"
        return self._algebra.leg_constant(np.array(node.values))

    def write(self, results: Iterable[Expression]) -> list[str]:
        """Statements for what ``results`` need and is not written yet, in an order that compiles."""
        lines = []
        for node in self._ordered(list(results)):
            if node.index not in self.written:
                lines.append(self._statement(node))
        return lines

    def _ordered(self, results: Sequence[Expression]) -> list[Expression]:
        """Depth first: arguments before what uses them."""
        order, seen = [], set(self.written)
        stack = [(node, False) for node in reversed(results)]
        while stack:
            node, ready = stack.pop()
            if ready:
                order.append(node)
            elif node.index not in seen and node.operation not in ("constant", "variable"):
                seen.add(node.index)
                stack.append((node, True))
                stack.extend((argument, False) for argument in reversed(node.arguments))
        return order

    def _statement(self, node: Expression) -> str:
        names = [self.reference(argument) for argument in node.arguments]
        if node.operation in ("sin", "cos"):
            sine, cosine = self._algebra.sine(node.arguments[0])
            self.written |= {sine.index, cosine.index}
            return f"number t{sine.index}, t{cosine.index}; sine({names[0]}, t{sine.index}, t{cosine.index});"
        self.written.add(node.index)
        return f"const number t{node.index} = {_FORMATS[node.operation].format(*names)};"


Vector: TypeAlias = NDArray[np.object_]
"""Three expressions; arrays of expressions add, multiply and transpose as arrays of numbers do."""
Matrix: TypeAlias = NDArray[np.object_]
"""Three rows of three."""


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product of two vectors."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def skew(vector: Vector) -> Matrix:
    """``[vector]x``."""
    x, y, z = vector
    return np.array([[x - x, -z, y], [z, x - x, -x], [-y, x, x - x]])


def diagonal(value: Expression) -> Matrix:
    """A number times the unit matrix."""
    matrix = np.full((3, 3), value - value)
    matrix[np.diag_indices(3)] = value
    return matrix


def mirrored(matrix: Matrix) -> Matrix:
    """A symmetric matrix from its upper triangle: the lower one is then not computed."""
    return np.array([[matrix[min(a, b), max(a, b)] for b in range(3)] for a in range(3)])


class Rotation:
    """Rotation about a coordinate axis: ``up`` maps a child's coordinates to its parent's, ``down`` back."""

    def __init__(self, axis: int, sine: Expression, cosine: Expression) -> None:
        self._axis, self._sine, self._cosine = axis, sine, cosine
        first, second = (axis + 1) % 3, (axis + 2) % 3
        self._matrix = diagonal(sine.algebra.constant(1.0))
        self._matrix[[first, second], [first, second]] = cosine
        self._matrix[first, second], self._matrix[second, first] = -sine, sine

    def up(self, vector: Vector) -> Vector:
        """From the child's frame to the parent's."""
        return self._matrix @ vector

    def down(self, vector: Vector) -> Vector:
        """From the parent's frame to the child's."""
        return self._matrix.T @ vector

    def up_matrix(self, matrix: Matrix) -> Matrix:
        """``R matrix R^T``."""
        return self._matrix @ matrix @ self._matrix.T

    def up_symmetric(self, matrix: Matrix) -> Matrix:
        """``R matrix R^T`` of a symmetric matrix, with half of the products."""
        k, i, j = self._axis, (self._axis + 1) % 3, (self._axis + 2) % 3
        sine, cosine, turned = self._sine, self._cosine, matrix.copy()
        mixed, difference = cosine * sine, matrix[i, i] - matrix[j, j]
        twice = mixed * matrix[i, j] + mixed * matrix[i, j]
        turned[i, i] = matrix[i, i] - sine * sine * difference - twice
        turned[j, j] = matrix[j, j] + sine * sine * difference + twice
        turned[i, j] = turned[j, i] = (cosine * cosine - sine * sine) * matrix[i, j] + mixed * difference
        turned[k, i] = turned[i, k] = cosine * matrix[k, i] - sine * matrix[k, j]
        turned[k, j] = turned[j, k] = sine * matrix[k, i] + cosine * matrix[k, j]
        return turned
