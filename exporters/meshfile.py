"""Mesh files of the twin folder: OBJ with a colour on every vertex, normals and textures."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import CheckError, ExportError
from part2gs_robotics.exporters.xmlio import add
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.solids import GREY
from part2gs_robotics.model.twin import Part, PartMesh, Texture, Twin, corner_normals
from part2gs_robotics.runtime.atomic import write_bytes_atomic, write_error

NAME = re.compile(r"[a-z0-9_]+\Z")  # bare names every simulator and package tool accepts
CREASE = np.cos(np.deg2rad(30.0))  # faces farther apart form an edge; Blender's default as well
ASSETS = "assets"  # folder of meshes and pictures, as in MuJoCo Menagerie
KEPT_BYTES = 1 << 16  # files up to that are parsed once: a check reads every piece three times
KEPT_FILES = 512  # of them, twice the pieces of a large twin
KEPT_LARGE = 8, 1 << 23  # larger ones and their bytes: visual meshes, parsed three times as well
MAX_OBJ_BYTES = 1 << 30  # five million triangles with texture take 600 MB
MOST_PIXELS = 16384  # a side; the largest texture graphics cards take
FARTHEST = 1e18  # scene units: float32, which every engine takes, still squares it
NORMAL_DIGITS = 3  # 0.06 degrees: no eye sees it, and a flat wall has one normal


def require_name(name: str) -> str:
    """Return the name if every simulator takes it as part of a file name.

    Raises:
        ExportError: otherwise.
    """
    if not NAME.match(name):
        raise ExportError(
            f"part name {name!r} cannot be a file name. "
            "Needed letters a-z, digits and _; rename the part."
        )
    return name


def visual_name(part: Part) -> str:
    """Return the file of a part's visual mesh, from the twin folder."""
    return f"{ASSETS}/{require_name(part.name)}_visual.obj"


def piece_name(part: Part, index: int) -> str:
    """Return the file of a part's convex piece, from the twin folder."""
    return f"{ASSETS}/{require_name(part.name)}_piece_{index:02d}.obj"


def texture_name(part: Part) -> str:
    """Return the file of a part's texture, from the twin folder."""
    return f"{ASSETS}/{require_name(part.name)}_texture.png"


def write_meshes(twin: Twin, folder: Path) -> list[Path]:
    """Write every visual mesh and convex piece of a twin into `assets/`; return the files."""
    written = []
    make_assets(folder)
    for part in twin.parts:
        written.append(write_obj(part.mesh, folder / visual_name(part), shaded=True))
        written += write_texture(part, folder)
        written += [
            write_obj(piece, folder / piece_name(part, i)) for i, piece in enumerate(part.pieces)
        ]
    return written


def write_obj(mesh: PartMesh, path: Path, *, shaded: bool = False) -> Path:
    """Write one mesh as OBJ, `v x y z r g b` with colours in 0..1; return the path.

    Corners of faces have their own `vt` and `vn` while they share `v`: the surface stays closed
    for every reader that looks at vertices.

    Args:
        mesh: of a part or of a piece of one.
        path: ending in .obj; a textured mesh names the .mtl beside it.
        shaded: with normals, which nothing but a viewer needs.
    """
    colors = mesh.colors.astype(float) / 255.0
    lines = [
        f"v {x:.9g} {y:.9g} {z:.9g} {r:.4g} {g:.4g} {b:.4g}"
        for (x, y, z), (r, g, b) in zip(mesh.vertices.tolist(), colors.tolist(), strict=True)
    ]
    corners = [[str(v) for v in (mesh.faces + 1).ravel().tolist()]]
    if mesh.texture is not None:
        values, index = _distinct(mesh.texture.uv)
        lines = [f"mtllib {path.stem}.mtl", *lines, *(f"vt {u:.6f} {v:.6f}" for u, v in values)]
        corners.append([str(i) for i in index])
    if shaded:
        normals = corner_normals(mesh.vertices, mesh.faces, CREASE)
        values, index = _distinct(normals.round(NORMAL_DIGITS) + 0.0)  # + 0: no -0
        lines += [f"vn {x:g} {y:g} {z:g}" for x, y, z in values]
        corners += [[""] * len(index)] * (mesh.texture is None) + [[str(i) for i in index]]
    if mesh.texture is not None:
        lines.append(f"usemtl {path.stem}")
    words = ["/".join(corner) for corner in zip(*corners, strict=True)]
    lines += [f"f {a} {b} {c}" for a, b, c in zip(words[::3], words[1::3], words[2::3],
                                                  strict=True)]
    write_bytes_atomic(path, ("\n".join(lines) + "\n").encode())
    return path


