"""Frozen dataclasses as configuration: read and written as YAML, with closed sets of keys.

The order is: defaults in code, then ``configs/*.yaml``, then the command line. A field may be
a bool, int, float, str, Path, ``Literal``, another dataclass, a tuple or a dict of these, or
one of them or None. The output of ``to_yaml`` reads back as an equal object.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar, Union

import yaml

from articulate.errors import ConfigError, nearest, shorten
from articulate.untrusted import load_yaml

T = TypeVar("T")

_WORDS = {
    bool: "true or false",
    int: "an integer",
    float: "a number",
    str: "text",
    Path: "a path",
}


def load_config(
    cls: type[T],
    source: Path | str | Mapping[str, Any] | None = None,
    overrides: Mapping[str, Any] | None = None,
) -> T:
    """Read a ``cls`` from a YAML file, a preset's name or a mapping, on top of its defaults.

    Args:
        cls: A frozen dataclass.
        source: A path, a preset's name, a mapping, or None for the defaults.
        overrides: Dotted keys and their values, on top of ``source``.

    Raises:
        ConfigError: The source cannot be read, a key is not known or a value not accepted.
    """
    if source is None or isinstance(source, Mapping):
        content, where = dict(source or {}), "configuration"
    else:
        path = find_config(source)
        content, where = read_yaml(path), str(path)
    base = from_mapping(cls, content, where)
    if not overrides:
        return base
    nested: dict[str, Any] = {}
    for key, value in overrides.items():
        *parents, last = key.split(".")
        level = nested
        for parent in parents:
            level = level.setdefault(parent, {})
        level[last] = value
    return from_mapping(cls, nested, "overrides", base=base)


def from_mapping(
    cls: type[T], mapping: Mapping[str, Any], where: str, *, base: T | None = None
) -> T:
    """Decode a mapping, nested like its fields, into a ``cls``.

    Args:
        cls: A dataclass.
        mapping: Names of fields and their values, as read from YAML.
        where: Origin of the values for messages, such as a file name.
        base: Values of fields that ``mapping`` omits; None: the defaults of ``cls``.

    Raises:
        ConfigError: A key is not known, is missing, or its value is not accepted.
    """
    result: T = _Decoder(cls, where).dataclass(cls, mapping, "", base)
    return result


def field_values(cls: type[Any], mapping: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Decode the fields of ``cls`` in ``mapping``; others may be missing."""
    return _Decoder(cls, where).fields(cls, mapping, "", None)


