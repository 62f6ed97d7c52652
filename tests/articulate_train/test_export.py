import dataclasses
import io
import json
import shutil
import zipfile

import numpy as np
import onnx
import pytest
import torch
from numpy.testing import assert_allclose
from tests.assets import make_cabinet
from tests.runs import make_run, write_checkpoint

from articulate.errors import RunError, UsageError
from articulate.onnx_runtime import onnxruntime
from articulate.task.manifest import decode_manifest
from articulate.task.observation import OBSERVATION
from articulate_train.action_scaling import corrected_action
from articulate_train.commands.export import main
from articulate_train.config import ActionScalingConfig
from articulate_train.export import (
    export_policy,
    golden_pairs,
    licence_warnings,
    select_seed,
    to_onnx,
    write_bundle,
)
from articulate_train.policy import checkpoint_sha256, load_policy, read_checkpoint
from articulate_train.run import open_run


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    return open_run(make_run(folder / "run", make_cabinet(folder / "cabinet"), seeds=(0, 1)))


@pytest.fixture(scope="module")
def policy(run):
    return load_policy(run.seed_folder(0))


@pytest.fixture(scope="module")
def model(policy):
    return to_onnx(policy)


def act(model, seen):
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    return session.run(["action"], {"observation": seen.astype(np.float32)})[0]


@pytest.mark.parametrize("n", [1, 2, 7, 1000])
def test_the_network_that_is_exported_is_the_one_that_was_trained(policy, model, n):
    rng = np.random.default_rng(n)
    seen = rng.uniform(OBSERVATION.low, OBSERVATION.high, (n, OBSERVATION.size))
    assert_allclose(act(model, seen), policy.act(seen), rtol=0, atol=1e-5)


def test_normalisation_clipping_and_finer_motions_are_inside(policy, model):
    far = np.full((1, OBSERVATION.size), 1e6)
    assert np.abs(act(model, far)).max() <= 1.0
    assert_allclose(
        act(model, far), act(model, 2 * far), rtol=0, atol=0
    )  # clipped to 10 deviations
    with torch.no_grad():
        network = policy.networks[0]
        linear = network.head(network.body(torch.zeros(1, OBSERVATION.size)))
    mean = network.mean.numpy()[None]
    correction = torch.clamp(linear, -1, 1).numpy()
    action = corrected_action(ActionScalingConfig(), mean, correction)
    assert_allclose(act(model, mean), action, rtol=0, atol=1e-5)


def test_the_file_is_plain_onnx_without_traces_of_the_machine(model):
    loaded = onnx.load_from_string(model)
    assert [o.domain for o in loaded.opset_import] == [""]
    assert loaded.opset_import[0].version >= 17
    assert not loaded.functions
    assert not any(node.metadata_props or node.doc_string for node in loaded.graph.node)
    assert b"site-packages" not in model
    assert loaded.graph.input[0].type.tensor_type.shape.dim[0].dim_param == "batch"


def test_exporting_twice_gives_the_same_network(policy, model):
    assert to_onnx(policy) == model


def test_golden_pairs_are_single_precision_and_within_the_layout(policy):
    seen, action = golden_pairs(policy, np.random.default_rng(0), 64)
    assert seen.shape == (64, OBSERVATION.size)
    assert seen.dtype == action.dtype == np.float32
    assert np.all(seen >= OBSERVATION.low)
    assert np.all(seen <= OBSERVATION.high)
    assert_allclose(action, policy.act(seen), rtol=0, atol=1e-6)


def test_a_bundle_names_what_made_it_and_nothing_of_the_machine(run, tmp_path):
    done = export_policy(run.folder, tmp_path / "b.zip", seed=1)
    with zipfile.ZipFile(done.path) as archive:
        text = archive.read("manifest.json").decode()
        manifest = decode_manifest(text, "m")
        assert set(archive.namelist()) == {"manifest.json", *manifest.files}
        with np.load(io.BytesIO(archive.read("golden.npz")), allow_pickle=False) as pairs:
            assert set(pairs.files) == {"observation", "action"}
    assert str(run.folder.parent) not in text
    assert manifest.training.seed == 1
    assert manifest.training.seed_rule == "given"
    assert manifest.task == run.task
    assert manifest.placement == run.placement
    assert manifest.randomization == run.config.randomization
    assert manifest.control == run.config.control
    assert manifest.licences["object"] == "MIT"
    assert manifest.object_sha256 == run.asset.content_id()
    assert "system" not in manifest.producer


def report(run, **success):
    seeds = [
        {
            "seed": int(k[1:]),
            "success": {"value": v},
            "checkpoint_sha256": checkpoint_sha256(run.seed_folder(int(k[1:]))),
        }
        for k, v in success.items()
    ]
    (run.folder / "report.json").write_text(json.dumps({"seeds": seeds}))


