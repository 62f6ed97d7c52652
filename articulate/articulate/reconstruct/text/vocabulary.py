"""Vocabulary: objects, parts, materials, positions and words without effect."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class ObjectClass:
    """One kind of object that a text may name."""

    name: str
    """Key of the procedural library, or ``furniture``."""
    partnet: str
    """PartNet-Mobility's name of the category."""
    nouns: tuple[str, ...]
    """Regular expressions of the singular; the first is used in messages."""
    size_m: tuple[float, float, float] = (0.8, 0.45, 0.8)
    """Usual width, depth and height of furniture [m]."""
    parts: Mapping[str, int] = field(default_factory=dict)
    """Usual parts of furniture where the text names none."""
    base: str = "plinth"
    """Base of furniture."""


def word_set(text: str) -> frozenset[str]:
    """Return the words of a text; expressions of several words are separated by commas."""
    parts = text.split(",") if "," in text else text.split()
    return frozenset(" ".join(part.split()) for part in parts)


def _alternatives(pattern: str) -> tuple[str, ...]:
    """Split a pattern at each ``|`` outside of parentheses."""
    return tuple(re.split(r"\|(?![^(]*\))", pattern))


def _furniture(
    nouns: str,
    size_m: tuple[float, float, float],
    parts: dict[str, int],
    base: str = "plinth",
    partnet: str = "StorageFurniture",
) -> ObjectClass:
    return ObjectClass(
        name="furniture",
        partnet=partnet,
        nouns=_alternatives(nouns),
        size_m=size_m,
        parts=parts,
        base=base,
    )


def _object(name: str, partnet: str, nouns: str) -> ObjectClass:
    return ObjectClass(name=name, partnet=partnet, nouns=_alternatives(nouns))


