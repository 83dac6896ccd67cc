"""The export door: what is repaired is repaired and told, what is not names its part."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import manifold3d
import mujoco
import numpy as np
import pytest
from synth import toy_cabinet_twin

from part2gs_robotics.errors import ExportError
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.sound import plain_name, sound_mesh, sound_twin
from part2gs_robotics.model.solids import defect, to_manifold, to_mesh
from part2gs_robotics.model.twin import PartMesh, Texture, Twin

CUBE = to_mesh(manifold3d.Manifold.cube((1.0, 1.0, 1.0)))
FLAT = PartMesh(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]),
                np.array([[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]]), np.zeros((4, 3), np.uint8))


def soup(mesh: PartMesh) -> PartMesh:
    """Return the mesh with corners of its own for every face."""
    at = mesh.faces.ravel()
    return PartMesh(mesh.vertices[at], np.arange(len(at)).reshape(-1, 3), mesh.colors[at])


def overlapping() -> PartMesh:
    other = CUBE.vertices + 0.5
    return PartMesh(np.concatenate([CUBE.vertices, other]),
                    np.concatenate([CUBE.faces, CUBE.faces + len(other)]),
                    np.concatenate([CUBE.colors, CUBE.colors]))


@pytest.mark.parametrize(("mesh", "told", "volume"), [
    (CUBE, None, 1.0),
    (replace(CUBE, faces=CUBE.faces[2:]), "hole", 1.0),
    (replace(CUBE, faces=CUBE.faces[1:]), "hole", 1.0),
    (replace(CUBE, faces=CUBE.faces[:, ::-1]), "inward", 1.0),
    (soup(CUBE), "same place", 1.0),
    (soup(replace(CUBE, faces=CUBE.faces[2:, ::-1])), "inward", 1.0),
    (overlapping(), "united", 2 - 0.125),
])
def test_repairs_are_told(mesh: PartMesh, told: str | None, volume: float) -> None:
    notes: list[str] = []
    found = sound_mesh(mesh, "part_7", notes)
    assert defect(found) is None
    # a fan closes a hole around an edge of the cube with its middle, which lies inside
    rough = 0.2 if len(mesh.faces) < len(CUBE.faces) else 1e-9
    assert to_manifold(found).volume() == pytest.approx(volume, rel=rough)
    assert (told is None and not notes) or any(told in n and "part_7" in n for n in notes)


def test_texture_stays_with_its_faces_through_repairs() -> None:
    uv = np.random.default_rng(0).random((len(CUBE.faces), 3, 2)).astype(np.float32)
    mesh = replace(CUBE, faces=CUBE.faces[2:, ::-1],
                   texture=Texture(uv[2:], np.zeros((4, 4, 3), np.uint8)))
    found = sound_mesh(mesh, "a", [])
    assert len(found.texture.uv) == len(found.faces)
    np.testing.assert_array_equal(found.texture.uv[:len(uv) - 2], uv[2:, ::-1])


@pytest.mark.parametrize(("mesh", "said"), [
    (replace(CUBE, faces=CUBE.faces[:1]), "not closed"), (FLAT, "not closed"),
    (replace(CUBE, vertices=CUBE.vertices * (1, 1, 0)), "not closed"),
    (replace(CUBE, vertices=np.where(CUBE.vertices > 0.5, np.nan, CUBE.vertices)), "not finite"),
    (replace(CUBE, faces=CUBE.faces[:0]), "not closed"),
    (replace(CUBE, vertices=CUBE.vertices * 1e-4), "has mass 6e-10"),
], ids=["one triangle", "coplanar", "no volume", "NaN", "empty", "0.1 mm"])
def test_what_cannot_be_repaired_names_its_part(mesh: PartMesh, said: str) -> None:
    twin = toy_cabinet_twin(2)
    bad = replace(twin.parts[1], name="lid 3", mesh=mesh)
    with pytest.raises(ExportError, match=said) as caught:
        sound_twin(replace(twin, parts=(twin.parts[0], bad, twin.parts[2])))
    assert "lid_3: " in str(caught.value)


def test_flat_pieces_are_left_out_and_the_hull_takes_their_place(tmp_path: Path) -> None:
    twin = toy_cabinet_twin(2)
    parts = (twin.parts[0], replace(twin.parts[1], pieces=(FLAT,)),
             replace(twin.parts[2], pieces=(*twin.parts[2].pieces, FLAT)))
    found = sound_twin(replace(twin, parts=parts))
    assert [len(p.pieces) for p in found.parts] == [6, 1, 1]
    assert sum("flat collision" in n for n in found.notes) == 2
    assert any("part_1" in n and "hull" in n for n in found.notes)
    write_mjcf(found, tmp_path)
    mujoco.MjModel.from_xml_path(str(tmp_path / "twin.xml"))


@pytest.mark.parametrize(("name", "plain"), [
    ("part_1", "part_1"), ("Tür <links> & \"x\"", "tur_links_x"), ("部品", "part_0"),
    ("", "part_0"), ("a b", "a_b"), ("9", "n_9"), ("world", "world_2"), ("x" * 999, "x" * 60),
    ("\x00\n", "part_0"),
])
def test_names(name: str, plain: str) -> None:
    assert plain_name(name, "part_0", {"world"}) == plain


def test_names_differ_and_changes_are_told() -> None:
    twin = toy_cabinet_twin(3)
    names = ("Base", "a_turn", "A", "a")
    odd: Twin = replace(twin, name="<Küche>", parts=tuple(
        replace(p, name=n) for p, n in zip(twin.parts, names, strict=True)))
    found = sound_twin(odd)
    assert found.name == "kuche"
    own = [p.name for p in found.parts]
    assert len(set(own) | {f"{n}_turn" for n in own}) == 8
    for before, after in (("<Küche>", "kuche"), ("Base", "base")):
        assert any(repr(before) in n and repr(after) in n for n in found.notes)
    again = sound_twin(found)
    assert again.notes == found.notes
