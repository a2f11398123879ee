"""What a policy's network may be: shipped ones pass, programs that loop, grow or read other files do not."""

import itertools
import time
from types import SimpleNamespace

import numpy as np
import pytest

from sprintlab.control import CONTRACT_KEY, load_policy, shipped_policies, shipped_policy
from sprintlab.control.policy_graph import _OPERATORS, GraphError, check_graph
from sprintlab.core.errors import PolicyFileError

onnx = pytest.importorskip("onnx")
TensorProto, helper, numpy_helper = onnx.TensorProto, onnx.helper, onnx.numpy_helper
INPUT = load_policy(shipped_policy()).layout.input_size


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


def stacked():
    """Five million products of one number by one number: 1.3 s of a core a step, and 26 s before a run."""
    several = [helper.make_node("MatMul", ["column", "row"], ["several"])]
    sizes = {"column": (2300, 1, 1, 1), "row": (1, 2300, 1, 1)}
    return model(several, *(constant(name, np.ones(shape), np.float32) for name, shape in sizes.items()))


def outside():
    tensor = constant("secret", np.zeros(5), np.float32)
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


def filled_with(*nodes_and_constants):
    """10^9 numbers where the last of these nodes gives one, none where somebody computes it as nought."""
    nodes = [item for item in nodes_and_constants if isinstance(item, onnx.NodeProto)]
    return model(
        [
            *nodes,
            helper.make_node("Mul", [nodes[-1].output[0], "many"], ["size"]),
            helper.make_node("ConstantOfShape", ["size"], ["huge"]),
        ],
        constant("many", [10**9]),
        *(item for item in nodes_and_constants if not isinstance(item, onnx.NodeProto)),
    )


def half_is_true():
    return filled_with(
        helper.make_node("Cast", ["half"], ["yes"], to=TensorProto.BOOL),
        helper.make_node("Cast", ["yes"], ["one"], to=TensorProto.INT64),
        constant("half", [0.5], np.float32),
    )


def wrapped():
    """257 is 1 in eight bits."""
    return filled_with(
        helper.make_node("Cast", ["number"], ["byte"], to=TensorProto.INT8),
        helper.make_node("Cast", ["byte"], ["whole"], to=TensorProto.INT64),
        helper.make_node("Equal", ["whole", "one"], ["same"]),
        helper.make_node("Cast", ["same"], ["last"], to=TensorProto.INT64),
        constant("number", [257]),
        constant("one", [1]),
    )


def rounded():
    """A division that doubles cannot do."""
    return filled_with(
        helper.make_node("Div", ["large", "one"], ["same"]),
        helper.make_node("Sub", ["same", "other"], ["last"]),
        constant("large", [2**62 + 1]),
        constant("other", [2**62]),
        constant("one", [1]),
    )


def overflowing():
    """The sum is negative in 32 bits."""
    return filled_with(
        helper.make_node("Add", ["most", "step"], ["sum"]),
        helper.make_node("Cast", ["sum"], ["wide"], to=TensorProto.INT64),
        helper.make_node("Equal", ["wide", "least"], ["same"]),
        helper.make_node("Cast", ["same"], ["last"], to=TensorProto.INT64),
        helper.make_tensor("most", TensorProto.INT32, [1], [2**31 - 1]),
        helper.make_tensor("step", TensorProto.INT32, [1], [1]),
        constant("least", [-(2**31)]),
    )


def named_twice():
    return model(
        [helper.make_node("ConstantOfShape", ["size"], ["huge"])],
        constant("size", [10**9]),
        constant("size", [1]),
    )


def summing():
    """A thousand million additions that make a hundred numbers."""
    return model(
        [helper.make_node("ReduceSum", ["big"], [f"sum{n}"], keepdims=1) for n in range(100)],
        constant("big", np.zeros(12_000_000), np.float32),
    )


def dividing():
    """The least whole number over minus one ends a process."""
    return model(
        [
            helper.make_node("Cast", ["observation"], ["whole"], to=TensorProto.INT64),
            helper.make_node("Sub", ["whole", "one"], ["below"]),
            helper.make_node("Div", ["least", "below"], ["end"]),
        ],
        constant("one", [1]),
        constant("least", [-(2**63)]),
    )


