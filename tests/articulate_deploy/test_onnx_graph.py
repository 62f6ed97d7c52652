from typing import Any

import numpy as np
import onnx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from onnx import TensorProto, helper, numpy_helper

from articulate.errors import BundleError
from articulate_deploy.onnx_graph import MAX_NODES, check_graph


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
    for (kind, field), number in numbers.items():
        assert kind.DESCRIPTOR.fields_by_name[field].number == number