CLASSES: tuple[ObjectClass, ...] = (
    _furniture(
        "cabinet|cabinet unit|cupboard|storage (?:unit|cabinet|cupboard)|storage furniture|"
        "furniture unit|unit|vanity(?: unit)?|base (?:unit|cabinet)|kitchen (?:unit|island)|hutch|"
        "linen press|bar cabinet|bathroom unit|shoe cabinet|vitrine|larder|pantry|"
        "(?:display|china|glass) (?:case|cabinet|cupboard)",
        (0.8, 0.45, 0.8),
        {"door": 2},
    ),
    _furniture("wardrobe|armoire|closet|clothes (?:press|cabinet)", (1.0, 0.6, 1.9), {"door": 2}),
    _furniture(
        "nightstand|night stand|night table|bedside (?:table|cabinet|cupboard|unit|chest)|bedstand",
        (0.45, 0.4, 0.55),
        {"drawer": 1, "open": 1},
        "legs",
    ),
    _furniture(
        "sideboard|credenza|buffet(?: cabinet)?|console(?: cabinet)?|lowboard",
        (1.6, 0.45, 0.8),
        {"door": 2, "drawer": 3},
        "legs",
    ),
    _furniture(
        "tv (?:stand|unit|cabinet|bench|console|board)|television (?:stand|unit|cabinet)|"
        "media (?:unit|cabinet|console|center|centre)|entertainment (?:unit|center|centre)",
        (1.5, 0.4, 0.5),
        {"door": 2, "open": 1},
        "legs",
    ),
    _furniture(
        "chest of drawers|chest|dresser|drawer (?:unit|chest|cabinet|tower|base)|bureau|"
        "tallboy|highboy|lowboy|chiffonier|commode|apothecary (?:chest|cabinet)",
        (0.9, 0.45, 0.9),
        {"drawer": 4},
        "legs",
    ),
    _furniture(
        "(?:vertical |lateral )?(?:filing|file) cabinet|(?:lateral|vertical) file",
        (0.45, 0.6, 1.1),
        {"drawer": 4},
        "plinth",
    ),
    _furniture(
        "pedestal|drawer pedestal|office pedestal|under desk cabinet",
        (0.42, 0.55, 0.6),
        {"drawer": 3},
    ),
    _furniture("tool (?:cabinet|chest)|tool (?:trolley|cart)", (0.7, 0.45, 0.95), {"drawer": 5}),
    _furniture("locker", (0.4, 0.5, 1.8), {"door": 1}),
    _furniture("(?:server|network|computer) (?:rack|cabinet)", (0.6, 0.9, 1.9), {"door": 1}),
    _furniture(
        "bookcase|bookshelf|book cabinet|shelving unit|shelf unit",
        (0.8, 0.3, 1.8),
        {"open": 4, "door": 2},
    ),
    _furniture(
        "wall (?:cabinet|cupboard|unit)|overhead (?:cabinet|cupboard|unit)|hanging cabinet|"
        "upper cabinet|medicine cabinet|mirror cabinet|bathroom cabinet",
        (0.6, 0.35, 0.7),
        {"door": 1},
        "none",
    ),
    _furniture(
        "mail ?box|letter ?box|post ?box|parcel box|key (?:cabinet|box)",
        (0.3, 0.2, 0.4),
        {"door": 1},
        "none",
    ),
    _object(
        "table_with_drawers",
        "Table",
        "table|desk|writing (?:desk|table)|office desk|computer desk|work(?:bench| bench| table)|"
        "dressing table|coffee table|console table|kitchen table|dining table|side table|end table|"
        "hall table|secretary|escritoire",
    ),
    _object(
        "fridge",
        "Refrigerator",
        "fridge|refrigerator|fridge freezer|refrigerator freezer|freezer|minibar",
    ),
    _object("microwave", "Microwave", "microwave oven|microwave"),
    _object(
        "oven",
        "Oven",
        "oven|stove|cooker|range(?: cooker)?|hob|cook ?top with oven|kitchen range|wall oven",
    ),
    _object("dishwasher", "Dishwasher", "dishwasher|dish washer|dish washing machine"),
    _object(
        "washing_machine",
        "WashingMachine",
        "washing machine|washer|clothes washer|laundry (?:machine|washer)|washer dryer",
    ),
    _object("toilet", "Toilet", "toilet|wc|w c|water closet|lavatory|loo|toilet bowl"),
    _object(
        "door",
        "Door",
        "door|room door|interior door|exterior door|front door|entrance door|house door|"
        "bedroom door|bathroom door|office door|door (?:leaf|with frame|and frame)",
    ),
    _object("sliding_window", "Window", "window|sash window|sliding window|slider window"),
    _object(
        "office_chair",
        "Chair",
        "chair|office chair|desk chair|swivel chair|task chair|computer chair|armchair|"
        "rolling chair|executive chair",
    ),
    _object("safe", "Safe", "safe|strong ?box|security box|vault|safe box|wall safe"),
    _object(
        "suitcase",
        "Suitcase",
        "suitcase|trolley case|trolley suitcase|rolling (?:suitcase|case|luggage)|luggage|"
        "travel case|cabin (?:case|bag|trolley)|carry on|trolley bag",
    ),
    _object("laptop", "Laptop", "laptop|notebook|notebook (?:computer|pc)|laptop (?:computer|pc)"),
    _object(
        "trash_can",
        "TrashCan",
        "trash can|trash ?bin|dust ?bin|waste ?bin|waste ?basket|waste paper basket|garbage "
        "(?:can|bin)|rubbish bin|litter bin|pedal bin|bin|step (?:can|bin)|refuse bin|kitchen bin|"
        "ash ?can|(?:laundry )?hamper|laundry (?:bin|basket)",
    ),
    _object("bucket", "Bucket", "bucket|pail"),
    _object(
        "bottle",
        "Bottle",
        "bottle|water bottle|flask|thermos(?: flask| bottle)?|drinking bottle|drinks bottle|"
        "sports bottle|plastic bottle|glass bottle",
    ),
    _object("kettle", "Kettle", "kettle|electric kettle|tea ?kettle|water kettle|tea ?pot"),
    _object(
        "kitchen_pot",
        "KitchenPot",
        "pot|cooking pot|kitchen pot|saucepan|sauce pan|stock ?pot|casserole|cook ?pot|soup pot|"
        "pan|dutch oven",
    ),
    _object(
        "faucet",
        "Faucet",
        "faucet|tap|mixer tap|mixer|kitchen (?:tap|faucet)|water tap|sink (?:tap|mixer|faucet)|"
        "basin (?:tap|mixer)|bathroom (?:tap|faucet)",
    ),
    _object(
        "switch",
        "Switch",
        "switch|light switch|toggle switch|wall switch|dimmer(?: switch)?|wall plate|rotary switch|"
        "switch plate|lever switch|thermostat",
    ),
    _object(
        "box_with_lid",
        "Box",
        "box|storage (?:box|chest|trunk)|trunk|lidded box|treasure chest|blanket (?:box|chest)|"
        "toy (?:box|chest)|jewel(?:le)?ry box|hinged box|wooden box|crate|coffer|casket|"
        "chest freezer|deep freezer|freezer chest|cooler(?: box)?|cool box|ice chest|"
        "bread (?:box|bin)|tool ?box|lunch ?box|cash box|shoe box|sewing box|deck box|music box|"
        "humidor|(?:hope|cedar|linen) chest|(?:storage )?ottoman",
    ),
)
"""Objects, general nouns included; longer nouns take precedence."""

