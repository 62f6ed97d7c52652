"""Object from an English text, offline.

::

    text ─► parse ─► Description ─► builder of its class ─► ObjectProposal
"""

from __future__ import annotations

import difflib
import re

from articulate.errors import ConfigError, UsageError, quote
from articulate.library.procedural.urdf import Part
from articulate.reconstruct.actors.protocol import TraceStep
from articulate.reconstruct.proposal import ObjectProposal, Source
from articulate.reconstruct.text.description import Description, SeenSize, with_article
from articulate.reconstruct.text.furniture import (
    Built,
    build_double_oven,
    build_fridge,
    build_furniture,
    build_table,
)
from articulate.reconstruct.text.household import SYNONYMS, Household, build_household, kind_of
from articulate.reconstruct.text.parse import parse
from articulate.reconstruct.text.reader import normalise
from articulate.reconstruct.text.vocabulary import (
    CLASSES,
    COLOURS,
    FILLER,
    MATERIALS,
    NEAREST,
    NO_EFFECT,
    SIZE_WORDS,
    word_set,
)
from articulate.reconstruct.text.volume import OUTER_VOLUME

FOREIGN = word_set(
    """
    der die das ein eine einen einem einer mit und zwei drei vier ohne auf unter links rechts
    ist un une le la les des du avec deux trois quatre sans et sur sous pour dans gauche
    droite el los las una unos con dos tres cuatro sin y en del puertas cajones armario il lo
    gli di due tre quattro senza e su per porte cassetti um uma com dois duas sem e o os een
    het met twee drie zonder van op en ett med tva och utan
    """
)
"""Frequent words of other languages."""
EXAMPLES = "a cabinet, a fridge, an oven, a desk, a door, a box, a trash can, a laptop"
MOVING = frozenset({"drawer", "door", "flap"})
CONFIDENT, ASSUMED, DOUBTFUL = 0.97, 0.9, 0.5
"""Confidence with the structure in the text, with usual parts, and with doubts."""


def propose(text: str, seen: SeenSize | None = None) -> ObjectProposal:
    """Return the object that an English text describes.

    Args:
        text: English text.
        seen: Size in an image or video, which replaces usual sizes.

    Raises:
        ConfigError: No object is named, the library has no such object, counts contradict each
            other, or a size is not possible.
    """
    _check_language(text)
    description = parse(text)
    description.seen = seen
    _check_object(description)
    if description.volume_m3 is not None and description.category not in OUTER_VOLUME:
        noun = with_article(description.noun)
        description.assumptions.append(f"volume of {description.volume_text}: no effect on {noun}")
    built: Built | Household
    if description.category == "furniture":
        built = build_furniture(description)
    elif description.category == "table_with_drawers":
        built = build_table(description)
    elif description.category == "fridge":
        built = build_fridge(description)
    elif description.category == "oven" and (
        "times_2" in description.options or description.count("door") == 2
    ):
        built = build_double_oven(description)
    else:
        built = build_household(description)
    unknown = list(dict.fromkeys(description.unknown))
    doubts = [*description.doubts, *built.doubts]
    if unknown:
        doubts.insert(0, f"not understood: {', '.join(unknown)}")
    moving = [part for part in built.parts if part.motion is not None]
    if not moving:
        raise ConfigError(
            f"{quote(text)}: no part of the {description.noun} moves; describe one with a door, "
            "drawer or lid"
        )
    evidence = _evidence(built, description)
    assumptions = (*description.assumptions, *built.assumptions)
    confidence = CONFIDENT if "text" in evidence.values() else ASSUMED
    return ObjectProposal(
        name=built.name,
        category=built.category,
        parts=tuple(built.parts),
        confidence=DOUBTFUL if doubts else confidence,
        evidence=evidence,
        assumptions=assumptions,
        doubts=tuple(doubts),
        trace=_trace(description, built),
    )


def _evidence(built: Built | Household, description: Description) -> dict[str, Source]:
    """Return the origin of each joint."""
    same = SYNONYMS.get(description.category, {})
    named = {same.get(group.kind, group.kind) for group in description.groups}
    if "freezer" in named:
        named |= {"door", "drawer"}
    if "handle" in named and description.category == "faucet":
        named |= {"lever"}
    out: dict[str, Source] = {}
    for part in built.parts:
        if part.motion is None:
            continue
        kind = part_kind(description.category, part)
        kinds = {kind, "door"} if kind == "flap" else {kind}
        itself = description.category in {"door", "sliding_window"} and kind in {"door", "window"}
        out[part.name] = "text" if kinds & named or itself else "category"
    return out


