"""Names of the shapes that a file gives itself."""

from articulate.convert.convert import convert
from articulate.library.procedural.cabinet import embedded_cabinet


def test_only_the_shapes_of_the_handle_are_called_handle(tmp_path):
    """A named handle is looked for first; a drawer that is all handle would say nothing."""
    asset = convert(embedded_cabinet(tmp_path / "cabinet"), tmp_path / "out")
    text = asset.mjcf_path.read_text()
    for k in range(3):
        assert text.count(f'name="drawer_{k}_handle_') == 3  # a bar and two posts
        assert text.count(f'name="drawer_{k}_collision_') == 5  # front and tray
