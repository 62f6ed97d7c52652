import itertools
from typing import Any

import numpy as np
import onnx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx import TensorProto, helper, numpy_helper

from articulate.errors import BundleError
from articulate.onnx_runtime import onnxruntime
from articulate_deploy.onnx_graph import MAX_NODES, _Reader, check_graph
from articulate_deploy.onnx_shapes import OPERATORS, Tensor


def model(
    *, operator="MatMul", nodes=1, domain="", tensor=None, graph=None, functions=(), opsets=()
):
    weight = tensor or numpy_helper.from_array(np.ones((2, 2), dtype=np.float32), "w")
    x = helper.make_tensor_value_info("x", TensorProto.FLOAT, ["batch", 2])
    y = helper.make_tensor_value_info("y", TensorProto.FLOAT, ["batch", 2])
    node = helper.make_node(operator, ["x", "w"], ["y"], domain=domain)
    if graph is not None:
        node.attribute.append(helper.make_attribute("body", graph))
    made = helper.make_graph([node] * nodes, "g", [x], [y], [weight])
    imports = [helper.make_opsetid("", 18), *(helper.make_opsetid(d, 1) for d in opsets)]
    return helper.make_model(made, opset_imports=imports, functions=list(functions))


def external():
    tensor = TensorProto(name="w", data_type=TensorProto.FLOAT, dims=[2, 2])
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="../../etc/passwd")
    return tensor


def test_a_plain_model_passes():
    check_graph(model().SerializeToString(), "p")
    check_graph(model(opsets=("ai.onnx",)).SerializeToString(), "p")


def test_weights_in_another_file_are_refused(error_line):
    content = model(tensor=external()).SerializeToString()
    error_line("check_graph: external data", lambda: check_graph(content, "policy.onnx"))


def test_operators_of_others_are_refused(error_line):
    content = model(domain="com.evil").SerializeToString()
    error_line("check_graph: domain", lambda: check_graph(content, "policy.onnx"))
    with pytest.raises(BundleError, match=r"com\.evil"):
        check_graph(model(opsets=("com.evil",)).SerializeToString(), "p")


def test_functions_are_refused():
    function = helper.make_function(
        "f",
        "f",
        ["a"],
        ["b"],
        [helper.make_node("Relu", ["a"], ["b"])],
        [helper.make_opsetid("", 18)],
    )
    with pytest.raises(BundleError, match="functions"):
        check_graph(model(functions=[function]).SerializeToString(), "p")


def test_a_node_that_runs_a_graph_is_refused(error_line):
    """A loop of 2^62 turns is a small file that onnxruntime would run for ever."""
    content = model(graph=model().graph).SerializeToString()
    error_line("check_graph: loop", lambda: check_graph(content, "policy.onnx"))


@pytest.mark.parametrize("operator", ["Expand", "ConstantOfShape", "RandomNormalLike", "Loop"])
def test_operators_that_no_export_writes_are_refused(operator):
    """A few bytes of them make hours of work, or answers that differ each time."""
    content = model(operator=operator).SerializeToString()
    with pytest.raises(BundleError, match=f"operator '{operator}'"):
        check_graph(content, "p")


def test_a_graph_of_very_many_operators_is_refused():
    check_graph(model(nodes=MAX_NODES).SerializeToString(), "p")
    with pytest.raises(BundleError, match="more than 1000"):
        check_graph(model(nodes=MAX_NODES + 1).SerializeToString(), "p")


def policy_like(nodes, *tensors, size=72):
    """A model of one input ``observation`` (batch, size) with constants and nodes."""
    x = helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["batch", size])
    y = helper.make_tensor_value_info("action", TensorProto.FLOAT, ["batch", 8])
    graph = helper.make_graph(nodes, "g", [x], [y], list(tensors))
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)])


def constant(name, values, kind=np.float32):
    return numpy_helper.from_array(np.array(values, dtype=kind), name)


def doubling(operator, **attributes):
    """30 operators that each double their result."""
    names = ["observation", *(f"r{k}" for k in range(30))]
    return [
        helper.make_node(operator, [a, a], [b], **attributes) for a, b in itertools.pairwise(names)
    ]


