import json

import pytest

from articulate.commands import run_command
from articulate_deploy.bundle import load_bundle
from articulate_deploy.commands.deploy import main
from articulate_deploy.model_card import _numbers, describe, model_card
from articulate_deploy.signature import make_key, sign_bundle, signature_path, verify_bundle

pytest.importorskip("cryptography")


def test_a_signed_bundle_is_verified_with_its_key_only(folder, tmp_path, error_line):
    public = make_key(tmp_path / "author.key")
    assert (tmp_path / "author.key").stat().st_mode & 0o077 == 0
    error_line("verify_bundle(unsigned)", lambda: verify_bundle(folder, public))
    sign_bundle(folder, tmp_path / "author.key")
    verify_bundle(folder, public)
    other = make_key(tmp_path / "other.key")
    error_line("verify_bundle(another key)", lambda: verify_bundle(folder, other))
    error_line("verify_bundle(short key)", lambda: verify_bundle(folder, "12"))
    content = json.loads(signature_path(folder).read_text())
    content["signature"] = "00" * 64
    signature_path(folder).write_text(json.dumps(content))
    error_line("verify_bundle(changed)", lambda: verify_bundle(folder, public))
    (tmp_path / "no.key").write_text("no key")
    error_line("sign_bundle(no key)", lambda: sign_bundle(folder, tmp_path / "no.key"))


def test_numbers_that_are_zero_but_for_rounding_are_written_as_zero():
    assert _numbers([-7.69e-20, -1.01, 4.6e-20, 0.0123456]) == "0 -1.01 0 0.0123"


def test_inspect_describes_a_bundle_and_writes_its_card(exported, tmp_path, capsys):
    card = tmp_path / "card.md"
    assert run_command(main, ["inspect", str(exported), "--card", str(card)]) == 0
    printed = capsys.readouterr().out
    manifest = load_bundle(exported).manifest
    assert manifest.task.joint in printed
    assert "Nm/rad" in printed
    assert card.read_text() == model_card(load_bundle(exported))
    assert run_command(main, ["inspect", str(exported), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(
        json.dumps(describe(load_bundle(exported)))
    )
