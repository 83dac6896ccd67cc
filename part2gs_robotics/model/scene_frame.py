"""The frame the corridor works in: a scene of any size at any place, brought near to one.

Float32 keeps seven digits of a coordinate, the near plane is a length, and a fit amplifies the last
digit: two scenes give the same twin only if the arrays that the rooms see are the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.scene import Scene, StateViews
from part2gs_robotics.model.twin import Part, PartMesh

USUAL_DISTANCE = 4.0  # internal units from a camera to what it looks at: an object is about one
GRID = 2.0**-20  # internal units, of cameras: 1e-4 pixels, a million times the noise of other units
# Internal units: a tenth of what 16 bits resolve at 4 m (1 mm); coarser, to round millions alike.
DEPTH_GRID = 2.0**-14
NEAREST_DEPTH = 0.1  # internal units, 10 cm at 4 m: nearer, depth cameras report nothing reliable
PARALLEL = 1e-3  # of the mean projector's eigenvalues: below, all optical axes are within 2 degrees
# Powers of the unit in reported terms; a pull on a turn is a torque, one length more.
POWERS = {"contact_loss": 2, "velocity_loss": 2, "motion_residual": 1, "repel_gradient": 1}
PAPER_POWERS = POWERS | {"contact_loss": 0, "vector_field_loss": 2}  # as printed


@dataclass(frozen=True)
class SceneFrame:
    """Similarity scene_from_internal without rotation: p_scene = unit * p_internal + centre.

    It follows the scene: a scene scaled by s and shifted by t has the frame (s unit, s centre + t),
    so that what the rooms see is the same. Powers of two do so bit by bit. Any other scale or
    shift leaves noise of float64, which rounding to GRID removes; a fit would not forgive it (one
    number in its seventh digit turned the toy joint of the tests by 0.1 rad).

    Attributes:
        unit: scene units per internal unit.
        centre: [3] scene units, the internal origin.
    """

    unit: float
    centre: tuple[float, float, float]

    @property
    def assumed_meters(self) -> float:
        """Metres per scene unit when nobody knows: m, mm, km, ... whatever is most usual.

        The power of a thousand for which the cameras stand nearest to USUAL_DISTANCE metres.
        """
        return float(f"1e{-3 * round(math.log10(self.unit) / 3)}")

    def points(self, internal: NDArray[np.floating]) -> F64:
        """Return [..., 3] points in the scene's frame."""
        return np.asarray(self.unit * internal.astype(np.float64) + self.centre)


def frame_of(scene: Scene) -> SceneFrame:
    """Return the frame of a scene, from the cameras of both states alone.

    The origin is the point nearest to all optical axes, or the cameras' centroid when they are
    parallel; the unit is the median distance of the cameras from it over USUAL_DISTANCE.
    """
    viewmats = np.concatenate([state.viewmats for state in scene.states])
    eyes = -np.einsum("vji,vj->vi", viewmats[:, :3, :3], viewmats[:, :3, 3])
    middle = _middle(eyes, viewmats[:, 2, :3])
    distance = float(np.median(np.linalg.norm(eyes - middle, axis=1)))
    x, y, z = middle.tolist()
    # all cameras in one place: nothing tells the size
    return SceneFrame(distance / USUAL_DISTANCE if distance > 0 else 1.0, (x, y, z))


def _middle(eyes: F64, ways: F64) -> F64:
    """Return [3] the point nearest to all optical axes (eyes [V, 3], unit ways [V, 3])."""
    centroid = eyes.mean(0)
    across = np.eye(3) - ways[:, :, None] * ways[:, None, :]
    system = across.mean(0)
    if np.linalg.eigvalsh(system)[0] < PARALLEL:
        return np.asarray(centroid)
    # from the centroid: far from the origin the eyes' own digits are kept
    aside = np.einsum("vij,vj->vi", across, eyes - centroid).mean(0)
    return np.asarray(centroid + np.linalg.solve(system, aside))


def internal(scene: Scene, frame: SceneFrame) -> Scene:
    """Return the scene in internal units: cameras, depths and metres per unit."""
    metres = scene.meters_per_unit
    first, second = (_views(state, frame) for state in scene.states)
    return replace(scene, states=(first, second),
                   meters_per_unit=None if metres is None else metres * frame.unit)


def _views(state: StateViews, frame: SceneFrame) -> StateViews:
    viewmats = state.viewmats.copy()
    trans = viewmats[:, :3, 3] + viewmats[:, :3, :3] @ np.array(frame.centre)
    viewmats[:, :3, 3] = _rounded(trans / frame.unit, GRID)
    return replace(state, viewmats=viewmats, depths=_depths(state, frame.unit), depth_counts=None)


def _depths(state: StateViews, unit: float) -> NDArray[np.float32] | None:
    if state.depths is None:
        return None
    views, units = state.depth_counts or (state.depths, np.ones(len(state)))
    out = np.zeros(views.shape, np.float32)
    for view, factor, into in zip(views, units / unit, out, strict=True):
        depth = _rounded(view.astype(np.float64) * factor, DEPTH_GRID)
        into[:] = np.where(depth < NEAREST_DEPTH, 0.0, depth)
    return out


def _rounded(lengths: F64, grid: float) -> F64:
    return np.asarray(np.rint(lengths / grid) * grid + 0.0)  # no minus zeros: keys compare bits


def gaussians_in_scene(gaussians: Gaussians, frame: SceneFrame) -> Gaussians:
    """Return Gaussians in the scene's frame, float32: seven digits of their own coordinates."""
    return replace(gaussians, means=frame.points(gaussians.means).astype(np.float32),
                   log_scales=gaussians.log_scales + np.float32(math.log(frame.unit)))


def joint_in_scene(joint: Joint, frame: SceneFrame) -> Joint:
    """Return a joint in the scene's frame; infinite and unknown deviations stay so."""
    assert joint.carrier is None  # only while motions are searched; a finished one has parents
    slide = frame.unit if joint.kind == "prismatic" else 1.0
    return replace(joint, origin=frame.points(joint.origin), value=joint.value * slide,
                   pitch=joint.pitch * frame.unit, sigma_origin=joint.sigma_origin * frame.unit,
                   sigma_value=joint.sigma_value * slide,
                   sigma_rise=joint.sigma_rise * frame.unit)


def parts_in_scene(parts: tuple[Part, ...], frame: SceneFrame, paper: bool) -> tuple[Part, ...]:
    """Return parts in the scene's frame: meshes, pieces, joints, ranges and diagnostics.

    Args:
        parts: in internal units.
        frame: of their scene.
        paper: the diagnostics are those of paper mode, some of which have other units.
    """
    return tuple(_part(part, frame, PAPER_POWERS if paper else POWERS) for part in parts)


def _part(part: Part, frame: SceneFrame, powers: dict[str, int]) -> Part:
    joint, (low, high) = part.joint, part.limits
    slides = joint is not None and joint.kind == "prismatic"
    turns = joint is not None and joint.kind in ("revolute", "screw")
    length = frame.unit if slides else 1.0
    powers = powers | {"repel_gradient": 2 if turns else 1}
    return replace(
        part, mesh=_mesh(part.mesh, frame), pieces=tuple(_mesh(p, frame) for p in part.pieces),
        joint=None if joint is None else joint_in_scene(joint, frame),
        limits=(low * length, high * length),
        diagnostics={name: value * frame.unit ** powers.get(name, 0)
                     for name, value in part.diagnostics.items()})


def _mesh(mesh: PartMesh, frame: SceneFrame) -> PartMesh:
    return replace(mesh, vertices=frame.points(mesh.vertices))
