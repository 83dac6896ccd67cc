"""Pictures of the report: what the joint explains is not marked, and a wrong joint shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from toys import Box, cameras, cast, gaussians_of, scene_of

from part2gs_robotics.config import Config
from part2gs_robotics.model import se3
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.motion import LeftOver, Motion
from part2gs_robotics.model.scene_frame import SceneFrame
from part2gs_robotics.model.solids import to_mesh
from part2gs_robotics.model.twin import Part, Twin
from part2gs_robotics.pictures import PICTURES, pictures_of
from part2gs_robotics.plan import Plan
from part2gs_robotics.report.unexplained import unexplained
from part2gs_robotics.result import BuildResult

BASE, BLOCK = Box((0, 0, 0), (1, 1, 0.2), 1), Box((0.1, 0.1, 0.25), (0.4, 0.9, 0.5), 2)
JOINT = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.45)
FRAME = SceneFrame(2.0, (1.0, -3.0, 0.5))
SIDE = 96
NOTHING = LeftOver(0.0, 0.02, (-1, -1), (np.zeros((SIDE, SIDE), bool),) * 2)


def built(joint: Joint) -> BuildResult:
    """Return a build of a block that slid by JOINT, said to have moved by another joint."""
    import manifold3d

    eyes = cameras(16, SIDE, np.array([0.6, 0.5, 0.2]), 1.4)
    boxes = (BASE, BLOCK), (BASE, replace(BLOCK, move=JOINT.transform(JOINT.value)))
    held_out = np.arange(16) % 4 == 0
    states = tuple(replace(cast(pair, *eyes, SIDE), held_out=held_out) for pair in boxes)
    fits, probs = [], []
    for pair in boxes:
        gaussians, owner = gaussians_of(pair, 0.02)
        fits.append((gaussians, ((0.0, 30.0),)))
        probs.append(np.eye(2, dtype=np.float32)[owner])
    meshes = [to_mesh(manifold3d.Manifold.cube(np.subtract(box.hi, box.lo)).translate(box.lo))
              for box in (BASE, BLOCK)]
    meshes = [replace(mesh, vertices=FRAME.points(mesh.vertices)) for mesh in meshes]
    in_scene = replace(joint, value=2 * joint.value)
    twin = Twin("slide", (Part("base", -1, meshes[0], (), None),
                          Part("part_1", 0, meshes[1], (), in_scene, (0.0, 0.9))))
    return BuildResult(scene_of(states), FRAME, tuple(fits),
                       Motion(tuple(probs), (joint,), (0,)), NOTHING, twin, Plan(()), Config(), {})


# Blurred outlines are up to 7 % of a block of 20 pixels; half the way, half the block is astray.
@pytest.mark.parametrize(("share", "least", "most"), [(1.0, 0.0, 0.1), (0.5, 0.2, 1.0)])
def test_the_true_joint_explains_the_photos_and_half_of_it_does_not(
        share: float, least: float, most: float) -> None:
    pictures = pictures_of(built(replace(JOINT, value=share * JOINT.value)))
    differs = [found.differs for p in pictures if (found := unexplained(p)) is not None]
    assert len(differs) == 2 * PICTURES
    assert least <= min(differs) <= max(differs) <= most


def test_pictures_stand_where_their_cameras_do() -> None:
    """A point of the scene's frame lands on the pixel where the internal one does."""
    result = built(JOINT)
    for picture in pictures_of(result):
        state = result.scene.states[picture.state]
        view = next(v for v, name in enumerate(state.names) if picture.caption.endswith(name))
        place = np.array([0.3, 0.7, 0.4])
        inside = se3.apply(state.viewmats[view], place[None])[0]
        outside = se3.apply(se3.inverse(picture.world_from_camera), FRAME.points(place)[None])[0]
        np.testing.assert_allclose(outside[:2] / outside[2], inside[:2] / inside[2], atol=1e-9)
        assert np.tan(picture.fov / 2) * state.Ks[view, 1, 1] == pytest.approx(SIDE / 2)


def test_of_each_state_the_first_photo_is_from_where_the_part_went() -> None:
    pictures = pictures_of(built(JOINT))
    first = [next(p for p in pictures if p.state == state) for state in (0, 1)]
    for picture in first:
        assert picture.render is None
        way = picture.world_from_camera[:3, 3] - FRAME.points(np.array([0.5, 0.5, 0.1]))
        assert way[0] > 0.6 * np.linalg.norm(way), "the block slid along +x"
