"""Model files of others: nothing outside their folder is read, nothing hides behind a name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from part2gs_robotics.assets.model_files import check_model_files
from part2gs_robotics.errors import CheckError

Make = Callable[..., Path]


@pytest.fixture
def model(tmp_path: Path) -> Make:
    def write(text: str, name: str = "model.xml") -> Path:
        (tmp_path / "model").mkdir(exist_ok=True)
        (tmp_path / "model" / name).write_text(text)
        return tmp_path / "model" / name

    return write


def with_mesh(name: str, folder: str = "") -> str:
    compiler = f'<compiler meshdir="{folder}"/>' if folder else ""
    return f'<mujoco>{compiler}<asset><mesh file="{name}"/></asset></mujoco>'


@pytest.mark.parametrize(
    "text",
    [
        with_mesh("../secret.stl"),
        with_mesh("a/../../secret.stl"),
        with_mesh("/etc/passwd"),
        with_mesh("file:///etc/passwd"),
        with_mesh("http://example.com/a.stl"),
        with_mesh("..\\secret.stl"),
        with_mesh("link.stl"),
        with_mesh("secret.stl", ".."),
        with_mesh("passwd", "/etc"),
        with_mesh("package://../secret.stl"),
        with_mesh("a" * 5000),
        with_mesh("loop.stl"),
        '<mujoco><include file="../other.xml"/></mujoco>',
        '<mujoco><asset><texture fileup="/etc/passwd"/></asset></mujoco>',
        '<mujoco><asset><hfield file="../../h.png"/></asset></mujoco>',
        '<robot name="r"><link name="b"><visual><geometry><mesh filename="../secret.stl"/>'
        "</geometry></visual></link></robot>",
    ],
)
def test_references_that_leave_the_folder_are_refused(model: Make, tmp_path: Path, text: str):
    (tmp_path / "secret.stl").write_text("secret")
    path = model(text)
    (path.parent / "link.stl").symlink_to(tmp_path / "secret.stl")
    (path.parent / "loop.stl").symlink_to("loop.stl")
    with pytest.raises(CheckError, match="leaves the folder"):
        check_model_files(path)


def test_includes_are_followed_and_inspected(model: Make, tmp_path: Path):
    model('<mujocoinclude><include file="c.xml"/></mujocoinclude>', "b.xml")
    main = model('<mujoco><include file="b.xml"/></mujoco>')
    leaf = model(with_mesh("ok.stl"), "c.xml")
    assert {p.name for p in check_model_files(main)} == {"model.xml", "b.xml", "c.xml"}
    leaf.write_text(with_mesh("../../secret.stl"))
    with pytest.raises(CheckError, match=r"c\.xml: refers to '\.\./\.\./secret\.stl'"):
        check_model_files(main)
    leaf.write_text('<mujocoinclude><include file="model.xml"/></mujocoinclude>')
    assert len(check_model_files(main)) == 3  # a loop ends


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_entities_are_refused_in_any_encoding(model: Make, encoding: str):
    path = model("")
    bomb = '<!DOCTYPE m [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><mujoco model="&b;"/>'
    path.write_bytes(bomb.encode(encoding))
    with pytest.raises(CheckError, match="document type declaration"):
        check_model_files(path)


def test_meshes_below_the_folder_are_accepted(model: Make):
    path = model(with_mesh("../textures/a.stl", "meshes"))
    assert check_model_files(path) == (path,)


def test_included_files_are_inspected_whatever_their_suffix(model: Make, tmp_path: Path):
    """MuJoCo parses `a.txt` and an attached `arm.dat` as XML: so does the inspection."""
    leak = with_mesh("../../secret.stl")
    main = model('<mujoco><include file="a.txt"/></mujoco>')
    model(leak, "a.txt")
    with pytest.raises(CheckError, match=r"a\.txt: refers to '\.\./\.\./secret\.stl'"):
        check_model_files(main)
    model('<mujoco><asset><model name="m" file="arm.dat"/></asset></mujoco>', "a.txt")
    model(leak, "arm.dat")
    with pytest.raises(CheckError, match=r"arm\.dat: refers to"):
        check_model_files(main)
    model('<!DOCTYPE a [<!ENTITY b "c">]><mujoco/>', "arm.dat")
    with pytest.raises(CheckError, match="document type declaration"):
        check_model_files(main)


def test_folders_of_one_file_hold_for_names_of_another(model: Make, tmp_path: Path):
    main = model('<mujoco><compiler assetdir="sub"/><include file="a.txt"/></mujoco>')
    sub = main.parent / "sub"
    sub.mkdir()
    asset = '<asset><model name="m" file="arm"/><mesh file="b.stl"/></asset>'
    model(f"<mujoco>{asset}</mujoco>", "a.txt")
    (sub / "arm").write_text(with_mesh("/etc/passwd"))
    with pytest.raises(CheckError, match=r"arm: refers to '/etc/passwd'"):
        check_model_files(main)
    (sub / "arm").write_text("<mujoco/>")
    assert {p.name for p in check_model_files(main)} == {"model.xml", "a.txt", "arm"}
    (tmp_path / "secret.stl").write_text("secret")
    (sub / "b.stl").symlink_to(tmp_path / "secret.stl")
    with pytest.raises(CheckError, match=r"a\.txt: refers to 'b\.stl'"):
        check_model_files(main)


def test_every_file_a_name_can_mean_is_inspected(model: Make):
    """`e.xml` beside the main file hides one beside the file that includes it, or not."""
    main = model('<mujoco><include file="sub/d.xml"/></mujoco>')
    (main.parent / "sub").mkdir()
    model('<mujoco><include file="e.xml"/></mujoco>', "sub/d.xml")
    model("<mujoco/>", "e.xml")
    model(with_mesh("../../x/secret.stl"), "sub/e.xml")
    with pytest.raises(CheckError, match=r"sub/e\.xml: refers to"):
        check_model_files(main)


def test_too_many_includes_are_refused(model: Make):
    names = "".join(f'<include file="{i}.txt"/>' for i in range(250))
    with pytest.raises(CheckError, match="more than 200 files"):
        check_model_files(model(f"<mujoco>{names}</mujoco>"))


@pytest.mark.parametrize("name", ["%s%n", "%n", "%10.3s", "%-5ln"])
def test_a_name_that_is_a_format_is_refused(model: Make, name: str) -> None:
    """MuJoCo prints some names through a C format: %n writes into the memory."""
    with pytest.raises(CheckError, match="format"):
        check_model_files(model(f'<mujoco model="{name}"/>'))


def test_a_percent_sign_alone_is_a_name(model: Make) -> None:
    check_model_files(model('<mujoco model="50% of it, %20file"/>'))