def part_kind(category: str, part: Part) -> str:
    """Return the kind of a moving part, by the name of its link."""
    return kind_of(category, part.name)


def _check_language(text: str) -> None:
    """Reject text in other languages.

    Raises:
        ConfigError: The text is not English.
    """
    words = re.findall(r"[^\W\d_]+", normalise(text))
    latin = [word for word in words if word.isascii()]
    foreign = [word for word in words if word in FOREIGN]
    known = [word for word in words if _is_known(word)]
    other = len(latin) * 2 < len(words) or (
        foreign and len(known) * 2 <= len(words) and (len(foreign) >= 2 or not known)
    )
    if other:
        raise ConfigError(
            f"{quote(text)}: not an English text; other languages need a model: describe the "
            "object in English, or use --actor vlm with --parts or --library"
        )


def _is_known(word: str) -> bool:
    sets = (FILLER, NO_EFFECT, COLOURS, MATERIALS, SIZE_WORDS)
    if any(word in one for one in sets):
        return True
    try:
        return bool(parse(word).category or parse(word).groups)
    except UsageError:
        return True


def _check_object(description: Description) -> None:
    """Check that the text names an object of the library.

    Raises:
        ConfigError: It does not.
    """
    kinds = {group.kind for group in description.groups}
    if description.category == "furniture" and "lid" in kinds and not kinds & MOVING:
        description.category = "box_with_lid"
    if description.category:
        return
    unknown = [word for word in description.unknown if word.isalpha()]
    if not unknown and kinds & MOVING:
        description.category, description.noun = "furniture", "cabinet"
        description.doubts.append("the text names no object; a cabinet is assumed")
        return
    for word in description.unknown:
        for form in (word, word.removesuffix("s")):
            if form in NEAREST:
                raise ConfigError(
                    f"{quote(description.text)}: the library has no {form}; the nearest object "
                    f"is {with_article(NEAREST[form])}"
                )
    nouns = [re.sub(r"\(\?:([^|)]*)[^)]*\)\??|.\?", r"\1", n) for c in CLASSES for n in c.nouns]
    if unknown:
        close = [difflib.get_close_matches(word, nouns, n=1, cutoff=0.8) for word in unknown]
        hint = next((f"; did you mean {found[0]}?" for found in close if found), "")
        names = ", ".join(dict.fromkeys(unknown))
        raise ConfigError(
            f"{quote(description.text)}: names no object of the library ({quote(names)}){hint}; "
            f"name one, for example {EXAMPLES}"
        )
    raise ConfigError(
        f"{quote(description.text)}: names no object; name one, for example {EXAMPLES}"
    )


def _trace(description: Description, built: Built | Household) -> tuple[TraceStep, ...]:
    """Return the content of the text as a table."""
    rows: dict[str, str] = {"object": f"{description.noun} ({built.category})"}
    for number, group in enumerate(description.groups):
        count = "several" if group.count is None else str(group.count)
        more = {
            "position": group.position,
            "arrangement": group.stack,
            "rows": group.rows,
            "columns": group.columns,
            "hinged": group.hinge,
            "material": group.material,
        }
        words = ", ".join(f"{key} {value}" for key, value in more.items() if value)
        rows[f"part {number + 1}"] = f"{count} {group.kind}{f' ({words})' if words else ''}"
    for relation in description.relations:
        first, second = (description.groups[k].kind for k in (relation.first, relation.second))
        link = {"left": "left of"}.get(relation.link, relation.link)
        rows[f"relation {len(rows)}"] = f"{first} {link} {second}"
    for dimension, value in description.sizes_m.items():
        rows[f"size {dimension}"] = f"{value:g} m"
    extra = {
        "without": ", ".join(sorted(description.absent)),
        "material": description.material,
        "handles": " ".join(filter(None, (description.handle_material, description.handles))),
        "hinged": description.hinge,
        "variants": ", ".join(sorted(description.options)),
        "without effect": ", ".join(description.ignored),
        "not understood": ", ".join(description.unknown),
    }
    rows |= {key: value for key, value in extra.items() if value}
    table = "\n".join(f"{key:16}{value}" for key, value in rows.items())
    return (TraceStep(title="Content of the text", text=f"{table}\n"),)
