"""A room around an object of the benchmark kit, path-traced by Mitsuba as a phone would see it.

`Room(model, states)` puts the object of an MJCF file on a table in a lit room with papered walls,
boards and boxes; `shoot` draws it in either state from any camera, with the true mask. Lengths are
in diagonals of the object, z is up and the table's top is z = 0.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

os.environ.setdefault("MUJOCO_GL", "egl")
import cv2
import mitsuba as mi
import mujoco
import numpy as np
import pyoidn
from numpy.typing import NDArray

mi.set_variant(os.environ.get("P2G_MITSUBA", "llvm_ad_rgb"))
Array = NDArray[np.float64]

TABLE, HALF_ROOM, CEILING, FLOOR = 1.1, 5.0, 3.5, -1.4  # half sides and heights, in diagonals
DIAGONAL_M, SHEET_M = 0.6, (0.21, 0.297)  # metres: what the printed sheet is measured against


class Room:
    """An object of the kit in two states, in a room."""

    def __init__(self, xml: Path, frozen: dict[str, float],
                 move: dict[str, tuple[float, float]], seed: int, table: bool = True) -> None:
        """Read the model and lay out the room.

        Args:
            xml: MJCF file.
            frozen: joint -> value in both states.
            move: joint -> values in state 0 and 1.
            seed: of patterns and furniture.
            table: with the table and the printed sheet on it.
        """
        self.model = mujoco.MjModel.from_xml_path(str(xml))
        self.data = mujoco.MjData(self.model)
        self.frozen, self.move = frozen, move
        shown = self.model.geom_group <= 2
        free = shown & (self.model.geom_contype == 0) & (self.model.geom_conaffinity == 0)
        self.geoms = np.flatnonzero(free if free.any() else shown)
        clouds = []
        for state in (0, 1):
            self._pose(state)
            clouds.append(np.concatenate([self._mesh(g)[0] for g in self.geoms]))
        cloud = np.concatenate(clouds)
        low, high = cloud.min(0), cloud.max(0)
        self.unit = float(np.linalg.norm(high - low))
        self.foot = np.array([*((low + high) / 2)[:2], low[2]])
        self.size = (high - low) / self.unit
        at = (0.12 + self.size[0] / 2 + SHEET_M[0] / DIAGONAL_M / 2, 0.0)
        self.room = _room(np.random.default_rng(seed), table) | (_sheet(at) if table else {})
        self.scenes = [self._scene(state) for state in (0, 1)]

    def shoot(self, state: int, world_from_camera: Array, lens: tuple[float, int, int],
              samples: int, seed: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Return linear colour [H, W, 3] and the true mask [H, W].

        Args:
            state: 0 or 1.
            world_from_camera: [4, 4], OpenCV axes.
            lens: field of view across the width in degrees, width, height.
            samples: paths per pixel.
            seed: of the paths.
        """
        flip = world_from_camera @ np.diag([-1.0, -1.0, 1.0, 1.0])  # Mitsuba: x left, y up, z ahead
        sensor: Any = mi.load_dict({
            "type": "perspective", "fov": lens[0], "fov_axis": "x", "near_clip": 0.01,
            "to_world": mi.ScalarTransform4f(flip),
            "film": {"type": "hdrfilm", "width": lens[1], "height": lens[2],
                     "rfilter": {"type": "box"}, "pixel_format": "rgb"},
            "sampler": {"type": "independent", "sample_count": samples}})
        scene, alone = self.scenes[state]
        integrator: Any = mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal",
                                        "path": {"type": "path", "max_depth": 5}})
        layers = np.array(mi.render(scene, sensor=sensor, integrator=integrator, spp=samples,
                                    seed=seed), dtype=np.float32)
        # 16 paths alone leave 6 to 16 grey levels of noise on dark objects; a phone has 1 to 3
        image = pyoidn.denoise(*(np.ascontiguousarray(layers[..., 3 * k:3 * k + 3])
                                 for k in range(3)), hdr=True)
        depth: Any = mi.load_dict({"type": "aov", "aovs": "d:depth"})
        seen = np.array(mi.render(alone, sensor=sensor, integrator=depth, spp=1, seed=seed))
        return image, seen[..., -1] > 0

    def _pose(self, state: int) -> None:
        values = self.frozen | {name: both[state] for name, both in self.move.items()}
        for name, value in values.items():
            self.data.qpos[self.model.joint(name).qposadr[0]] = value
        mujoco.mj_forward(self.model, self.data)

    def _mesh(self, geom: int) -> tuple[Array, NDArray[np.int64], Array | None]:
        """Return vertices [3F, 3] of unrolled faces in the world, faces, and uv [3F, 2]."""
        m = self.model
        kind = mujoco.mjtGeom(m.geom_type[geom])
        uv = None
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            i = m.geom_dataid[geom]
            at, count = m.mesh_faceadr[i], m.mesh_facenum[i]
            corners = m.mesh_face[at:at + count].ravel() + m.mesh_vertadr[i]
            points = m.mesh_vert[corners].astype(float)
            if m.mesh_texcoordadr[i] >= 0:
                uv = m.mesh_texcoord[m.mesh_facetexcoord[at:at + count].ravel()
                                     + m.mesh_texcoordadr[i]].astype(float)
        else:
            points = _primitive(kind, m.geom_size[geom])
        world = points @ self.data.geom_xmat[geom].reshape(3, 3).T + self.data.geom_xpos[geom]
        return world, np.arange(len(points)).reshape(-1, 3), uv

    def _scene(self, state: int) -> tuple[Any, Any]:
        self._pose(state)
        content: dict[str, Any] = {"type": "scene"}
        for geom in self.geoms:
            points, faces, uv = self._mesh(geom)
            content[f"a{geom:04d}"] = _shape((points - self.foot) / self.unit, faces, uv,
                                             self._material(geom))
        return mi.load_dict(content | self.room), mi.load_dict(content)

    def _material(self, geom: int) -> dict[str, Any]:
        m = self.model
        mat = m.geom_matid[geom]
        rgba = m.geom_rgba[geom] if mat < 0 else m.mat_rgba[mat]
        color: Any = {"type": "rgb", "value": [float(c) ** 2.2 * 0.85 for c in rgba[:3]]}
        tex = -1 if mat < 0 else int(np.max(m.mat_texid[mat]))
        if tex >= 0 and m.tex_type[tex] == mujoco.mjtTexture.mjTEXTURE_2D:
            at, h, w, n = m.tex_adr[tex], m.tex_height[tex], m.tex_width[tex], m.tex_nchannel[tex]
            pixels = m.tex_data[at:at + h * w * n].reshape(h, w, n)[..., :3]
            color = _bitmap(np.ascontiguousarray(pixels))
        return {"type": "twosided", "b": {"type": "roughplastic", "alpha": 0.25,
                                          "diffuse_reflectance": color}}


