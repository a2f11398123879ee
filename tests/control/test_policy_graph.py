"""What a policy's network may be: shipped ones pass, programs that loop, grow or read other files do not."""

import itertools
import time

import numpy as np
import pytest

from sprintlab.control import load_policy, shipped_policies, shipped_policy
from sprintlab.control.policy_graph import OPERATORS, GraphError, check_graph
from sprintlab.core.errors import PolicyFileError

onnx = pytest.importorskip("onnx")
TensorProto, helper, numpy_helper = onnx.TensorProto, onnx.helper, onnx.numpy_helper
INPUT = 225


def constant(name, values, kind=np.int64):
    return numpy_helper.from_array(np.array(values, dtype=kind), name)


def model(nodes, *constants):
    """A policy whose network is the shipped one's with these nodes in front: the contract is in order."""
    whole = onnx.load(shipped_policy())
    for tensor in constants:
        whole.graph.initializer.append(tensor)
    for place, node in enumerate(nodes):
        whole.graph.node.insert(place, node)
    return whole


def loop():
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["go_out"]), helper.make_node("Identity", ["x"], ["x_out"])],
        "body",
        [
            helper.make_tensor_value_info("i", TensorProto.INT64, []),
            helper.make_tensor_value_info("go", TensorProto.BOOL, []),
            helper.make_tensor_value_info("x", TensorProto.FLOAT, None),
        ],
        [
            helper.make_tensor_value_info("go_out", TensorProto.BOOL, []),
            helper.make_tensor_value_info("x_out", TensorProto.FLOAT, None),
        ],
    )
    return model(
        [helper.make_node("Loop", ["times", "yes", "observation"], ["looped"], body=body)],
        constant("times", 2**62),
        constant("yes", True, bool),
    )


def doubling():
    """Twice the size with each operator: 2^60 numbers."""
    names = ["observation", *(f"d{n}" for n in range(60))]
    return model([helper.make_node("Concat", [a, a], [b], axis=1) for a, b in itertools.pairwise(names)])


def outer():
    """40 GB from two vectors of 400 kB each."""
    return model(
        [helper.make_node("Add", ["row", "column"], ["huge"])],
        constant("row", np.zeros((1, 100_000)), np.float32),
        constant("column", np.zeros((100_000, 1)), np.float32),
    )


def filled():
    return model([helper.make_node("ConstantOfShape", ["size"], ["huge"])], constant("size", [10**10]))


def busy():
    """Little memory, and a million million multiplications."""
    side = 4000
    return model(
        [helper.make_node("MatMul", ["square", "square"], ["s0"])]
        + [helper.make_node("MatMul", [f"s{n}", "square"], [f"s{n + 1}"]) for n in range(20)],
        constant("square", np.zeros((side, side)), np.float32),
    )


def outside():
    tensor = constant("secret", np.zeros(5), np.float32)
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/passwd")
    return model([], tensor)


def claimed():
    tensor = constant("huge", [0.0], np.float32)
    tensor.dims[:] = [10**5, 10**5]
    return model([], tensor)


def data_dependent():
    return model(
        [
            helper.make_node("Cast", ["observation"], ["whole"], to=TensorProto.INT64),
            helper.make_node("ConstantOfShape", ["whole"], ["huge"]),
        ]
    )


def function():
    whole = model([])
    opset = [helper.make_opsetid("", 17)]
    whole.functions.append(helper.make_function("own", "F", ["a"], ["b"], [], opset))
    return whole


STRANGE = [loop, doubling, outer, filled, busy, outside, claimed, data_dependent, function]


@pytest.mark.parametrize("make", STRANGE, ids=lambda make: make.__name__)
def test_program_is_refused_in_time(tmp_path, make):
    path = tmp_path / "policy.onnx"
    path.write_bytes(make().SerializeToString())
    started = time.monotonic()
    with pytest.raises(PolicyFileError, match="its network") as refusal:
        load_policy(path)
    assert time.monotonic() - started < 10.0
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("name", shipped_policies())
def test_shipped_policies_pass(name):
    content = shipped_policies()[name].read_bytes()
    check_graph(content)
    for cut in (0, 10, len(content) // 2, len(content) - 1):
        with pytest.raises(GraphError):
            check_graph(content[:cut])


@pytest.mark.parametrize("place", ["pipe", "folder", "device"])
def test_no_file(tmp_path, place):
    import os

    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    path = {"pipe": tmp_path / "pipe", "folder": tmp_path / "folder", "device": "/dev/zero"}[place]
    with pytest.raises(PolicyFileError, match="no regular file"):
        load_policy(path)


def test_sizes_are_those_of_the_runtime():
    """Every rule against ONNX's own: the shapes that are worked out are the shapes that come out."""
    onnxruntime = pytest.importorskip("onnxruntime")
    from sprintlab.control import policy_graph

    rng = np.random.default_rng(0)
    x = rng.normal(size=(1, 4, 6)).astype(np.float32)
    cases = {
        "Gather": ([constant("k", [0, 2])], {"axis": 1}),
        "Unsqueeze": ([constant("k", [0, -1])], {}),
        "Squeeze": ([constant("k", [0])], {}),
        "Expand": ([constant("k", [3, 1, 1])], {}),
        "Tile": ([constant("k", [2, 1, 3])], {}),
        "Reshape": ([constant("k", [0, -1, 3])], {}),
        "Slice": (
            [constant("k", [-1]), constant("l", [-(2**62)]), constant("m", [2]), constant("n", [-2])],
            {},
        ),
        "Flatten": ([], {"axis": 2}),
        "Transpose": ([], {"perm": [2, 0, 1]}),
        "ReduceMean": ([], {"axes": [-1], "keepdims": 0}),
        "MatMul": ([constant("k", np.ones((5, 6, 2)), np.float32)], {}),
        "Concat": ([constant("k", np.ones((1, 4, 6)), np.float32)], {"axis": -1}),
    }
    for operator, (constants, attributes) in cases.items():
        node = helper.make_node(operator, ["x", *(tensor.name for tensor in constants)], ["y"], **attributes)
        graph = helper.make_graph(
            [node],
            "one",
            [helper.make_tensor_value_info("x", TensorProto.FLOAT, list(x.shape))],
            [helper.make_tensor_value_info("y", TensorProto.FLOAT, None)],
            constants,
        )
        content = helper.make_model(
            graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8
        ).SerializeToString()
        (made,) = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"]).run(
            None, {"x": x}
        )
        read = policy_graph._read_model(content)
        rule = policy_graph._OPERATORS[operator]
        inputs = [policy_graph._Tensor(x.shape), *(read.tensors[tensor.name] for tensor in constants)]
        seen = rule(read.nodes[0], inputs, policy_graph._Costs())
        assert seen[0].shape == made.shape, operator


def test_no_operator_branches_or_draws():
    assert not {"Loop", "If", "Scan", "RandomNormal", "Range", "Resize", "Pad", "OneHot"} & set(OPERATORS)
