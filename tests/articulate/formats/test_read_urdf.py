"""URDFs that are xacros, Git LFS pointers, or too large."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.articulate.conversion.boxes import AXIS, BODY_BOX, made, repairs_text

from articulate.conversion import convert
from articulate.errors import AssetError
from articulate.formats.read_urdf import read_urdf


def more(text: str) -> tuple[str, str]:
    """Put ``text`` before the end of the file."""
    return "</robot>", f"{text}</robot>"


def test_a_xacro_is_distinguished_from_a_urdf(tmp_path: Path) -> None:
    text = "<robot xmlns:xacro='http://wiki.ros.org/xacro' name='x'><xacro:macro name='m'/></robot>"
    (tmp_path / "a.urdf.xacro").write_text(text)
    with pytest.raises(
        AssetError, match=r"not expanded \(macro\).*: xacro a\.urdf\.xacro > object"
    ):
        read_urdf(tmp_path / "a.urdf.xacro")


MACRO = """<xacro:macro name="front" params="n">
  <link name="extra"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
  <xacro:if value="${n}"><joint name="x" type="fixed"/></xacro:if>
</xacro:macro>"""


@pytest.mark.parametrize(
    "text",
    [
        MACRO + '<xacro:front n="1"/>',
        '<xacro:include filename="drawer.xacro"/>',
        '<include filename="drawer.xacro"/>',
        '<xacro:if value="1"><link name="extra"/></xacro:if>',
        '<link name="frame"><xacro:insert_block name="origin"/></link>',
    ],
)
@pytest.mark.parametrize("declared", [True, False])
def test_a_macro_call_or_an_include_leaves_parts_out(
    tmp_path: Path, text: str, declared: bool
) -> None:
    name = '<robot name="two"'
    namespace = (name, f'{name} xmlns:xacro="http://www.ros.org/wiki/xacro"')
    with pytest.raises(AssetError, match=r"macros are not expanded \(.*\): run xacro on the file"):
        made(tmp_path, more(text), *([namespace] if declared else []))


@pytest.mark.parametrize("text", [MACRO, '<xacro:property name="w" value="2"/>', "<!-- xacro -->"])
def test_a_property_or_a_definition_that_is_not_called_may_stay(tmp_path: Path, text: str) -> None:
    asset = made(tmp_path, more(text))
    assert [joint.name for joint in asset.joints] == ["slide"]
    assert ("macros are not expanded" in repairs_text(asset)) is ("<xacro" in text)


def test_expressions_of_a_xacro_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="is not made of numbers; expand the xacro first"):
        made(tmp_path, (AXIS, '<axis xyz="${side} 0 0"/>'))
    mesh = '<mesh filename="$(find pkg)/a.obj"/>'
    with pytest.raises(AssetError, match="of <mesh>; expand the xacro first"):
        made(tmp_path / "two", (BODY_BOX, mesh))


def test_a_git_lfs_pointer_is_named_with_its_command(tmp_path: Path) -> None:
    pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:1\nsize 9\n"
    (tmp_path / "body.obj").write_text(pointer)
    with pytest.raises(AssetError, match=r"body\.obj: a Git LFS pointer.*git lfs pull"):
        made(tmp_path, (BODY_BOX, '<mesh filename="body.obj"/>'))
    (tmp_path / "two.urdf").write_text(pointer)
    with pytest.raises(AssetError, match=r"two\.urdf: a Git LFS pointer.*git lfs pull"):
        convert(tmp_path / "two.urdf", tmp_path / "out")


@pytest.mark.parametrize("element", ["link", "joint"])
def test_very_many_links_or_joints_are_rejected(tmp_path: Path, element: str) -> None:
    many = "".join(f'<{element} name="n{k}" type="fixed"/>' for k in range(90_000))
    with pytest.raises(AssetError, match="at most 400 are accepted"):
        made(tmp_path, more(many))