NEAREST = {
    "toaster": "microwave",
    "dryer": "washing machine",
    "grill": "oven",
    "fireplace": "oven",
    "lamp": "light switch",
    "stool": "office chair",
    "sofa": "office chair",
    "couch": "office chair",
    "mug": "bottle",
    "cup": "bottle",
    "glass": "bottle",
    "jar": "bottle",
    "jug": "kettle",
    "vase": "bottle",
    "briefcase": "suitcase",
    "sink": "faucet",
    "bathtub": "faucet",
    "shower": "faucet",
    "gate": "door",
    "hatch": "door",
    "garage": "door",
    "phone": "laptop",
    "tablet": "laptop",
    "computer": "laptop",
    "monitor": "laptop",
    "keyboard": "laptop",
    "printer": "microwave",
    "tv": "TV stand",
    "television": "TV stand",
    "shelf": "bookcase",
    "basket": "bucket",
    "barrel": "trash can",
    "aquarium": "box",
    "drawer": "chest of drawers",
}
"""Nearest object of the library for common nouns that it lacks."""

PARTS: dict[str, str] = {
    "door": "doors?|leaf|leaves|door fronts?|doored",
    "drawer": "drawers?|pull outs?|pullouts?|drawer fronts?|drawered",
    "flap": "flaps?|hatch(?:es)?|drop fronts?|fall fronts?",
    "open": "(?:open |empty |adjustable |internal )?(?:shelf|shelves|shelving|compartments?|"
    "cubb(?:y|ies)|cubby holes?|niches?|pigeonholes?)|open (?:sections?|bays?|spaces?|cells?)",
    "panel": "fixed panels?|fixed fronts?|blind panels?|false (?:fronts?|drawers?)|panels?",
    "freezer": "freezers?(?: compartments?| sections?)?|ice ?box(?:es)?",
    "lid": "lids?|hinged tops?",
    "cover": "covers?",
    "seat": "seats?|toilet seats?",
    "back": "backs?|back ?rests?",
    "handle": "handles?|grips?|pulls?|door handles?|drawer (?:handles?|pulls?)|handlebars?|bails?",
    "knob": "knobs?|door knobs?|drawer knobs?|control knobs?",
    "dial": "dials?|rotary (?:dials?|knobs?|controls?)|combination (?:dials?|locks?)",
    "lever": "levers?|toggles?|toggle levers?|flush(?:ing)? (?:levers?|handles?)|gangs?|rockers?|"
    "switch(?:es)?",
    "wheel": "wheels?|castors?|casters?|hand ?wheels?",
    "pedal": "pedals?|foot pedals?",
    "spout": "spouts?|outlets?",
    "cap": "caps?|stoppers?|tops",
    "window": "sash(?:es)?|panes?|windows?",
    "pull": "telescopic handles?|telescoping handles?|pull handles?|extendable handles?|"
    "trolley handles?|retractable handles?",
    "rack": "racks?|trays?|baskets?|grids|grates?",
    "plate": "plates?|turntables?|hot ?plates?|burners?|hobs?|cook ?tops?|rings?|hob tops?",
    "leg": "legs?|feet",
    "base": "plinths?|bases?|stands?|pedestals?",
    "top": "worktops?|counter ?tops?|table ?tops?|tops?",
    "arm": "arm ?rests?|arms?",
    "screen": "screens?|displays?|keyboards?|touch ?pads?|track ?pads?|keys",
    "tank": "tanks?|cisterns?|bowls?|toilet bowls?",
    "frame": "frames?|door ?frames?|window frames?",
    "neck": "necks?|bodies|bod(?:y|ies)|rims?|shells?",
    "drum": "drums?|portholes?|port holes?",
}
"""Kinds of parts."""

