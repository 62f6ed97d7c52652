"""``deploy inspect``, ``deploy sign`` and ``deploy verify``: describe and sign a bundle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from articulate.commands import console
from articulate.commands.fields import POSITIONAL
from articulate.commands.flags import parse
from articulate.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class InspectFlags:
    """Check a bundle and describe it; nothing moves.

    Example: deploy inspect cabinet.zip --card MODEL_CARD.md
    """

    bundle: Annotated[Path, POSITIONAL]
    """Folder or zip file from export-policy."""
    card: Path | None = None
    """File for a model card in Markdown."""
    json: bool = False
    """Print only the description as JSON on standard output."""


@dataclass(frozen=True, kw_only=True)
class SignFlags:
    """Sign a bundle with ed25519; the signature is written to BUNDLE.sig.

    Example: deploy sign cabinet.zip --key author.key
    """

    bundle: Annotated[Path, POSITIONAL]
    """Bundle to sign."""
    key: Path | None = None
    """Private key."""
    new_key: Path | None = None
    """File for a new private key, which is used at once."""

    def __post_init__(self) -> None:
        if (self.key is None) == (self.new_key is None):
            raise ConfigError("give one of --key FILE and --new-key FILE")


@dataclass(frozen=True, kw_only=True)
class VerifyFlags:
    """Check a bundle and its signature.

    Example: deploy verify cabinet.zip --public-key 2152f8...
    """

    bundle: Annotated[Path, POSITIONAL]
    """Bundle with a signature."""
    public_key: str
    """Public key of the author, 64 hexadecimal digits."""


def inspect(argv: Sequence[str]) -> int:
    """Run ``deploy inspect``."""
    flags = parse(InspectFlags, argv, prog="deploy inspect")
    from articulate.files import write_text
    from articulate_deploy import model_card
    from articulate_deploy.bundle import load_bundle
    from articulate_deploy.policy_runner import Policy

    bundle = load_bundle(flags.bundle)
    Policy(bundle)  # reproduces the golden pairs
    if flags.card is not None:
        write_text(flags.card, model_card.model_card(bundle))
    if flags.json:
        console.emit_json(model_card.describe(bundle))
    else:
        console.emit(model_card.text(bundle))
    return 0


def sign(argv: Sequence[str]) -> int:
    """Run ``deploy sign``."""
    flags = parse(SignFlags, argv, prog="deploy sign")
    from articulate_deploy.signature import make_key, sign_bundle

    key = flags.key
    if flags.new_key is not None:
        console.emit(f"public key {make_key(flags.new_key)}")
        key = flags.new_key
    assert key is not None
    console.emit(str(sign_bundle(flags.bundle, key)))
    return 0


def verify(argv: Sequence[str]) -> int:
    """Run ``deploy verify``."""
    flags = parse(VerifyFlags, argv, prog="deploy verify")
    from articulate_deploy.signature import verify_bundle

    verify_bundle(flags.bundle, flags.public_key)
    console.emit(f"{flags.bundle}: signed with {flags.public_key}")
    return 0
