"""Replacement of phrases by symbols, so that the parser reads one word at a time.

Symbols start with ``@``: ``@rel_above``, ``@pos_left``, ``@hinge_top``, ``@row``, ``@grid_3_2``.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from articulate.reconstruct.text.vocabulary import CLASSES, ObjectClass, word_set

WEAK = word_set(
    """
    drawer pedestal, office pedestal, pedestal, door, window, freezer, hob, unit, range, mixer,
    tap, bin, box, switch, pan, pot,
    safe, console, toilet bowl, door leaf, door with frame, door and frame, wall plate, trunk,
    vault
    """
)
"""Nouns that often name a part; they name the object only where no other noun does."""
SIDES = {
    "left": "left",
    "lefthand": "left",
    "right": "right",
    "righthand": "right",
    "top": "top",
    "upper": "top",
    "bottom": "bottom",
    "lower": "bottom",
    "up": "top",
    "upward": "top",
    "upwards": "top",
    "down": "bottom",
    "downward": "bottom",
    "downwards": "bottom",
    "leftward": "left",
    "leftwards": "left",
    "rightward": "right",
    "rightwards": "right",
}
SIDE = r"(left|right|top|bottom|upper|lower)(?:[ -]?hand)?"
THE = r"(?:(?:its|the|their|a|one)\s+)*"
AT = r"(?:(?:on|at|to|along|by|from|in|towards?)\s+)?"
OPENS = (
    r"(?:opens?|opened|opening|swings?|swinging|folds?|folding|flips?|flipping|lifts?|lifting|"
    r"drops?|dropping|tilts?|tilting|pulls?|pulled|turns?|turning|hinges?|hinging|falls?|falling|"
    r"moves?|raises?|lowers?)"
)
OTHER = r"(?:each other|one another|1 another)"


def _hinge(match: re.Match[str]) -> str:
    return f" @hinge_{SIDES[match[1].replace(' ', '').replace('-', '')]} "


def _position(match: re.Match[str]) -> str:
    word = match[1]
    side = {"center": "middle", "centre": "middle", "base": "bottom", "foot": "bottom"}
    row = " @row " if match[2] == "row" else " "
    return f" @pos_{side.get(word, SIDES.get(word, word))}{row}"


def _grid(match: re.Match[str]) -> str:
    return f" @grid_{match[1]}_{match[2]} "


def _grid_turned(match: re.Match[str]) -> str:
    return f" @grid_{match[2]}_{match[1]} "


def _repeated_noun(match: re.Match[str]) -> str:
    """Replace ``ones`` by the noun before it."""
    noun = match[1]
    plural = noun if noun.endswith("s") else "shelves" if noun == "shelf" else f"{noun}s"
    return f"{noun}{match[2]}{plural}"


ROWS = r"(?:horizontal )?(?:rows?|tiers?|levels?)"
COLUMNS = r"(?:vertical )?(?:columns?|stacks?|towers?|banks?)"
Symbol = str | Callable[[re.Match[str]], str]
IDIOMS: tuple[tuple[str, Symbol], ...] = (
    (
        r"\b(doors?|drawers?|flaps?|shelf|shelves)\b((?:(?!\b(?:doors?|drawers?|flaps?|shel)).)*?"
        r"\b(?:above|over|on top of|below|under(?:neath)?|beneath|beside|next to) \d+ (?:\w+ )?)"
        r"ones\b",
        _repeated_noun,
    ),
    (r"\bno (?:more|less|wider|higher|taller|deeper) than\b", " "),
    (r"\bhandle ?less\b", " @no handles "),
    (r"\b(?:instead of|rather than|in place of) (?:a |the )?(?:bars?|knobs?|handles?)\b", " "),
    (
        r"\b(?:do(?:es)? not (?:have|include|contain|come with)|ha(?:s|ve) no|with no|without|"
        r"no|none|neither|nor|lacking|lacks|free of|minus|zero|0)(?: any| an?)?\b",
        " @no ",
    ),
    (
        r"\b(?:of |with |in )?(?:the |an? )?(?:same|equal|identical|similar) "
        r"(?:height|width|size|depth|dimension)s?\b|\b(?:the )?same size\b",
        " ",
    ),
    (r"(?<!\S)-\s?(\d+)", lambda m: f" @unknown_-{m[1]} "),
    (r"\btop load(?:ing|er|ed)?\b", " @unknown_top_loading "),
    (r"\bfront load(?:ing|er|ed)?\b", " "),
    (
        r"\b2 pedestals?,? (?:of|with|each with) (\d+) drawers?(?: each)?",
        lambda m: f" {2 * int(m[1])} drawers @pos_ends @opt_pedestal ",
    ),
    # grids
    (
        r"\b(\d+) (rows?|columns?)(?: of \w+)?,? (?:(?:and|with|each with|having|containing) )?"
        r"(\d+) (\w+) (?:per|in each|in every|on each|for each) (?:row|column)\b",
        r" \1 \2 of \3 \4 ",
    ),
    (
        r"\b(left|right|upper|lower|top|bottom|central|middle) (?:column|stack|bank|row|group) of "
        r"(?=\d)",
        r" \1 ",
    ),
    (rf"\b(\d+) {ROWS},? (?:(?:and|by|x|with|times) )?(\d+) {COLUMNS}\b", _grid),
    (rf"\b(\d+) {COLUMNS},? (?:(?:and|by|x|with|times) )?(\d+) {ROWS}\b", _grid_turned),
    (rf"\b(\d+) {ROWS} (?:of|with|containing|having|each of) (\d+)\b", _grid),
    (rf"\b(\d+) {COLUMNS} (?:of|with|containing|having|each of) (\d+)\b", _grid_turned),
    (r"\b(\d+) (?:x|by|times) (\d+)(?: (?:grid|matrix|array|arrangement|block|layout))?\b", _grid),
    (rf"\b(?:1|a|single|1 single|a single) {ROWS}\b", " @row "),
    (rf"\b(?:1|a|single|1 single|a single) {COLUMNS}\b", " @column "),
    (rf"\b(\d+) {ROWS}\b", lambda m: f" @rows_{m[1]} "),
    (rf"\b(\d+) {COLUMNS}\b", lambda m: f" @columns_{m[1]} "),
    # arrangement inside a group
    (
        r"\b(?:stacked |placed |arranged |set )?(?:1|one|an?) (?:directly )?(?:above|over|"
        r"on top of|atop|below|under|beneath|underneath) (?:the other|another|the next)\b",
        " @column ",
    ),
    (rf"\b(?:stacked )?(?:on top of|above|below|under|over|beneath) {OTHER}\b", " @column "),
    (r"\b(?:stacked vertically|vertically stacked|stacked|vertically)\b", " @column "),
    (
        rf"\b(?:side by side|(?:right )?next to {OTHER}|beside {OTHER}|alongside {OTHER}|"
        rf"adjacent to {OTHER}|(?:1|one) (?:beside|next to) the other|abreast|horizontally)\b",
        " @row ",
    ),
    # hinges
    (r"\b(?:fold|drop|fall|flip|pull) ?(?:down )?front\b", " flap "),
    (
        rf"\b(?:hing(?:ed|es?)|pivot(?:s|ed)?|hung)\s+(?:(?:is|are|being|located|placed|set)\s+)?"
        rf"{AT}{THE}{SIDE}(?:\s+(?:side|edge|end))?\b",
        _hinge,
    ),
    (
        rf"\b(?:hing(?:ed|es?)|pivot(?:s|ed)?)\s+(?:(?:is|are)\s+)?{AT}{THE}(?:back|rear)"
        r"(?:\s+(?:side|edge|end))?\b",
        " ",
    ),
    (rf"\b{SIDE}[ -](?:side )?(?:hing(?:ed|es?)|hung)\b", _hinge),
    (
        rf"\b(?:handles?|knobs?|grips?) (?:is |are )?(?:on|at|to) (?:the |its )?{SIDE}"
        r"(?: side| edge)?\b",
        lambda m: f" @handle_{SIDES[m[1]]} ",
    ),
    (
        rf"\b{OPENS}(?: open)?(?: out(?:wards?)?)?\s+(?:to(?:wards?)?\s+)?(?:the |its )?"
        r"(left|right|up(?:wards?)?|down(?:wards?)?|leftwards?|rightwards?|top|bottom)"
        r"(?: side)?\b",
        _hinge,
    ),
    (r"\b(?:open(?:s|ing) sideways|side opening|swing(?:s|ing) sideways)\b", " @hinge_left "),
    (r"\b(?:top hung|up ?wards? opening)\b", " @hinge_top "),
    (r"\b(?:bottom hung|down ?wards? opening)\b", " @hinge_bottom "),
    (r"\b(?:open(?:s|ing)?|swing(?:s|ing)?) (?:outwards?|to the front|forwards?)\b", " "),
    (
        rf"\b(?:the|its)\s+{SIDE}(?:most)? (?:1|one)\b",
        lambda m: f" @member_{SIDES[m[1]]} ",
    ),
    (r"\b(?:the|its)\s+(?:middle|central|cent(?:er|re)) (?:1|one)\b", " @member_middle "),
    (
        r"\b(?:(?:in|on|at) )?(?:the |its |whose )?(upper|lower|top|bottom|left|right)"
        r"(?:[ -]hand)? (half|part|section|side|portion|column|row|end)\s*(?:has|have|with|"
        r"contains?|holds?|containing|is|:|(?=\d))",
        lambda m: f" ; @pos_{SIDES[m[1]]} " + ("@row " if m[2] == "row" else ""),
    ),
    # relations and positions
    (rf"\b{AT}{THE}left(?:[ -]hand)?(?: side)? of\b", " @rel_left "),
    (rf"\b{AT}{THE}right(?:[ -]hand)?(?: side)? of\b", " @rel_right "),
    (
        rf"\b(?:under(?:neath)?|below|beneath)\s+{THE}(left|right)(?:[ -]hand)?"
        r" (side|half|part|end|edge|third|portion)\b",
        _position,
    ),
    (r"\b(?:on|at) (?:the )?top of\b|\b(?:above|over|atop)\b", " @rel_above "),
    (r"\b(?:at the bottom of|under(?:neath)?|below|beneath)\b", " @rel_below "),
    (r"\b(?:topped|surmounted|crowned) (?:by|with)\b", " @rel_below "),
    (r"\b(?:beside|next to|alongside|adjacent to|adjoining)\b", " @rel_beside "),
    (r"\b(?:flanked|framed|enclosed) (?:by|with)\b", " @rel_flanked "),
    (r"\bflanking\b", " @rel_flanking "),
    (r"\b(?:in between|in the (?:very )?(?:middle|cent(?:er|re)))\b", " @pos_middle "),
    (r"\bbetween (?:them|both|the 2|those|these)\b", " @pos_middle "),
    (r"\bbetween\b", " @rel_between "),
    (
        r"\b(?:on|at|to) (each|either) (?:side|end)(?: of (?:it|them))?\b",
        " @pos_each ",
    ),
    (
        r"\b(?:on|at|to) (?:both|the 2|2|the) (?:sides|ends)(?: of (?:it|them))?\b"
        r"|\b(?:on the )?left and right\b",
        " @pos_ends ",
    ),
    (
        rf"\b(?:on|at|to|in|along|near|across)\s+{THE}(?:very |far |extreme )?"
        r"(left|right|top|bottom|middle|center|centre|base|foot|upper|lower)(?:[ -]hand)?"
        r"(?: (side|half|part|section|end|edge|third|column|row|portion|area))?(?! of)\b",
        _position,
    ),
    # variants
    (r"\bflip(?: top| up)? (?:caps?|lids?|tops?)\b|\bflip top\b", " cap @opt_flip "),
    (r"\b(?:screw|twist|screw on|twist off|threaded) (?:caps?|tops?|lids?)\b", " cap @opt_twist "),
    (r"\b(?:deep|rimmed) lids?\b|\blid (?:is|that is) deep\b", " lid @opt_deep "),
    (r"\bflat lids?\b|\blid is flat\b", " lid @opt_flat "),
    (r"\bhot and cold (?:water )?(?:handles?|taps?|knobs?|levers?)\b", " 2 handles "),
    (r"\b(?:drawer |office )?pedestals?\b", " pedestal @opt_pedestal "),
    (r"\bfrench doors?\b", " 2 doors @row "),
    (
        r"\b(?:double|twin|dual|triple) (?:wall(?:ed)?|glaz(?:ed|ing)|insulated|sided|layer(?:ed)?|"
        r"skin(?:ned)?|lined|paned?|action|sealed|locking)\b",
        " ",
    ),
    (r"\b(?:double|twin|dual)\b", " @mult_2 "),
    (r"\btriple\b", " @mult_3 "),
    (r"\b(?:quadruple|quad)\b", " @mult_4 "),
    (r"\bsliding (?=drawers?)", " "),
    (r"\bsliding (?=(?:[a-z]+ )?doors?\b)", " @slide "),
    (
        r"(?<=doors )(?:that |which |can |to )?(?:slide|are sliding)\b(?: sideways| aside| open)?"
        r"|(?<=door )(?:that |which |can |to )?(?:slides?|is sliding)\b(?: sideways| aside| open)?",
        " @slide ",
    ),
    (r"\b(?:single|a lone|a sole)\b", " 1 "),
)
"""Patterns and their symbols, in the order in which they are applied."""


@dataclass(frozen=True, kw_only=True)
class Noun:
    """The noun of a text that names the object."""

    object_class: ObjectClass
    text: str
    plural: bool


_PATTERNS = [
    (re.compile(rf"(?<![\w@])({noun})(e?s)?(?![\w])"), one) for one in CLASSES for noun in one.nouns
]


def replace_idioms(text: str) -> str:
    """Replace phrases by symbols; the text is in lower case, without hyphens between words."""
    for pattern, symbol in IDIOMS:
        text = re.sub(pattern, symbol, text)
    return text


@dataclass(frozen=True, kw_only=True)
class _Match:
    start: int
    end: int
    noun: str
    plural: bool
    object_class: ObjectClass


def _is_weak(match: _Match) -> bool:
    """Return whether a noun often names a part."""
    return match.noun in WEAK or match.object_class.name in {"door", "sliding_window"}


def replace_nouns(text: str) -> tuple[str, list[Noun]]:
    """Replace nouns of objects by ``@object``, later ones of the same class by ``@again``.

    Returns:
        The text, and the nouns: the object first, then those of other classes.
    """
    matches: list[_Match] = []
    found = [(m, one) for pattern, one in _PATTERNS for m in pattern.finditer(text)]
    for m, one in sorted(found, key=lambda item: (-len(item[0][0]), item[0].start())):
        if all(m.end() <= other.start or m.start() >= other.end for other in matches):
            matches.append(
                _Match(start=m.start(), end=m.end(), noun=m[1], plural=bool(m[2]), object_class=one)
            )
    matches.sort(key=lambda match: match.start)
    strong = [m for m in matches if not _is_weak(m)]
    chosen = strong or matches[:1]
    if not chosen:
        return text, []
    # "a laptop table": the last of adjacent nouns is the object
    head = chosen[0]
    for match in chosen[1:]:
        if not text[head.end : match.start].strip():
            head = match
    nouns = [Noun(object_class=head.object_class, text=head.noun, plural=head.plural)]
    out, at = "", 0
    for match in chosen:
        out += text[at : match.start]
        at = match.end
        if match is head:
            counted = re.search(r"(?:\d|@mult_\d)\s*$", out) is not None
            out += " drawer " if match.noun.startswith("drawer") and counted else " "
            out += " @object "
        elif match.object_class.partnet == head.object_class.partnet:
            out += " @again "
        elif re.match(r"\s+(?:doors?|drawers?|handles?|knobs?|lids?)\b", text[match.end :]):
            out += " "  # "a cupboard door" of a desk
        else:
            nouns.append(
                Noun(object_class=match.object_class, text=match.noun, plural=match.plural)
            )
            out += " @other "
    return out + text[at:], nouns