def to_plain(value: Any) -> Any:
    """Convert ``value`` to dicts, lists, numbers and text, for YAML and JSON."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            f.name: to_plain(getattr(value, f.name)) for f in dataclasses.fields(value) if f.init
        }
    if isinstance(value, Mapping):
        return {key: to_plain(item) for key, item in value.items()}
    if isinstance(value, (tuple, list)):
        return [to_plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


def to_yaml(config: Any) -> str:
    """Return ``config`` as YAML in the order of its fields."""
    # Escapes instead of letters beyond ASCII: PyYAML loses some of them (U+0085) otherwise.
    return str(yaml.safe_dump(to_plain(config), sort_keys=False, width=100))


def read_yaml(path: Path) -> dict[str, Any]:
    """Read the mapping in ``path``; an empty file gives an empty one.

    Raises:
        ConfigError: It cannot be read, is not YAML, has a duplicate key, or is not a mapping.
    """
    content = load_yaml(path, error=ConfigError)
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise ConfigError(
            f"{path}: holds {_quoted(content)}; it must map names of fields to values"
        )
    return content


def preset_folder() -> Path:
    """Folder of the presets: in the package if installed from a wheel, else in the checkout."""
    package = Path(__file__).resolve().parent
    installed = package / "_configs"
    return installed if installed.is_dir() else package.parents[1] / "configs"


def preset_names() -> list[str]:
    """Return the names of the presets, sorted."""
    return sorted(path.stem for path in preset_folder().glob("*.yaml"))


def preset_path(name: str) -> Path:
    """Return the path of the preset ``name``.

    Raises:
        ConfigError: It does not exist; the message lists the nearest.
    """
    known = preset_names()
    if name not in known:
        raise ConfigError(f"{name}: neither a file nor a preset{nearest(name, known)}")
    return preset_folder() / f"{name}.yaml"


def find_config(source: Path | str) -> Path:
    """Return the file ``source``, or the preset of that name.

    Raises:
        ConfigError: It is neither.
    """
    path = Path(source)
    if path.is_file():
        return path
    if path.suffix or len(path.parts) != 1:
        known = ", ".join(preset_names())
        raise ConfigError(f"{path}: no such file; give a YAML file or a preset ({known})")
    return preset_path(str(source))


def known_keys(cls: type[Any], prefix: str = "") -> Iterator[str]:
    """Yield the dotted names of all fields of ``cls``, those of nested dataclasses included."""
    for name, hint in _hints(cls).items():
        yield prefix + name
        for option in options_of(hint):
            if dataclasses.is_dataclass(option) and isinstance(option, type):
                yield from known_keys(option, f"{prefix}{name}.")


def check_bounds(section: str, config: Any, low: float, high: float, *names: str) -> None:
    """Check that the numbers in fields ``names`` of ``config`` are finite, ``low`` to ``high``.

    Args:
        section: Key of ``config``, for the message.
        config: A dataclass; its fields are numbers or tuples of numbers.
        low: Lower bound; minus infinity: none.
        high: Upper bound; infinity: none.
        names: Names of fields.

    Raises:
        ConfigError: A number is out of bounds or infinite.
    """
    accepted = "finite" if low == -math.inf else f"finite and at least {low:g}"
    accepted = accepted if high == math.inf else f"in [{low:g}, {high:g}]"
    _check(section, config, names, lambda v: low <= v <= high and math.isfinite(v), accepted)


def check_above_0(section: str, config: Any, *names: str) -> None:
    """Check that the numbers in fields ``names`` of ``config`` are finite and above 0.

    Raises:
        ConfigError: A number is not.
    """
    _check(section, config, names, lambda v: 0.0 < v < math.inf, "above 0")


def _check(
    section: str,
    config: Any,
    names: tuple[str, ...],
    accepts: Callable[[float], bool],
    accepted: str,
) -> None:
    for name in names:
        value = getattr(config, name)
        if not all(accepts(v) for v in (value if isinstance(value, tuple) else (value,))):
            raise ConfigError(f"{section}.{name} is {value}; it must be {accepted}")


class _Decoder:
    """Decoder of plain values into one dataclass tree; errors name the key that fails."""

    def __init__(self, root: type[Any], where: str) -> None:
        self.root = root
        self.where = where

    def dataclass(self, cls: type[Any], mapping: Any, key: str, base: Any) -> Any:
        if not isinstance(mapping, Mapping):
            raise self.rejection(key, mapping, f"a mapping of {', '.join(_hints(cls))}")
        values = self.fields(cls, mapping, key, base)
        try:
            if base is not None:
                return dataclasses.replace(base, **values)
            for field in dataclasses.fields(cls):
                if field.init and field.name not in values and not _has_default(field):
                    raise ConfigError(f"key {_dotted(key, field.name)} is missing")
            return cls(**values)
        except ConfigError as error:
            raise ConfigError(f"{self.where}: {error}") from None

    def fields(
        self, cls: type[Any], mapping: Mapping[str, Any], key: str, base: Any
    ) -> dict[str, Any]:
        hints = _hints(cls)
        values = {}
        for name, value in mapping.items():
            dotted = _dotted(key, str(name))
            if name not in hints:
                raise self.unknown(dotted, [_dotted(key, known) for known in hints])
            default = getattr(base, name) if base is not None else _default(cls, name)
            values[name] = self.value(hints[name], value, dotted, default)
        return values

    def value(self, hint: Any, value: Any, key: str, base: Any = None) -> Any:
        origin, args = typing.get_origin(hint), typing.get_args(hint)
        if origin in (Union, types.UnionType):
            return self.union(args, value, key, base)
        if origin is Literal:
            for choice in args:
                if choice == value and type(choice) is type(value):
                    return choice
            choices = ", ".join(map(str, args))
            close = nearest(value, map(str, args)) if isinstance(value, str) else ""
            close = close if "did you mean" in close else ""
            raise self.rejection(key, value, f"one of {choices}{close}")
        if origin is tuple:
            return self.tuple(args, value, key)
        if origin in (dict, Mapping):
            if not isinstance(value, Mapping):
                raise self.rejection(key, value, "a mapping")
            return {
                self.value(args[0], k, key): self.value(args[1], v, _dotted(key, str(k)))
                for k, v in value.items()
            }
        if dataclasses.is_dataclass(hint):
            plain = value if not isinstance(value, hint) else to_plain(value)  # type: ignore[arg-type]
            return self.dataclass(hint, plain, key, base if isinstance(base, hint) else None)  # type: ignore[arg-type]
        return self.scalar(hint, value, key)

    def union(self, args: tuple[Any, ...], value: Any, key: str, base: Any) -> Any:
        if value is None and types.NoneType in args:
            return None
        options = [option for option in args if option is not types.NoneType]
        if type(value) in options:
            return self.value(type(value), value, key, base)
        if len(options) == 1:
            return self.value(options[0], value, key, base)
        for option in options:
            try:
                return self.value(option, value, key, base)
            except ConfigError:
                continue
        raise self.rejection(key, value, " or ".join(_WORDS.get(o, str(o)) for o in options))

    def tuple(self, args: tuple[Any, ...], value: Any, key: str) -> tuple[Any, ...]:
        if not isinstance(value, (list, tuple)):
            raise self.rejection(key, value, "a list")
        if len(args) == 2 and args[1] is Ellipsis:
            args = (args[0],) * len(value)
        if len(args) != len(value):
            raise self.rejection(key, value, f"a list of {len(args)}")
        return tuple(
            self.value(a, v, f"{key}[{i}]")
            for i, (a, v) in enumerate(zip(args, value, strict=True))
        )

    def scalar(self, hint: Any, value: Any, key: str) -> Any:
        if hint not in _WORDS:
            raise TypeError(f"{self.root.__name__}.{key}: a field cannot be of type {hint}")
        if hint is Path and isinstance(value, (str, Path)):
            return Path(value)
        if hint in (bool, str) and isinstance(value, hint):
            return value
        if (
            hint in (int, float)
            and isinstance(value, (int, float, str))
            and not isinstance(value, bool)
        ):
            number = number_of(hint, value)
            if number is not None:
                return number
        raise self.rejection(key, value, _WORDS[hint])

    def rejection(self, key: str, value: Any, accepted: str) -> ConfigError:
        return ConfigError(
            f"{self.where}: {key or 'content'} is {_quoted(value)}; it must be {accepted}"
        )

    def unknown(self, key: str, siblings: list[str]) -> ConfigError:
        hint = nearest(key, siblings)
        last = key.rsplit(".", 1)[-1]
        elsewhere = [known for known in known_keys(self.root) if known.rsplit(".", 1)[-1] == last]
        if "did you mean" not in hint and elsewhere:
            hint = f"; did you mean {elsewhere[0]}?"
        return ConfigError(f"{self.where}: unknown key {shorten(key)}{hint}")


def number_of(hint: type[Any], value: float | str) -> float | int | None:
    """Convert ``value`` to a number, or None; YAML 1.1 reads ``1e-3`` as text."""
    if hint is int and isinstance(value, int):
        return value
    if hint is int and isinstance(value, str):
        with contextlib.suppress(ValueError):  # not by a float, which loses digits
            return int(value)
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    if math.isnan(number):
        return None
    if hint is int:
        return int(number) if number.is_integer() else None
    return number


def _hints(cls: type[Any]) -> dict[str, Any]:
    hints = typing.get_type_hints(cls)
    return {field.name: hints[field.name] for field in dataclasses.fields(cls) if field.init}


def options_of(hint: Any) -> tuple[Any, ...]:
    """Return the types of a union, or the type itself."""
    return typing.get_args(hint) if typing.get_origin(hint) in (Union, types.UnionType) else (hint,)


def _has_default(field: dataclasses.Field[Any]) -> bool:
    missing = dataclasses.MISSING
    return field.default is not missing or field.default_factory is not missing


def _default(cls: type[Any], name: str) -> Any:
    field = next(f for f in dataclasses.fields(cls) if f.name == name)
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return None if field.default is dataclasses.MISSING else field.default


def _dotted(prefix: str, name: str) -> str:
    return f"{prefix}.{name}" if prefix else name


def _quoted(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
