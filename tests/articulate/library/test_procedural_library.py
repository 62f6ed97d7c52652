"""Ids of the procedural library, and what is written for them."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from articulate.errors import AssetError
from articulate.library import Library, ProceduralLibrary
from articulate.library.procedural.categories import CATEGORIES


def _bytes_of(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_ids_go_by_category_and_seed():
    library: Library = ProceduralLibrary(count=2)
    ids = list(library.ids())
    assert len(ids) == len(set(ids)) == 2 * len(CATEGORIES)
    assert ids[:2] == ["cabinet-0000", "cabinet-0001"]
    assert library.category("box_with_lid-1") == "Box"


@pytest.mark.parametrize("name", CATEGORIES)
def test_the_same_id_gives_the_same_bytes_in_any_process(name, tmp_path):
    library = ProceduralLibrary()
    path = library.write(f"{name}-0003", tmp_path / "a")
    library.write(f"{name}-3", tmp_path / "b")
    assert path == tmp_path / "a" / f"{name}.urdf"
    assert _bytes_of(tmp_path / "a") == _bytes_of(tmp_path / "b")
    library.write(f"{name}-0004", tmp_path / "c")
    assert _bytes_of(tmp_path / "a") != _bytes_of(tmp_path / "c")


@pytest.mark.parametrize(
    "names",
    [list(CATEGORIES)[::4], pytest.param(list(CATEGORIES), marks=pytest.mark.slow)],
    ids=len,
)
def test_another_process_writes_the_same_bytes(tmp_path, names):
    """Hash seeds and import order must not matter."""
    code = (
        "import sys; from pathlib import Path; from articulate.library import ProceduralLibrary\n"
        "for name in sys.argv[2:]: ProceduralLibrary().write(name + '-2', Path(sys.argv[1], name))"
    )
    subprocess.run([sys.executable, "-c", code, tmp_path / "other", *names], check=True)
    for name in names:
        ProceduralLibrary().write(f"{name}-2", tmp_path / "here" / name)
    assert _bytes_of(tmp_path / "here") == _bytes_of(tmp_path / "other")


def test_source_licence_and_category_stand_beside_the_urdf(tmp_path):
    ProceduralLibrary().write("box_with_lid-7", tmp_path)
    said = json.loads((tmp_path / "source.json").read_text())
    assert said == {
        "source": "procedural box_with_lid, seed 7",
        "licence": "MIT",
        "category": "Box",
    }


@pytest.mark.parametrize(
    ("object_id", "says"),
    [
        ("box_with_lit-0003", "no procedural category 'box_with_lit'; did you mean box_with_lid"),
        ("cabinett", "did you mean cabinet"),
        ("cabinet", "give a seed as well: cabinet-0000"),
        ("cabinet-0100", "seeds of cabinet go from 0 to 99"),
        ("../cabinet-1", "no procedural category"),
        ("", "no procedural category ''"),
    ],
)
def test_an_unknown_id_is_answered_in_one_line_with_the_nearest(object_id, says, tmp_path):
    with pytest.raises(AssetError, match=says) as caught:
        ProceduralLibrary().write(object_id, tmp_path / "x")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "x").exists()


def test_the_table_of_the_documents_lists_every_category():
    page = Path(__file__).resolve().parents[3] / "docs" / "reference" / "library.md"
    told = [
        line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| `")
    ]
    known = []
    for name, category in CATEGORIES.items():
        joints = ", ".join(f"`{part.motion.name}`" for part in category.parts(0)[1:])  # type: ignore[union-attr]
        known.append(f"| `{name}` | {category.partnet} | {joints} |")
    assert told == known
