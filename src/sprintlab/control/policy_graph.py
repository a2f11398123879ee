"""What a policy file's network may be: known operators, all numbers in the file, tensors of bounded size.

An ONNX file is a program, which may loop, read other files or ask for any amount of memory. A policy does
nothing of this, so that a file is checked before ONNX Runtime builds it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import onnx
from google.protobuf.message import DecodeError
from onnx import checker, shape_inference

LARGEST_TENSOR = 1 << 24
"""Most numbers of one tensor for one robot."""

_OPERATORS = """
Abs Add And Cast Ceil Clip Concat Constant ConstantOfShape Cos Div Elu Equal Erf Exp Expand Flatten
Floor Gather Gelu Gemm Greater GreaterOrEqual Identity LayerNormalization LeakyRelu Less LessOrEqual
Log MatMul Max Mean Min Mul Neg Not Or Pow Reciprocal ReduceMax ReduceMean ReduceMin ReduceSum Relu
Reshape Selu Shape Sigmoid Sign Sin Slice Softmax Softplus Split Sqrt Squeeze Sub Sum Tanh Tile
Transpose Unsqueeze Where
"""
OPERATORS = frozenset(_OPERATORS.split())
"""Operators of a policy's network: feed-forward, without branches, loops or random numbers."""


class GraphError(ValueError):
    """A network that no policy has; the message completes "its network ..."."""


def check_graph(content: bytes) -> None:
    """Refuse an ONNX file, given as its bytes, whose network could do more than a policy does."""
    model = _parsed(content)
    if model.functions or model.training_info or model.graph.sparse_initializer:
        raise GraphError("holds functions of its own, a training or sparse tensors")
    for node in model.graph.node:
        _check_node(node)
    for tensor in _tensors(model.graph):
        if tensor.external_data or tensor.data_location == onnx.TensorProto.EXTERNAL:
            raise GraphError("keeps numbers in other files")
    try:
        validated: Any = checker
        validated.check_model(model)
        _check_sizes(_inferred(model).graph)
    except (checker.ValidationError, shape_inference.InferenceError, DecodeError) as error:
        raise GraphError(f"is refused by ONNX: {str(error).strip().splitlines()[0]}") from error


def _parsed(content: bytes) -> Any:
    """The ONNX model in a file's bytes, without what it may keep in other files."""
    try:
        return onnx.load_model_from_string(content)
    except DecodeError as error:
        raise GraphError("is damaged") from error


def _check_node(node: Any) -> None:
    if node.domain not in ("", "ai.onnx") or node.op_type not in OPERATORS:
        raise GraphError(f"uses the operator {node.op_type[:60]!r}, which no policy of this package has")
    if any(attribute.HasField("g") or attribute.graphs for attribute in node.attribute):
        raise GraphError(f"holds a network within its operator {node.op_type}")


def _tensors(graph: Any) -> Iterator[Any]:
    """Every tensor whose numbers stand in the file: weights and constants."""
    yield from graph.initializer
    for node in graph.node:
        yield from (attribute.t for attribute in node.attribute if attribute.HasField("t"))


def _inferred(model: Any) -> Any:
    """The model with the shapes of its tensors for one robot, as far as ONNX can tell them."""
    single = onnx.ModelProto()
    single.CopyFrom(model)
    for value in single.graph.input:
        for dimension in value.type.tensor_type.shape.dim:
            dimension.dim_value = dimension.dim_value or 1
    for value in single.graph.output:
        value.ClearField("type")
    del single.graph.value_info[:]
    return shape_inference.infer_shapes(single, check_type=True, strict_mode=True, data_prop=True)


def _check_sizes(graph: Any) -> None:
    for value in (*graph.value_info, *graph.output):
        count = math.prod(max(1, side.dim_value) for side in value.type.tensor_type.shape.dim)
        if count > LARGEST_TENSOR:
            raise GraphError(f"needs a tensor of {count} numbers; at most {LARGEST_TENSOR} are allowed")