HUGE = {
    "concatenation": policy_like(doubling("Concat", axis=1)),
    "concatenation of rows": policy_like(doubling("Concat", axis=0)),
    "outer sum": policy_like(
        [helper.make_node("Add", ["row", "column"], ["r"])],
        constant("row", np.zeros((1, 40_000))),
        constant("column", np.zeros((40_000, 1))),
    ),
    "outer product": policy_like(
        [helper.make_node("MatMul", ["column", "row"], ["r"])],
        constant("row", np.zeros((1, 40_000))),
        constant("column", np.zeros((40_000, 1))),
    ),
    "outer product of Gemm": policy_like(
        [helper.make_node("Gemm", ["row", "row"], ["r"], transA=1)],
        constant("row", np.zeros((1, 40_000))),
    ),
    "many dimensions": policy_like(
        [
            helper.make_node("Mul", ["a", "b"], ["ab"]),
            helper.make_node("Mul", ["ab", "c"], ["r"]),
        ],
        constant("a", np.zeros((1000, 1, 1))),
        constant("b", np.zeros((1, 1000, 1))),
        constant("c", np.zeros((1, 1, 1000))),
    ),
    "products": policy_like(
        [helper.make_node("MatMul", ["a", "a"], [f"r{k}"]) for k in range(900)],
        constant("a", np.zeros((400, 400))),
    ),
}


@pytest.mark.parametrize("name", HUGE)
def test_results_that_grow_without_bound_are_rejected(name):
    with pytest.raises(BundleError, match="its results are larger than"):
        check_graph(HUGE[name].SerializeToString(), "p")


def test_the_number_of_rows_counts(error_line):
    """A product of two tensors of ``batch`` rows has ``batch`` squared numbers."""
    node = helper.make_node("Gemm", ["observation", "observation"], ["r"], transB=1)
    content = policy_like([node]).SerializeToString()
    check_graph(content, "p", rows=64)
    error_line("check_graph: rows", lambda: check_graph(content, "p", rows=10_000))


MISMATCHED = {
    "inner dimensions": [helper.make_node("MatMul", ["observation", "observation"], ["r"])],
    "unknown input": [helper.make_node("Abs", ["nothing"], ["r"])],
    "computed bounds": [
        helper.make_node("Slice", ["observation", "observation", "observation"], ["r"])
    ],
    "backward slice": [
        helper.make_node("Slice", ["observation", "start", "end", "axis", "step"], ["r"])
    ],
    "axis": [helper.make_node("Concat", ["observation", "observation"], ["r"], axis=7)],
    "no axis": [helper.make_node("Concat", ["observation", "observation"], ["r"])],
    "no input": [helper.make_node("Add", ["observation"], ["r"])],
}


@pytest.mark.parametrize("name", MISMATCHED)
def test_shapes_that_do_not_fit_together_are_rejected(name):
    integers = {"start": 5, "end": 0, "axis": 1, "step": -1}
    constants = [constant(name, [value], np.int64) for name, value in integers.items()]
    with pytest.raises(BundleError, match="do not fit together"):
        check_graph(policy_like(MISMATCHED[name], *constants).SerializeToString(), "p")


@pytest.mark.parametrize("change", [{"dims": [100_000, 100_000]}, {"dims": [-1]}, {"dims": [3]}])
def test_a_tensor_of_another_size_than_its_data_is_rejected(change):
    tensor = TensorProto(name="w", data_type=TensorProto.FLOAT, raw_data=bytes(16), **change)
    with pytest.raises(BundleError, match="does not match its shape"):
        check_graph(model(tensor=tensor).SerializeToString(), "p")


def test_many_fields_and_large_files_are_rejected_at_once():
    with pytest.raises(BundleError, match="more than 200000 fields"):
        check_graph(b"\x08\x01" * 300_000, "p")
    with pytest.raises(BundleError, match="larger than 32 MB"):
        check_graph(bytes(33 << 20), "p")


SLICES = st.tuples(st.integers(-9, 9), st.integers(-(2**62), 2**62), st.sampled_from([1, 2, 3]))


