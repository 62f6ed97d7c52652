"""Dimensions of an object: fields with the range from which each is sampled."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from articulate.errors import ConfigError, nearest
from articulate.library.procedural.urdf import Part

DIGITS = 3
"""Decimals of sampled lengths: millimetres."""


def between(low: float, high: float, accepted: tuple[float, float] | None = None) -> Any:
    """Describe a number, sampled from ``low`` to ``high``; given values lie in ``accepted``."""
    limits = accepted or (low, high)
    return dataclasses.field(metadata={"between": (low, high), "accepted": limits})


def integer(low: int, high: int, accepted: tuple[int, int] | None = None) -> Any:
    """Describe an integer, sampled from ``low`` to ``high``; given ones lie in ``accepted``."""
    limits = accepted or (low, high)
    return dataclasses.field(metadata={"integers": (low, high), "accepted": limits})


def one_of(*choices: str) -> Any:  # as above
    """One of ``choices``, all equally likely."""
    return dataclasses.field(metadata={"choices": choices})


@dataclass(frozen=True, kw_only=True)
class Dimensions(ABC):
    """Every dimension of one object, all within their ranges.

    A category is a subclass whose fields are made by :func:`between`, :func:`integer` and
    :func:`one_of`.
    """

    category: ClassVar[str]
    """PartNet-Mobility's name of the category."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            _check(type(self).__name__, field, getattr(self, field.name))

    @classmethod
    def sample(cls, seed: int) -> Self:
        """Sample dimensions with ``seed``.

        Seed 0 gives the middle of every range and the first of all choices.

        Raises:
            ConfigError: ``seed`` is below 0.
        """
        if seed < 0:
            raise ConfigError(f"{cls.__name__}: seed is {seed}; it must be at least 0")
        fields = dataclasses.fields(cls)
        shares = np.random.default_rng(seed).random(len(fields))
        return cls(
            **{
                field.name: _sampled(field, float(share) if seed else None)
                for field, share in zip(fields, shares, strict=True)
            }
        )

    @abstractmethod
    def parts(self) -> list[Part]:
        """Return the links, parents before children; z up, the front towards -x, floor at z = 0."""


def _sampled(field: dataclasses.Field[Any], share: float | None) -> float | int | str:
    """Return the value at the fraction ``share`` of the range of a field; None: that of seed 0."""
    about = field.metadata
    if "choices" in about:
        choices: tuple[str, ...] = about["choices"]
        return choices[0 if share is None else int(share * len(choices))]
    share = 0.5 if share is None else share
    if "integers" in about:
        low, high = about["integers"]
        return int(low + int(share * (high - low + 1)))
    low, high = about["between"]
    return round(float(low + share * (high - low)), DIGITS)


def _check(name: str, field: dataclasses.Field[Any], value: Any) -> None:
    about = field.metadata
    if "choices" in about:
        if value not in about["choices"]:
            known = nearest(str(value), about["choices"])
            raise ConfigError(f"{name}.{field.name} is {value!r}{known}")
        return
    low, high = about["accepted"]
    if not low <= value <= high:
        raise ConfigError(f"{name}.{field.name} is {value}; it must be in [{low}, {high}]")
