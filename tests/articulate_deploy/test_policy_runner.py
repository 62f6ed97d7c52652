import dataclasses
import io

import numpy as np
import pytest
from numpy.testing import assert_allclose
from onnx import TensorProto, helper, numpy_helper

from articulate.errors import BundleError
from articulate_deploy import policy_runner
from articulate_deploy.onnx_graph import check_graph
from articulate_deploy.policy_runner import Policy
from articulate_train.policy import load_policy


def with_golden(bundle, **arrays):
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return dataclasses.replace(bundle, files={**bundle.files, "golden.npz": stream.getvalue()})


def golden(bundle):
    with np.load(io.BytesIO(bundle.golden), allow_pickle=False) as pairs:
        return {name: pairs[name] for name in pairs.files}


def test_the_bundle_acts_as_the_trained_policy(bundle, run):
    policy, trained = Policy(bundle), load_policy(run.seed_folder(0))
    layout = bundle.manifest.observation
    seen = np.random.default_rng(0).uniform(layout.low, layout.high, (100, layout.size))
    assert_allclose(policy.act(seen), trained.act(seen), rtol=0, atol=1e-5)
    assert_allclose(policy.act(seen[:1]), trained.act(seen[:1]), rtol=0, atol=1e-5)


def test_golden_pairs_are_not_all_at_the_bounds(bundle):
    action = golden(bundle)["action"]
    assert len(action) == 64
    assert np.mean(np.abs(action) < 1.0) > 0.5


def test_actions_stay_in_bounds_whatever_is_seen(bundle):
    seen = np.full((1, bundle.manifest.observation.size), 1e30)
    assert np.all(np.abs(Policy(bundle).act(seen)) <= 1.0)


def test_a_policy_that_misses_its_golden_pairs_is_refused(bundle, error_line):
    pairs = golden(bundle)
    pairs["action"] = np.clip(pairs["action"] + 0.5, -1, 1)
    forged = dataclasses.replace(with_golden(bundle, **pairs), where="bundle")
    line = error_line("Policy: golden pairs", lambda: Policy(forged))
    assert "golden" in line


@pytest.mark.parametrize("count", [0, 63])
def test_too_few_golden_pairs_are_refused(bundle, count):
    pairs = {name: value[:count] for name, value in golden(bundle).items()}
    with pytest.raises(BundleError, match="64 pairs"):
        Policy(with_golden(bundle, **pairs))


def test_pickled_golden_pairs_are_refused(bundle):
    pairs = golden(bundle)
    pairs["action"] = np.array([{"a": 1}], dtype=object)
    with pytest.raises(BundleError, match="golden"):
        Policy(with_golden(bundle, **pairs))


def test_a_golden_pair_that_is_not_a_number_is_refused(bundle):
    pairs = golden(bundle)
    pairs["action"] = pairs["action"].copy()
    pairs["action"][3, 2] = np.nan
    with pytest.raises(BundleError, match="golden"):
        Policy(with_golden(bundle, **pairs))


def test_a_file_that_is_no_network_is_refused(bundle):
    files = {**bundle.files, "policy.onnx": b"\x08\x08\x3a\x00"}
    with pytest.raises(BundleError, match="cannot be run"):
        Policy(dataclasses.replace(bundle, files=files))


def test_a_network_of_another_input_is_refused(bundle):
    entry = dataclasses.replace(bundle.manifest.policy, input="seen")
    manifest = dataclasses.replace(bundle.manifest, policy=entry)
    with pytest.raises(BundleError, match="input and output"):
        Policy(dataclasses.replace(bundle, manifest=manifest))


def network(rows, size):
    """A network that takes so many rows of observations, and gives their first 8 numbers."""
    x = helper.make_tensor_value_info("observation", TensorProto.FLOAT, [rows, size])
    y = helper.make_tensor_value_info("action", TensorProto.FLOAT, [rows, 8])
    weight = numpy_helper.from_array(np.eye(size, 8, dtype=np.float32), "w")
    node = helper.make_node("MatMul", ["observation", "w"], ["action"])
    graph = helper.make_graph([node], "g", [x], [y], [weight])
    opset = helper.make_opsetid("", 18)
    return helper.make_model(graph, opset_imports=[opset], ir_version=8).SerializeToString()


@pytest.mark.parametrize("rows", [1, 64])
def test_a_network_that_takes_one_number_of_rows_only_is_refused(bundle, rows, capfd):
    """64 is the number of golden pairs; a robot asks for one row."""
    content = network(rows, bundle.manifest.observation.size)
    changed = dataclasses.replace(bundle, files={**bundle.files, "policy.onnx": content})
    with pytest.raises(BundleError, match="cannot be run"):
        Policy(changed)
    assert capfd.readouterr().err == ""


def test_a_network_that_takes_too_long_is_stopped(bundle, monkeypatch):
    size = bundle.manifest.observation.size
    x = helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["batch", size])
    y = helper.make_tensor_value_info("action", TensorProto.FLOAT, ["batch", 8])
    row = numpy_helper.from_array(np.ones((1, 2000), dtype=np.float32), "row")
    column = numpy_helper.from_array(np.ones((2000, 1), dtype=np.float32), "column")
    first = numpy_helper.from_array(np.eye(size, 8, dtype=np.float32), "w")
    nodes = [helper.make_node("Mul", ["row", "column"], ["m0"])]
    nodes += [helper.make_node("MatMul", [f"m{k}", "m0"], [f"m{k + 1}"]) for k in range(900)]
    nodes += [
        helper.make_node("MatMul", ["observation", "w"], ["a"]),
        helper.make_node("MatMul", ["row", "m900"], ["b"]),
        helper.make_node("MatMul", ["b", "column"], ["c"]),
        helper.make_node("Add", ["a", "c"], ["action"]),
    ]
    graph = helper.make_graph(nodes, "g", [x], [y], [first, row, column])
    opset = helper.make_opsetid("", 18)
    made = helper.make_model(graph, opset_imports=[opset], ir_version=8).SerializeToString()
    with pytest.raises(BundleError, match="billion products"):
        check_graph(made, "p")
    monkeypatch.setattr(policy_runner, "MAX_GOLDEN_S", 0.2)
    changed = dataclasses.replace(bundle, files={**bundle.files, "policy.onnx": made})
    with pytest.raises(BundleError, match="terminate"):
        Policy(changed)


def test_an_action_that_is_not_finite_is_rejected(bundle):
    """Actions of the golden pairs are finite, as they have to agree with the pairs."""
    size = bundle.manifest.observation.size
    policy = Policy(bundle)
    with pytest.raises(BundleError, match="not finite"):
        policy.act(np.full((1, size), np.nan))


def test_golden_pairs_that_unpack_to_more_than_a_bundle_are_refused(bundle):
    stream = io.BytesIO()
    np.savez_compressed(stream, observation=np.zeros(9_000_000))
    files = {**bundle.files, "golden.npz": stream.getvalue()}
    with pytest.raises(BundleError, match="does not hold"):
        Policy(dataclasses.replace(bundle, files=files))


def test_damaged_golden_pairs_are_refused(bundle):
    stream = io.BytesIO()
    np.savez_compressed(stream, **golden(bundle))
    content = bytearray(stream.getvalue())
    begin = content.index(b"observation.npy") + 40
    content[begin : begin + 16] = b"\xff" * 16
    files = {**bundle.files, "golden.npz": bytes(content)}
    with pytest.raises(BundleError, match="golden"):
        Policy(dataclasses.replace(bundle, files=files))