def _primitive(kind: Any, size: Array) -> Array:
    import trimesh

    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        mesh = trimesh.creation.box(2 * size)
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        mesh = trimesh.creation.cylinder(size[0], 2 * size[1], sections=64)
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        mesh = trimesh.creation.capsule(2 * size[1], size[0], count=[32, 64])
    else:
        mesh = trimesh.creation.uv_sphere(size[0])
    return np.asarray(mesh.triangles).reshape(-1, 3)


def _shape(points: Array, faces: NDArray[np.int64], uv: Array | None, material: Any) -> Any:
    props = mi.Properties()
    props["bsdf"] = mi.load_dict(material)
    mesh: Any = mi.Mesh("m", len(points), len(faces), props=props,
                        has_vertex_texcoords=uv is not None)
    params = mi.traverse(mesh)
    params["vertex_positions"] = points.astype(np.float32).ravel()
    params["faces"] = faces.astype(np.uint32).ravel()
    if uv is not None:
        params["vertex_texcoords"] = uv.astype(np.float32).ravel()
    params.update()
    return mesh


def _bitmap(pixels: NDArray[np.uint8]) -> dict[str, Any]:
    return {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "raw": False, "wrap_mode": "repeat"}


def _room(rng: np.random.Generator, table: bool) -> dict[str, Any]:
    """Return floor, walls, boxes and lights, and a table unless it would hide what is seen."""
    T = mi.ScalarTransform4f
    out: dict[str, Any] = {}

    def box(name: str, middle: Any, half: Any, turn: float, pixels: NDArray[np.uint8]) -> None:
        place = T().translate(list(middle)).rotate([0, 0, 1], turn).scale(list(half))
        out[name] = {"type": "cube", "to_world": place,
                     "bsdf": {"type": "diffuse", "reflectance": _bitmap(pixels)}}

    wood = _pattern(rng, (120, 84, 56), 0.25, stretch=12, sheets=0)
    if table:
        box("table", [0, 0, -0.04], [TABLE, TABLE, 0.04], 0, wood)
    box("floor", [0, 0, FLOOR - 0.1], [HALF_ROOM, HALF_ROOM, 0.1], 0,
        _pattern(rng, (140, 130, 120), 0.35, stretch=3, sheets=0))
    for n, (x, y) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
        half = [0.1 if x else HALF_ROOM, 0.1 if y else HALF_ROOM, (CEILING - FLOOR) / 2]
        box(f"wall{n}", [x * HALF_ROOM, y * HALF_ROOM, (CEILING + FLOOR) / 2], half, 0,
            _pattern(rng, (205, 200, 190), 0.12, stretch=1, sheets=14))
    box("ceiling", [0, 0, CEILING + 0.1], [HALF_ROOM, HALF_ROOM, 0.1], 0,
        np.full((8, 8, 3), 225, np.uint8))
    for n in range(14):
        angle, far = rng.uniform(0, 360), rng.uniform(3.0, 4.4)
        half = rng.uniform([0.15, 0.15, 0.2], [0.5, 0.5, 1.0])
        at = [far * np.cos(np.deg2rad(angle)), far * np.sin(np.deg2rad(angle)), FLOOR + half[2]]
        box(f"box{n}", at, half, rng.uniform(0, 90),
            _pattern(rng, tuple(rng.integers(60, 220, 3)), 0.3, stretch=2, sheets=4))
    for n, (x, y, power) in enumerate(((-1.5, 1.0, 9.0), (2.0, -1.2, 6.0))):
        out[f"lamp{n}"] = {
            "type": "rectangle", "emitter": {"type": "area", "radiance": {"type": "rgb",
                                                                          "value": power}},
            "to_world": T().translate([x, y, CEILING - 0.02]).rotate([1, 0, 0], 180).scale(0.9)}
    return out


