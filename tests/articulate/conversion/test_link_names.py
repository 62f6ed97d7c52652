"""Names of the shapes and frames that a file gives itself."""

from pathlib import Path

from tests.articulate.conversion.boxes import loaded, made

from articulate.conversion.convert import convert
from articulate.library.procedural.cabinet import embedded_cabinet
from articulate.library.procedural.categories import CATEGORIES, write_object


def test_only_the_shapes_of_the_handle_are_called_handle(tmp_path):
    """A named handle is looked for first; a drawer that is all handle would be ambiguous."""
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


def test_frames_called_as_a_handle_have_sites_of_their_own(tmp_path: Path) -> None:
    """Also where the first free name is that of another frame, in any part."""
    frames = "".join(
        f'<link name="{name}"/><joint name="f{k}" type="fixed"><parent link="{part}"/>'
        f'<child link="{name}"/><origin xyz="{0.01 * k} 0 0"/></joint>'
        for k, (name, part) in enumerate(
            [("handle_slide", "drawer"), ("handle_slide_2", "drawer"), ("handle_slide_3", "body")]
        )
    )
    asset = made(tmp_path, ("</robot>", f"{frames}</robot>"))
    model = loaded(asset)
    sites = {model.site(s).name for s in range(model.nsite)}
    assert sites == {"handle_slide", *(f"handle_slide_{k}" for k in (2, 3, 4))}
