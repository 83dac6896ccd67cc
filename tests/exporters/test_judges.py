"""Programs that do not know this project judge its twins; where one errs is shown beside it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from manifold3d import Manifold
from synth import box, toy_cabinet_twin

from part2gs_robotics.exporters.urdf import write_urdf
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.solids import to_manifold, to_mesh
from part2gs_robotics.model.twin import Part, PartMesh, Twin

GREY = (90, 90, 90)
PASSES = 0.99  # of the range


@pytest.fixture(scope="module")
def judges(load):
    return load("judges")


@pytest.fixture(scope="module")
def twins(judges):
    return judges.toys()


@pytest.fixture(scope="module")
def urdfs(judges, twins, tmp_path_factory):
    folder = tmp_path_factory.mktemp("judged")
    return {name: judges.export(twin, folder / name) for name, twin in twins.items()}


@pytest.fixture(scope="module")
def reports(judges, urdfs):
    files = [urdf.with_name(name) for urdf in urdfs.values() for name in ("twin.urdf", "scene.xml")]
    found = judges.simcheck(files)
    return {name: found[2 * i : 2 * i + 2] for i, name in enumerate(urdfs)}


TOYS = ("cabinet", "slide", "hinge", "screw", "chain")


@pytest.mark.parametrize("name", TOYS)
def test_urdfdom_reads_a_tree_that_hangs_on_the_world(judges, urdfs, name):
    assert judges.check_urdf(urdfs[name]) == "root world"


@pytest.mark.parametrize("name", TOYS)
def test_yourdfpy_puts_every_part_where_we_do(judges, twins, urdfs, name):
    assert judges.yourdfpy_error(twins[name], urdfs[name]) < 1e-6


@pytest.mark.parametrize("name", TOYS)
def test_simcheck_finds_no_error(reports, name):
    urdf, mjcf = reports[name]
    assert (urdf["counts"]["error"], mjcf["counts"]["error"]) == (0, 0)
    assert mjcf["verdict"] == "PASS"
    # Wrong: the turn of a screw has no shape, so no contact of it can be unstable.
    masses = [f for f in urdf["findings"] if f.startswith("inertia.mass: 'part_4_turn'")]
    assert urdf["findings"] == masses
    assert len(masses) == (name in ("cabinet", "screw"))


def test_what_simcheck_fears_has_no_shape(urdfs):
    links = {link.get("name"): link for link in ET.parse(urdfs["screw"]).iter("link")}
    assert links["part_4_turn"].find("collision") is None
    assert links["part_4"].find("collision") is not None


@pytest.mark.parametrize("name", TOYS)
def test_bullet_passes_every_range_with_self_collision(judges, urdfs, name):
    pytest.importorskip("pybullet", reason="has wheels for Python 3.11 only")
    assert min(judges.bullet_reach(urdfs[name]).values()) >= PASSES


def blocked() -> Twin:
    """Return the cabinet's drawer with a wall across its way, at a third of its range."""
    twin = toy_cabinet_twin(1)
    base, drawer = twin.parts
    wall = to_mesh(box((0.6, 0.25, 0.1), (0.62, 0.35, 0.2)), GREY)
    return replace(twin, parts=(replace(base, pieces=(*base.pieces, wall)), drawer))


@pytest.mark.parametrize("kept", [0.001, 0.02])
def test_bullet_finds_a_wall_across_the_way(judges, tmp_path, kept):
    pytest.importorskip("pybullet", reason="has wheels for Python 3.11 only")
    write_urdf(blocked(), tmp_path)
    (reach,) = judges.bullet_reach(tmp_path / "twin.urdf", kept).values()
    assert reach == pytest.approx(0.1 / 0.3, abs=0.02)
    assert judges.check_urdf(tmp_path / "twin.urdf") == "root world"  # which sees no physics


def chamfered(piece: PartMesh) -> PartMesh:
    """Return a piece without an edge: no box, so that PyBullet puts its margin round it."""
    level = (piece.vertices[:, :2].sum(1).min() + 0.002) / np.sqrt(2)
    return to_mesh(to_manifold(piece).trim_by_plane([1.0, 1.0, 0.0], float(level)), GREY)


def passing(seed: int = 29) -> Twin:
    """Return a board that slides over two others, turned by a degree or two, millimetres apart."""
    rng = np.random.default_rng(seed)
    gap = rng.uniform(0.0025, 0.006)

    def board(low, size):
        solid = Manifold.cube([float(s) for s in size]).translate([float(x) for x in low])
        return chamfered(to_mesh(solid.rotate([0, 0, float(rng.uniform(-3, 3))]), GREY))

    pieces = tuple(board((x, -0.3, -0.05), (rng.uniform(0.02, 0.2), 0.6, 0.05))
                   for x in (-0.2, 0.1))
    board_x = rng.uniform(-0.3, -0.05)
    mover = board((board_x, -0.25, gap), (rng.uniform(0.05, 0.2), 0.5, 0.018))
    joint = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.3)
    parts = (Part("base", -1, pieces[0], pieces, None),
             Part("part_1", 0, mover, (mover,), joint, (0.0, 0.4)))
    return Twin("passing", parts, meters_per_unit=1.0, up=np.array([0, 0, 1.0]))


def test_bullet_by_default_stops_boards_in_free_air(judges, tmp_path):
    pytest.importorskip("pybullet", reason="has wheels for Python 3.11 only")
    twin = passing()
    gap = twin.parts[1].mesh.vertices[:, 2].min() - max(
        piece.vertices[:, 2].max() for piece in twin.parts[0].pieces)
    assert gap > 0.0021  # more than two margins, on the whole way: nothing moves along z
    write_urdf(twin, tmp_path)
    (free,) = judges.bullet_reach(tmp_path / "twin.urdf", 0.001).values()
    (stuck,) = judges.bullet_reach(tmp_path / "twin.urdf", 0.02).values()
    assert free > PASSES
    assert stuck < 0.8


@pytest.mark.parametrize(("clearance", "boxes", "passes"),
                         [(0.0015, False, False), (0.003, False, True), (0.0015, True, True)])
def test_bullet_needs_two_margins_of_a_millimetre_except_round_boxes(judges, tmp_path, clearance,
                                                                     boxes, passes):
    pytest.importorskip("pybullet", reason="has wheels for Python 3.11 only")
    twin = toy_cabinet_twin(1, clearance=clearance)
    if not boxes:
        twin = replace(twin, parts=tuple(
            replace(part, pieces=tuple(chamfered(piece) for piece in part.pieces))
            for part in twin.parts))
    write_urdf(twin, tmp_path)
    (reach,) = judges.bullet_reach(tmp_path / "twin.urdf").values()
    assert (reach >= PASSES) == passes