@given(SLICES, st.booleans())
def test_inferred_shapes_are_those_of_onnx_runtime(bounds, keepdims):
    start, end, step = bounds
    nodes = [
        helper.make_node("Slice", ["observation", "start", "end", "axis", "step"], ["a"]),
        helper.make_node("ReduceSum", ["a", "axis"], ["b"], keepdims=int(keepdims)),
        helper.make_node("Add", ["w", "row"], ["c"]),
        helper.make_node("Concat", ["a", "observation"], ["action"], axis=1),
    ]
    integers = {"start": start, "end": end, "axis": 1, "step": step}
    constants = [constant(name, [value], np.int64) for name, value in integers.items()]
    constants += [constant("w", np.zeros((3, 1))), constant("row", np.zeros(4))]
    made = policy_like(nodes, *constants, size=7)
    del made.graph.output[:]
    for name in ("a", "b", "c", "action"):
        made.graph.output.append(helper.make_tensor_value_info(name, TensorProto.FLOAT, None))
    made.ir_version = 8
    session = onnxruntime.InferenceSession(made.SerializeToString())
    results = session.run(None, {"observation": np.zeros((5, 7), dtype=np.float32)})
    graph = _Reader("p").graph(made.SerializeToString())
    known = {**graph.tensors, "observation": Tensor((5, 7))}
    for node, result in zip(graph.nodes, results, strict=True):
        shape = OPERATORS[node.operator]([known[n] for n in node.inputs], node.attributes)
        known[node.outputs[0]] = Tensor(shape)
        assert shape == result.shape


def field(key, content):
    """A field of bytes under a key of any size."""
    out = bytearray()
    for value in (key, len(content)):
        while value > 127:
            out.append(value & 127 | 128)
            value >>= 7
        out.append(value)
    return bytes(out) + content


@pytest.mark.parametrize("number", [7, 8, 25])
def test_a_key_that_others_cut_to_another_field_is_refused(number):
    """protobuf keeps 32 bits of a key: without bit 32 this is a field that would be looked at."""
    plain = model().SerializeToString()
    hidden = field(number << 3 | 2 | 1 << 32, model(domain="com.evil").SerializeToString())
    with pytest.raises(BundleError, match="not an ONNX model"):
        check_graph(plain + hidden, "p")
    check_graph(plain + field((1 << 29) - 1 << 3 | 2, b""), "p")  # the largest there is


def test_a_field_without_a_number_is_refused():
    with pytest.raises(BundleError, match="not an ONNX model"):
        check_graph(model().SerializeToString() + field(2, b"x"), "p")


@given(st.binary(max_size=300))
def test_noise_is_refused_as_what_it_is(content):
    with pytest.raises(BundleError):
        check_graph(content, "p")


@given(st.data())
def test_a_damaged_model_never_raises_anything_else(data):
    content = bytearray(model().SerializeToString())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(content) - 1))
        content[at] = data.draw(st.integers(0, 255))
    try:
        check_graph(bytes(content), "p")
    except BundleError:
        return


def test_the_field_numbers_are_those_of_onnx():
    numbers: dict[tuple[Any, str], int] = {
        (onnx.ModelProto, "graph"): 7,
        (onnx.ModelProto, "opset_import"): 8,
        (onnx.ModelProto, "training_info"): 20,
        (onnx.ModelProto, "functions"): 25,
        (onnx.GraphProto, "node"): 1,
        (onnx.GraphProto, "initializer"): 5,
        (onnx.GraphProto, "sparse_initializer"): 15,
        (onnx.NodeProto, "attribute"): 5,
        (onnx.NodeProto, "domain"): 7,
        (onnx.AttributeProto, "t"): 5,
        (onnx.AttributeProto, "g"): 6,
        (onnx.AttributeProto, "tensors"): 10,
        (onnx.AttributeProto, "graphs"): 11,
        (onnx.AttributeProto, "sparse_tensor"): 22,
        (onnx.AttributeProto, "sparse_tensors"): 23,
        (onnx.TensorProto, "external_data"): 13,
        (onnx.TensorProto, "data_location"): 14,
    }
    numbers |= {
        (onnx.GraphProto, "input"): 11,
        (onnx.NodeProto, "input"): 1,
        (onnx.NodeProto, "output"): 2,
        (onnx.NodeProto, "op_type"): 4,
        (onnx.NodeProto, "domain"): 7,
        (onnx.AttributeProto, "name"): 1,
        (onnx.AttributeProto, "i"): 3,
        (onnx.TensorProto, "dims"): 1,
        (onnx.TensorProto, "data_type"): 2,
        (onnx.TensorProto, "name"): 8,
        (onnx.TensorProto, "raw_data"): 9,
        (onnx.ValueInfoProto, "name"): 1,
        (onnx.ValueInfoProto, "type"): 2,
        (onnx.TypeProto, "tensor_type"): 1,
        (onnx.TypeProto.Tensor, "shape"): 2,
        (onnx.TensorShapeProto, "dim"): 1,
        (onnx.TensorShapeProto.Dimension, "dim_value"): 1,
    }
    for (kind, field), number in numbers.items():
        assert kind.DESCRIPTOR.fields_by_name[field].number == number