def _distinct(corners: NDArray[np.floating]) -> tuple[list[list[float]], list[int]]:
    """Return the different rows of [F, 3, n] values and, counted from 1, the row of each corner."""
    rows = np.ascontiguousarray(corners, np.float32).reshape(-1, corners.shape[-1])
    # rows as one value of raw bytes: sorting rows takes ten times as long
    raw = rows.view(np.dtype((np.void, rows.itemsize * rows.shape[1]))).ravel()
    _, first, index = np.unique(raw, return_index=True, return_inverse=True)
    return rows[first].tolist(), (index.ravel() + 1).tolist()


def make_assets(folder: Path) -> None:
    """Make the folder of meshes and pictures.

    Raises:
        StoreError: if it cannot be made.
    """
    try:
        (folder / ASSETS).mkdir(parents=True, exist_ok=True)
    except OSError as err:
        raise write_error(folder / ASSETS, err) from err


def png_of(texture: Texture) -> bytes:
    """Return the picture of a texture as PNG."""
    import cv2

    return bytes(cv2.imencode(".png", texture.image[..., ::-1])[1].tobytes())


def write_texture(part: Part, folder: Path) -> list[Path]:
    """Write the picture of a textured part and the material that names it; return the files."""
    texture = part.mesh.texture
    if texture is None:
        return []
    picture = folder / texture_name(part)
    write_bytes_atomic(picture, png_of(texture))
    material = (folder / visual_name(part)).with_suffix(".mtl")
    lines = f"newmtl {material.stem}\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nmap_Kd {picture.name}\n"
    write_bytes_atomic(material, lines.encode())
    return [picture, material]


def mean_rgba(mesh: PartMesh) -> tuple[float, float, float, float]:
    """Return the area-weighted mean colour of a mesh in 0..1, opaque."""
    tri = mesh.vertices[mesh.faces]
    area = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    face = mesh.colors[mesh.faces].mean(1) / 255.0
    red, green, blue = (area[:, None] * face).sum(0) / max(float(area.sum()), 1e-300)
    return round(float(red), 4), round(float(green), 4), round(float(blue), 4), 1.0


def add_material(asset: ET.Element, part: Part) -> None:
    """Add the MJCF material of a part: its texture, or the mean colour of its surface."""
    name = f"{part.name}_color"
    if part.mesh.texture is None:
        add(asset, "material", name=name, rgba=mean_rgba(part.mesh))
        return
    picture = f"{part.name}_texture"
    add(asset, "texture", name=picture, type="2d", file=texture_name(part))
    add(asset, "material", name=name, texture=picture, rgba=(1, 1, 1, 1))


def read_png(path: Path) -> NDArray[np.uint8]:
    """Return the picture of a texture, [H, W, 3] RGB.

    Raises:
        CheckError: if it is no PNG of a sensible size.
    """
    import cv2

    data = path.read_bytes()
    sides = int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
    small = data[:8] == b"\x89PNG\r\n\x1a\n" and 0 < max(sides) <= MOST_PIXELS
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if small else None
    if image is None:
        raise CheckError(f"{path}: is no PNG of up to {MOST_PIXELS} pixels a side. Needed the "
                         "picture that `build` writes; build the twin again.")
    return np.ascontiguousarray(image[..., ::-1], np.uint8)


