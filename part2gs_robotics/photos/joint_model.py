"""Both states' points and cameras joined where they stayed, and solved for together."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.photos.lock import Lock, carried
from part2gs_robotics.photos.posed import Posed

log = logging.getLogger(__name__)

OUTLIER_PX = 3.0  # reprojection; noise of SIFT is 0.5 px, so six sigma
LEAST_ANGLE_DEG = 1.5  # between rays: COLMAP's own limit for a point whose depth means something


@dataclass(frozen=True)
class Model:
    """One state's solution, in plain arrays.

    Attributes:
        params: focal length, cx, cy, k1 of the lens; size: width, height.
        viewmats: name -> [4, 4] camera_from_world.
        keypoints: name -> [N, 2] pixels.
        points_of: name -> [N] id of each keypoint's point, -1 = none.
        points: id -> [3].
    """

    params: F64
    size: tuple[int, int]
    viewmats: dict[str, F64]
    keypoints: dict[str, F64]
    points_of: dict[str, NDArray[np.int64]]
    points: dict[int, F64]

    @classmethod
    def read(cls, model: Any) -> Model:
        """Return the arrays of a pycolmap reconstruction."""
        camera = next(iter(model.cameras.values()))
        images = sorted((i for i in model.images.values() if i.has_pose), key=lambda i: i.name)
        views, pixels, owners = {}, {}, {}
        for image in images:
            view = np.eye(4)
            view[:3] = image.cam_from_world().matrix()
            views[image.name] = view
            pixels[image.name] = np.array([p.xy for p in image.points2D]).reshape(-1, 2)
            owners[image.name] = np.array([p.point3D_id if p.has_point3D() else -1
                                           for p in image.points2D], np.int64)
        points = {int(k): np.array(p.xyz) for k, p in model.points3D.items()}
        return cls(np.array(camera.params), (camera.width, camera.height), views, pixels, owners,
                   points)


def joint_model(colmap: Any, folder: Path, models: tuple[Model, Model], lock: Lock,
                keys: NDArray[np.int64]) -> Posed:
    """Return both states in the frame of state 0 after one adjustment of all cameras.

    Args:
        colmap: pycolmap.
        folder: for working files.
        models: of state 0 and 1, each in its own frame.
        lock: how they lie to each other, and which pairs stayed.
        keys: [M, 2] ids of the paired points.
    """
    joined, paired = folder / "joined", keys[lock.kept]
    joined.mkdir()
    _write_model(joined, models, lock, paired)
    model = colmap.Reconstruction(joined)
    for _ in range(2):  # the second time without what the first shows to be wrong
        _adjust(colmap, model)
        colmap.ObservationManager(model).filter_all_points3D(OUTLIER_PX, LEAST_ANGLE_DEG)
    model.update_point_3d_errors()
    return _posed(Model.read(model), lock, float(model.compute_mean_reprojection_error()))


def _adjust(colmap: Any, model: Any) -> None:
    """Solve for all cameras, the lens and all points; pycolmap's own wrapper writes to stderr."""
    options, config = colmap.BundleAdjustmentOptions(), colmap.BundleAdjustmentConfig()
    options.refine_principal_point, options.print_summary = False, False
    options.ceres.loss_function_type = colmap.LossFunctionType.SOFT_L1
    for image in model.images:
        config.add_image(image)
    config.fix_gauge(colmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    colmap.create_default_bundle_adjuster(options, config, model).solve()


def _posed(model: Model, lock: Lock, error: float) -> Posed:
    names = [[n for n in model.viewmats if n[0] == str(s)] for s in (0, 1)]
    ids = sorted(model.points)
    place = {k: n for n, k in enumerate(ids)}
    seen = np.zeros((len(ids), 2), bool)
    for name, owners in model.points_of.items():
        seen[[place[int(k)] for k in owners[owners >= 0]], int(name[0])] = True
    focal, cx, cy, k1 = model.params
    views = [np.stack([model.viewmats[n] for n in names[s]]) for s in (0, 1)]
    short = [tuple(n.partition("/")[2] for n in names[s]) for s in (0, 1)]
    return Posed(np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1.0]]), float(k1),
                 (short[0], short[1]), (views[0], views[1]),
                 np.array([model.points[k] for k in ids]).reshape(-1, 3), seen, lock.residual,
                 error)


def _write_model(out: Path, models: tuple[Model, Model], lock: Lock,
                 paired: NDArray[np.int64]) -> None:
    """Write COLMAP's three text files of the joined model, which every version of it reads."""
    offset = 1 + max(models[0].points, default=0)
    renamed = {int(b): int(a) for a, b in paired}
    back = np.linalg.inv(lock.zero_from_one)
    images: list[str] = []
    places = dict(models[0].points)
    tracks: dict[int, list[tuple[int, int]]] = {}
    if models[1].points:
        moved = carried(np.stack(list(models[1].points.values())), lock.scale, lock.zero_from_one)
        places |= {k + offset: p for k, p in zip(models[1].points, moved, strict=True)
                   if k not in renamed}
    for state, model in enumerate(models):
        for name, view in model.viewmats.items():
            number, owners = len(images) + 1, model.points_of[name].copy()
            if state:
                owners = np.array([k if k < 0 else renamed.get(int(k), int(k) + offset)
                                   for k in owners])
                view = view.copy()
                view[:3, 3] *= lock.scale
                view = view @ back
            for at in np.flatnonzero(owners >= 0):
                tracks.setdefault(int(owners[at]), []).append((number, int(at)))
            images.append(_image_lines(number, name, view, model.keypoints[name], owners))
    width, height = models[0].size
    params = np.mean([model.params for model in models], axis=0)
    (out / "cameras.txt").write_text(f"1 SIMPLE_RADIAL {width} {height} "
                                     f"{' '.join(map(repr, map(float, params)))}\n", "utf-8")
    (out / "images.txt").write_text("".join(images), "utf-8")
    (out / "points3D.txt").write_text("".join(_point_line(k, places[k], tracks[k])
                                              for k in sorted(tracks)), "utf-8")


def _image_lines(number: int, name: str, view: F64, pixels: F64, owners: NDArray[np.int64]) -> str:
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(view[:3, :3]).as_quat()
    pose = " ".join(repr(float(v)) for v in (w, x, y, z, *view[:3, 3]))
    dots = " ".join(f"{u:.4f} {v:.4f} {k}" for (u, v), k in zip(pixels, owners, strict=True))
    return f"{number} {pose} 1 {name}\n{dots}\n"


def _point_line(key: int, place: F64, track: list[tuple[int, int]]) -> str:
    x, y, z = map(float, place)
    return f"{key} {x!r} {y!r} {z!r} 0 0 0 0 {' '.join(f'{i} {j}' for i, j in track)}\n"
