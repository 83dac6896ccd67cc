"""nerfstudio transforms.json: cameras, image paths, masks and depth of posed frames."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, cast

import numpy as np

from part2gs_robotics.errors import SceneError
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.readers.image_files import image_size, inside, own_file

MAX_JSON_BYTES = 64 << 20  # 10,000 frames with every key are below 10 MB
MAX_FRAMES = 10_000  # more posed photos of one object are a mistake
PINHOLE_MODELS = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE")
ROTATION_TOLERANCE = 1e-3  # files rounded to 4 digits stay inside, a scaled pose does not
MAX_COORDINATE = 1e9  # a camera this far from the origin is an export error; squares stay finite
FOCAL_BOUNDS = (0.1, 1e4)  # of the longer side: 157 degrees wide to nearly parallel rays
MAX_DISTORTION = 100.0  # coefficients of real lenses stay below 10, those of long lenses below 100
SUFFIXES = (".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG")
DEPTH_UNIT = 1e-3  # uint16 millimetres unless depth_unit_scale_factor says otherwise

Json = Mapping[str, object]


@dataclass(frozen=True)
class PosedImage:
    """One photo with its camera, before pixels are read.

    Attributes:
        name: file_path as the json has it.
        path: image inside the scene, symlinks resolved.
        size: (width, height) from the image header.
        K: [3, 3] pixels, pixel centres at +0.5.
        distortion: k1, k2, p1, p2, k3 in OpenCV's order, or the parameters of `lens`; None for a
            pinhole camera.
        camera_from_world: [4, 4], OpenCV axes.
        time: state the frame says it shows, None when it does not say.
        mask, depth: files inside the scene; depth_unit: scene units per count.
        lens: COLMAP's model the distortion belongs to, None for OpenCV's.
    """

    name: str
    path: Path
    size: tuple[int, int]
    K: F64
    distortion: tuple[float, ...] | None
    camera_from_world: F64
    time: int | None = None
    mask: Path | None = None
    depth: Path | None = None
    depth_unit: float = DEPTH_UNIT
    lens: str | None = None


def read_json(path: Path) -> Json:
    """Return the object in a json file, size and syntax checked.

    Raises:
        SceneError: unreadable, too large, not json, or not an object.
    """
    try:
        size = path.stat().st_size
        if size > MAX_JSON_BYTES:
            raise SceneError(f"{path}: {size} bytes. Expected at most {MAX_JSON_BYTES} bytes of "
                             "camera data; check that this is a transforms.json.")
        content = json.loads(path.read_text("utf-8"))
    except OSError as err:
        raise SceneError(f"{path}: cannot be read ({err.strerror}). Expected the cameras of the "
                         "scene in this file; check that it exists and is readable.") from err
    except (ValueError, RecursionError) as err:  # bad syntax, bad UTF-8, numbers of 5,000 digits
        reason = str(err).split("\n")[0][:120] or type(err).__name__
        raise SceneError(f"{path}: not valid JSON ({reason}). Expected an object with 'frames'; "
                         "export the cameras again.") from err
    if not isinstance(content, dict):
        raise SceneError(f"{path}: holds a {type(content).__name__}. Expected a JSON object with "
                         "'frames'; export the cameras again.")
    return content


def read_transforms(path: Path, root: Path, allow_missing: bool) -> list[PosedImage]:
    """Return the posed images of one transforms.json, sorted by name.

    Args:
        path: the json; file_path entries are relative to its folder.
        root: the scene folder; nothing outside it is read.
        allow_missing: drop frames without camera or image instead of refusing.
    """
    own_file(path, root)
    content = read_json(path)
    frames = content.get("frames")
    if not isinstance(frames, list) or not all(isinstance(f, dict) for f in frames):
        raise SceneError(f"{path}: 'frames' is missing or not a list of objects. Expected one "
                         "entry per photo with file_path and transform_matrix; export the cameras "
                         "again.")
    if len(frames) > MAX_FRAMES:
        raise SceneError(f"{path}: {len(frames)} frames. Expected at most {MAX_FRAMES}; keep the "
                         "sharpest photos of each state.")
    images, missing = [], []
    for index, frame in enumerate(frames):
        where = f"{path}: frame {index}"
        image = _find_image(frame, path, root, where)
        if image is None or "transform_matrix" not in frame:
            missing.append(str(frame.get("file_path"))[:80])
        else:
            images.append(_posed(frame, content, image, path, root, where))
    if missing and not allow_missing:
        refuse_missing(path, missing, len(frames))
    return sorted(images, key=lambda image: image.name)


def refuse_missing(path: Path, missing: Sequence[str], total: int) -> NoReturn:
    """Refuse a camera file some of whose frames lack camera or image.

    Raises:
        SceneError: always.
    """
    raise SceneError(
        f"{path}: {len(missing)} of {total} frames have no camera or no image file "
        f"({', '.join(missing[:3])}{', ...' if len(missing) > 3 else ''}). Expected a pose and an "
        "existing image for every frame; export them again or go on without these frames with "
        "--allow-missing.")


def _find_image(frame: Json, path: Path, root: Path, where: str) -> Path | None:
    file_path = frame.get("file_path")
    exact = inside(root, path.parent, file_path, where)
    # ArtGS keeps the masked photos in ../rgba beside the originals its json may name
    masked = exact.parent.parent / "rgba" / f"{exact.stem}.png"
    names = [exact, *(exact.with_name(exact.name + suffix) for suffix in SUFFIXES)]
    if exact.suffix.lower() in (".jpg", ".jpeg"):
        names.insert(0, masked)
    for name in names:
        if name.is_file():
            return inside(root, name.parent, name.name, where)
    return None


def _posed(frame: Json, shared: Json, image: Path, path: Path, root: Path,
           where: str) -> PosedImage:
    size = image_size(image)
    entries: dict[str, object] = {**shared, **frame}  # a frame's own intrinsics win
    extra: dict[str, Path | None] = {}
    for key, entry in (("mask", "mask_path"), ("depth", "depth_file_path")):
        extra[key] = inside(root, path.parent, frame[entry], where) if entry in frame else None
    unit = number(entries, "depth_unit_scale_factor", where, DEPTH_UNIT)
    time = frame.get("time")
    if time not in (None, 0, 1):
        raise SceneError(f"{where}: time is {str(time)[:40]!r}. Expected 0 or 1, the state this "
                         "photo shows; keep two states.")
    return PosedImage(str(frame["file_path"]), image, size, intrinsics(entries, size, where),
                      _distortion(entries, where), camera_from_world(frame, where),
                      None if time is None else int(cast(int, time)), mask=extra["mask"],
                      depth=extra["depth"], depth_unit=unit)


def number(entries: Json, key: str, where: str, default: float) -> float:
    """Return a finite number of a json object.

    Raises:
        SceneError: present but not a finite number.
    """
    value = entries.get(key, default)
    try:
        good = isinstance(value, int | float) and not isinstance(value, bool)
        result = float(value) if good else math.nan  # type: ignore[arg-type]  # checked above
    except OverflowError:
        result = math.inf
    if not math.isfinite(result):
        raise SceneError(f"{where}: {key} is {str(value)[:40]!r}. Expected a finite number; "
                         "correct the entry.")
    return result


def intrinsics(entries: Json, size: tuple[int, int], where: str) -> F64:
    """Return K [3, 3] in pixels from fl_x, fl_y, cx, cy, w, h or fields of view; or raise."""
    width, height = size
    stated = number(entries, "w", where, width), number(entries, "h", where, height)
    if stated != (width, height):
        raise SceneError(f"{where}: camera says {stated[0]:g} x {stated[1]:g} pixels, the image is "
                         f"{width} x {height}. Expected equal sizes; use the images the cameras "
                         "were made for (no images_4 folder), --max-side downscales them.")
    if "fl_x" in entries:
        fl_x = number(entries, "fl_x", where, 0.0)
        fl_y = number(entries, "fl_y", where, fl_x)
    else:
        fl_x = _focal(entries, "camera_angle_x", width, where, None)
        fl_y = _focal(entries, "camera_angle_y", height, where, fl_x)
    low, high = (bound * max(size) for bound in FOCAL_BOUNDS)
    if not (low < fl_x < high and low < fl_y < high and 0.5 < fl_x / fl_y < 2):
        raise SceneError(f"{where}: focal length is {fl_x:g}, {fl_y:g} pixels. Expected two "
                         f"similar numbers from {low:g} to {high:g}; export the cameras again.")
    cx, cy = number(entries, "cx", where, width / 2), number(entries, "cy", where, height / 2)
    if not (0 < cx < width and 0 < cy < height):
        raise SceneError(f"{where}: principal point is {cx:g}, {cy:g}. Expected a point inside the "
                         f"{width} x {height} image; export the cameras again.")
    return np.array([[fl_x, 0, cx], [0, fl_y, cy], [0, 0, 1]], float)


def _focal(entries: Json, key: str, side: int, where: str, default: float | None) -> float:
    if key not in entries:
        if default is not None:
            return default
        raise SceneError(f"{where}: no intrinsics. Expected fl_x (pixels) or camera_angle_x (rad), "
                         "per file or per frame; add one of them.")
    angle = number(entries, key, where, 0.0)
    if not 0 < angle < math.pi:
        raise SceneError(f"{where}: {key} is {angle:g}. Expected a field of view between 0 and pi "
                         "rad; correct the entry.")
    return side / (2 * math.tan(angle / 2))


def _distortion(entries: Json, where: str) -> tuple[float, ...] | None:
    model = str(entries.get("camera_model", "OPENCV")).upper()
    k4 = number(entries, "k4", where, 0.0)
    if model not in PINHOLE_MODELS or entries.get("is_fisheye") or k4 != 0:
        name = "fisheye" if entries.get("is_fisheye") or k4 != 0 else model[:40]
        raise SceneError(f"{where}: camera model {name} is not supported. Expected one of "
                         f"{', '.join(PINHOLE_MODELS)}; undistort fisheye photos first "
                         "(for example with COLMAP's image_undistorter).")
    found = tuple(number(entries, key, where, 0.0) for key in ("k1", "k2", "p1", "p2", "k3"))
    if max(map(abs, found)) > MAX_DISTORTION:
        raise SceneError(f"{where}: distortion k1 k2 p1 p2 k3 is {found}. Expected numbers below "
                         f"{MAX_DISTORTION:g}; export the cameras again.")
    return found if any(found) else None


def camera_from_world(frame: Json, where: str) -> F64:
    """Return [4, 4] camera_from_world (OpenCV axes) of an OpenGL camera-to-world frame.

    Raises:
        SceneError: wrong shape, not finite, singular, scaled or mirrored.
    """
    return from_opengl(frame["transform_matrix"], "transform_matrix", where)


def from_opengl(numbers: object, name: str, where: str) -> F64:
    """Return [4, 4] camera_from_world of a 4 x 4 camera-to-world matrix with OpenGL axes.

    Args:
        numbers: nested lists.
        name: what messages call them.
        where: their place.

    Raises:
        SceneError: as `camera_from_world`.
    """
    try:
        matrix = np.array(numbers, float)
    except (TypeError, ValueError, OverflowError):
        matrix = np.zeros(0)
    if matrix.shape != (4, 4):
        raise SceneError(f"{where}: {name} has shape {matrix.shape}. Expected 4 x 4 "
                         "numbers, camera to world; export the cameras again.")
    if not (np.abs(matrix) < MAX_COORDINATE).all():  # false for NaN, too
        raise SceneError(f"{where}: {name} holds NaN, infinity or a number beyond "
                         f"{MAX_COORDINATE:g}. Expected finite numbers; drop the frame or export "
                         "the cameras again.")
    rot = matrix[:3, :3]
    error = float(np.abs(rot.T @ rot - np.eye(3)).max())
    if error > ROTATION_TOLERANCE or np.linalg.det(rot) < 0:
        raise SceneError(f"{where}: {name} is not a rotation (off by {error:.3g}, "
                         f"determinant {np.linalg.det(rot):.3g}). Expected orthonormal columns and "
                         "determinant 1; remove scale or mirroring from the poses.")
    if np.abs(matrix[3] - [0, 0, 0, 1]).max() > ROTATION_TOLERANCE:
        raise SceneError(f"{where}: last row of {name} is {matrix[3].tolist()}. Expected "
                         "0 0 0 1; export the cameras again.")
    left, _, right = np.linalg.svd(rot)  # nearest rotation: rounding must not scale the scene
    axes = (left @ right) * np.array([1.0, -1.0, -1.0])  # OpenGL to OpenCV: y and z turn round
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = axes.T, -axes.T @ matrix[:3, 3]
    return out