def _sheet(at: tuple[float, float]) -> dict[str, Any]:
    """Return the printed sheet of markers, lying on the table."""
    from part2gs_robotics.photos import markers as m

    px = 4000  # per metre: a cell is 30 px
    image = np.full((round(SHEET_M[1] * px), round(SHEET_M[0] * px), 3), 235, np.uint8)
    cell, step = round(m.SIZE_M / 8 * px), round((m.SIZE_M + m.GAP_M) * px)
    rows = m.COUNT // m.COLUMNS
    left = (image.shape[1] - (m.COLUMNS - 1) * step - 8 * cell) // 2
    top = (image.shape[0] - (rows - 1) * step - 8 * cell) // 2
    for number in range(m.COUNT):
        bits = np.kron(m.marker_bits(number), np.ones((cell, cell), bool))
        y, x = top + number // m.COLUMNS * step, left + number % m.COLUMNS * step
        image[y:y + 8 * cell, x:x + 8 * cell][bits] = 25
    half = [side / DIAGONAL_M / 2 for side in SHEET_M]
    place = mi.ScalarTransform4f().translate([*at, 0.001]).scale([*half, 1.0])
    return {"sheet": {"type": "rectangle", "to_world": place,
                      "bsdf": {"type": "diffuse",
                               "reflectance": _bitmap(np.ascontiguousarray(image[::-1]))}}}


def _pattern(rng: np.random.Generator, base: tuple[int, ...], contrast: float, stretch: int,
             sheets: int, side: int = 2048) -> NDArray[np.uint8]:
    """Return [S, S, 3] noise of many sizes about a colour, with printed sheets pinned on it."""
    noise = np.zeros((side, side), np.float32)
    for level in range(2, 11):
        grid = rng.normal(size=(2**level, max(2, 2**level // stretch))).astype(np.float32)
        noise += cv2.resize(grid, (side, side), interpolation=cv2.INTER_CUBIC) * 0.85**level
    noise /= noise.std()
    image = np.array(base) * np.exp(contrast * noise[..., None] * rng.uniform(0.8, 1.2, 3))
    for _ in range(sheets):
        h, w = rng.integers(120, 400, 2)
        y, x = rng.integers(0, side - h), rng.integers(0, side - w)
        sheet = np.full((h, w, 3), rng.integers(150, 250, 3), float)
        for _ in range(40):
            a, b = rng.integers(0, h - 6), rng.integers(0, w - 8)
            sheet[a:a + rng.integers(6, 60), b:b + rng.integers(6, 100)] = rng.integers(0, 255, 3)
        image[y:y + h, x:x + w] = sheet
    return np.asarray(np.clip(image, 0, 255), np.uint8)


def handheld(count: int, size: Array, fov_deg: float, rng: np.random.Generator) -> list[Array]:
    """Return world_from_camera [4, 4] (OpenCV axes) of a walk in two rounds about the object."""
    out = []
    middle = np.array([0.0, 0.0, size[2] / 2])
    start = rng.uniform(0, 2 * np.pi)
    for i in range(count):
        second = i >= count // 2
        turn = start + 4 * np.pi * i / count + rng.normal(0, 0.03)
        rise = np.deg2rad((48 if second else 20) + rng.normal(0, 4))
        far = 0.5 / np.sin(np.deg2rad(fov_deg) / 2) * rng.uniform(1.25, 1.5)
        eye = middle + far * np.array([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn),
                                       np.sin(rise)])
        ahead = middle + rng.normal(0, 0.03, 3) - eye
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        down = np.cross(ahead, right)
        roll = rng.normal(0, 0.05)
        pose = np.eye(4)
        pose[:3, 0] = np.cos(roll) * right + np.sin(roll) * down
        pose[:3, 1] = np.cos(roll) * down - np.sin(roll) * right
        pose[:3, 2], pose[:3, 3] = ahead, eye
        out.append(pose)
    return out


def developed(linear: NDArray[np.float32], exposure: float, rng: np.random.Generator,
              ) -> NDArray[np.uint8]:
    """Return sRGB [H, W, 3]: exposure, photon and read noise, gamma."""
    x = linear * exposure
    x = x + rng.normal(size=x.shape) * np.sqrt(0.0004 * np.clip(x, 0, None) + 0.00001)
    x = np.clip(x, 0, 1)
    srgb = np.where(x < 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    noisy = np.asarray(np.rint(255 * srgb), np.uint8)
    # every phone smooths its noise
    return np.asarray(cv2.fastNlMeansDenoisingColored(noisy, None, 4, 6, 3, 11), np.uint8)