def not_reduced():
    """Without axes the runtime keeps all 225 numbers, where another form makes one."""
    return filled_with(
        helper.make_node("ReduceSum", ["observation"], ["same"], noop_with_empty_axes=1),
        helper.make_node("Shape", ["same"], ["shape"]),
        helper.make_node("Sub", ["shape", "one"], ["last"]),
        constant("one", [1]),
    )


def reduced_wholly():
    """An empty list of axes makes one number, where another form keeps all 225."""
    return filled_with(
        helper.make_node("ReduceSum", ["observation", "axes"], ["one_number"]),
        helper.make_node("Shape", ["one_number"], ["shape"]),
        helper.make_node("Sub", ["input", "shape"], ["last"]),
        constant("axes", []),
        constant("input", [1, INPUT]),
    )


def backwards():
    """Behind its first number a list that is read backwards holds that one in ONNX, and none in Python."""
    return filled_with(
        helper.make_node("Slice", ["list", "before", "end", "axis", "back"], ["one_number"]),
        helper.make_node("Shape", ["one_number"], ["last"]),
        constant("list", [1, 2, 3]),
        *(constant(*pair) for pair in (("before", [2**31]), ("end", [2**63 - 1]), ("axis", [-1]))),
        constant("back", [-(2**63)]),
    )


def written_out():
    """Numbers as texts: a thousand times slower than numbers."""
    return model([helper.make_node("Cast", ["observation"], ["texts"], to=TensorProto.STRING)])


def many():
    """Few multiplications, no large tensor, but a gigabyte of them."""
    nodes = [helper.make_node("ConstantOfShape", ["size"], [f"t{number}"]) for number in range(17)]
    return model(nodes, constant("size", [1 << 20]))


def crowded():
    """Tensors that nothing uses: of 49,000 the runtime took 13 s to get rid."""
    return model(
        [], *(TensorProto(name=f"{n:x}", data_type=TensorProto.INT64, dims=[0]) for n in range(12_500))
    )


STRANGE = [crowded, loop, doubling, outer, filled, busy, stacked, outside, claimed, data_dependent, function]
STRANGE += [many, half_is_true, wrapped, rounded, overflowing, named_twice, summing, dividing]


def split_otherwise_than_told():
    """The runtime writes beyond the end of its list, and the process dies."""
    node = helper.make_node("Split", ["x"], ["a", "b", "c"], num_outputs=2, axis=0)
    return model([node], constant("x", [0, 1, 2]))


STRANGE += [split_otherwise_than_told, not_reduced, reduced_wholly, backwards, written_out]


def sized(node):
    """A tensor as large as the last number that an operator makes."""
    nodes = [
        node,
        helper.make_node("Gather", ["sizes", "last"], ["size"]),
        helper.make_node("ConstantOfShape", ["size"], ["filled"]),
    ]
    return model(nodes, constant("last", [-1]))


def numbers_that_the_runtime_passes_over():
    """In a repeated whole number, protocol buffers skip what has eight bytes; the last one here is a 1."""
    node = helper.make_node("Constant", [], ["sizes"], value_ints=[2**31])
    node.attribute[0].MergeFromString(b"\x41" + b"\x01" * 8)
    return sized(node)


def attribute_of_another_kind():
    """The runtime goes by the kind that an attribute says, not by its name."""
    node = helper.make_node("Constant", [], ["sizes"], value_ints=[1])
    node.attribute[0].t.CopyFrom(constant("t", [2**31]))
    node.attribute[0].type = onnx.AttributeProto.TENSOR
    return sized(node)


def number_for_a_name():
    """A terabyte of zeros, where a text is made from a number."""
    node = helper.make_node("Identity", ["observation"], [])
    node.MergeFromString(b"\x10\x80\x80\x80\x80\x80\x20")
    return model([node])


def long_number_of_a_field():
    """A hidden operator: of a field's number the runtime reads 32 bits, and then this is a node too."""
    made, hidden = model([]), helper.make_node("Relu", ["observation"], ["y"]).SerializeToString()
    graph = made.graph.SerializeToString() + b"\x8a\x80\x80\x80\x10" + bytes([len(hidden)]) + hidden
    made.ClearField("graph")
    text = made.SerializeToString() + b"\x3a" + varint(len(graph)) + graph
    return SimpleNamespace(SerializeToString=lambda: text)


