"""Scenes of any unit at any place share their internal arrays, and the twin goes back to them."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from synth import toy_cabinet_twin

from part2gs_robotics import cli
from part2gs_robotics.config import ReadConfig
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.scene_frame import (
    GRID,
    NEAREST_DEPTH,
    USUAL_DISTANCE,
    SceneFrame,
    frame_of,
    gaussians_in_scene,
    internal,
    joint_in_scene,
    parts_in_scene,
)
from part2gs_robotics.model.twin import Twin
from part2gs_robotics.readers.read_scene import read_scene
from part2gs_robotics.sim_checks import check

DIAGONAL = 2.6  # of the ball scene
FRAME = SceneFrame(0.02, (5.0, -3.0, 40.0))


@pytest.fixture(scope="module")
def seen(toy: Any) -> Scene:
    """Return two states of a box beside the origin, with exact depth."""
    boxes = [toy.Box((0.1, 0, 0), (0.5, 0.4, 0.3), 1)]
    eyes = toy.cameras(12, 24, np.array([0.3, 0.2, 0.15]), 0.8)
    state = toy.cast(boxes, *eyes, 24)
    counts = np.asarray(np.rint(1000 * state.depths), np.uint16)
    state = replace(state, depth_counts=(counts, np.full(12, 1e-3)))
    return replace(toy.scene_of((state, state)), meters_per_unit=0.5)


def placed(scene: Scene, scale: float, shift: Any = (0.0, 0.0, 0.0)) -> Scene:
    """Return the scene in another unit at another place, as its files would tell."""
    states = []
    for state in scene.states:
        world_from_camera = np.linalg.inv(state.viewmats)
        world_from_camera[:, :3, 3] = scale * world_from_camera[:, :3, 3] + shift
        viewmats = state.viewmats.copy()
        viewmats[:, :3, 3] = -np.einsum("vij,vj->vi", viewmats[:, :3, :3],
                                        world_from_camera[:, :3, 3])
        counts, units = state.depth_counts or (None, None)
        assert counts is not None
        assert units is not None
        states.append(replace(state, viewmats=viewmats, depth_counts=(counts, units * scale),
                              depths=(counts * units[:, None, None] * scale).astype(np.float32)))
    return replace(scene, states=(states[0], states[1]))


def assert_same_inside(one: Scene, two: Scene) -> None:
    for a, b in zip(internal(one, frame_of(one)).states, internal(two, frame_of(two)).states,
                    strict=True):
        assert a.depths is not None
        assert b.depths is not None
        assert a.viewmats.tobytes() == b.viewmats.tobytes()
        assert a.depths.tobytes() == b.depths.tobytes()


@pytest.mark.parametrize("power", [-20, -3, 1, 10])
def test_powers_of_two_are_bit_equal_inside(seen: Scene, power: int) -> None:
    scaled = replace(seen, states=tuple(  # type: ignore[arg-type]
        replace(state, viewmats=state.viewmats * [*[[1, 1, 1, 2.0**power]] * 3, [1] * 4],
                depths=state.depths * np.float32(2.0**power), depth_counts=None)
        for state in seen.states))
    bare = replace(seen, states=tuple(  # type: ignore[arg-type]
        replace(state, depth_counts=None) for state in seen.states))
    assert frame_of(scaled).unit == 2.0**power * frame_of(seen).unit
    assert_same_inside(bare, scaled)


@pytest.mark.parametrize("scale", [1e-3, 1e3, 0.0254, 1 / 3])
@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (1234.5, -777.7, 0.01)])
def test_any_unit_and_place_is_bit_equal_inside(seen: Scene, scale: float, shift: Any) -> None:
    base = placed(seen, 1.0)
    assert_same_inside(base, placed(base, scale, scale * np.array(shift)))


@pytest.mark.parametrize("diagonals", [1e3, 1e4, 1e5, 1e6])
def test_far_scenes_keep_the_digits_of_float32(seen: Scene, diagonals: float) -> None:
    """What float64 files lose by the shift is all that is lost."""
    shift = diagonals * np.array([1.0, -0.7, 0.3])
    far, here = (internal(s, frame_of(s)).states[0]
                 for s in (placed(seen, 1.0, shift), placed(seen, 1.0)))
    np.testing.assert_allclose(far.viewmats, here.viewmats, atol=8 * np.spacing(diagonals) + GRID)
    assert np.abs(far.viewmats[:, :3, 3]).max() < 2 * USUAL_DISTANCE


def test_the_frame_is_where_the_cameras_look(seen: Scene) -> None:
    frame = frame_of(seen)
    np.testing.assert_allclose(frame.centre, [0.3, 0.2, 0.15], atol=1e-12)
    assert frame.unit == pytest.approx(2.2 * 0.8 / USUAL_DISTANCE, rel=1e-12)
    inside = internal(seen, frame)
    again = frame_of(inside)
    assert again.unit == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(again.centre, 0.0, atol=1e-6)
    assert inside.meters_per_unit == pytest.approx(0.5 * frame.unit)
    assert inside.states[0].depth_counts is None


def test_parallel_and_coincident_cameras_have_a_frame(seen: Scene) -> None:
    state = seen.states[0]
    views = np.tile(np.eye(4), (len(state), 1, 1))
    views[:, 0, 3] = -np.arange(len(state))
    row, one = (replace(seen, states=(replace(state, viewmats=v),) * 2)
                for v in (views, np.tile(views[3], (len(state), 1, 1))))
    assert frame_of(row).centre == (5.5, 0.0, 0.0)
    assert frame_of(row).unit == pytest.approx(3.0 / USUAL_DISTANCE)
    assert frame_of(one) == SceneFrame(1.0, (3.0, 0.0, 0.0))


def test_depth_right_before_a_camera_is_invalid(seen: Scene) -> None:
    state, frame = seen.states[0], frame_of(seen)
    depths = np.full_like(state.depths, 1.01 * NEAREST_DEPTH * frame.unit)
    depths[:, 0] *= 0.9
    cut = internal(replace(seen, states=(replace(state, depths=depths, depth_counts=None),) * 2),
                   frame).states[0].depths
    assert cut is not None
    assert not cut[:, 0].any()
    np.testing.assert_allclose(cut[:, 1:], 1.01 * NEAREST_DEPTH, atol=1e-4)


def test_unknown_scale_is_taken_as_the_nearest_power_of_a_thousand() -> None:
    for unit, meters in ((1e-3, 1e3), (0.1, 1.0), (1.0, 1.0), (20.0, 1.0), (1e3, 1e-3)):
        assert SceneFrame(unit, (0, 0, 0)).assumed_meters == meters


def test_gaussians_go_back(seen: Scene) -> None:
    rng = np.random.default_rng(0)
    shapes = {"means": (9, 3), "quats": (9, 4), "log_scales": (9, 3), "logit_opacities": (9,),
              "sh0": (9, 3), "shN": (9, 3, 3)}
    inside = Gaussians(**{k: rng.normal(size=v).astype(np.float32) for k, v in shapes.items()})
    back = gaussians_in_scene(inside, FRAME)
    assert back.means.dtype == back.log_scales.dtype == np.float32
    np.testing.assert_allclose((back.means - np.array(FRAME.centre)) / FRAME.unit, inside.means,
                               atol=np.spacing(np.float32(40)) / FRAME.unit)
    np.testing.assert_allclose(back.scales, FRAME.unit * inside.scales, rtol=1e-5)
    for name in ("quats", "logit_opacities", "sh0", "shN"):
        np.testing.assert_array_equal(getattr(back, name), getattr(inside, name))


def in_frame(twin: Twin, frame: SceneFrame) -> Twin:
    return replace(twin, parts=parts_in_scene(twin.parts, frame, False),
                   meters_per_unit=1.0 / frame.unit)


def test_joints_move_points_alike_in_both_frames() -> None:
    """Slide, turn, turn and screw of the toy cabinet, deviations and unknown ones too."""
    points = np.random.default_rng(0).normal(size=(5, 3))
    for part in toy_cabinet_twin(4).parts[1:]:
        assert part.joint is not None
        one = replace(part.joint, sigma_value=float("inf"), sigma_axis=float("nan"),
                      sigma_origin=0.25)
        two = joint_in_scene(one, FRAME)
        for share in (0.3, 1.0):
            there, back = one.transform(share * one.value), two.transform(share * two.value)
            expected = FRAME.points(points @ there[:3, :3].T + there[:3, 3])
            moved = FRAME.points(points) @ back[:3, :3].T + back[:3, 3]
            np.testing.assert_allclose(moved, expected, atol=1e-12)
        assert two.sigma_value == np.inf
        assert np.isnan(two.sigma_axis)
        assert two.sigma_origin == 0.25 * FRAME.unit


def test_parts_go_back_with_what_was_measured_of_them() -> None:
    twin = toy_cabinet_twin(2)
    rows = {"contact_loss": 2.0, "velocity_loss": 3.0, "motion_residual": 5.0, "repel_points": 7.0,
            "vector_field_loss": 0.5, "repel_gradient": 11.0}
    parts = tuple(replace(part, diagnostics=rows) for part in twin.parts)
    unit = FRAME.unit
    drawer, door = parts_in_scene(parts, FRAME, False)[1:]
    assert drawer.diagnostics == pytest.approx({
        "contact_loss": 2 * unit**2, "velocity_loss": 3 * unit**2, "motion_residual": 5 * unit,
        "repel_points": 7, "vector_field_loss": 0.5, "repel_gradient": 11 * unit})
    assert door.diagnostics["repel_gradient"] == pytest.approx(11 * unit**2)
    printed = parts_in_scene(parts, FRAME, True)[1].diagnostics
    assert printed["contact_loss"] == 2.0
    assert printed["vector_field_loss"] == pytest.approx(0.5 * unit**2)
    assert drawer.limits == pytest.approx(tuple(unit * x for x in twin.parts[1].limits))
    assert door.limits == twin.parts[2].limits
    np.testing.assert_allclose(drawer.mesh.vertices, FRAME.points(twin.parts[1].mesh.vertices))


@pytest.mark.parametrize("frame", [
    SceneFrame(1e-3, (0.0, 0.0, 0.0)), SceneFrame(1e3, (2e3, -1e3, 5e2)),
    SceneFrame(1.0, (1000.0, -700.0, 300.0))])
def test_mujoco_moves_a_placed_twin_like_the_twin(frame: SceneFrame, tmp_path: Path) -> None:
    import mujoco

    twin = toy_cabinet_twin(3)
    here, there = tmp_path / "here", tmp_path / "there"
    models = []
    for folder, one in ((here, twin), (there, in_frame(twin, frame))):
        folder.mkdir()
        write_mjcf(one, folder)
        models.append(mujoco.MjModel.from_xml_path(str(folder / "twin.xml")))
    np.testing.assert_allclose(models[1].body_mass, models[0].body_mass, rtol=1e-4)
    moved = []
    for model, one in zip(models, (twin, in_frame(twin, frame)), strict=True):
        data = mujoco.MjData(model)
        data.qpos[:] = model.key_qpos[1]
        mujoco.mj_forward(model, data)
        moved.append(data.xipos[[model.body(part.name).id for part in one.parts]])
    np.testing.assert_allclose((moved[1] - frame.centre) / frame.unit, moved[0], atol=1e-4)
    assert check(there, quick=True).ok == check(here, quick=True).ok


def scaled_folder(source: Path, folder: Path, scale: float, shift: Any) -> Path:
    """Copy a scene folder with its cameras in another unit at another place."""
    shutil.copytree(source, folder)
    for file in folder.glob("*.json"):
        content = json.loads(file.read_text())
        for frame in content["frames"]:
            matrix = np.array(frame["transform_matrix"])
            matrix[:3, 3] = scale * matrix[:3, 3] + shift
            frame["transform_matrix"] = matrix.tolist()
        file.write_text(json.dumps(content))
    return folder


PLACES = [(1e-3, (0.0, 0.0, 0.0)), (1e3, (0.0, 0.0, 0.0)), (1.0, (2600.0, -1234.5, 777.7))]


def short_fit(folder: Path) -> Gaussians:
    from part2gs_robotics.fit.fit_state import FitConfig, fit_state

    config = FitConfig(steps=12, half_steps=6, start_gaussians=400, hull_resolution=32)
    scene = read_scene(folder, ReadConfig())
    return fit_state(internal(scene, frame_of(scene)).states[0], None, config).gaussians


@pytest.fixture(scope="module")
def fitted(ball_scene: Path) -> Gaussians:
    return short_fit(ball_scene)


@pytest.mark.parametrize(("scale", "shift"), PLACES)
def test_a_fit_is_the_same_for_every_unit_and_place(
    ball_scene: Path, fitted: Gaussians, tmp_path: Path, scale: float, shift: Any,
) -> None:
    """From files to Gaussians, bit by bit: everything after a fit follows from it."""
    other = short_fit(scaled_folder(ball_scene, tmp_path / "scene", scale, shift))
    for name in ("means", "quats", "log_scales", "logit_opacities", "sh0", "shN"):
        assert getattr(other, name).tobytes() == getattr(fitted, name).tobytes(), name


WORDS = ["--preset", "draft", "--steps", "120", "--half-steps", "60", "--parts", "1",
         "--start-gaussians", "3000", "--resolution", "48", "--hull-resolution", "64", "--quiet"]


def joint_of(scene: Path) -> tuple[int, list[dict[str, Any]]]:
    out = scene.parent / f"{scene.name}_twin"
    code = cli.main(["build", str(scene), "-o", str(out), *WORDS])
    return code, yaml.safe_load((out / "twin.yaml").read_text())["joints"]


@pytest.mark.slow
def test_a_build_gives_the_same_twin_for_every_unit_and_place(tmp_path: Path) -> None:
    from synth_photos import write_ball_scene

    source = write_ball_scene(tmp_path / "scene", side=64)
    code, joints = joint_of(source)
    assert joints
    for number, (scale, shift) in enumerate(PLACES):
        other = joint_of(scaled_folder(source, tmp_path / f"scene_{number}", scale, shift))
        assert other[0] == code
        for one, two in zip(joints, other[1], strict=True):
            length = scale if one["type"] == "prismatic" else 1.0
            reach = scale * DIAGONAL
            assert two["type"] == one["type"]
            axes = [np.array(joint["axis"]["value"]) for joint in (one, two)]
            assert np.linalg.norm(np.cross(*axes)) < 1e-4
            origin = scale * np.array(one["origin"]["value"]) + shift
            np.testing.assert_allclose(two["origin"]["value"], origin, atol=1e-4 * reach)
            assert two["state_1"]["value"] == pytest.approx(length * one["state_1"]["value"],
                                                            rel=1e-4)
