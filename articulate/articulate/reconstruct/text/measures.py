"""Numbers, lengths and volumes in a text, in any usual unit and notation."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

UNITS_M = {
    "mm": 0.001,
    "millimetre": 0.001,
    "millimeter": 0.001,
    "cm": 0.01,
    "centimetre": 0.01,
    "centimeter": 0.01,
    "dm": 0.1,
    "decimetre": 0.1,
    "decimeter": 0.1,
    "m": 1.0,
    "metre": 1.0,
    "meter": 1.0,
    "in": 0.0254,
    "inch": 0.0254,
    "inche": 0.0254,
    '"': 0.0254,
    "ft": 0.3048,
    "foot": 0.3048,
    "feet": 0.3048,
    "'": 0.3048,
    "km": 1000.0,
    "kilometre": 1000.0,
    "kilometer": 1000.0,
    "yd": 0.9144,
    "yard": 0.9144,
}
"""Length of a unit [m]."""
UNITS = ("zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
TEENS = (
    *("ten", "eleven", "twelve", "thirteen", "fourteen", "fifteen", "sixteen", "seventeen"),
    *("eighteen", "nineteen"),
)
TENS = ("twenty", "thirty", "forty", "fifty", "sixty", "seventy", "eighty", "ninety")
SMALL = {word: n for n, word in enumerate((*UNITS, *TEENS))}
SMALL |= {word: 10 * n for n, word in enumerate(TENS, start=2)}
NUMBER = r"\d+(?:\.\d+)?"
UNIT = (
    r"(?:millimet(?:er|re)s?|kilomet(?:er|re)s?|centimet(?:er|re)s?|decimet(?:er|re)s?|met(?:er|re)s?|inch(?:es)?|"
    r"mm|cm|dm|km|m|ft|foot|feet|yards?|yd|\"|'|in(?=\s*(?:wide|deep|high|tall|long|x\b|by\b|across|"
    r"broad|thick|in\b|[.,;)]|$)))(?![a-z])\.?"
)
QUANTITY = rf"({NUMBER})\s*({UNIT})?"
LABELS = {
    "w": "width",
    "d": "depth",
    "h": "height",
    "l": "length",
    "width": "width",
    "breadth": "width",
    "length": "length",
    "wide": "width",
    "broad": "width",
    "long": "length",
    "depth": "depth",
    "deep": "depth",
    "thick": "thickness",
    "thickness": "thickness",
    "height": "height",
    "high": "height",
    "tall": "height",
    "diameter": "diameter",
    "across": "diameter",
    "dia": "diameter",
    "radius": "radius",
}
BEFORE = r"(?:w|d|h|l|width|breadth|length|depth|height|diameter|dia|radius|thickness)"
AFTER = (
    r"(?:wide|broad|long|deep|thick|high|tall|across|dia|diameter|width|depth|height|length|"
    r"thickness|w|d|h)"
)
ABOUT = r"(?:(?:of|is|are|about|approximately|approx\.?|around|roughly|circa|ca\.?|at|least|most|"
ABOUT += r"up|to|exactly|no|more|less|than|nearly|almost|some)\s+)*"
SMALLEST_BARE = 10.0
"""Smaller numbers without a unit are counts."""
LITRE_M3, GALLON_M3 = 0.001, 0.003785
"""Volume of a litre and of a US gallon [m^3]."""
PLACE = "@size"
"""Placeholder for a length in the text that is parsed further."""


@dataclass(frozen=True, kw_only=True)
class Measure:
    """One length in a text."""

    dimension: str
    """``width``, ``depth``, ``height``, ``diameter``, ``thickness`` or, without a name, ``any``."""
    value: float
    """Number, in the unit."""
    unit_m: float | None
    """Length of the unit [m]; None: the text gives none."""
    text: str
    """Words of the text."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Text with placeholders, and the lengths in their order."""

    text: str
    measures: tuple[tuple[Measure, ...], ...]
    """Lengths of each placeholder."""


