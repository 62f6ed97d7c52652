"""Test joints by moving the part: the hinge at which it collides least is chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.transforms import Array, Ints, apply, axis_angle_to_matrix, pose

POINTS, PART_POINTS = 20_000, 600
"""Points on the rest of the object, and on the part."""
ANGLES_RAD = (0.1, 0.25, 0.5, 0.9, 1.4)
SLIDES = (0.15, 0.4, 0.7, 1.0)
"""Shares of a travel."""
TOUCH = 0.012
"""Distance of points in contact, as a share of the diagonal."""
BLOCKED = 0.12
"""A part of which more collides is not free."""
INSETS = (0.0, 0.015, 0.03)
"""Distances of a hinge from the edge of a panel, as shares of the diagonal."""


class FreeSweep:
    """Rest of the object as points, for the motion of one part.

    Args:
        mesh: The object.
        moving: Faces of the part (K,).
        others: Faces of the rest (M,).
    """

    def __init__(self, mesh: ScanMesh, moving: Ints, others: Ints) -> None:
        self.touch = TOUCH * mesh.diagonal
        self.points = _samples(mesh, moving, PART_POINTS)[0]
        self.rest, self.normals = _samples(mesh, others, POINTS)
        self.tree = cKDTree(self.rest)

    def blocked(self, poses: Array) -> float:
        """Return the share of the part's points that meet a surface across their travel.

        Surfaces that they touch at the start, or along which they slide, do not count.

        Args:
            poses: Poses along the travel (T, 4, 4), homogeneous, without the first.
        """
        travel = np.concatenate([self.points[None], apply(poses[:, None], self.points)])
        distance, which = self.tree.query(travel, distance_upper_bound=self.touch)
        near = np.isfinite(distance)
        ahead = np.diff(travel, axis=0, append=travel[-1:])
        ahead[-1] = ahead[-2]
        ahead /= np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-12)
        across = np.abs((self.normals[np.where(near, which, 0)] * ahead).sum(axis=-1)) > 0.5
        met = near & across
        return float((met[1:].any(axis=0) & ~near[0]).mean())


def _samples(mesh: ScanMesh, faces: Ints, count: int) -> tuple[Array, Array]:
    """Return uniform samples on faces, and their normals, both (N, 3)."""
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces[faces], process=False)
    points, index = trimesh.sample.sample_surface(surface, count, seed=0)
    return np.asarray(points, dtype=np.float64), mesh.normals[faces[np.asarray(index)]]


def with_free_joints(mesh: ScanMesh, proposals: Sequence[PartProposal]) -> list[PartProposal]:
    """Return the proposals with their freest hinges, and confidences lowered where they collide."""
    everything = np.arange(len(mesh.faces))
    found = []
    for k, proposal in enumerate(proposals):
        attached = [proposal.faces, *(p.faces for p in proposals if p.on == k)]
        others = np.setdiff1d(everything, np.concatenate(attached))
        if proposal.joint == "continuous" or not len(others):
            found.append(proposal)
            continue
        sweep = FreeSweep(mesh, proposal.faces, others)
        found.append(_best(mesh, proposal, sweep))
    return found


def _best(mesh: ScanMesh, proposal: PartProposal, sweep: FreeSweep) -> PartProposal:
    candidates = _candidates(mesh, proposal)
    rated = [(sweep.blocked(_poses(candidate)), k) for k, candidate in enumerate(candidates)]
    share, k = min((round(share, 2), k) for share, k in rated)
    best = candidates[k]
    if share <= BLOCKED:
        return best
    return replace(
        best.with_confidence(best.confidence * (1.0 - share)),
        evidence=(*best.evidence, f"{share:.0%} of it collides on its travel"),
    )


def _candidates(mesh: ScanMesh, proposal: PartProposal) -> list[PartProposal]:
    """Return the proposal with its hinge at several depths of the panel, the likeliest first."""
    if proposal.joint != "revolute" or proposal.panel is None:
        return [proposal]
    corners = mesh.triangles[proposal.faces].reshape(-1, 3)
    back = max(float(proposal.pivot[0]), float(corners[:, 0].min()))
    centre = np.array([0.0, *(0.5 * (proposal.panel[:2] + proposal.panel[2:]))])
    inward = centre - proposal.pivot
    inward[0] = 0.0
    inward -= proposal.axis * float(inward @ proposal.axis)
    inward /= max(float(np.linalg.norm(inward)), 1e-12)
    found = []
    for inset in INSETS:
        for depth in (0.0, 0.5, 1.0):
            pivot = proposal.pivot + inset * mesh.diagonal * inward
            pivot[0] = back + depth * (proposal.front - back)
            found.append(replace(proposal, pivot=pivot))
    return found


def _poses(proposal: PartProposal) -> Array:
    """Return poses along the travel (T, 4, 4)."""
    if proposal.joint == "prismatic":
        q = np.asarray(SLIDES) * proposal.upper
        return pose(q[:, None] * proposal.axis)
    q = np.asarray(
        [angle for angle in ANGLES_RAD if angle <= proposal.upper + 1e-9] or [proposal.upper]
    )
    rotation = axis_angle_to_matrix(np.broadcast_to(proposal.axis, (len(q), 3)), q)
    return pose(proposal.pivot - np.einsum("tij,j->ti", rotation, proposal.pivot), rotation)