FIXED_COUNTS = {
    ("oven", "plate"): 4,
    ("dishwasher", "rack"): 2,
    ("suitcase", "wheel"): 4,
    ("office_chair", "wheel"): 5,
    ("office_chair", "leg"): 5,
    ("office_chair", "arm"): 2,
    ("kitchen_pot", "handle"): 2,
    ("table_with_drawers", "leg"): 4,
}
"""Number of parts that do not move, by class and kind."""
FIXED_FEATURES: dict[str, frozenset[str]] = {
    "furniture": frozenset({"leg", "base", "top", "neck", "panel", "frame"}),
    "table_with_drawers": frozenset({"leg", "top", "frame", "base"}),
    "fridge": frozenset({"open", "rack", "leg", "neck"}),
    "microwave": frozenset({"plate", "window", "leg", "panel", "handle"}),
    "oven": frozenset({"window", "rack", "plate", "panel", "handle", "top"}),
    "dishwasher": frozenset({"rack", "panel", "leg", "handle"}),
    "washing_machine": frozenset({"window", "drum", "panel", "leg", "handle"}),
    "toilet": frozenset({"tank"}),
    "door": frozenset({"frame", "panel"}),
    "sliding_window": frozenset({"frame", "handle"}),
    "office_chair": frozenset({"arm", "wheel", "leg", "base"}),
    "safe": frozenset({"open", "leg", "handle"}),
    "suitcase": frozenset({"wheel", "neck"}),
    "laptop": frozenset({"screen", "base"}),
    "trash_can": frozenset({"neck", "handle"}),
    "bucket": frozenset({"neck"}),
    "bottle": frozenset({"neck"}),
    "kettle": frozenset({"spout", "base", "handle", "knob"}),
    "kitchen_pot": frozenset({"handle", "knob", "neck"}),
    "faucet": frozenset({"base"}),
    "switch": frozenset({"plate", "panel"}),
    "box_with_lid": frozenset({"neck", "handle"}),
}
"""Parts that the objects of a class have and that do not move."""

WOODS = ("oak", "walnut", "birch", "pine", "beech", "maple", "cherry", "mahogany", "teak", "ash")
MATERIALS: dict[str, str] = {
    **{wood: wood for wood in WOODS},
    "wood": "oak",
    "wooden": "oak",
    "timber": "oak",
    "plywood": "birch",
    "bamboo": "bamboo",
    "mdf": "birch",
    "chipboard": "birch",
    "stainless steel": "steel",
    "stainless": "steel",
    "steel": "steel",
    "metal": "steel",
    "metallic": "steel",
    "iron": "dark_steel",
    "cast iron": "dark_steel",
    "aluminium": "steel",
    "aluminum": "steel",
    "tin": "steel",
    "zinc": "steel",
    "chrome": "chrome",
    "chromed": "chrome",
    "nickel": "chrome",
    "silver": "chrome",
    "brass": "brass",
    "gold": "brass",
    "golden": "brass",
    "bronze": "copper",
    "copper": "copper",
    "glass": "glass",
    "ceramic": "ceramic",
    "porcelain": "ceramic",
    "fabric": "fabric",
    "cloth": "fabric",
    "leather": "leather",
    "rubber": "rubber",
    "plastic": "plastic",
}
"""Palette entry of a word; ``plastic`` depends on the colour."""
COLOURS: dict[str, str] = {
    "white": "white",
    "cream": "beige",
    "beige": "beige",
    "ivory": "beige",
    "black": "black",
    "grey": "grey",
    "gray": "grey",
    "anthracite": "black",
    "red": "red",
    "blue": "blue",
    "navy": "blue",
    "turquoise": "blue",
    "green": "green",
    "olive": "green",
    "yellow": "yellow",
    "orange": "orange",
    "brown": "brown",
    "pink": "pink",
    "purple": "purple",
    "violet": "purple",
}
"""Colour of the palette by word."""