def with_digits(text: str) -> str:
    """Replace numbers in words and fractions by digits: ``one and a half`` gives 1.5."""
    text = re.sub(r"(?<=\d),(?=\d{3}\b)", "", text)
    text = re.sub(r"(?<=\d),(?=\d)", ".", text)
    for sign, value in (("½", ".5"), ("¼", ".25"), ("¾", ".75")):
        text = re.sub(rf"(\d){sign}", rf"\g<1>{value}", text).replace(sign, f"0{value}")
    text = re.sub(
        r"\b(\d+)\s+(\d)/([2-9])\b", lambda m: f"{int(m[1]) + int(m[2]) / int(m[3]):g}", text
    )
    text = re.sub(r"(?<![\d/.])(\d)/([2-9])(?![\d/])", lambda m: f"{int(m[1]) / int(m[2]):g}", text)
    tens, teens = "|".join(TENS), "|".join(TEENS)
    units = "|".join(UNITS[1:])
    text = re.sub(rf"\b({tens})[ -]({units})\b", lambda m: str(SMALL[m[1]] + SMALL[m[2]]), text)
    text = re.sub(rf"\b({tens}|{teens}|{units}|zero)\b", lambda m: str(SMALL[m[1]]), text)
    text = re.sub(r"\b(?:a|1) hundred\b", "100", text)
    text = re.sub(r"\b(\d) hundred\b", lambda m: f"{m[1]}00", text)
    text = re.sub(r"\b(\d)00 and (\d{1,2})\b", lambda m: str(100 * int(m[1]) + int(m[2])), text)
    text = re.sub(r"\b(\d+)\.? and (?:a|1) half\b", r"\1.5", text)
    text = re.sub(
        rf"\b(?:a |1 )?half (?:of )?(?:a |an )?(?={UNIT}|lit(?:re|er)\b|gallon)", "0.5 ", text
    )
    text = re.sub(rf"\b(?:a |1 )?quarter (?:of )?(?:a |an )(?={UNIT})", "0.25 ", text)
    text = re.sub(r"\b(?:a|1) ((?:met(?:er|re)|foot|yard)\b)(?= and (?:a|1) half)", r"1 \1", text)
    text = re.sub(r"\b(\d+) (met(?:er|re)s?|foot|feet) and (?:a|1) half\b", r"\1.5 \2", text)
    text = re.sub(
        r"\ban? (met(?:er|re)|foot|yard)\b(?= (?:wide|broad|deep|high|tall|long|in|x|by|and)\b)",
        r"1 \1",
        text,
    )
    text = re.sub(r"\b(\d) met(?:er|re)s? (\d\d)\b(?! ?[a-z]*m\b)", r"\1.\2 metre", text)
    text = re.sub(r"\bhalf (?:a )?dozen\b", "6", text)
    text = re.sub(r"\b(?:a )?dozen\b", "12", text)
    return re.sub(r"\b(?:a )?(?:couple|pair) (?:of )?", "2 ", text)


def find_volume(text: str) -> tuple[str, float | None]:
    """Return a text without its first volume, and the volume [m^3]; None without one.

    A bare ``l`` is a length where the text has other dimensions by their letters.
    """
    letters = re.search(r"\d\s*[wdh]\b|\b[wdh]\s*\d", text)
    units = "litres?|liters?|gallons?|gal" + ("" if letters else "|l")
    match = re.search(
        rf"(?<![\w@.])({NUMBER})\s*({units})\b(?:\s+(?:of )?(?:capacity|volume))?", text
    )
    if match is None:
        return text, None
    unit_m3 = GALLON_M3 if match[2].startswith("gal") else LITRE_M3
    before = re.sub(r"\b(?:capacity|volume) (?:of )?$", "", text[: match.start()])
    return f"{before} {text[match.end() :]}", float(match[1]) * unit_m3


def find_measures(text: str) -> Measured:
    """Find lengths; the text is in lower case with numbers as digits."""
    text = re.sub(r"(?<=[\d\"'])\s*[×*]\s*(?=\d)", " x ", text)
    text = re.sub(r"\b(\d)\s?m\s?(\d\d)\b", r"\1.\2 m", text)
    text = re.sub(r"(mm|cm|\dm|in|ft|[\d\"'])\s?x\s?(?=\d)", r"\1 x ", text)
    text = re.sub(r"\b([wdhl])(?=\d)", r"\1 ", text)
    text = re.sub(r"(\d)([wdhl])\b", r"\1 \2", text)
    text = re.sub(
        r"(\d+)\s*(?:'|ft\.?|foot|feet)\s*(?:and\s+)?(\d+(?:\.\d+)?)\s*(?:\"|in\b\.?|inch(?:es)?)",
        lambda m: f"{12 * int(m[1]) + float(m[2]):g} inch",
        text,
    )
    text = re.sub(  # "thickness of the walls is 4 cm"
        rf"\bthickness of ((?:[a-z]+ )+?){ABOUT}[:=]?\s*(?={NUMBER}\s*{UNIT})",
        r"\1thickness ",
        text,
    )
    text = re.sub(rf"\b({NUMBER})\s*({UNIT})\s+cube\b", r"\1 x \1 x \1 \2", text)
    found: list[tuple[Measure, ...]] = []

    def keep(measures: list[Measure]) -> str:
        found.append(tuple(measures))
        return f" {PLACE}{len(found) - 1} "

    text = _products(text, keep)
    text = _labelled(text, keep)
    text = re.sub(
        rf"(?<![\w@.]){QUANTITY}(?![\w.])",
        lambda m: keep([_measure("any", m[1], m[2], m[0])]) if m[2] else m[0],
        text,
    )
    order = [int(k) for k in re.findall(rf"{PLACE}(\d+)", text)]
    for new, old in enumerate(order):
        text = text.replace(f"{PLACE}{old} ", f"{PLACE}#{new} ", 1)
    return Measured(text=text.replace("#", ""), measures=tuple(found[k] for k in order))