def read_obj(path: Path, image: NDArray[np.uint8] | None = None,
             synthesised: float = 0.0) -> PartMesh:
    """Return the triangles of an OBJ: places, colours and, with a picture, texture coordinates.

    Args:
        path: as `write_obj` writes it; names, groups, materials and normals are passed over.
        image: picture of its texture.
        synthesised: share of the surface area nobody saw.

    Raises:
        CheckError: too large, or not such a file.
    """
    if path.stat().st_size > MAX_OBJ_BYTES:
        raise CheckError(f"{path}: larger than {MAX_OBJ_BYTES >> 20} MB. Needed a mesh of a few "
                         "million triangles at most; simplify it.")
    data = path.read_bytes()
    try:
        read = (_kept_numbers if len(data) <= KEPT_BYTES else
                _kept_large if len(data) <= KEPT_LARGE[1] else _numbers)
        points, uv, corners = read(data)
    except (ValueError, OverflowError) as error:  # 400 digits are no index
        raise CheckError(f"{path}: is not a mesh of triangles ({str(error)[:120]}). Needed OBJ "
                         "with `v x y z` and faces of three corners; export it as triangles."
                         ) from None
    colored = points.shape[1] == 6
    colors = (np.rint(points[:, 3:] * 255).clip(0, 255) if colored
              else np.tile(GREY, (len(points), 1)))
    texture = None
    if image is not None and corners.shape[2] > 1 and len(uv):
        texture = Texture(uv[corners[..., 1], :2].astype(np.float32), image)
    return PartMesh(points[:, :3].copy(), corners[..., 0].copy(), colors.astype(np.uint8),
                    synthesised, texture)


def _numbers(data: bytes) -> tuple[F64, F64, NDArray[np.int64]]:
    """Return places with colours, texture coordinates, and the corners of faces."""
    rows: dict[str, list[str]] = {"v": [], "vt": [], "f": []}
    for line in data.decode("ascii", "replace").splitlines():
        key, _, rest = line.partition(" ")
        if key in rows:
            rows[key].append(rest)
    points, uv = _table(rows["v"], (6, 3)), _table(rows["vt"], (2, 3))
    return points, uv, _corners(rows["f"], (len(points), len(uv)))


_kept_numbers = lru_cache(maxsize=KEPT_FILES)(_numbers)
_kept_large = lru_cache(maxsize=KEPT_LARGE[0])(_numbers)


def _table(rows: list[str], widths: tuple[int, ...]) -> F64:
    """Return the numbers of rows that are all equally long."""
    width = len(rows[0].split()) if rows else widths[0]
    found = np.array(" ".join(rows).split(), np.float64)
    if width not in widths or len(found) != width * len(rows):
        raise ValueError(f"{len(found)} numbers in {len(rows)} rows")
    if np.abs(found).max(initial=0.0) > FARTHEST:
        raise ValueError(f"a coordinate beyond {FARTHEST:g}")
    return found.reshape(-1, width)


def _corners(rows: list[str], counts: tuple[int, int]) -> NDArray[np.int64]:
    """Return [F, 3, 1 or 2] indices of places and texture coordinates of the corners of faces."""
    words = " ".join(rows).split()
    if len(words) != 3 * len(rows) or not rows:
        raise ValueError(f"{len(words)} corners in {len(rows)} faces")
    slashes = {word.count("/") for word in words}
    if slashes <= {0}:  # what has a texture has both, most has none: parsed in one go
        found = np.array(words).astype(np.int64)[:, None] - 1
    else:
        fields = [word.split("/")[:2] for word in words]
        both = all(len(field) == 2 and field[1] for field in fields)
        found = np.array([field if both else field[:1] for field in fields]).astype(np.int64) - 1
    if (found < 0).any() or (found >= np.array(counts[:found.shape[1]])).any():
        raise ValueError("a face names a vertex that does not exist")
    return found.reshape(len(rows), 3, -1)


def write_gaussians_ply(gaussians: Gaussians, path: Path) -> Path:
    """Write Gaussians as binary little-endian 3DGS PLY, atomically; return the file."""
    n, rest = len(gaussians), 3 * gaussians.shN.shape[1]
    names = _properties(rest)
    columns = [
        gaussians.means,
        np.zeros((n, 3), np.float32),
        gaussians.sh0,
        gaussians.shN.transpose(0, 2, 1).reshape(n, rest),  # channel-major: all R, all G, all B
        gaussians.logit_opacities[:, None],
        gaussians.log_scales,
        gaussians.quats,
    ]
    table = np.concatenate([np.asarray(c, "<f4") for c in columns], 1)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {n}"]
    header += [f"property float {name}" for name in names] + ["end_header\n"]
    write_bytes_atomic(path, "\n".join(header).encode() + table.astype("<f4").tobytes())
    return path


def _properties(rest: int) -> list[str]:
    return [
        *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"),
        *(f"f_rest_{i}" for i in range(rest)),
        "opacity",
        *(f"scale_{i}" for i in range(3)),
        *(f"rot_{i}" for i in range(4)),
    ]
