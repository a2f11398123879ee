"""What a policy's network will take, known before it is loaded: every tensor's size, from the file alone.

An ONNX file is a program: it may loop for ever, ask for 40 GB, read other files. A policy is a network of
known operators whose sizes follow from its own numbers, so they are worked out here, for one robot, without
running anything: what cannot be followed is refused. Whoever reads the bytes can also change what stands
beside the network: ``with_metadata``.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

MOST_NUMBERS = 1 << 24
"""Most numbers of one tensor, and of all that one step makes."""
MOST_PRODUCTS = 1 << 30
"""Most multiplications of one step: beyond, no step would fit into its 20 ms."""
_MATRIX_WORK = 2048  # multiplications in whose time the runtime begins one product of matrices, however small
_METADATA = 14  # field of a model in which its metadata stand
_MOST_NODES = 5000
_MOST_FIELDS = 50_000  # of which the runtime's time grows with the square; a policy has a thousand
_MOST_KNOWN = 4096  # numbers of a tensor whose values are followed: shapes, indices

Shape = tuple[int, ...]
Value = npt.NDArray[Any] | None

# Types of tensors that a policy may hold: ONNX's number, and NumPy's type.
_TYPES: dict[int, str] = {1: "<f4", 2: "u1", 3: "i1", 6: "<i4", 7: "<i8", 9: "?", 11: "<f8"}
_INT64, _BOOL = 7, 9
_FOLLOWED = {_INT64, _BOOL}
"""Types whose values are followed: here and in the runtime they are the same to the last bit."""
_WHOLE = set(range(2, 8)) | {12, 13}
# Kinds of attributes, and the field in which each keeps its value.
_FLOAT, _WHOLE_NUMBER, _TENSOR, _WHOLE_NUMBERS = 1, 2, 4, 7
_VALUE_FIELDS = {_FLOAT: -2, _WHOLE_NUMBER: 3, 3: 4, _TENSOR: 5, 6: 7, _WHOLE_NUMBERS: 8, 8: 9}


class GraphError(ValueError):
    """A network that no policy has; the message completes "its network ..."."""


class _Tensor(NamedTuple):
    """A tensor: its shape with one robot, and its values where they are few and known.

    Attributes:
        shape: with one robot.
        value: whole numbers of 64 bits, or truth values; None where nobody knows them.
        whole: whether it holds whole numbers.
    """

    shape: Shape
    value: Value = None
    whole: bool = False


class _Attribute(NamedTuple):
    kind: int
    number: int
    numbers: tuple[int, ...]
    tensor: _Tensor | None


class _Node(NamedTuple):
    operator: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    attributes: Mapping[str, _Attribute]

    def number(self, name: str, default: int) -> int:
        return self.of_kind(name, _WHOLE_NUMBER).number if name in self.attributes else default

    def value(self) -> _Tensor | None:
        """The tensor that a constant or a filled shape holds."""
        return self.of_kind("value", _TENSOR).tensor if "value" in self.attributes else None

    def of_kind(self, name: str, kind: int) -> _Attribute:
        """An attribute that is there; of another kind runtimes take another value, or their default."""
        if self.attributes[name].kind != kind:
            raise GraphError(
                f"holds an operator {self.operator} with an attribute of another kind than it has"
            )
        return self.attributes[name]

    def flag(self, name: str, default: bool) -> bool:
        """A choice of two; runtimes differ in what they make of any other number."""
        number = self.number(name, int(default))
        if number not in (0, 1):
            raise ValueError(name)
        return bool(number)


@dataclass
class _Costs:
    """What one step takes."""

    products: int = 0
    numbers: int = 0


@dataclass(frozen=True)
class _Graph:
    nodes: list[_Node] = field(default_factory=list["_Node"])
    tensors: dict[str, _Tensor] = field(default_factory=dict[str, _Tensor])
    inputs: dict[str, Shape] = field(default_factory=dict[str, Shape])


def check_graph(content: bytes) -> None:
    """Refuse an ONNX file whose network could do more than a policy does.

    Raises:
        GraphError: it is damaged; holds an operator that a policy does not need, a subgraph, a function or
            data in other files; or one step of it would take more memory or multiplications than is allowed.
    """
    try:
        graph = _read_model(content)
        _follow(graph)
    except (IndexError, struct.error, UnicodeDecodeError, OverflowError, TypeError) as error:
        raise GraphError("is damaged") from error


def with_metadata(content: bytes, name: str, text: str) -> bytes:
    """An ONNX file in which one entry of the metadata is another one; every other byte is the same.

    Args:
        content: of a file that ``check_graph`` accepts.
        name: key of the metadata entry; where the file has no such entry, one is added.
        text: its new content.

    Raises:
        GraphError: the file is damaged.
    """
    wire, before = _Wire(), slice(len(content), len(content))
    try:
        for entry in wire.entries(memoryview(content)):
            if entry.number == _METADATA and _text(_single(wire.fields(entry.value), 1, b"")) == name:
                before = entry.place
    except (IndexError, UnicodeDecodeError) as error:
        raise GraphError("is damaged") from error
    pair = _written(1, name.encode()) + _written(2, text.encode())
    return content[: before.start] + _written(_METADATA, pair) + content[before.stop :]


# --- the file's bytes: protocol buffers -------------------------------------------------------------------


class _Entry(NamedTuple):
    number: int
    value: Any
    place: slice


class _Wire:
    """Reads messages of the protocol buffers' wire format; counts fields: no file keeps it busy."""

    def __init__(self) -> None:
        self._fields = 0

    def fields(self, data: memoryview) -> dict[int, list[Any]]:
        """Values by field number: whole numbers, or the bytes of everything else.

        Numbers of four or eight bytes stand under the negative field number: where the field is of another
        kind, runtimes pass over them.
        """
        found: dict[int, list[Any]] = {}
        for entry in self.entries(data):
            found.setdefault(entry.number, []).append(entry.value)
        return found

    def entries(self, data: memoryview) -> Iterator[_Entry]:
        """One entry after the other, numbered as in ``fields``."""
        at = 0
        while at < len(data):
            self._fields += 1
            if self._fields > _MOST_FIELDS:
                raise GraphError(f"has more than {_MOST_FIELDS} entries")
            start = at
            key, at = _varint(data, at)
            if key >> 32:  # runtimes drop the rest, and read another field
                raise GraphError("is damaged")
            kind = key & 7
            if kind == 0:
                value, at = _varint(data, at)
            elif kind in (1, 2, 5):
                length, at = (8, at) if kind == 1 else (4, at) if kind == 5 else _varint(data, at)
                if at + length > len(data):
                    raise GraphError("is cut off")
                value, at = data[at : at + length], at + length
            else:
                raise GraphError("is damaged")
            yield _Entry(-(key >> 3) if kind in (1, 5) else key >> 3, value, slice(start, at))


