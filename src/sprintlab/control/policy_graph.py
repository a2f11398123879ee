"""What a policy file's network may be: known operators, with all their numbers in the file.

An ONNX file is a program, which may loop or read other files. A policy does nothing of this, so that a file
is checked before ONNX Runtime builds it.
"""

from __future__ import annotations

from typing import Any

import onnx
from google.protobuf.message import DecodeError
from onnx import checker

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
    validated: Any = checker
    try:
        model = onnx.load_model_from_string(content)
    except DecodeError as error:
        raise GraphError("is damaged") from error
    if model.functions:
        raise GraphError("holds functions of its own")
    for node in model.graph.node:
        if node.domain not in ("", "ai.onnx") or node.op_type not in OPERATORS:
            operator = repr(node.op_type[:60])
            raise GraphError(f"uses the operator {operator}, which no policy of this package has")
    if any(tensor.data_location == onnx.TensorProto.EXTERNAL for tensor in model.graph.initializer):
        raise GraphError("keeps numbers in other files")
    try:
        validated.check_model(model)
    except checker.ValidationError as error:
        raise GraphError(f"is refused by ONNX: {str(error).strip().splitlines()[0]}") from error
