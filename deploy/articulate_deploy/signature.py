"""Detached signature of a bundle: ed25519 over its manifest, which lists the SHA-256 of each file.

The signature is a file beside the bundle, ``BUNDLE.sig``: a line of JSON with the public key and
the signature in hexadecimal digits. The hash in a manifest detects damage; a signature names the
author to those who know the public key.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from articulate.errors import BundleError, MissingError, UsageError
from articulate.files import write_text
from articulate.task.manifest import MANIFEST_FILE
from articulate.untrusted import read_bounded
from articulate_deploy.bundle import load_bundle
from articulate_deploy.bundle_files import read_contents

SCHEMA = "articulate.bundle-signature"
CONTEXT = b"articulate bundle manifest 1\n"
"""Bytes before the manifest, so that the signature is valid for nothing else."""
MAX_BYTES = 10_000
"""Largest key or signature file [bytes]."""


def _keys() -> Any:
    try:
        from cryptography.hazmat.primitives.asymmetric import ed25519
    except ModuleNotFoundError:
        raise MissingError(
            "signatures need cryptography, which is not installed; run: "
            'pip install "articulate-robots[sign]"'
        ) from None
    return ed25519


def signature_path(bundle: Path) -> Path:
    """Return the path of a bundle's signature."""
    return bundle.with_name(bundle.name + ".sig")


def make_key(path: Path) -> str:
    """Write a new private key that only its owner can read; return the public key.

    Raises:
        UsageError: The file exists or cannot be written.
    """
    key = _keys().Ed25519PrivateKey.generate()
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except OSError as error:
        raise UsageError(f"{path}: cannot be written ({error.strerror})") from None
    with os.fdopen(handle, "w") as stream:
        stream.write(key.private_bytes_raw().hex() + "\n")
    return str(key.public_key().public_bytes_raw().hex())


def sign_bundle(bundle: Path, key_file: Path) -> Path:
    """Check the bundle, sign its manifest and return the path of the signature.

    Raises:
        BundleError: The bundle is invalid.
        UsageError: The key cannot be read.
    """
    keys = _keys()
    load_bundle(bundle)
    try:
        text = read_bounded(key_file, MAX_BYTES, error=UsageError).decode("ascii").strip()
        key = keys.Ed25519PrivateKey.from_private_bytes(bytes.fromhex(text))
    except ValueError:
        raise UsageError(
            f"{key_file}: not a private key; make one with deploy sign --new-key FILE"
        ) from None
    content = {
        "schema": SCHEMA,
        "schema_version": 1,
        "public_key": key.public_key().public_bytes_raw().hex(),
        "signature": key.sign(CONTEXT + _manifest(bundle)).hex(),
    }
    path = signature_path(bundle)
    write_text(path, json.dumps(content) + "\n")
    return path


def verify_bundle(bundle: Path, public_key: str) -> None:
    """Check the bundle and its signature.

    Args:
        bundle: Bundle with a signature beside it.
        public_key: Public key of the author, 64 hexadecimal digits.

    Raises:
        BundleError: The bundle is invalid, or the signature is absent or of another key.
    """
    keys = _keys()
    from cryptography.exceptions import InvalidSignature

    path = signature_path(bundle)
    if not path.exists():
        raise BundleError(f"{path}: no signature; the author makes one with deploy sign")
    load_bundle(bundle)
    try:
        content = json.loads(read_bounded(path, MAX_BYTES, error=BundleError))
        signature = bytes.fromhex(content["signature"])
        good = content["schema"] == SCHEMA and content["public_key"] == public_key.lower()
        key = keys.Ed25519PublicKey.from_public_bytes(bytes.fromhex(public_key))
    except (ValueError, KeyError, TypeError):
        raise BundleError(f"{path}: not a signature, or the key has not 64 digits") from None
    try:
        if not good:
            raise InvalidSignature
        key.verify(signature, CONTEXT + _manifest(bundle))
    except InvalidSignature:
        raise BundleError(f"{path}: not signed with that key, or changed afterwards") from None


def _manifest(bundle: Path) -> bytes:
    return read_contents(bundle)[MANIFEST_FILE]
