"""What a policy's network may be: shipped ones pass, programs that loop, grow or read other files do not."""

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from sprintlab.control import load_policy, shipped_policies, shipped_policy
from sprintlab.control.policy_graph import GraphError, check_graph
from sprintlab.core.errors import PolicyFileError


def constant(name, values, kind=np.int64):
    return numpy_helper.from_array(np.array(values, dtype=kind), name)


def model(nodes, *constants):
    """The shipped policy with these nodes in front of its own: its contract is in order."""
    whole = onnx.load(shipped_policy())
    whole.graph.initializer.extend(constants)
    for place, node in enumerate(nodes):
        whole.graph.node.insert(place, node)
    return whole


def loop():
    number, flag = TensorProto.INT64, TensorProto.BOOL
    body = helper.make_graph(
        [helper.make_node("Identity", ["go"], ["go_out"])],
        "body",
        [helper.make_tensor_value_info("i", number, []), helper.make_tensor_value_info("go", flag, [])],
        [helper.make_tensor_value_info("go_out", flag, [])],
    )
    return model(
        [helper.make_node("Loop", ["times", "yes"], [], body=body)],
        constant("times", 2**62),
        constant("yes", True, bool),
    )


def function():
    whole = model([])
    opset = [helper.make_opsetid("", 17)]
    whole.functions.append(helper.make_function("own", "F", ["a"], ["b"], [], opset))
    return whole


def numbers_in_another_file():
    tensor = constant("secret", np.zeros(5), np.float32)
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/passwd")
    return model([], tensor)


REFUSED = {
    loop: "operator 'Loop'",
    function: "functions of its own",
    numbers_in_another_file: "other files",
}


@pytest.mark.parametrize("make", REFUSED, ids=lambda make: make.__name__)
def test_a_network_that_no_policy_has_is_refused_in_one_sentence(tmp_path, make):
    path = tmp_path / "policy.onnx"
    path.write_bytes(make().SerializeToString())
    with pytest.raises(PolicyFileError, match=REFUSED[make]) as refusal:
        load_policy(path)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("name", shipped_policies())
def test_shipped_policies_pass_and_truncated_ones_do_not(name):
    content = shipped_policies()[name].read_bytes()
    check_graph(content)
    for cut in (10, len(content) // 2, len(content) - 1):
        with pytest.raises(GraphError):
            check_graph(content[:cut])
