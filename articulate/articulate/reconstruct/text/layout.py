"""Layout planner: from groups of parts and their relations to the panels of a front."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, cast

from articulate.library.procedural.front_layout import (
    FrontPanel,
    HandleKind,
    HingeSide,
    PanelKind,
    SlideDirection,
)
from articulate.reconstruct.text.description import Description, PartGroup, Position, Side

Direction = Literal["", "row", "column"]
HEIGHTS = {"drawer": 1.0, "door": 3.0, "flap": 1.6, "open": 1.3, "panel": 1.0, "gap": 4.0}
"""Relative height of one part of each kind."""
WIDTHS = {"drawer": 1.0, "door": 1.0, "flap": 1.4, "open": 1.0, "panel": 1.0, "gap": 1.6}
"""Relative width of one part of each kind."""
TWO_COLUMNS = 6
"""Fewer drawers without an arrangement are in one column."""
MOST_IN_COLUMN = 8
HORIZONTAL = frozenset({"left", "right", "ends"})


@dataclass(kw_only=True)
class Node:
    """Region of a front: one group, or regions beside or above each other."""

    direction: Direction = ""
    """``row``: children from the left; ``column``: children from the top."""
    children: list[Node] = field(default_factory=list)
    group: PartGroup | None = None
    position: Position = ""

    def leaves(self) -> list[PartGroup]:
        """Return the groups in this region."""
        if self.group is not None:
            return [self.group]
        return [group for child in self.children for group in child.leaves()]


@dataclass(frozen=True, kw_only=True)
class FrontStyle:
    """Rules of one kind of object."""

    width_m: float
    height_m: float
    handle: HandleKind = "bar"
    doors_above: bool = False
    """Doors are above drawers where the text gives no arrangement."""
    middle_is_vertical: bool = False
    """``in the middle`` is between above and below."""
    door_hinge: HingeSide = ""
    """Hinged edge of doors without a separate one."""


def front_panels(description: Description, style: FrontStyle) -> tuple[FrontPanel, ...]:
    """Return the panels of a front, in shares of its width and height."""
    node = arrange(description, style)
    return tuple(_panels(node, (0.0, 1.0, 0.0, 1.0), style))


def arrange(description: Description, style: FrontStyle) -> Node:
    """Combine groups to a tree of rows and columns."""
    groups = [g for g in description.groups if g.kind in HEIGHTS and g.count != 0]
    nodes = {id(g): Node(group=g, position=g.position) for g in groups}
    for relation in description.relations:
        first, second = description.groups[relation.first], description.groups[relation.second]
        if id(first) in nodes and id(second) in nodes:
            _merge(nodes, first, second, relation.link)
    tops: list[Node] = []
    for node in nodes.values():
        if all(node is not other for other in tops):
            tops.append(node)
    return _solve(tops, style)


def _merge(nodes: dict[int, Node], first: PartGroup, second: PartGroup, link: str) -> None:
    """Put two regions into one."""
    a, b = nodes[id(first)], nodes[id(second)]
    if a is b:
        return
    if link == "between":
        halves = _split_ends(b)
        merged = Node(direction="row", children=[halves[0], a, halves[1]])
    else:
        direction: Direction = "column" if link == "above" else "row"
        children: list[Node] = []
        for node in (a, b):
            same = node.direction == direction
            children += node.children if same else [node]
        merged = Node(direction=direction, children=children)
    merged.position = a.position or b.position
    if link == "above" and merged.position in {"top", "bottom"}:
        merged.position = ""
    for group in merged.leaves():
        nodes[id(group)] = merged
    for group in (first, second):
        nodes[id(group)] = merged


def _split_ends(node: Node) -> tuple[Node, Node]:
    """Split a region into its left and right half."""
    group = node.group
    if group is not None:
        count = group.count or 2
        left, right = count - count // 2, count // 2
        return _half(group, left, "left"), _half(group, right or left, "right")
    if node.direction == "row" and len(node.children) == 2:
        return node.children[0], node.children[1]
    pairs = [_split_ends(child) for child in node.children]
    return (
        Node(direction=node.direction, children=[pair[0] for pair in pairs]),
        Node(direction=node.direction, children=[pair[1] for pair in pairs]),
    )


def _half(group: PartGroup, count: int, side: Side) -> Node:
    """Return a region with ``count`` parts of a group at one side of the front."""
    hinge = group.hinge or (side if group.kind == "door" else "")
    half = replace(group, count=count, position="", columns=None, rows=None, hinge=hinge)
    return Node(group=half)


def _solve(nodes: Sequence[Node], style: FrontStyle) -> Node:
    """Arrange regions by their positions."""
    if len(nodes) == 1:
        node = nodes[0]
        return _placed_single(node)
    by: dict[str, list[Node]] = {
        name: [n for n in nodes if n.position == name]
        for name in ("top", "bottom", "left", "right", "ends", "middle", "")
    }
    if style.middle_is_vertical and by["middle"] and not by["top"] and not by["bottom"]:
        return _middle_row(by, style)
    if by["top"] or by["bottom"]:
        middle = [n for n in nodes if n.position not in {"top", "bottom"}]
        rows = [_solve(_clear(part), style) for part in (by["top"],) if part]
        rows += [_solve(middle, style)] if middle else []
        rows += [_solve(_clear(part), style) for part in (by["bottom"],) if part]
        return rows[0] if len(rows) == 1 else Node(direction="column", children=rows)
    if by["left"] or by["right"] or by["ends"] or by["middle"]:
        return _as_row(by, style)
    return _default(list(nodes), style)


def _placed_single(node: Node) -> Node:
    return node


def _clear(nodes: Sequence[Node]) -> list[Node]:
    for node in nodes:
        node.position = ""
    return list(nodes)


def _middle_row(by: dict[str, list[Node]], style: FrontStyle) -> Node:
    """Put regions in the middle between halves of the others above and below."""
    rest = by[""] + by["left"] + by["right"] + by["ends"]
    middle = _solve(_clear(by["middle"]), style)
    if len(rest) == 1 and rest[0].group is not None and (rest[0].group.count or 2) >= 2:
        group = rest[0].group
        count = group.count or 2
        halves = [replace(group, count=n) for n in (count - count // 2, count // 2)]
        above, below = (Node(group=half) for half in halves)
    elif len(rest) >= 2:
        above, below = rest[0], _solve(_clear(rest[1:]), style)
    else:
        return Node(direction="column", children=[*rest, middle])
    return Node(direction="column", children=[above, middle, below])


def _as_row(by: dict[str, list[Node]], style: FrontStyle) -> Node:
    """Put regions beside each other."""
    children: list[Node] = []
    ends = list(by["ends"])
    free = list(by[""])
    if by["middle"] and not ends and not by["left"] and not by["right"]:
        ends, free = free, []
    halves = [_split_ends(node) for node in _clear(ends)]
    column = [half[0] for half in halves]
    if by["left"]:
        children.append(_solve(_clear(by["left"]), style))
    if column:
        children.append(_stacked(column))
    if free and by["left"] and not by["right"] and not by["middle"]:
        children.append(_solve(free, style))
        free = []
    if free and by["right"] and not by["left"]:
        children.append(_solve(free, style))
        free = []
    middle = _clear(by["middle"]) + free
    if middle:
        children.append(_solve(middle, style))
    if column:
        children.append(_stacked([half[1] for half in halves]))
    if by["right"]:
        children.append(_solve(_clear(by["right"]), style))
    return children[0] if len(children) == 1 else Node(direction="row", children=children)


def _stacked(nodes: list[Node]) -> Node:
    return nodes[0] if len(nodes) == 1 else Node(direction="column", children=nodes)


def _default(nodes: list[Node], style: FrontStyle) -> Node:
    """Arrange regions for which the text gives no relation: above each other."""
    if all(g.kind == "door" for node in nodes for g in node.leaves()):
        return Node(direction="row", children=nodes)
    order = {"drawer": 0, "open": 1, "flap": 1, "door": 2}
    if style.doors_above:
        order |= {"open": 0, "door": 1, "drawer": 2}

    def rank(node: Node) -> int:
        return min(order.get(group.kind, 2) for group in node.leaves())

    return Node(direction="column", children=sorted(nodes, key=rank))


# -- panels ----------------------------------------------------------------------------------
Area = tuple[float, float, float, float]
"""Left, right, bottom and top in shares of the front."""


def _panels(node: Node, area: Area, style: FrontStyle, beside: int = 0) -> list[FrontPanel]:
    """Return the panels of a region."""
    if node.group is not None:
        return _group_panels(node.group, area, style, beside)
    left, right, bottom, top = area
    horizontal = node.direction == "row"
    doors = max([_columns_of_doors(child) for child in node.children] or [0])
    sizes = [
        _extent(child, style, area, horizontal=horizontal, beside=doors) for child in node.children
    ]
    out: list[FrontPanel] = []
    at = left if horizontal else top
    for child, size in zip(node.children, sizes, strict=True):
        share = size / sum(sizes)
        if horizontal:
            end = at + share * (right - left)
            out += _panels(child, (at, min(end, right), bottom, top), style)
        else:
            end = at - share * (top - bottom)
            out += _panels(child, (left, right, max(end, bottom), at), style, doors)
        at = end
    return out


def _columns_of_doors(node: Node) -> int:
    """Return the number of doors beside each other in a region that is one group."""
    group = node.group
    if group is None or group.kind != "door" or group.stack == "column":
        return 0
    return group.columns or group.count or 2


def _extent(node: Node, style: FrontStyle, area: Area, *, horizontal: bool, beside: int) -> float:
    """Return the relative width or height of a region."""
    if node.group is not None:
        rows, columns = grid_of(node.group, area, style, beside)
        weight = node.group.weight
        if horizontal:
            return columns * WIDTHS[node.group.kind] * (weight if weight < 1.0 else 1.0)
        return rows * HEIGHTS[node.group.kind] * weight
    inner = [_extent(c, style, area, horizontal=horizontal, beside=0) for c in node.children]
    along = (node.direction == "row") == horizontal
    return sum(inner) if along else max(inner)


def number_of(group: PartGroup) -> int:
    """Return the number of parts of a group; two where the text has a plural."""
    if group.count is not None:
        return group.count
    if group.rows and group.columns:
        return group.rows * group.columns
    return max(2, group.rows or 0, group.columns or 0)


def grid_of(group: PartGroup, area: Area, style: FrontStyle, beside: int = 0) -> tuple[int, int]:
    """Return rows and columns of a group of equal parts.

    Args:
        group: Parts of one kind.
        area: Region for them.
        style: Size of the front.
        beside: Doors beside each other above or below them.
    """
    count = number_of(group)
    if group.rows and group.columns:
        return group.rows, group.columns
    if group.columns:
        return -(-count // group.columns), group.columns
    if group.rows:
        return group.rows, -(-count // group.rows)
    if group.stack == "row":
        return 1, count
    if group.stack == "column":
        return count, 1
    width_m = (area[1] - area[0]) * style.width_m
    if group.kind in {"door", "flap"}:
        return 1, count
    if group.kind == "drawer" and 1 < count == beside and width_m / count >= 0.25:
        return 1, count
    if group.kind == "drawer" and count >= TWO_COLUMNS and width_m >= 0.5:
        for columns in (2, 3, 4):
            if count % columns == 0 and count // columns <= MOST_IN_COLUMN:
                return count // columns, columns
    return count, 1


def _group_panels(group: PartGroup, area: Area, style: FrontStyle, beside: int) -> list[FrontPanel]:
    rows, columns = grid_of(group, area, style, beside)
    count = number_of(group)
    left, right, bottom, top = area
    kind, hinges = _kind_and_hinges(group, columns, area, style)
    high = (top - bottom) / rows
    out = []
    for k in range(count):
        row, column = divmod(k, columns)
        in_row = min(columns, count - row * columns)
        wide = (right - left) / in_row
        slide = _slide(column, in_row, area) if group.slides and kind == "door" else ""
        hinge = _member_hinge(group, k, count, in_row) or hinges[column % len(hinges)]
        out.append(
            FrontPanel(
                kind=kind,
                left=left + column * wide,
                right=min(1.0, left + (column + 1) * wide),
                bottom=max(0.0, top - (row + 1) * high),
                top=top - row * high,
                hinge="" if slide else hinge,
                slide=slide,
                layer=_layer(column, in_row) if slide else 0,
                handle="none" if kind in {"open", "panel", "gap"} else style.handle,
            )
        )
    return out


def _slide(column: int, columns: int, area: Area) -> SlideDirection:
    """Return the direction in which a sliding door opens: before or behind its neighbour."""
    if columns == 1:
        return "left" if area[0] >= 1.0 - area[1] else "right"
    return "right" if column % 2 == 0 and column + 1 < columns else "left"


def _layer(column: int, columns: int) -> int:
    """Return the layer of a sliding door; one without a neighbour passes before other fronts."""
    return 2 if columns == 1 else column % 2


def _member_hinge(group: PartGroup, k: int, count: int, columns: int) -> HingeSide:
    """Return the hinged edge of one part if the text gives it for that part."""
    names = {0: ("left",) if columns > 1 else ("top",), count - 1: ("right", "bottom")}
    if count % 2 and k == count // 2:
        names[k] = ("middle",)
    for name in names.get(k, ()):
        side = group.member_hinges.get(name, "")
        if side in {"left", "right"}:
            return side
    return ""


def _kind_and_hinges(
    group: PartGroup, columns: int, area: Area, style: FrontStyle
) -> tuple[PanelKind, list[HingeSide]]:
    """Return the kind of panel and the hinged edge of each column."""
    side = group.hinge or (style.door_hinge if group.kind in {"door", "flap"} else "")
    if group.kind == "flap" or (group.kind == "door" and side in {"top", "bottom"}):
        if side in {"left", "right"}:
            return "door", [side]
        return "flap", [side or "bottom"]
    if group.kind != "door":
        return cast("PanelKind", group.kind), [""]
    if side:
        return "door", [side]
    if columns == 1:
        at_left = area[0] < 1e-6 and area[1] < 1.0 - 1e-6
        return "door", ["left" if at_left else "right"]
    hinges: list[HingeSide] = ["right" if k % 2 else "left" for k in range(columns)]
    hinges[-1] = "right"
    return "door", hinges
