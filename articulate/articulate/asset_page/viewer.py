"""3-D view of an asset for a page: every joint has a slider, every part can be dragged."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib import resources
from typing import Any

import numpy as np

from articulate.asset_page.views import AZIMUTH_OFF_FRONT_DEG, ELEVATION_DEG, front_azimuth_deg
from articulate.assets.asset import Asset, Joint
from articulate.checks.model import Follower, ObjectModel
from articulate.checks.triangles import surfaces_of
from articulate.page.text import escape_text
from articulate.transforms import pose, quat_to_matrix

ASSETS = resources.files("articulate.asset_page").joinpath("assets")
FULL_TURN = 2.0 * np.pi


def viewer_html(subject: ObjectModel, needs: Mapping[str, tuple[str, ...]] | None = None) -> str:
    """Return the view with its data and scripts as HTML, for one use in a page.

    Args:
        subject: Asset and its model.
        needs: Joints that must be open before others move, by joint.
    """
    asset = subject.asset
    leaders = {f.joint: f.leader for f in subject.followers}
    sliders = "".join(
        _slider(joint, leaders.get(joint.name), (needs or {}).get(joint.name, ()))
        for joint in asset.joints
    )
    content = json.dumps(viewer_content(subject), allow_nan=False, separators=(",", ":"))
    # A name of a link must not be able to end the script element.
    content = content.replace("<", "\\u003c").replace("\u2028", " ").replace("\u2029", " ")
    buttons = "".join(
        f'<button type="button" data-do="{do}"{extra}>{label}</button>'
        for do, label, extra in _buttons(asset)
    )
    return (
        '<section class="viewer" id="viewer" aria-label="3-D view">'
        '<div class="stage"><canvas tabindex="0" aria-label="The object in 3-D: drag to turn it, '
        'arrow keys turn it, + and − zoom"></canvas>'
        f'<div class="tools">{buttons}</div>'
        f'<p class="hint">{_hint(asset)}</p></div>'
        f'<div class="sliders">{sliders}</div>'
        '<p class="trouble" hidden></p>'
        "<noscript><p>The 3-D view needs JavaScript; the images do not.</p></noscript></section>"
        f'<script type="application/json" id="viewer-data">{content}</script>'
        f"<script>{_script('three.min.js')}</script>"
        f"<script>{_script('viewer.js')}</script>"
    )


def viewer_content(subject: ObjectModel) -> dict[str, Any]:
    """Return the data of the script: links, joints, followers, surfaces and view direction.

    All values are in the object frame with every joint at 0 [m, rad]; poses are rows of
    4 x 4 matrices.
    """
    asset = subject.asset
    low, high = (np.asarray(corner) for corner in asset.bounds_o)
    return {
        "name": asset.name,
        "bounds": [low.tolist(), high.tolist()],
        "azimuth_deg": front_azimuth_deg(asset) + AZIMUTH_OFF_FRONT_DEG,
        "elevation_deg": ELEVATION_DEG,
        "links": [
            {
                "name": link.name,
                "parent": link.parent,
                "T_ol": pose(link.pos_o, quat_to_matrix(link.quat_o)).reshape(-1).tolist(),
            }
            for link in asset.links
        ],
        "joints": [_joint_content(joint) for joint in asset.joints],
        "followers": [_follower_content(f) for f in subject.followers],
        "surfaces": [surface.content() for surface in surfaces_of(subject)],
    }


def _joint_content(joint: Joint) -> dict[str, Any]:
    return {
        "name": joint.name,
        "kind": joint.kind,
        "link": joint.link,
        "axis": list(joint.axis_o),
        "pivot": list(joint.pivot_o),
        "closed": joint.closed,
        "open": joint.open,
        "low": slider_range(joint)[0],
        "high": slider_range(joint)[1],
    }


def _follower_content(follower: Follower) -> dict[str, Any]:
    return {
        "joint": follower.joint,
        "leader": follower.leader,
        "coefficients": list(follower.coefficients),
    }


def slider_range(joint: Joint) -> tuple[float, float]:
    """Return the range of a slider [m or rad]: the limits, or one turn without limits."""
    if joint.lower is not None and joint.upper is not None:
        return joint.lower, joint.upper
    turn = FULL_TURN if joint.kind == "hinge" else 1.0
    return (joint.closed, joint.closed + turn) if joint.span >= 0 else (joint.closed - turn,
                                                                        joint.closed)  # fmt: skip


def _slider(joint: Joint, leader: str | None, needs: tuple[str, ...]) -> str:
    low, high = slider_range(joint)
    note = ""
    if leader is not None:
        note = f"follows {leader}"
    elif needs:
        note = f"free once {' and '.join(needs)} {'is' if len(needs) == 1 else 'are'} open"
    name = escape_text(joint.name)
    # The slider begins at the closed position, in whichever direction the joint opens.
    direction = ' dir="rtl"' if joint.span < 0 else ""
    disabled = " disabled" if leader is not None else ""
    small = f"<small>{escape_text(note)}</small>" if note else ""
    return (
        f'<label><span class="name">{name}</span>'
        f'<output data-joint="{name}"></output>'
        f'<input type="range" data-joint="{name}" min="{low!r}" max="{high!r}" step="any" '
        f'value="{joint.closed!r}"{direction}{disabled}>{small}</label>'
    )


def _buttons(asset: Asset) -> list[tuple[str, str, str]]:
    pressed = ' aria-pressed="false"'
    always = [("collision", "Collision shapes", pressed), ("view", "Reset", "")]
    if not asset.joints:
        return always
    return [("all", "Open all", pressed), ("play", "Play", pressed), *always]


def _hint(asset: Asset) -> str:
    if not asset.joints:
        return "Drag to turn it."
    return "Drag a part to move it, the rest to turn."


def _script(name: str) -> str:
    text = ASSETS.joinpath(name).read_text("utf-8")
    assert "</script" not in text.lower()
    return text