def test_the_best_seed_of_the_evaluation_is_used_and_ties_go_to_the_lower(run):
    try:
        report(run, s0=0.9, s1=0.95)
        assert select_seed(run, None)[::2] == (1, 0.95)
        report(run, s0=0.9, s1=0.9)
        assert select_seed(run, None)[::2] == (0, 0.9)
        assert select_seed(run, 1)[::2] == (1, 0.9)
    finally:
        (run.folder / "report.json").unlink()


def test_success_of_a_checkpoint_that_was_replaced_since_is_not_reported(tmp_path):
    """After a training that went on without an evaluation the report is of what was before."""
    made = make_run(tmp_path / "run", make_cabinet(tmp_path / "cabinet"), seeds=(0, 1))
    run = open_run(made)
    report(run, s0=0.9, s1=0.95)
    shutil.rmtree(run.seed_folder(1))
    write_checkpoint(run.seed_folder(1), 7)
    assert select_seed(run, 1)[2] is None
    assert select_seed(run, 0)[2] == 0.9
    assert "not evaluated" in select_seed(run, None)[1]
    (run.folder / "report.json").write_text('{"seeds": [{"seed": 0, "success": {"value": 1}}]}')
    assert select_seed(run, 0)[2] is None  # a report without the hash of its checkpoint


def test_steps_of_a_bundle_are_those_of_its_checkpoint(tiny, tmp_path):
    """Progress has more steps if the training went on after the last checkpoint."""
    write_checkpoint(tiny.seed_folder(0), 0)
    content = read_checkpoint(tiny.seed_folder(0)) | {"metadata": json.dumps({"num_timesteps": 64})}
    torch.save(content, tiny.seed_folder(0) / "checkpoint.pt")
    row = json.dumps({"steps": 96, "seconds": 1.0, "success": 0.5, "opened": 0.5}) + "\n"
    (tiny.seed_folder(0) / "progress.jsonl").write_text(row)
    done = export_policy(tiny.folder, tmp_path / "bundle")
    manifest = decode_manifest((done.path / "manifest.json").read_text(), "m")
    assert manifest.training.steps == 64


def test_a_folder_that_another_export_writes_to_is_left_only(tmp_path):
    other = tmp_path / ".bundle.part"
    other.mkdir()
    (other / "half").write_text("of another export")
    write_bundle(tmp_path / "bundle", {"a/b.txt": b"c"})
    assert (tmp_path / "bundle" / "a" / "b.txt").read_bytes() == b"c"
    assert (other / "half").exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == [".bundle.part", "bundle"]
    assert (tmp_path / "bundle").stat().st_mode & 0o777 == 0o755


def test_without_an_evaluation_the_end_of_training_decides_and_it_reports_it(run):
    path = run.seed_folder(1) / "progress.jsonl"
    try:
        row = {"steps": 10, "seconds": 1.0, "success": 0.5, "opened": 0.5}
        path.write_text(json.dumps(row) + "\n")
        seed, rule, success = select_seed(run, None)
        assert (seed, success) == (1, None)
        assert "not evaluated" in rule
    finally:
        path.unlink()


def test_seeds_that_are_not_there_are_named(run):
    with pytest.raises(RunError, match="seed 7 has no checkpoint; there are: 0, 1"):
        select_seed(run, 7)


def test_a_run_without_checkpoints_is_rejected(run, tmp_path, error_line):
    bare = dataclasses.replace(run, folder=tmp_path / "run")
    error_line("choose_seed(untrained)", lambda: select_seed(bare, None))


def test_what_is_no_run_is_rejected(tmp_path):
    with pytest.raises(RunError):
        export_policy(tmp_path, tmp_path / "b.zip")
    assert list(tmp_path.iterdir()) == []


def test_an_existing_bundle_is_not_overwritten(run, tmp_path, error_line):
    (tmp_path / "b.zip").write_text("mine")
    error_line("export_policy(existing)", lambda: export_policy(run.folder, tmp_path / "b.zip"))
    assert (tmp_path / "b.zip").read_text() == "mine"


def test_a_place_that_cannot_be_written_is_one_line(run, tmp_path):
    (tmp_path / "file").write_text("")
    for name in ("b.zip", "bundle"):
        with pytest.raises(UsageError, match="cannot be written"):
            export_policy(run.folder, tmp_path / "file" / name)


@pytest.mark.parametrize(
    ("licence", "action"),
    [
        ("MIT", False),
        ("Apache-2.0", False),
        ("CC-BY-4.0", False),
        ("CC BY-NC 4.0", True),
        ("CC-BY-NC-SA-4.0", True),
        ("PartNet-Mobility terms: non-commercial research", True),
        ("noncommercial", True),
        ("unknown", True),
        ("", True),
    ],
)
def test_a_licence_that_forbids_redistribution_is_an_error(licence, action):
    assert bool(licence_warnings(licence, "cabinet")) == action


def test_the_command_prints_the_bundle_it_wrote(run, tmp_path, capsys):
    assert main([str(run.folder), "--out", str(tmp_path / "b"), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["bundle"] == str(tmp_path / "b")
    assert (tmp_path / "b" / "manifest.json").is_file()
