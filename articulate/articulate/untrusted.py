"""Reading files that may be damaged or hostile: the one gate in front of every parser.

Regular files only (no FIFO, device or folder, through links as well), of bounded size. JSON and
YAML are bounded in depth and in the number of values; their numbers are finite and their keys
unique.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import resource
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import yaml

from articulate.errors import UsageError, quote, shorten

JSON_BYTES = 20_000_000
"""Largest JSON file that is read."""
YAML_BYTES = 1_000_000
"""Largest YAML file that is read."""
MAX_DEPTH = 100
"""Deepest nesting of lists and mappings."""
MAX_VALUES = 2_000_000
"""Most values of a JSON or YAML file, each alias counted with all that it repeats."""
MAX_DIGITS = 400
"""Longest number in YAML."""
LFS_HEADER = b"version https://git-lfs.github.com/spec/"
"""First bytes of a file that Git LFS has not fetched."""


def open_regular(path: Path, *, limit_bytes: int, error: type[UsageError] = UsageError) -> BinaryIO:
    """Open the regular file at ``path``, or that a link there leads to, for reading.

    Args:
        path: File to read. Opening a FIFO does not block.
        limit_bytes: Largest size that is accepted.
        error: Class of the error that is raised.

    Raises:
        UsageError: It cannot be opened, is no regular file, or is larger.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as problem:
        raise error(f"{_name(path)}: cannot be read ({problem.strerror})") from None
    except ValueError:  # a name with a zero byte
        raise error(f"{_name(path)}: cannot be read (not a file name)") from None
    state = os.fstat(descriptor)
    reason = ""
    if not stat.S_ISREG(state.st_mode):
        reason = "is a folder; give a file" if stat.S_ISDIR(state.st_mode) else "not a regular file"
    elif state.st_size > limit_bytes:
        reason = f"larger than {limit_bytes} bytes, the most that is accepted"
    if reason:
        os.close(descriptor)
        raise error(f"{_name(path)}: {reason}")
    return os.fdopen(descriptor, "rb")


def read_bounded(path: Path, limit_bytes: int, *, error: type[UsageError] = UsageError) -> bytes:
    """Return the content of the regular file at ``path``, of at most ``limit_bytes``.

    Raises:
        UsageError: As :func:`open_regular`; also where the file grows while it is read.
    """
    with open_regular(path, limit_bytes=limit_bytes, error=error) as stream:
        try:
            content = stream.read(limit_bytes + 1)
        except OSError as problem:
            raise error(f"{_name(path)}: cannot be read ({problem.strerror})") from None
    if len(content) > limit_bytes:
        raise error(f"{_name(path)}: larger than {limit_bytes} bytes, the most that is accepted")
    if is_lfs_pointer(content):
        raise error(f"{_name(path)}: a Git LFS pointer, not the file; fetch it with: git lfs pull")
    return content


def read_text(path: Path, limit_bytes: int, *, error: type[UsageError] = UsageError) -> str:
    """Return the text of the regular UTF-8 file at ``path``, of at most ``limit_bytes``.

    Raises:
        UsageError: As :func:`read_bounded`, or it is not UTF-8.
    """
    try:
        return read_bounded(path, limit_bytes, error=error).decode("utf-8")
    except UnicodeDecodeError:
        raise error(f"{_name(path)}: not text in UTF-8") from None


def load_json_object(
    path: Path,
    *,
    limit_bytes: int = JSON_BYTES,
    max_depth: int = MAX_DEPTH,
    error: type[UsageError] = UsageError,
) -> dict[str, Any]:
    """Return the JSON object in the file at ``path``.

    Raises:
        UsageError: As :func:`read_text` and :func:`parse_json_object`.
    """
    text = read_text(path, limit_bytes, error=error)
    return parse_json_object(text, _name(path), max_depth=max_depth, error=error)


def parse_json_object(
    text: str, where: str, *, max_depth: int = MAX_DEPTH, error: type[UsageError] = UsageError
) -> dict[str, Any]:
    """Return the JSON object that ``text`` is.

    Args:
        text: JSON.
        where: Name of its file, for messages.
        max_depth: Deepest nesting that is accepted.
        error: Class of the error that is raised.

    Raises:
        UsageError: It is not JSON, not an object, nested deeper, or has a duplicate key or a
            number that is not finite.
    """
    try:
        content = json.loads(
            text, object_pairs_hook=_unique, parse_constant=_reject, parse_float=_finite
        )
    except RecursionError:
        raise error(f"{where}: nested deeper than {max_depth} levels") from None
    except ValueError as problem:
        raise error(f"{where}: not JSON ({shorten(problem)})") from None
    if not isinstance(content, dict):
        raise error(f"{where}: holds {quote(content)}; a JSON object was expected")
    _check_depth(content, where, max_depth, error)
    return content