def varint(number):
    bytes_ = [number >> 7 * place & 127 | 128 for place in range(max(1, -(-number.bit_length() // 7)))]
    return bytes([*bytes_[:-1], bytes_[-1] & 127])


def long_truth():
    """2^32 is no truth for the runtime, which reads 32 bits: it fills the large tensor."""
    nodes = [
        helper.make_node("Where", ["truth", "small", "large"], ["size"]),
        helper.make_node("ConstantOfShape", ["size"], ["filled"]),
    ]
    truth = TensorProto(name="truth", data_type=TensorProto.BOOL, dims=[1], int32_data=[2**31 - 1])
    made = model(nodes, truth, constant("small", [1]), constant("large", [10**9])).SerializeToString()
    before = b"\x2a\x05" + varint(2**31 - 1)
    assert made.count(before) == 1
    text = made.replace(before, b"\x2a\x05" + varint(2**32))
    return SimpleNamespace(SerializeToString=lambda: text)


def product_of_nothing():
    """Three stacked products of no numbers, of which the runtime makes one."""
    return model(
        [helper.make_node("MatMul", ["x", "y"], ["z"])],
        constant("x", np.zeros((1, 1, 0)), np.float32),
        constant("y", np.zeros((3, 0, 1)), np.float32),
    )


def input_without_a_name():
    """The runtime looks for its numbers where nothing is, and the process dies."""
    return model([helper.make_node("Max", ["observation", ""], ["y"])])


def two_contracts():
    """Some readers take the first, some the last."""
    made = onnx.load(shipped_policy("sprint"))
    made.metadata_props.add(key=CONTRACT_KEY, value="{}")
    return made


STRANGE += [
    two_contracts,
    input_without_a_name,
    product_of_nothing,
    numbers_that_the_runtime_passes_over,
    attribute_of_another_kind,
    number_for_a_name,
    long_number_of_a_field,
    long_truth,
]


@pytest.mark.parametrize("make", STRANGE, ids=lambda make: make.__name__)
def test_program_is_refused_in_time(tmp_path, make):
    path = tmp_path / "policy.onnx"
    path.write_bytes(make().SerializeToString())
    started = time.monotonic()
    with pytest.raises(PolicyFileError, match="its network") as refusal:
        load_policy(path)
    assert time.monotonic() - started < 60.0  # a hang; the machine may be busy
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("make", [outer, filled], ids=lambda make: make.__name__)
def test_a_tensor_is_refused_by_its_own_size_before_it_is_counted(make):
    with pytest.raises(GraphError, match="needs a tensor of"):
        check_graph(make().SerializeToString())


def with_second_network():
    """Other readers add its nodes to those of the first one."""
    hidden = onnx.GraphProto(node=[node("Relu", "observation")]).SerializeToString()
    return model([]).SerializeToString() + b"\x3a" + varint(len(hidden)) + hidden


def node(operator, *inputs, outputs=("y",), **attributes):
    return helper.make_node(operator, list(inputs), list(outputs), **attributes)


def tensor(kind, dims, **values):
    return model([], TensorProto(name="t", data_type=kind, dims=dims, **values)).SerializeToString()


def with_attribute_twice():
    made = node("Gather", "observation", "index", axis=0)
    made.attribute.add().CopyFrom(helper.make_attribute("axis", 1))
    return model([made], constant("index", [0])).SerializeToString()


def with_axis_of_another_kind():
    """The runtime takes the number that it is without one."""
    made = node("Concat", "observation", "observation", axis=1)
    made.attribute[0].CopyFrom(helper.make_attribute("axis", 1.0))
    return model([made]).SerializeToString()


def with_training():
    made = model([])
    made.training_info.add()
    return made.SerializeToString()


def with_sparse_tensor():
    """Eight bytes that the runtime unfolds to 40 GB."""
    made = model([])
    sparse = made.graph.sparse_initializer.add(dims=[10**5, 10**5])
    sparse.values.CopyFrom(constant("huge", [0.0], np.float32))
    sparse.indices.CopyFrom(constant("", [0]))
    return made.SerializeToString()


def with_tensor_made_twice():
    return model([node("Relu", "observation", outputs=["one"])], constant("one", [1])).SerializeToString()


def with_location_only():
    return tensor(FLOAT, [1], raw_data=bytes(4), data_location=TensorProto.EXTERNAL)


def with_name_of_another_file():
    place = onnx.StringStringEntryProto(key="location", value="/etc/passwd")
    return tensor(FLOAT, [1], raw_data=bytes(4), external_data=[place])


FLOAT, INT64 = TensorProto.FLOAT, TensorProto.INT64
FITS = r"an operator \w+ whose sizes do not fit"
SIZED = "size is not that of its shape"
NETWORKS = {
    "two-networks": (with_second_network, "an entry comes twice"),
    "attribute-twice": (with_attribute_twice, "an entry comes twice"),
    "attribute-of-another-kind": (with_axis_of_another_kind, "attribute of another kind than it has"),
    "training": (with_training, "holds a training"),
    "sparse": (with_sparse_tensor, "sparse tensors"),
    "location-only": (with_location_only, "numbers in other files"),
    "name-of-another-file": (with_name_of_another_file, "numbers in other files"),
    "made-twice": (with_tensor_made_twice, "two of its tensors have one name"),
    "text": (lambda: tensor(TensorProto.STRING, [1], string_data=[b"x"]), "of a type that no policy has"),
    "half": (lambda: tensor(TensorProto.FLOAT16, [1], raw_data=bytes(2)), "of a type that no policy has"),
    "negative": (lambda: tensor(FLOAT, [-1, -1], raw_data=bytes(4)), "without a shape"),
    "deep": (lambda: tensor(FLOAT, [1] * 17, raw_data=bytes(4)), "without a shape"),
    "none-of-many": (lambda: tensor(FLOAT, [0, 2**40], raw_data=b""), "needs a tensor of"),
    "few-bytes": (lambda: tensor(FLOAT, [1000], raw_data=bytes(4)), SIZED),
    "few-numbers": (lambda: tensor(FLOAT, [1000], float_data=[0.0]), SIZED),
    "few-whole-numbers": (lambda: tensor(INT64, [1000], int64_data=[0]), SIZED),
    "packed": (lambda: tensor(INT64, [50_001], int64_data=[0] * 50_001), "more than 50000 entries"),
}
NETWORKS |= {
    name: (lambda nodes=nodes, constants=constants: model(nodes, *constants).SerializeToString(), sentence)
    for name, nodes, constants, sentence in (
        (
            "nodes",
            [node("Relu", "observation", outputs=[f"y{n}"]) for n in range(5001)],
            [],
            "5000 operators",
        ),
        ("domain", [node("Gelu", "observation", domain="com.microsoft")], [], "com.microsoft.Gelu"),
        ("whole-power", [node("Pow", "k", "k")], [constant("k", [2])], "on whole numbers"),
        ("second-output", [node("Relu", "observation", outputs=["y", "z"])], [], "that no policy uses"),
        ("part-of-shape", [node("Shape", "observation", start=1)], [], "in a form that no policy uses"),
        ("below-zero", [node("Div", "k", "l")], [constant("k", [-3]), constant("l", [2])], FITS),
        ("by-less", [node("Div", "k", "l")], [constant("k", [3]), constant("l", [-2])], FITS),
        ("by-nought", [node("Div", "k", "l")], [constant("k", [3]), constant("l", [0])], FITS),
        ("axis", [node("Gather", "observation", "k", axis=2)], [constant("k", [0])], FITS),
        ("axis-of-concat", [node("Concat", "observation", "observation", axis=2)], [], FITS),
        ("axis-of-split", [node("Split", "observation", outputs="ab", axis=2)], [], FITS),
        ("axis-twice", [node("Unsqueeze", "observation", "k")], [constant("k", [0, 0])], FITS),
        ("no-single", [node("Squeeze", "observation", "k")], [constant("k", [1])], FITS),
        ("inner", [node("MatMul", "k", "k")], [constant("k", np.ones((2, 3)), np.float32)], FITS),
        ("vectors", [node("Gemm", "k", "k")], [constant("k", np.ones(3), np.float32)], FITS),
        (
            "stack-by-matrix",
            [node("Gemm", "k", "l")],
            [constant("k", np.ones((2, 3, 3)), np.float32), constant("l", np.ones((3, 3)), np.float32)],
            FITS,
        ),
        (
            "matrix-by-stack",
            [node("Gemm", "l", "k")],
            [constant("k", np.ones((2, 3, 3)), np.float32), constant("l", np.ones((3, 3)), np.float32)],
            FITS,
        ),
        (
            "multiplications",
            [node("MatMul", "k", "k", outputs=["y"]), node("MatMul", "y", "k", outputs=["z"])],
            [constant("k", np.ones((1024, 1024)), np.float32)],
            "would not fit into its 20 ms",
        ),
        ("beside", [node("Concat", "observation", "k", axis=1)], [constant("k", np.ones((2, 3)))], FITS),
        ("count", [node("Reshape", "observation", "k")], [constant("k", [3])], FITS),
        ("repeats", [node("Tile", "observation", "k")], [constant("k", [2])], FITS),
        ("order", [node("Transpose", "observation", perm=[0, 0])], [], FITS),
        (
            "parts",
            [node("Split", "k", "l", outputs="ab")],
            [constant("k", [1, 2]), constant("l", [1, 2])],
            FITS,
        ),
        (
            "more-parts-than-outputs",
            [node("Split", "k", "l", outputs="ab")],
            [constant("k", [1, 2, 3]), constant("l", [1, 1, 1])],
            FITS,
        ),
        (
            "part-below-zero",
            [node("Split", "k", "l", outputs="ab")],
            [constant("k", [1, 2]), constant("l", [3, -1])],
            "without a shape",
        ),
    )
}


@pytest.mark.parametrize("name", NETWORKS)
def test_a_network_is_refused_for_what_it_is(name):
    """Each by its own sentence: many would be caught elsewhere as well, or by the runtime, but not all."""
    make, sentence = NETWORKS[name]
    with pytest.raises(GraphError, match=sentence):
        check_graph(make())


def axis_with(**more):
    """An operator whose attribute holds more than the number that it says."""
    made = node("Gather", "observation", "index", axis=0)
    made.attribute[0].MergeFrom(onnx.AttributeProto(**more))
    return model([made], constant("index", [0])).SerializeToString()


@pytest.mark.parametrize(
    "more",
    [
        {"type": onnx.AttributeProto.UNDEFINED},
        {"f": 1.0},
        {"s": b"x"},
        {"t": constant("x", [1])},
        {"floats": [1.0]},
        {"ints": [1]},
        {"strings": [b"x"]},
    ],
    ids=lambda more: next(iter(more)),
)
def test_an_attribute_holds_nothing_but_the_value_that_it_says(more):
    with pytest.raises(GraphError, match="of another kind than it says"):
        check_graph(axis_with(**more))


@pytest.mark.parametrize(
    "more",
    [
        {"g": onnx.GraphProto()},
        {"graphs": [onnx.GraphProto()]},
        {"tensors": [constant("x", [1])]},
        {"tp": onnx.TypeProto()},
        {"type_protos": [onnx.TypeProto()]},
        {"ref_attr_name": "x"},
        {"sparse_tensor": onnx.SparseTensorProto()},
        {"sparse_tensors": [onnx.SparseTensorProto()]},
    ],
    ids=lambda more: next(iter(more)),
)
def test_no_attribute_holds_a_network_or_what_only_networks_need(more):
    with pytest.raises(GraphError, match="holds a network within its operator Gather"):
        check_graph(axis_with(**more))


def entry(number, content):
    """One field of a message as it is written: a text, a message, or a whole number."""
    if isinstance(content, int):
        return varint(number << 3) + varint(content)
    return varint(number << 3 | 2) + varint(len(content)) + content


def attribute(*more):
    axis = helper.make_attribute("axis", 0).SerializeToString() + b"".join(more)
    return node("Gather", "observation", "index").SerializeToString() + entry(5, axis)


TENSOR, RELU = constant("t", [1]).SerializeToString(), node("Relu", "observation").SerializeToString()
TWICE = {
    "type-of-a-tensor": (5, TENSOR + entry(2, 7)),
    "bytes-of-a-tensor": (5, TENSOR + entry(9, bytes(8))),
    "name-of-a-tensor": (5, TENSOR + entry(8, b"u")),
    "place-of-a-tensor": (5, TENSOR + 2 * entry(14, 0)),
    "operator": (1, RELU + entry(4, b"Relu")),
    "domain": (1, RELU + 2 * entry(7, b"")),
    "kind-of-an-attribute": (1, attribute(entry(20, 2))),
    "number-of-an-attribute": (1, attribute(entry(3, 0))),
    "name-of-an-attribute": (1, attribute(entry(1, b"axis"))),
    "name-of-an-input": (11, 2 * entry(1, b"x")),
    "type-of-an-input": (11, 2 * entry(2, b"")),
    "tensor-of-an-input": (11, entry(2, 2 * entry(1, b""))),
    "shape-of-an-input": (11, entry(2, entry(1, 2 * entry(2, b"")))),
    "side-of-an-input": (11, entry(2, entry(1, entry(2, entry(1, 2 * entry(1, 1)))))),
}


@pytest.mark.parametrize("name", TWICE)
def test_nothing_stands_twice_of_which_a_reader_takes_one(name):
    made = model([])
    graph = made.graph.SerializeToString() + entry(*TWICE[name])
    made.ClearField("graph")
    with pytest.raises(GraphError, match="an entry comes twice"):
        check_graph(made.SerializeToString() + entry(7, graph))


def test_a_network_may_list_its_numbers_and_average_what_is_measured():
    listed = [
        TensorProto(name="f", data_type=FLOAT, dims=[2], float_data=[0.5, 1.5]),
        TensorProto(name="d", data_type=TensorProto.DOUBLE, dims=[1], double_data=[0.5]),
        TensorProto(name="i", data_type=TensorProto.INT32, dims=[1], int32_data=[7]),
        TensorProto(name="l", data_type=INT64, dims=[2], int64_data=[-1, 225]),
        TensorProto(name="b", data_type=TensorProto.BOOL, dims=[2], int32_data=[0, 1]),
    ]
    nodes = [
        node("Identity", "observation", outputs=["same"]),
        node("Mean", "same", "observation", outputs=["mean"]),
        node("Cast", "d", outputs=["single"], to=FLOAT),
        node("Pow", "mean", "single", outputs=["power"]),
        node("ReduceMean", "power", outputs=["one_number"]),
        node("Where", "b", "l", "l", outputs=["shape"]),
        node("Reshape", "same", "shape", outputs=["again"]),
    ]
    check_graph(model(nodes, *listed).SerializeToString())


@pytest.mark.parametrize("bounds", [[], ["", "one"], ["one", ""]])
def test_a_clip_may_lack_a_bound(bounds):
    node = helper.make_node("Clip", ["observation", *bounds], ["y"])
    check_graph(model([node], constant("one", 1.0, np.float32)).SerializeToString())


def in_the_runtimes_own_format(folder):
    """A network with an operator that no policy may use; the place of its root is a multiple of eight."""
    import onnxruntime

    for count in range(8):
        whole = model([helper.make_node("RandomNormalLike", ["observation"], ["drawn" * (count + 1)])])
        options = onnxruntime.SessionOptions()
        options.optimized_model_filepath = str(folder / "hidden.ort")
        options.log_severity_level = 4
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
        options.add_session_config_entry("session.save_model_format", "ORT")
        onnxruntime.InferenceSession(whole.SerializeToString(), options, providers=["CPUExecutionProvider"])
        content = (folder / "hidden.ort").read_bytes()
        if content[0] % 8 == 0:
            return content
    raise AssertionError("none of them has its root there")


def test_a_file_of_two_networks_is_the_one_that_was_checked(tmp_path):
    """ONNX Runtime has a format of its own, known by four letters; an ONNX file can have them there.

    As ONNX this one has an ir_version of 1, a name of 79 letters, the hidden network in an unknown field, and
    then a policy. The runtime reads in it where the hidden network's root lies, and the four letters.
    """
    hidden, root = in_the_runtimes_own_format(tmp_path), 0x00920108
    head = root.to_bytes(4, "little") + b"ORTM" + b"x" * (79 - 3)
    begin = root - hidden[0] + 8
    unknown = b"\xa2\x06" + varint(begin + len(hidden) - 8 - len(head) - 6)
    policy = onnx.load(shipped_policy())
    policy.ClearField("ir_version")
    policy.ClearField("producer_name")
    path = tmp_path / "policy.onnx"
    path.write_bytes((head + unknown).ljust(begin, b"\0") + hidden[8:] + policy.SerializeToString())
    assert load_policy(path)._session.get_modelmeta().producer_name == "RTM" + "x" * 76


def test_network_that_fails_on_what_it_is_given_says_so(tmp_path):
    """An index far outside, which nobody knows before the robot has measured."""
    path = tmp_path / "policy.onnx"
    nodes = [
        helper.make_node("Cast", ["observation"], ["whole"], to=TensorProto.INT64),
        helper.make_node("Add", ["whole", "far"], ["index"]),
        helper.make_node("Gather", ["few", "index"], ["taken"]),
    ]
    path.write_bytes(model(nodes, constant("far", [10**9]), constant("few", [1, 2])).SerializeToString())
    policy = load_policy(path)
    for batch in (1, 2):
        with pytest.raises(PolicyFileError, match="network fails") as refusal:
            policy.infer(np.zeros((batch, INPUT), np.float32))
        assert "\n" not in str(refusal.value)


def test_the_runtime_prints_nothing_of_its_own(tmp_path, capfd):
    """Its error about a name that is no text fails as well; then it would try again, and say so."""
    content = model([helper.make_node("Relu", ["observation"], ["y"], name="NAME", unknown=1)])
    path = tmp_path / "policy.onnx"
    path.write_bytes(content.SerializeToString().replace(b"NAME", b"\x80\x80\x80\x80"))
    with pytest.raises(PolicyFileError, match="no ONNX file"):
        load_policy(path)
    assert capfd.readouterr() == ("", "")


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
            [constant("k", [-5]), constant("l", [2**62]), constant("m", [2]), constant("n", [2])],
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


FORMS = [
    ("ReduceSum", {"keepdims": keep, "noop_with_empty_axes": none}, axes, shape)
    for keep, none in itertools.product((0, 1, 2), (0, 1))
    for axes in (None, [], [0], [-1], [0, 1])
    for shape in ((2, 3), (0, 3), (1, 1))
]
FORMS += [
    ("Squeeze", {}, axes, shape) for axes in (None, [], [0], [-1]) for shape in ((1, 3), (1, 1), (2, 3))
]
FORMS += [("Reshape", {"allowzero": zero}, to, (2, 0)) for zero in (0, 1, 2) for to in ([0, 0], [2, -1], [0])]


def test_a_form_is_refused_or_gives_what_the_runtime_gives():
    """What one of both takes for another form is a way around all limits."""
    import onnxruntime

    from sprintlab.control import policy_graph

    refused = 0
    for operator, attributes, given, shape in FORMS:
        constants = [constant("x", np.zeros(shape), np.float32)]
        constants += [] if given is None else [constant("k", given)]
        node = helper.make_node(operator, [tensor.name for tensor in constants], ["y"], **attributes)
        graph = helper.make_graph([node], "one", [], [onnx.ValueInfoProto(name="y")], constants)
        opset = [helper.make_opsetid("", 18 if operator == "Reshape" else 13)]
        content = helper.make_model(graph, opset_imports=opset, ir_version=8).SerializeToString()
        read = policy_graph._read_model(content)
        inputs = [read.tensors[tensor.name] for tensor in constants]
        try:
            (seen,) = policy_graph._results(read.nodes[0], inputs, policy_graph._Costs())
        except GraphError:
            refused += 1
            continue
        try:
            (made,) = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"]).run(None, {})
        except Exception:
            continue  # the runtime refuses it: so does load_policy
        assert seen.shape == made.shape, (operator, attributes, given, shape)
    assert 0 < refused < len(FORMS)


def test_no_operator_branches_or_draws():
    assert not {"Loop", "If", "Scan", "RandomNormal", "Range", "Resize", "Pad", "OneHot"} & set(_OPERATORS)
