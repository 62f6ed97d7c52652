"""Names of the shapes that a file gives itself."""

from articulate.convert.convert import convert
from articulate.library.procedural.cabinet import embedded_cabinet
from articulate.library.procedural.categories import CATEGORIES, write_object


def test_only_the_shapes_of_the_handle_are_called_handle(tmp_path):
    """A named handle is looked for first; a drawer that is all handle would say nothing."""
    asset = convert(embedded_cabinet(tmp_path / "cabinet"), tmp_path / "out")
    text = asset.mjcf_path.read_text()
    for k in range(3):
        assert text.count(f'name="drawer_{k}_handle_') == 3  # a bar and two posts
        assert text.count(f'name="drawer_{k}_collision_') == 5  # front and tray


def test_shapes_that_a_file_gives_are_not_joined_over_the_room_between_them(tmp_path):
    """The cells of this table's drawers are so flat that a box over one looks like a good fit."""
    asset = convert(write_object("table_with_drawers", 1, tmp_path / "table"), tmp_path / "out")
    parts = CATEGORIES["table_with_drawers"].parts(1)
    assert asset.link("table").collisions == len(parts[0].solids)