def load_yaml(
    path: Path, *, limit_bytes: int = YAML_BYTES, error: type[UsageError] = UsageError
) -> Any:
    """Return the plain values of the YAML file at ``path``; None where it is empty.

    Raises:
        UsageError: As :func:`read_text` and :func:`parse_yaml`.
    """
    return parse_yaml(read_text(path, limit_bytes, error=error), _name(path), error=error)


def parse_yaml(text: str, where: str, *, error: type[UsageError] = UsageError) -> Any:
    """Return the plain values of YAML: mappings, lists, text, numbers, booleans and None.

    Args:
        text: YAML of one document.
        where: Name of its file, for messages.
        error: Class of the error that is raised.

    Raises:
        UsageError: It is not YAML, has a duplicate key, or grows too large by its aliases.
    """
    try:
        return yaml.load(text, _YamlLoader)  # noqa: S506  # a SafeLoader: no Python objects
    except yaml.MarkedYAMLError as problem:
        mark = problem.problem_mark or problem.context_mark
        line = f":{mark.line + 1}" if mark else ""
        reason = shorten(problem.problem or problem.context or "")
        raise error(f"{where}{line}: not YAML ({reason})") from None
    except (yaml.YAMLError, ValueError, RecursionError):  # a date of no calendar, deep brackets
        raise error(f"{where}: not YAML") from None


@contextlib.contextmanager
def memory_limit(extra_bytes: int) -> Iterator[None]:
    """Limit by how much the address space of this process can grow inside the block.

    Allocations beyond it raise ``MemoryError``. A lower limit that is already set stays.

    Args:
        extra_bytes: Memory that the block may take.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except OSError:  # a system without it
        yield
        return
    limit = pages * resource.getpagesize() + extra_bytes
    limits = [value for value in (limit, soft, hard) if value != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_AS, (min(limits), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def is_lfs_pointer(content: bytes) -> bool:
    """Return whether ``content`` is a Git LFS pointer in place of the file."""
    return content.startswith(LFS_HEADER)


def _name(path: Path) -> str:
    return str(path) if str(path).isprintable() else quote(str(path))


def _unique(items: list[tuple[str, Any]]) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for key, value in items:
        if key in content:
            raise ValueError(f"duplicate key {quote(key)}")
        content[key] = value
    return content


def _reject(word: str) -> float:
    raise ValueError(f"{word} is not a JSON number")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{quote(text)} is not finite")
    return value


def _check_depth(content: Any, where: str, max_depth: int, error: type[UsageError]) -> None:
    level, count = [content], 0
    for _ in range(max_depth):
        level = [value for item in level for value in _items(item)]
        count += len(level)
        if not level:
            break
    else:
        raise error(f"{where}: nested deeper than {max_depth} levels")
    if count > MAX_VALUES:
        raise error(f"{where}: {count} values; at most {MAX_VALUES} are accepted")


def _items(value: Any) -> Iterator[Any]:
    if isinstance(value, dict):
        yield from value.values()
    elif isinstance(value, list):
        yield from value


class _YamlLoader(yaml.SafeLoader):
    """YAML without Python objects, with unique keys, and bounded where aliases repeat nodes."""

    def get_single_node(self) -> yaml.Node | None:
        node = super().get_single_node()
        if node is not None and self._size(node, {}, 0) > MAX_VALUES:
            raise yaml.constructor.ConstructorError(
                None, None, f"more than {MAX_VALUES} values with all aliases", node.start_mark
            )
        return node

    def _size(self, node: yaml.Node, sizes: dict[int, int], depth: int) -> int:
        """Return the number of values in ``node`` with its aliases expanded."""
        if id(node) in sizes:
            if sizes[id(node)] < 0:
                raise yaml.constructor.ConstructorError(
                    None, None, "a value contains itself", node.start_mark
                )
            return sizes[id(node)]
        if depth > MAX_DEPTH:
            raise yaml.constructor.ConstructorError(
                None, None, f"nested deeper than {MAX_DEPTH} levels", node.start_mark
            )
        number = node.tag.endswith((":int", ":float"))
        if number and len(node.value) > MAX_DIGITS:  # in base 60, quadratic in its length
            raise yaml.constructor.ConstructorError(
                None, None, f"a number of {len(node.value)} characters", node.start_mark
            )
        sizes[id(node)] = -1
        children: list[yaml.Node] = []
        if isinstance(node, yaml.SequenceNode):
            children = node.value
        elif isinstance(node, yaml.MappingNode):
            children = [child for pair in node.value for child in pair]
        sizes[id(node)] = 1 + sum(self._size(child, sizes, depth + 1) for child in children)
        return sizes[id(node)]

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key_node, _ in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(
                    None, None, "a key must be a name", key_node.start_mark
                )
            key = key_node.value
            if key in seen and key != "<<":
                raise yaml.constructor.ConstructorError(
                    None, None, f"duplicate key {key}", key_node.start_mark
                )
            seen.add(key)
        return dict(super().construct_mapping(node, deep))
