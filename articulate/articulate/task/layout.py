"""Layouts: name, unit and frame of each number of an observation or an action."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

from articulate.errors import ConfigError, field_error, nearest
from articulate.transforms import Array


@dataclass(frozen=True, kw_only=True)
class Field:
    """One named piece of a vector."""

    name: str
    """Name, unique in the layout."""
    size: int
    """Number of values."""
    unit: str
    """Unit of the values in the vector; ``"1"`` for none."""
    frame: str
    """Frame of the values; ``"-"`` for none."""
    source: Literal["robot", "estimator", "controller", "clock", "policy", "expert"]
    """Origin of the values."""
    low: float = -10.0
    """Lower bound; values are clipped."""
    high: float = 10.0
    """Upper bound; values are clipped."""


@dataclass(frozen=True)
class Layout:
    """The named fields of a vector, in order."""

    fields: tuple[Field, ...]

    def __post_init__(self) -> None:
        names = [f.name for f in self.fields]
        if len(set(names)) != len(names):
            raise ConfigError(f"duplicate field in layout: {', '.join(names)}")

    @property
    def size(self) -> int:
        """Length of the vector."""
        return sum(f.size for f in self.fields)

    def slice(self, name: str) -> slice:
        """Return the slice of field ``name``; ConfigError if it is unknown."""
        start = 0
        for field in self.fields:
            if field.name == name:
                return slice(start, start + field.size)
            start += field.size
        raise ConfigError(f"no field {name!r}{nearest(name, [f.name for f in self.fields])}")

    @property
    def low(self) -> Array:
        """Lower bounds (size,)."""
        return np.repeat([f.low for f in self.fields], [f.size for f in self.fields])

    @property
    def high(self) -> Array:
        """Upper bounds (size,)."""
        return np.repeat([f.high for f in self.fields], [f.size for f in self.fields])

    def pack(self, values: dict[str, Array]) -> Array:
        """Return clipped vectors (N, size) from one array (N, size of field) or (N,) per field.

        Raises:
            ConfigError: A field is missing or has another size.
        """
        columns = []
        for field in self.fields:
            if field.name not in values:
                raise ConfigError(f"no value for {field.name}")
            value = np.asarray(values[field.name], dtype=np.float64)
            value = value[:, None] if value.ndim == 1 else value
            if value.shape[1] != field.size:
                raise ConfigError(f"{field.name} has {value.shape[1]} numbers, not {field.size}")
            columns.append(value)
        out = np.concatenate(columns, axis=1)
        low, high = self._bounds
        return np.clip(out, low, high, out=out)

    @cached_property
    def _bounds(self) -> tuple[Array, Array]:
        return self.low, self.high

    def as_list(self) -> list[dict[str, Any]]:
        """Return one dictionary per field, with its slice, for a manifest."""
        out = []
        for field in self.fields:
            place = self.slice(field.name)
            out.append({**asdict(field), "slice": [place.start, place.stop]})
        return out


def layout_from_list(items: list[dict[str, Any]]) -> Layout:
    """Return the layout that :meth:`Layout.as_list` wrote; ConfigError if it is inconsistent."""
    try:
        fields = tuple(Field(**{k: v for k, v in item.items() if k != "slice"}) for item in items)
    except TypeError as error:
        raise ConfigError(f"layout: {field_error(error)}; export the bundle again") from None
    layout = Layout(fields)
    for item in items:
        where = layout.slice(item["name"])
        if [where.start, where.stop] != list(item.get("slice", [])):
            raise ConfigError(f"layout: slice of {item['name']} does not fit its size")
    return layout