def _products(text: str, keep: Callable[[list[Measure]], str]) -> str:
    """Find two or three lengths with ``x`` or ``by`` between them."""
    one = rf"(?:(w|d|h|l)\s)?{QUANTITY}(?:\s*\(?(w|d|h|l|wide|deep|high|tall|long)\b\)?)?"
    glue = r"\s*(?:x|by)\s*"
    # "w x d x h: 80 x 40 x 180 cm": letters before the numbers move to them.
    text = re.sub(
        rf"\b([wdhl])\s?x\s?([wdhl])\s?x\s?([wdhl])\s*[:=]?\s*({NUMBER}){glue}({NUMBER}){glue}"
        rf"({NUMBER})",
        r"\1 \4 x \2 \5 x \3 \6",
        text,
    )
    # "80 x 40 x 180 cm (w x d x h)": letters after the numbers move before them.
    text = re.sub(
        rf"({NUMBER}){glue}({NUMBER}){glue}({NUMBER})\s*({UNIT})?\s*\(?\s*"
        r"([wdhl])\s?x\s?([wdhl])\s?x\s?([wdhl])\b\s*\)?",
        lambda m: f"{m[5]} {m[1]} x {m[6]} {m[2]} x {m[7]} {m[3]} {m[4] or ''}",
        text,
    )
    text = re.sub(  # "60 w x 40 d x 80 h cm": so does the unit
        rf"({NUMBER}) ([wdh]){glue}({NUMBER}) ([wdh]){glue}({NUMBER}) ([wdh])\s+({UNIT})",
        r"\2 \1 x \4 \3 x \6 \5 \7",
        text,
    )
    pattern = re.compile(rf"(?<![\w.@]){one}{glue}{one}(?:{glue}{one})?(?![\w.])")

    def replace(m: re.Match[str]) -> str:
        groups = [m.group(4 * k + 1, 4 * k + 2, 4 * k + 3, 4 * k + 4) for k in range(3)]
        groups = [g for g in groups if g[1] is not None]
        units = [g[2] for g in groups]
        values = [float(g[1]) for g in groups]
        if not any(units) and (max(values) < 10 or min(values) < 4):
            return m[0]
        unit = next((u for u in reversed(units) if u), None)
        labels = [g[0] or g[3] or "" for g in groups]
        names = [LABELS.get(label, "") for label in labels]
        if not any(names):
            names = ["first", "second", "third"][: len(groups)]
        rest = [d for d in ("width", "depth", "height") if d not in names]
        names = [name or rest.pop(0) for name in names]
        return keep(
            [_measure(n, g[1], g[2] or unit, m[0]) for n, g in zip(names, groups, strict=True)]
        )

    return pattern.sub(replace, text)


def _labelled(text: str, keep: Callable[[list[Measure]], str]) -> str:
    """Find lengths with the name of a dimension before or after them."""
    after = re.compile(
        rf"(?<![\w.@]){QUANTITY}\s*(?:in |of |its |the )*\(?({AFTER})\b(?!\s*[:=])(?:\))?"
    )
    before = re.compile(rf"\b({BEFORE})\b\s*[:=.]?\s*{ABOUT}{QUANTITY}(?![\w.])")

    def from_after(m: re.Match[str]) -> str:
        if m[2] is None and float(m[1]) < SMALLEST_BARE:  # "one tall door"
            return m[0]
        return keep([_measure(LABELS[m[3]], m[1], m[2], m[0])])

    def from_before(m: re.Match[str]) -> str:
        return keep([_measure(LABELS[m[1]], m[2], m[3], m[0])])

    # "width: 80 cm, depth: 40 cm" and "80 cm wide, 40 cm deep" have numbers on different sides.
    first = before.search(text)
    letters = re.search(rf"\b[wdhl] {NUMBER}", text)
    named = first is not None and after.search(text[: first.end()]) is None
    if letters or named:
        return after.sub(from_after, before.sub(from_before, text))
    return before.sub(from_before, after.sub(from_after, text))


def _measure(dimension: str, number: str, unit: str | None, text: str) -> Measure:
    value = float(number)
    if dimension == "radius":
        dimension, value = "diameter", 2.0 * value
    return Measure(dimension=dimension, value=value, unit_m=unit_length(unit), text=text.strip())


def unit_length(unit: str | None) -> float | None:
    """Return the length of a unit [m]; None without one."""
    if not unit:
        return None
    plain = unit.rstrip(".")
    return UNITS_M.get(plain) or UNITS_M[plain.removesuffix("s")]


def guessed_unit(values: list[float]) -> float:
    """Return the unit of lengths without one, from their magnitude: mm, cm or m [m]."""
    largest = max(values)
    return 0.001 if largest >= 400 else 0.01 if largest >= 5 else 1.0
