from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from articulate.formats.msh import read_msh

CORNERS = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]


def msh(faces: list[tuple[int, int, int]], *, normals: int = 0, coordinates: int = 0) -> bytes:
    """The tetrahedron with so many unused normals and texture coordinates before its faces."""
    return (
        struct.pack("<4i", len(CORNERS), normals, coordinates, len(faces))
        + np.array(CORNERS, "<f4").tobytes()
        + np.full(3 * normals + 2 * coordinates, 7.0, "<f4").tobytes()
        + np.array(faces, "<i4").tobytes()
    )


@pytest.mark.parametrize(("normals", "coordinates"), [(0, 0), (4, 0), (4, 4)])
def test_tetrahedron_has_its_volume(tmp_path: Path, normals: int, coordinates: int) -> None:
    path = tmp_path / "a.msh"
    path.write_bytes(msh(FACES, normals=normals, coordinates=coordinates))
    assert read_msh(path).volume == pytest.approx(1.0 / 6.0)


def test_vertices_without_faces_are_those_of_a_hull(tmp_path: Path) -> None:
    path = tmp_path / "a.msh"
    path.write_bytes(msh([]))
    assert read_msh(path).volume == pytest.approx(1.0 / 6.0)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"abc", "too short"),
        (msh(FACES)[:-1], "the header speaks of"),
        (struct.pack("<4i", -1, 0, 0, 1) + bytes(0), "the header speaks of"),
        (struct.pack("<4i", 2_000_000_000, 0, 0, 0), "the header speaks of"),
        (msh([(0, 1, 4)]), "a vertex that does not exist"),
        (msh([(0, 1, -1)]), "a vertex that does not exist"),
    ],
)
def test_counts_that_do_not_fit_are_refused(tmp_path: Path, content: bytes, reason: str) -> None:
    path = tmp_path / "a.msh"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=reason):
        read_msh(path)
