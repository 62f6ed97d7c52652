"""Pieces of one element of the source are written as one mesh, under the names they go by."""

import numpy as np
import pytest
import trimesh

from articulate.formats.load_meshes import Piece
from articulate.formats.mesh_file import read_mesh
from articulate.formats.repairs import Repairs
from articulate.formats.textures import named_files
from articulate.reconstruct.program.elements import common_name, elements_of, write_element

RED, BLUE, GLASS = (1.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0), (0.5, 0.5, 0.5, 0.3)


def piece(name, rgba=RED, element="0", at=(0.0, 0.0, 0.0), link="body"):
    mesh = trimesh.creation.box((0.1, 0.2, 0.3), trimesh.transformations.translation_matrix(at))
    return Piece(name=name, mesh=mesh, rgba=rgba, link=link, element=element)


def test_pieces_are_together_by_element_in_their_order():
    a, b, c = piece("a"), piece("b", element="1"), piece("c", BLUE)
    assert elements_of([a, b, c]) == [[a, c], [b]]
    assert elements_of([]) == []
    assert elements_of([a, piece("d", link="door")]) != [[a, piece("d", link="door")]]


def test_glass_stays_by_itself_for_meshes_tell_no_opacity():
    wood, one, two = piece("wood"), piece("one", GLASS), piece("two", GLASS)
    assert elements_of([one, wood, two]) == [[one], [wood], [two]]


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("link_1 handle-12 new-0 red", "link_1 handle-12 new-0 blue"), "link_1 handle-12 new-0"),
        (("link_1 frame new-0 red",), "link_1 frame new-0 red"),
        (("red", "blue"), "red"),
    ],
)
def test_an_element_goes_by_the_words_that_its_pieces_share(names, words):
    assert common_name([piece(name) for name in names]) == words


def test_one_mesh_of_several_colours_is_read_as_it_was(tmp_path):
    pieces = [piece("a"), piece("b", BLUE, at=(1.0, 0.0, 0.0))]
    write_element(pieces, tmp_path, "p000")
    assert named_files(tmp_path / "p000.obj") == [tmp_path / "p000.mtl"]
    groups = {colour: mesh for _, mesh, colour in read_mesh(tmp_path / "p000.obj", Repairs())}
    assert set(groups) == {RED, BLUE}
    for one in pieces:
        np.testing.assert_allclose(groups[one.rgba].bounds, one.mesh.bounds, atol=1e-9)
        assert groups[one.rgba].area == pytest.approx(one.mesh.area)


def test_one_colour_needs_no_file_of_materials(tmp_path):
    write_element([piece("a")], tmp_path, "p000")
    assert [path.name for path in tmp_path.iterdir()] == ["p000.obj"]