def _varint(data: memoryview, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        byte = data[at]
        value |= (byte & 127) << shift
        at += 1
        if byte < 128:
            return value & (1 << 64) - 1, at
    raise GraphError("is damaged")


def _written(number: int, data: bytes) -> bytes:
    """An entry that holds these bytes."""
    return _written_varint(number << 3 | 2) + _written_varint(len(data)) + data


def _written_varint(value: int) -> bytes:
    written = bytearray()
    while value > 127:
        written.append(value & 127 | 128)
        value >>= 7
    return bytes([*written, value])


def _signed(value: Any) -> int:
    if not isinstance(value, int):
        raise GraphError("is damaged")
    return value - (1 << 64) if value >> 63 else value


def _bytes(value: Any) -> bytes:
    if isinstance(value, int):  # bytes(n) would be n zeros
        raise GraphError("is damaged")
    return bytes(value)


def _text(value: Any) -> str:
    return _bytes(value).decode("utf-8")


def _single(fields: Mapping[int, list[Any]], number: int, default: Any = None) -> Any:
    """The value of a field that must not come twice: readers differ in what they make of the second."""
    values = fields.get(number, [default])
    if len(values) > 1:
        raise GraphError("is damaged: an entry comes twice")
    return values[0]


def _whole_numbers(values: Sequence[Any]) -> tuple[int, ...]:
    """A repeated whole number, packed or not."""
    numbers: list[int] = []
    for value in values:
        if isinstance(value, int):
            numbers.append(_signed(value))
            continue
        at = 0
        while at < len(value):
            number, at = _varint(value, at)
            numbers.append(_signed(number))
            if len(numbers) > _MOST_FIELDS:
                raise GraphError(f"has more than {_MOST_FIELDS} entries")
    return tuple(numbers)


def _check_model(wire: _Wire, model: Mapping[int, list[Any]]) -> None:
    """Refuse what stands beside the network and no policy has."""
    if 25 in model:
        raise GraphError("defines functions of its own")
    if 20 in model:
        raise GraphError("holds a training")
    names = [_bytes(_single(wire.fields(item), 1, b"")) for item in model.get(_METADATA, [])]
    if len(set(names)) < len(names):  # of two contracts, some readers take the first and some the last
        raise GraphError("is damaged: two of its metadata entries have one name")


def _read_model(content: bytes) -> _Graph:
    wire = _Wire()
    model = wire.fields(memoryview(content))
    _check_model(wire, model)
    if 7 not in model:
        raise GraphError("is missing")
    fields = wire.fields(_single(model, 7))
    if 15 in fields:
        raise GraphError("holds sparse tensors")
    graph = _Graph()
    for item in fields.get(5, []):
        name, tensor = _read_tensor(wire, item)
        if name in graph.tensors:
            raise GraphError("is damaged: two of its tensors have one name")
        graph.tensors[name] = tensor
    for item in fields.get(11, []):
        name, shape = _read_input(wire, item)
        if name not in graph.tensors:
            graph.inputs[name] = shape
    if len(fields.get(1, [])) > _MOST_NODES:
        raise GraphError(f"has more than {_MOST_NODES} operators")
    graph.nodes.extend(_read_node(wire, item) for item in fields.get(1, []))
    return graph


def _read_tensor(wire: _Wire, data: memoryview) -> tuple[str, _Tensor]:
    fields = wire.fields(data)
    if 13 in fields or _single(fields, 14, 0) != 0:
        raise GraphError("keeps numbers in other files")
    kind = _single(fields, 2, 0)
    if kind not in _TYPES:
        raise GraphError("holds a tensor of a type that no policy has")
    shape = _checked(_whole_numbers(fields.get(1, [])))
    count = math.prod(shape)
    raw = _single(fields, 9)
    values: Value = None
    if raw is not None:
        if len(raw) != count * np.dtype(_TYPES[kind]).itemsize:
            raise GraphError("holds a tensor whose size is not that of its shape")
        if count <= _MOST_KNOWN:
            values = np.frombuffer(raw, dtype=_TYPES[kind]).reshape(shape)
    else:
        values = _listed(fields, kind, count)
        values = None if values is None else values.reshape(shape)
    followed = values if kind in _FOLLOWED else None
    return _text(_single(fields, 8, b"")), _Tensor(shape, followed, kind in _WHOLE)


def _listed(fields: Mapping[int, list[Any]], kind: int, count: int) -> Value:
    """Values that stand in the field of their type instead of in raw bytes."""
    number = {1: 4, 2: 5, 3: 5, 6: 5, 7: 7, 9: 5, 11: 10}[kind]
    found = fields.get(number, [])
    if kind in (1, 11):
        text = b"".join(_bytes(value) for value in (*found, *fields.get(-number, [])))
        size = 4 if kind == 1 else 8
        if len(text) != count * size:
            raise GraphError("holds a tensor whose size is not that of its shape")
        return None
    numbers = _whole_numbers(found)
    if len(numbers) != count:
        raise GraphError("holds a tensor whose size is not that of its shape")
    if kind == _BOOL and not {0, 1}.issuperset(numbers):  # of more than 32 bits runtimes drop the rest
        raise GraphError("is damaged: a truth value is neither 0 nor 1")
    return np.array(numbers, dtype=_TYPES[kind]) if kind in _FOLLOWED else None


def _read_input(wire: _Wire, data: memoryview) -> tuple[str, Shape]:
    """Name and shape of an input; a dimension without a number is the batch, here one robot."""
    fields = wire.fields(data)
    kind = wire.fields(_single(fields, 2, memoryview(b"")))
    tensor = wire.fields(_single(kind, 1, memoryview(b"")))
    shape: list[int] = []
    for item in wire.fields(_single(tensor, 2, memoryview(b""))).get(1, []):
        dimension = wire.fields(item)
        shape.append(_signed(_single(dimension, 1)) if 1 in dimension else 1)
    return _text(_single(fields, 1, b"")), _checked(tuple(shape))


def _read_node(wire: _Wire, data: memoryview) -> _Node:
    fields = wire.fields(data)
    domain = _text(_single(fields, 7, b""))
    operator = _text(_single(fields, 4, b""))
    if domain not in ("", "ai.onnx") or operator not in _OPERATORS:
        known = f"{domain}.{operator}" if domain else operator
        raise GraphError(f"uses the operator {known[:60]!r}, which is none of those that a policy may use")
    attributes: dict[str, _Attribute] = {}
    for item in fields.get(5, []):
        name, attribute = _read_attribute(wire, item, operator)
        if name in attributes:
            raise GraphError("is damaged: an entry comes twice")
        attributes[name] = attribute
    return _Node(
        operator,
        tuple(_text(value) for value in fields.get(1, [])),
        tuple(_text(value) for value in fields.get(2, [])),
        attributes,
    )


def _read_attribute(wire: _Wire, data: memoryview, operator: str) -> tuple[str, _Attribute]:
    """Name and value; refuses one that holds a value of another kind than it says."""
    fields = wire.fields(data)
    if {6, 10, 11, 14, 15, 21, 22, 23} & fields.keys():
        raise GraphError(f"holds a network within its operator {operator}")
    kind = _single(fields, 20, 0)
    values = {2, -2, 3, 4, 5, 7, -7, 8, 9} & fields.keys()
    if kind not in _VALUE_FIELDS or not values <= {_VALUE_FIELDS[kind], -7 if kind == 6 else 0}:
        raise GraphError(
            f"holds an attribute of its operator {operator} that is of another kind than it says"
        )
    tensor = _read_tensor(wire, _single(fields, 5))[1] if 5 in fields else None
    number, numbers = _signed(_single(fields, 3, 0)), _whole_numbers(fields.get(8, []))
    return _text(_single(fields, 1, b"")), _Attribute(kind, number, numbers, tensor)


# --- sizes ------------------------------------------------------------------------------------------------


def _checked(shape: Sequence[int]) -> Shape:
    """A shape that is one, of a tensor that is not too large."""
    if any(size < 0 for size in shape) or len(shape) > 16:
        raise GraphError("holds a tensor without a shape")
    if math.prod(max(size, 1) for size in shape) > MOST_NUMBERS:
        raise GraphError(f"needs a tensor of {' x '.join(map(str, shape))} numbers, more than {MOST_NUMBERS}")
    return tuple(int(size) for size in shape)


def _follow(graph: _Graph) -> None:
    """Work out every tensor in the order of the nodes, which ONNX demands to be that of the computation."""
    tensors = dict(graph.tensors)
    tensors |= {name: _Tensor(shape) for name, shape in graph.inputs.items()}
    costs = _Costs()
    for node in graph.nodes:
        # A bound that Clip does not have; the runtime ends the process over other inputs without a name.
        unbound = node.operator == "Clip"
        named = [name for place, name in enumerate(node.inputs) if name or not (unbound and place)]
        inputs = [_made(tensors, name) for name in named]
        costs.products += sum(math.prod(tensor.shape) for tensor in inputs)
        for name, tensor in zip(node.outputs, _results(node, inputs, costs), strict=False):
            if name in tensors:
                raise GraphError("is damaged: two of its tensors have one name")
            tensors[name] = tensor
            costs.numbers += math.prod(tensor.shape)
        if costs.products > MOST_PRODUCTS or costs.numbers > MOST_NUMBERS:
            raise GraphError("takes more than a policy's step may: it would not fit into its 20 ms")


def _made(tensors: Mapping[str, _Tensor], name: str) -> _Tensor:
    if not name or name not in tensors:
        raise GraphError(f"uses the tensor {name[:60]!r} before it is made")
    return tensors[name]


def _results(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    """What an operator makes."""
    whole = _makes_whole(node, inputs)
    if whole and node.operator in _NO_WHOLE:
        raise GraphError(f"uses the operator {node.operator} on whole numbers, as no policy does")
    try:
        made = _OPERATORS[node.operator](node, inputs, costs)
    except GraphError:
        raise
    except (ValueError, KeyError, IndexError, AttributeError, ZeroDivisionError) as error:
        raise GraphError(f"holds an operator {node.operator} whose sizes do not fit") from error
    if len(node.outputs) > len(made):
        raise GraphError(f"uses an output of {node.operator} that no policy uses")
    return [_Tensor(_checked(tensor.shape), tensor.value, whole) for tensor in made]


def _makes_whole(node: _Node, inputs: Inputs) -> bool:
    """Whether what an operator makes are whole numbers."""
    if node.operator == "Cast":
        return node.number("to", 1) in _WHOLE
    if node.operator in ("Constant", "ConstantOfShape"):
        tensor = node.value()
        named = "value_int" in node.attributes or "value_ints" in node.attributes
        return named if tensor is None else tensor.whole
    if node.operator in _TRUTHS:
        return False
    several = node.operator in _TOGETHER or node.operator == "Concat"
    given = inputs if several else inputs[:1]
    return node.operator == "Shape" or any(tensor.whole for tensor in given)


Inputs = list[_Tensor]
_Rule = Callable[[_Node, Inputs, _Costs], list[_Tensor]]


def _known(inputs: Inputs, index: int) -> npt.NDArray[Any]:
    """Values of an input that decides about sizes."""
    value = inputs[index].value
    if value is None:
        raise GraphError("computes sizes from what the robot measures")
    return value


def _kept(shape: Shape, values: Sequence[Value], function: Callable[[list[Any]], Any]) -> _Tensor:
    """A tensor, with its values where all that it is made from is known and it is small.

    Args:
        shape: of the tensor.
        values: that it is made from.
        function: of these values, gives its own.
    """
    if any(value is None for value in values) or math.prod(shape) > _MOST_KNOWN:
        return _Tensor(shape)
    with np.errstate(all="ignore"):
        return _Tensor(shape, np.asarray(function(list(values))))


def _same(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    return [_Tensor(inputs[0].shape)]


def _alike(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    first, cast = inputs[0], node.operator == "Cast"
    if cast and node.number("to", 0) not in _TYPES:
        raise GraphError("makes numbers of a type that no policy has")
    if cast and node.number("to", 1) != _INT64:
        return [_Tensor(first.shape)]
    return [_kept(first.shape, [first.value], lambda v: v[0].astype(np.int64) if cast else v[0])]


def _broadcast(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    shape = _checked(np.broadcast_shapes(*(tensor.shape for tensor in inputs)))
    function = _ARITHMETIC.get(node.operator)
    if node.operator == "Div" and any(tensor.whole and tensor.value is None for tensor in inputs):
        raise GraphError("divides whole numbers that it computes from what the robot measures")
    if function is None:
        return [_Tensor(shape)]
    return [_kept(shape, [tensor.value for tensor in inputs], lambda v: function(*v))]


def _division(a: npt.NDArray[Any], b: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """As ONNX divides whole numbers: toward zero. Negative ones end a program in some cases: not allowed."""
    if (a < 0).any() or (b <= 0).any():
        raise ValueError("no division of sizes")
    return np.asarray(a // b)


_ARITHMETIC: dict[str, Callable[..., Any]] = {
    "Add": np.add, "Sub": np.subtract, "Mul": np.multiply, "Div": _division,
    "Equal": np.equal, "Where": np.where,
}  # fmt: skip


def _product(rows: Shape, columns: Shape, costs: _Costs) -> Shape:
    """Shape of a matrix product as NumPy makes it; its multiplications are counted."""
    left, right = (1, *rows) if len(rows) == 1 else rows, (*columns, 1) if len(columns) == 1 else columns
    if not rows or not columns or left[-1] != right[-2] or 0 in (*rows, *columns):
        raise ValueError("shapes do not fit")  # of products of nothing the runtime makes other shapes
    stack = np.broadcast_shapes(left[:-2], right[:-2])
    full = _checked((*stack, left[-2], right[-1]))
    costs.products += math.prod(full) * left[-1] + _MATRIX_WORK * math.prod(stack)
    kept = list(full)
    if len(columns) == 1:
        kept.pop()
    if len(rows) == 1:
        kept.pop(len(stack))
    return tuple(kept)


def _matmul(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    return [_Tensor(_product(inputs[0].shape, inputs[1].shape, costs))]


def _gemm(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    a, b = inputs[0].shape, inputs[1].shape
    if len(a) != 2 or len(b) != 2:
        raise ValueError("matrices")
    a = a[::-1] if node.flag("transA", default=False) else a
    b = b[::-1] if node.flag("transB", default=False) else b
    return [_Tensor(_product(a, b, costs))]


def _constant(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    (name,) = node.attributes
    tensor = node.value()
    if tensor is not None:
        return [tensor]
    if name == "value_int":
        return [_Tensor((), np.array(node.number(name, 0)))]
    if name == "value_ints":
        numbers = node.of_kind(name, _WHOLE_NUMBERS).numbers
        return [_Tensor((len(numbers),), np.array(numbers, dtype=np.int64))]
    if name == "value_float" and node.of_kind(name, _FLOAT):
        return [_Tensor(())]
    raise GraphError("holds a constant of a kind that no policy has")


def _shape(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    if node.attributes:
        raise GraphError("uses the operator Shape in a form that no policy uses")
    shape = inputs[0].shape
    return [_Tensor((len(shape),), np.array(shape, dtype=np.int64))]


def _gather(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    data, index = inputs[0], inputs[1]
    axis = _axis(node.number("axis", 0), len(data.shape))
    shape = _checked((*data.shape[:axis], *index.shape, *data.shape[axis + 1 :]))
    return [_kept(shape, [data.value, index.value], lambda v: np.take(v[0], v[1].astype(np.int64), axis))]


def _axis(axis: int, rank: int) -> int:
    if not -rank <= axis < rank:
        raise ValueError("axis")
    return axis % rank


def _axes(node: _Node, inputs: Inputs, default: Sequence[int] = ()) -> tuple[int, ...]:
    """Axes, which older operators have as an attribute, newer ones as an input.

    An empty list is refused: by operator and version it means none of the axes, or all.
    """
    if "axes" in node.attributes:
        axes = node.of_kind("axes", _WHOLE_NUMBERS).numbers
    elif len(inputs) > 1:
        axes = tuple(int(value) for value in _known(inputs, 1).reshape(-1))
    else:
        return tuple(default)
    if not axes:
        raise ValueError("no axes")
    return axes


def _unsqueeze(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    data, axes = inputs[0], _axes(node, inputs)
    rank = len(data.shape) + len(axes)
    places = {_axis(axis, rank) for axis in axes}
    if rank > 16 or len(places) != len(axes):
        raise ValueError("axes")
    sizes = iter(data.shape)
    shape = tuple(1 if place in places else next(sizes) for place in range(rank))
    return [_kept(shape, [data.value], lambda v: v[0].reshape(shape))]


def _squeeze(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    data = inputs[0]
    rank = len(data.shape)
    places = {
        _axis(axis, rank) for axis in _axes(node, inputs, [i for i in range(rank) if data.shape[i] == 1])
    }
    if any(data.shape[place] != 1 for place in places):
        raise ValueError("axes")
    shape = tuple(size for place, size in enumerate(data.shape) if place not in places)
    return [_kept(shape, [data.value], lambda v: v[0].reshape(shape))]


def _concat(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    axis = _axis(node.number("axis", 0), len(inputs[0].shape))
    others = {(*tensor.shape[:axis], *tensor.shape[axis + 1 :]) for tensor in inputs}
    if len(others) != 1:
        raise ValueError("shapes do not fit")
    total = sum(tensor.shape[axis] for tensor in inputs)
    shape = _checked((*inputs[0].shape[:axis], total, *inputs[0].shape[axis + 1 :]))
    return [_kept(shape, [tensor.value for tensor in inputs], lambda v: np.concatenate(v, axis))]


def _filled(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    shape = _checked([int(size) for size in _known(inputs, 0).reshape(-1)])
    given = node.value()
    value = None if given is None else given.value
    return [_kept(shape, [value], lambda v: np.full(shape, v[0].reshape(-1)[0]))]


def _expand(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    data = inputs[0]
    wanted = _checked([int(size) for size in _known(inputs, 1).reshape(-1)])
    shape = _checked(np.broadcast_shapes(data.shape, wanted))
    return [_kept(shape, [data.value], lambda v: np.broadcast_to(v[0], shape))]


def _tile(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    data, repeats = inputs[0], [int(count) for count in _known(inputs, 1).reshape(-1)]
    shape = _checked([size * count for size, count in zip(data.shape, repeats, strict=True)])
    return [_kept(shape, [data.value], lambda v: np.tile(v[0], repeats))]


def _slice(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    data = inputs[0]
    starts, ends = _known(inputs, 1).reshape(-1), _known(inputs, 2).reshape(-1)
    axes = _known(inputs, 3).reshape(-1) if len(inputs) > 3 else np.arange(len(starts))
    steps = _known(inputs, 4).reshape(-1) if len(inputs) > 4 else np.ones(len(starts), int)
    parts = [slice(None)] * len(data.shape)
    shape = list(data.shape)
    for start, end, axis, step in zip(starts, ends, axes, steps, strict=True):
        place = _axis(int(axis), len(shape))
        if step < 1:
            raise ValueError("backwards, where ONNX and Python do not stop at the same number")
        parts[place] = slice(int(start), int(end), int(step))
        shape[place] = len(range(*parts[place].indices(data.shape[place])))
    return [_kept(tuple(shape), [data.value], lambda v: v[0][tuple(parts)])]


def _reshape(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    data, wanted = inputs[0], [int(size) for size in _known(inputs, 1).reshape(-1)]
    if not node.flag("allowzero", default=False):
        wanted = [data.shape[place] if size == 0 else size for place, size in enumerate(wanted)]
    count, rest = math.prod(data.shape), math.prod(size for size in wanted if size != -1)
    if wanted.count(-1) == 1 and rest > 0 and count % rest == 0:
        wanted[wanted.index(-1)] = count // rest
    shape = _checked(wanted)
    if math.prod(shape) != count:
        raise ValueError("sizes do not fit")
    return [_kept(shape, [data.value], lambda v: v[0].reshape(shape))]


def _flatten(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    shape, axis = inputs[0].shape, node.number("axis", 1)
    axis = axis if axis >= 0 else axis + len(shape)
    return [_Tensor((math.prod(shape[:axis]), math.prod(shape[axis:])))]


def _transpose(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    shape = inputs[0].shape
    order = (
        node.of_kind("perm", _WHOLE_NUMBERS).numbers if "perm" in node.attributes else range(len(shape))[::-1]
    )
    if sorted(order) != list(range(len(shape))):
        raise ValueError("perm")
    return [_Tensor(tuple(shape[place] for place in order))]


def _split(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    shape, parts = inputs[0].shape, len(node.outputs)
    axis = _axis(node.number("axis", 0), len(shape))
    if len(inputs) > 1:
        sizes = [int(size) for size in _known(inputs, 1).reshape(-1)]
    elif "split" in node.attributes:
        sizes = list(node.of_kind("split", _WHOLE_NUMBERS).numbers)
    else:
        size = -(-shape[axis] // parts)
        sizes = [min(size, shape[axis] - size * part) for part in range(parts)]
    told = node.number("num_outputs", parts)  # with another number the runtime ends the process
    if sum(sizes) != shape[axis] or len(sizes) != parts or told != parts:
        raise ValueError("split")
    return [_Tensor((*shape[:axis], size, *shape[axis + 1 :])) for size in sizes]


def _reduce(node: _Node, inputs: Inputs, costs: _Costs) -> list[_Tensor]:
    shape = inputs[0].shape
    if 0 in shape or node.number("noop_with_empty_axes", 0):
        raise ValueError("nothing to reduce")
    places = {_axis(axis, len(shape)) for axis in _axes(node, inputs, range(len(shape)))}
    if node.flag("keepdims", default=True):
        return [_Tensor(tuple(1 if place in places else size for place, size in enumerate(shape)))]
    return [_Tensor(tuple(size for place, size in enumerate(shape) if place not in places))]


_ONE_FOR_ONE = (
    "Abs Celu Clip Cos Elu Erf Exp Gelu HardSigmoid HardSwish LayerNormalization LeakyRelu Log LogSoftmax "
    "Mish Neg Not Reciprocal Relu Selu Sigmoid Sign Sin Softmax Softplus Softsign Sqrt Tanh Floor Ceil Round "
    "BatchNormalization"
)
_TRUTHS = ("Equal", "Less", "Greater", "LessOrEqual", "GreaterOrEqual", "And", "Or")
_TOGETHER = ("Add", "Sub", "Mul", "Div", "Pow", "Min", "Max", "Sum", "Mean", "Where", "PRelu", *_TRUTHS)
_NO_WHOLE = ("Mean", "Pow", "ReduceMean")
_OPERATORS: dict[str, _Rule] = {
    **dict.fromkeys(_ONE_FOR_ONE.split(), _same),
    **dict.fromkeys(("Identity", "Cast"), _alike),
    **dict.fromkeys(_TOGETHER, _broadcast),
    **dict.fromkeys(("ReduceMean", "ReduceSum", "ReduceMax", "ReduceMin"), _reduce),
    "MatMul": _matmul,
    "Gemm": _gemm,
    "Constant": _constant,
    "Shape": _shape,
    "Gather": _gather,
    "Unsqueeze": _unsqueeze,
    "Squeeze": _squeeze,
    "Concat": _concat,
    "ConstantOfShape": _filled,
    "Expand": _expand,
    "Tile": _tile,
    "Slice": _slice,
    "Reshape": _reshape,
    "Flatten": _flatten,
    "Transpose": _transpose,
    "Split": _split,
}
