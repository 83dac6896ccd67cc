"""COLMAP's sparse models: one of both states with a folder of photos each, or one per state."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from part2gs_robotics.errors import SceneError
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.readers.colmap_files import (
    ColmapCamera,
    ColmapImage,
    read_cameras,
    read_images,
)
from part2gs_robotics.readers.image_files import image_size, inside, own_file
from part2gs_robotics.readers.lenses import distorts, split
from part2gs_robotics.readers.nerfstudio import (
    MAX_COORDINATE,
    MAX_DISTORTION,
    PosedImage,
    intrinsics,
    refuse_missing,
)

MODELS = ("sparse/0", "sparse", "colmap/sparse/0")  # where models lie, below the scene or state
KNOWN = {("end", "start"): ("start", "end")}  # folders whose order is not that of the alphabet
UNIT_TOLERANCE = 1e-3  # of a quaternion's length: text files round to six digits

Pair = tuple[list[PosedImage], list[PosedImage]]


def model_folder(folder: Path) -> Path | None:
    """Return where a COLMAP model lies below a folder, None if there is none."""
    for name in MODELS:
        if any((folder / name / f"images.{kind}").is_file() for kind in ("bin", "txt")):
            return folder / name
    return None


def read_both(model: Path, scene: Path, allow_missing: bool) -> Pair:
    """Return the posed images of one model, divided by the folder that their names begin with.

    Args:
        model: folder of cameras and images.
        scene: the scene folder; nothing outside it is read.
        allow_missing: drop images without file instead of refusing.

    Raises:
        SceneError: not two folders, or as `read_model`.
    """
    posed = read_model(model, scene, allow_missing)
    folders = sorted({image.name.split("/")[0] for image in posed if "/" in image.name})
    loose = [image.name for image in posed if "/" not in image.name]
    if len(folders) != 2 or loose:
        some = ", ".join([*folders, *loose][:4])
        raise SceneError(f"{model}: its images lie in {len(folders)} folders, {len(loose)} in none "
                         f"({some or 'no image'}). Expected two folders, one per state, such as "
                         "images/state_0 and images/state_1; sort the photos by state and register "
                         "all in one run.")
    first, second = KNOWN.get((folders[0], folders[1]), (folders[0], folders[1]))
    return ([image for image in posed if image.name.startswith(f"{first}/")],
            [image for image in posed if image.name.startswith(f"{second}/")])


def read_model(model: Path, scene: Path, allow_missing: bool) -> list[PosedImage]:
    """Return the posed images of a model, sorted by name.

    Args:
        model: folder of cameras and images.
        scene: the scene folder; nothing outside it is read.
        allow_missing: drop images without file instead of refusing.

    Raises:
        SceneError: a broken file, a lens that cannot be undistorted, or images that lack.
    """
    for name in ("cameras", "images"):
        for kind in ("bin", "txt"):
            own_file(model / f"{name}.{kind}", scene)
    cameras, images = read_cameras(model), read_images(model)
    roots = _roots(model, scene)
    posed, missing = [], []
    for image in sorted(images, key=lambda image: image.name):
        where = f"{model}: image {image.name[:80]!r}"
        if image.camera not in cameras:
            raise SceneError(f"{where}: camera {image.camera} is not in the model. Expected one "
                             f"of {sorted(cameras)[:8]}; export the model again.")
        found = _find(scene, roots, image.name, where)
        if found is None:
            missing.append(image.name[:80])
        else:
            posed.append(_posed(image, cameras[image.camera], found, scene, where))
    if missing and not allow_missing:
        refuse_missing(model, missing, len(images))
    return posed


def _roots(model: Path, scene: Path) -> list[Path]:
    """Return the folders that names may be relative to, nearest to the model first."""
    home = model.parent
    while not any((home / name) == model for name in MODELS):
        home = home.parent
    return [*dict.fromkeys((home / "images", home, scene / "images", scene))]


def _find(scene: Path, roots: list[Path], name: str, where: str) -> Path | None:
    paths = [inside(scene, root, name, where) for root in roots]
    return next((path for path in paths if path.is_file()), None)


def _posed(image: ColmapImage, camera: ColmapCamera, path: Path, scene: Path,
           where: str) -> PosedImage:
    size = image_size(path)
    (fx, fy, cx, cy), own = split(camera.model, camera.params)
    K = intrinsics({"fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, "w": camera.size[0],
                    "h": camera.size[1]}, size, where)
    if any(abs(value) > MAX_DISTORTION for value in own):
        raise SceneError(f"{where}: distortion of {camera.model} is {own}. Expected numbers below "
                         f"{MAX_DISTORTION:g}; calibrate the lens again.")
    lens = distorts(camera.model, own)
    return PosedImage(image.name, path, size, K, own if lens else None, _pose(image, where),
                      mask=_mask(scene, path), lens=camera.model if lens else None)


def _pose(image: ColmapImage, where: str) -> F64:
    """Return [4, 4] camera_from_world; COLMAP's axes are OpenCV's and ours."""
    q, t = np.array(image.q), np.array(image.t)
    length = float(np.linalg.norm(q))
    if not (np.isfinite(q).all() and abs(length - 1) < UNIT_TOLERANCE
            and (np.abs(t) < MAX_COORDINATE).all()):
        raise SceneError(f"{where}: q is {image.q}, t is {image.t}. Expected a unit quaternion "
                         f"(w x y z) and finite numbers below {MAX_COORDINATE:g}; export the "
                         "model again.")
    w, x, y, z = q / length
    out = np.eye(4)
    out[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                   [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                   [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    out[:3, 3] = t
    return out


def _mask(scene: Path, image: Path) -> Path | None:
    """Return the mask of a photo: in a tree beside the photos' own, or in a folder below them."""
    root = scene.resolve()
    for home in (root, *image.relative_to(root).parents):
        for photos in (root / home / "images", root / home):
            if image.is_relative_to(photos):
                folder = root / home / "masks" / image.relative_to(photos).parent
                for name in (f"{image.stem}.png", f"{image.name}.png"):
                    mask = folder / name
                    if mask.is_file() and mask.resolve().is_relative_to(root):
                        return mask.resolve()
    return None
