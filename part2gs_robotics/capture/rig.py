"""A posed MuJoCo model under fixed lights, photographed off screen."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.assets.model_files import check_model_files
from part2gs_robotics.capture.cameras import FOV_RAD, direction
from part2gs_robotics.errors import CheckError, ConfigError

if sys.platform.startswith("linux"):
    # Read by mujoco at its first import; EGL needs no screen.
    os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco

Array = NDArray[np.float64]

# Odd, so that the middle sub-pixel lies on the pixel centre and depth needs no second rendering.
SUPERSAMPLE = 3
_CAMERA = "part2gs_capture"
_AMBIENT = 0.3  # of all lights together: what none of them reaches is not black
# Azimuth and elevation in degrees, strength: key, fill and low light; brightest sum stays below 1.
_LIGHTS = ((215.0, 50.0, 0.4), (330.0, 35.0, 0.25), (95.0, 25.0, 0.25))
_SHOWN, _HIDDEN = 2, 5  # two of MuJoCo's six geom groups, 0 to 5
_APT = "apt-get install -y libegl1 libegl-mesa0 libgl1-mesa-dri libgl1 libgles2"


@dataclass(frozen=True)
class JointInfo:
    """One joint of the model: `name`, `hinge` (else slide), range [2] or None, and ids."""

    name: str
    hinge: bool
    limits: tuple[float, float] | None
    body: int
    qpos: int
    index: int


class Rig:
    """A compiled model with a free camera; use it as a context manager.

    Attributes:
        joints: hinge and slide joints in model order.
        extent: MuJoCo's own estimate of the model's size, scene units.
    """

    def __init__(self, path: Path, size: int) -> None:
        check_model_files(path)
        self._size = size
        self._model = _compile(path, size * SUPERSAMPLE)
        self._data = mujoco.MjData(self._model)
        self._geoms = _drawn_geoms(self._model)
        if not len(self._geoms):
            raise CheckError(
                f"{path}: has nothing to photograph in geom groups 0 to 2. "
                "Expected meshes or solid shapes; planes and height fields do not count."
            )
        self._model.geom_group[:] = _HIDDEN
        self._model.geom_group[self._geoms] = _SHOWN
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = [g == _SHOWN for g in range(6)]
        self._option.sitegroup[:] = 0
        self._renderer: Any = None
        self.joints = _joints(self._model)
        self.extent = float(self._model.stat.extent)

    def __enter__(self) -> Self:
        """Open the off-screen renderer."""
        try:
            self._renderer = mujoco.Renderer(
                self._model, self._size * SUPERSAMPLE, self._size * SUPERSAMPLE
            )
        except Exception as error:  # EGL, OSMesa and GLFW fail with types of their own
            raise ConfigError(
                f"capture: no off-screen OpenGL here ({type(error).__name__}: {error}). "
                f"Expected EGL (MUJOCO_GL=egl); run: {_APT}"
            ) from error
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Free the off-screen renderer."""
        self._renderer.close()

    def pose(self, values: dict[str, float]) -> None:
        """Put every named joint at its value (rad or scene units), all others at rest."""
        self._data.qpos[:] = self._model.qpos0
        for joint in self.joints:
            self._data.qpos[joint.qpos] = values.get(joint.name, self._data.qpos[joint.qpos])
        mujoco.mj_forward(self._model, self._data)

    def points(self) -> Array:
        """Return [N, 3] world points whose hull holds everything drawn in this pose."""
        clouds = [
            _geom_points(self._model, g) @ self._data.geom_xmat[g].reshape(3, 3).T
            + self._data.geom_xpos[g]
            for g in self._geoms
        ]
        return np.concatenate(clouds)

    def focus(self, cloud: Array) -> None:
        """Fit clipping planes and lights to the object [N, 3]."""
        size = float(np.linalg.norm(np.ptp(cloud, axis=0)))
        self._model.stat.extent = size
        # In units of the extent; cameras stand 0.5 to 4 object sizes away.
        self._model.vis.map.znear, self._model.vis.map.zfar = 0.05, 10.0
        self._model.light_pos[:] = cloud.mean(0) - 2 * size * self._model.light_dir

    def axis_and_anchor(self, joint: JointInfo) -> tuple[Array, Array]:
        """Return axis [3] (unit) and anchor [3] of a joint in the world, in this pose."""
        return self._data.xaxis[joint.index].copy(), self._data.xanchor[joint.index].copy()

    def body_name(self, body: int) -> str:
        """Return the name of a body."""
        return str(self._model.body(body).name)

    def carrier(self, body: int, moving: dict[int, int]) -> int:
        """Return the part (value of `moving`) of the nearest moving ancestor of a body, else 0."""
        while body:
            body = int(self._model.body_parentid[body])
            if body in moving:
                return moving[body]
        return 0

    def shoot(self, world_from_camera: Array, *, depth: bool) -> tuple[NDArray[np.uint8], Array]:
        """Photograph the pose.

        Args:
            world_from_camera: [4, 4], OpenGL axes.
            depth: also measure depth; without it the depth is all background.

        Returns:
            rgba: [H, W, 4] straight RGB with the covered share of each pixel as alpha.
            depth: [H, W] z-depth at pixel centres, scene units, 0 = background.

        Glass is photographed as solid, so that colour, alpha and depth show one surface.
        """
        self._data.cam_xpos[-1] = world_from_camera[:3, 3]
        self._data.cam_xmat[-1] = world_from_camera[:3, :3].ravel()
        colour = self._draw().astype(np.float64)
        self._renderer.enable_segmentation_rendering()
        mask = self._draw()[..., 0] >= 0
        z = np.zeros(mask.shape)
        if depth:
            self._renderer.enable_depth_rendering()
            z = self._draw().astype(np.float64) * mask
        self._renderer.disable_segmentation_rendering()
        self._renderer.disable_depth_rendering()
        covered = _pool(mask.astype(np.float64)[..., None])
        rgb = _pool(colour * mask[..., None]) / np.maximum(covered, 1.0)
        rgba = np.concatenate([rgb, covered * (255.0 / SUPERSAMPLE**2)], -1)
        middle = slice(SUPERSAMPLE // 2, None, SUPERSAMPLE)
        return rgba.round().astype(np.uint8), z[middle, middle]

    def _draw(self) -> NDArray[Any]:
        self._renderer.update_scene(self._data, _CAMERA, self._option)
        scene = self._renderer.scene
        scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0
        for geom in scene.geoms[: scene.ngeom]:
            geom.rgba[3], geom.transparent = 1.0, 0
        return np.asarray(self._renderer.render())


def _compile(path: Path, pixels: int) -> Any:
    try:
        spec = _parse(path)
        # Nothing is simulated: links without mass, common in URDF, are photographed all the same.
        spec.compiler.boundmass = spec.compiler.boundinertia = 1e-6
        for light in spec.lights:
            light.active = False
        spec.worldbody.add_camera(name=_CAMERA, fovy=float(np.rad2deg(FOV_RAD)))
        for azimuth, elevation, strength in _LIGHTS:
            spec.worldbody.add_light(
                type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, dir=-direction(azimuth, elevation),
                diffuse=[strength] * 3, ambient=[_AMBIENT / len(_LIGHTS)] * 3,
                specular=[0.1] * 3, castshadow=False,
            )  # fmt: skip
        spec.visual.headlight.active = 0
        # Round shapes stay round: a facet lies within 0.2 % of the radius.
        spec.visual.quality.numslices = spec.visual.quality.numstacks = 64
        spec.visual.quality.offsamples = 0  # multisampling would blend the background into edges
        spec.visual.global_.offwidth = spec.visual.global_.offheight = pixels
        return spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise CheckError(
            f"{path}: MuJoCo {mujoco.__version__} does not compile it "
            f"({' '.join(str(error).split())}). "
            "Expected a model that loads in MuJoCo; repair it and try again."
        ) from None


def _parse(path: Path) -> Any:
    """Return the MjSpec of a file; a URDF keeps the visual shapes that MuJoCo would drop."""
    root = ElementTree.fromstring(path.read_bytes())
    if root.tag != "robot":
        return mujoco.MjSpec.from_file(str(path))
    extension = root.find("mujoco")
    extension = ElementTree.SubElement(root, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = ElementTree.SubElement(extension, "compiler") if compiler is None else compiler
    compiler.set("discardvisual", "false")
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    spec.modelfiledir = str(path.resolve().parent)
    return spec


def _drawn_geoms(model: Any) -> NDArray[np.int64]:
    """Return the geoms of groups 0 to 2; only the contact-free ones where there are any."""
    infinite = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_HFIELD)
    shown = (model.geom_group <= 2) & ~np.isin(model.geom_type, [int(t) for t in infinite])
    visual = shown & (model.geom_contype == 0) & (model.geom_conaffinity == 0)
    return np.flatnonzero(visual if visual.any() else shown)


def _geom_points(model: Any, geom: int) -> Array:
    """Return points in the geom's own frame: mesh vertices, else corners of its bounding box."""
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        return np.asarray(model.mesh_vert[start : start + model.mesh_vertnum[mesh]], np.float64)
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return np.asarray(middle + signs * half, np.float64)


def _joints(model: Any) -> tuple[JointInfo, ...]:
    kinds = {int(mujoco.mjtJoint.mjJNT_HINGE): True, int(mujoco.mjtJoint.mjJNT_SLIDE): False}
    return tuple(
        JointInfo(
            name=model.joint(j).name or f"joint_{j}",
            hinge=kinds[int(model.jnt_type[j])],
            limits=(float(model.jnt_range[j, 0]), float(model.jnt_range[j, 1]))
            if model.jnt_limited[j]
            else None,
            body=int(model.jnt_bodyid[j]),
            qpos=int(model.jnt_qposadr[j]),
            index=j,
        )
        for j in range(model.njnt)
        if int(model.jnt_type[j]) in kinds
    )


def _pool(image: Array) -> Array:
    """Return the sum over each SUPERSAMPLE x SUPERSAMPLE block of [H, W, C]."""
    h, w, c = image.shape
    blocks = image.reshape(h // SUPERSAMPLE, SUPERSAMPLE, w // SUPERSAMPLE, SUPERSAMPLE, c)
    return np.asarray(blocks.sum((1, 3)), np.float64)