SIZE_WORDS: dict[str, tuple[str, float]] = {
    "small": ("all", 0.8),
    "little": ("all", 0.8),
    "tiny": ("all", 0.7),
    "mini": ("all", 0.7),
    "compact": ("all", 0.8),
    "smaller": ("all", 0.8),
    "larger": ("all", 1.25),
    "bigger": ("all", 1.25),
    "large": ("all", 1.25),
    "big": ("all", 1.25),
    "huge": ("all", 1.4),
    "tall": ("height", 1.3),
    "taller": ("height", 1.3),
    "high": ("height", 1.3),
    "low": ("height", 0.7),
    "short": ("height", 0.7),
    "wide": ("width", 1.3),
    "wider": ("width", 1.3),
    "broad": ("width", 1.3),
    "long": ("width", 1.3),
    "narrow": ("width", 0.7),
    "narrower": ("width", 0.7),
    "slim": ("width", 0.75),
    "slimline": ("width", 0.75),
    "slender": ("width", 0.75),
    "deep": ("depth", 1.2),
    "deeper": ("depth", 1.2),
    "shallow": ("depth", 0.75),
}
"""Dimension and factor of words that describe size."""

FILLER = word_set(
    """
    unit units
    a an the this that these those of in on at to for from by as is are was be been being has
    have having had with and or but it its they them their there here which who whose where
    what when i we you my our your me us need want would like please make create generate
    build give get show design find let one's some any please s do does did can could should
    will just simply exactly precisely only also too very quite rather really model object
    piece item thing things kind type sort style version example asset urdf 3d
    three-dimensional articulated movable moving real realistic simple basic plain each every
    all both either other others another same equal equally identical similar equal-sized
    sized size sizes dimension dimensions measure measures measuring measurements overall
    total about approximately approx around roughly circa nearly almost ca feature features
    featuring contain contains containing consist consists consisting comprise comprises
    comprising include includes including include equipped fitted provided complete made
    finished finish fronted mounted arranged arrangement layout placed located positioned sits
    sit set put side sides part parts section sections half halves area front face faces rear
    edge edges end ends number count amount exactly total than more less into out then plus so
    if not such go goes stands standing stand found seen together respectively per well up
    down one ones
    """
)
"""Words that add nothing to the description of an object."""
NO_EFFECT = word_set(
    """
    modern classic classical contemporary traditional rustic vintage antique old new retro
    elegant scandinavian industrial minimalist minimalistic nice beautiful pretty cheap
    expensive sturdy solid standard normal typical regular common ordinary usual familiar
    generic domestic household kitchen bathroom bedroom office living room garage home hotel
    kids children school gym hallway laundry utility studio workshop classroom laboratory lab
    garden hospital apartment house freestanding standing free built-in built integrated
    inbuilt upright mounted wall floor electric electrical gas induction automatic manual
    digital conventional combi convection front loading loader american european style
    slimline loading-door fully shiny matt matte glossy gloss polished brushed painted
    lacquered varnished stained natural dark light pale bright deep-coloured coloured colored
    colour color clean empty heavy lightweight thick thin round cylindrical rectangular square
    straight upholstered cordless portable hot cold water drinking tea cooking writing work
    computer book books clothes shoes shoe tools cutlery detergent powder baking tray pizza
    storage combination flush front-loading side-hung hinged interior inner outer internal
    external decorative countertop veneer veneered laminate frost
    soft close self closing lockable lock locks keyhole mirrored mirror mirrors rolling
    gun sink baby changing
    """
)
"""Words that are understood and do not change the object."""
