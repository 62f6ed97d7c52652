"""Parts that cannot be seen for a part of the clip."""

import numpy as np
import pytest
import trimesh

from articulate.reconstruct.actors.geometric.video import video_actor
from articulate.reconstruct.actors.protocol import Evidence
from articulate.render.camera import front_camera
from articulate.render.joint_video import poses_of_parts, render_video
from articulate.render.parts import plain_part
from articulate.render.scene import PartScene


def block(name, low, high, rgb):
    mesh = trimesh.creation.box(bounds=[low, high])
    return plain_part(name, mesh.vertices, mesh.faces, rgb)


def test_a_tray_that_hides_under_its_table_at_first_slides_evenly():
    top = block("top", (-0.6, -0.7, 0.8), (0.5, 0.7, 0.85), (0.7, 0.6, 0.5))
    foot = block("foot", (-0.3, -0.3, 0.0), (0.0, 0.3, 0.6), (0.5, 0.4, 0.4))
    tray = block("tray", (-0.5, -0.4, 0.68), (0.2, 0.4, 0.72), (0.3, 0.5, 0.7))
    parts = (top, tray, foot)
    q = np.linspace(0.0, 0.6, 30)
    T_o = np.tile(np.eye(4), (30, 1, 1))
    T_o[:, 0, 3] = q
    camera = front_camera(240, 180)
    clip = render_video(PartScene(parts), camera, poses_of_parts(3, [1], T_o))
    evidence = Evidence(
        modality="video", parts=parts, video=clip.frames, times_s=clip.times_s, camera=camera
    )
    (said,) = [j for j in video_actor().predict(evidence).joints if j.kind != "fixed"]
    assert (said.part, said.kind) == ("tray", "prismatic")
    sign = np.sign(said.axis_o[0])
    assert sorted([sign * said.lower, sign * said.upper]) == pytest.approx([0.0, 0.6], abs=0.04)
