"""Cameras of all photos in one frame: each state by itself, locked on what stayed, then jointly.

pycolmap (extra `photos`) finds and matches features and solves for cameras. Matching goes by
pairs that share features, across the states as well; each state is solved without the other, so
nothing moves within it. `lock.py` finds what stayed; only these matches join the states' points,
and one adjustment solves for all cameras together.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.errors import ConfigError, SceneError
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.photos.joint_model import Model, joint_model
from part2gs_robotics.photos.lock import Lock, lock_states
from part2gs_robotics.photos.pairs import choose_pairs, largest_features, shared_features
from part2gs_robotics.photos.posed import Posed, focus
from part2gs_robotics.readers.image_files import image_size

log = logging.getLogger(__name__)

FEATURES = 4096  # per photo, half of COLMAP's default for time; photos of 800 px have 3000
THREADS = min(4, os.cpu_count() or 1)  # what COLMAP may use: memory grows with each
LENS = "SIMPLE_RADIAL"  # one focal length and one distortion: all that 40 photos determine well
FEWEST_INLIERS = 30  # of a pair: COLMAP's own limit for a pair it trusts is 15
FAR_PX = 4.0  # median distance from the epipolar line: COLMAP calls a match right below 4
DOUBTFUL_SHARE = 0.03  # of pairs: 0 of 185 in a room of unlike walls, 140 of 278 among alike ones
FEWEST_SHARE = 0.5  # of a state's photos: with fewer, half of the walk is missing


def register(folder: Path, names: tuple[Sequence[str], Sequence[str]],
             focal: float | None = None) -> Posed:
    """Return cameras and points of both states in one frame.

    Args:
        folder: photos in `0/` and `1/`, all of one size; working files are written beside them.
        names: file names of state 0 and 1 in the order they were taken.
        focal: pixels, where the search for it begins; None = COLMAP's guess.

    Raises:
        ConfigError: pycolmap is not installed.
        SceneError: a state's photos do not register, or the states do not lock.
    """
    colmap = import_colmap()
    database = folder / "features.db"
    every = [f"{s}/{name}" for s in (0, 1) for name in names[s]]
    _extract(colmap, database, folder, (every, focal))
    _match(colmap, database, folder, every)
    models = [_solve(colmap, database, folder, s, [f"{s}/{name}" for name in names[s]])
              for s in (0, 1)]
    first, second, keys = _shared_points(colmap, database, models)
    middle, radius = focus(np.stack(list(models[0].viewmats.values())))
    lock = lock_states(first, second, middle, radius) if len(first) >= 3 else None
    if lock is None or not lock.sure:
        raise _unlocked(lock, len(first))
    log.info("states locked on %d shared points in %d places (next best motion: %d)",
             int(lock.kept.sum()), lock.cells, lock.rival)
    posed = joint_model(colmap, folder, (models[0], models[1]), lock, keys)
    doubtful, pairs = _contradicting_pairs(colmap, database, posed, image_size(folder / every[0]))
    log.info("%d of %d pairs of photos match as the cameras stand", pairs - doubtful, pairs)
    if doubtful > DOUBTFUL_SHARE * pairs:
        log.warning("%d of %d pairs of photos match well, but not as their cameras stand: a "
                    "pattern repeats (tiles, wallpaper, alike sides), and cameras may stand in the "
                    "wrong place; look at the scene with inspect, or photograph with something "
                    "in the picture that is there once", doubtful, pairs)
    return posed


def _contradicting_pairs(colmap: Any, database: Path, posed: Posed,
                         size: tuple[int, int]) -> tuple[int, int]:
    """Return how many pairs of one state match by another motion than their cameras', and all.

    Two photos of alike things agree on a motion of their own; it is that of their cameras only if
    they show the same thing.
    """
    focal, middle = posed.K[0, 0], posed.K[:2, 2]
    camera = colmap.Camera(model=LENS, width=size[0], height=size[1],
                           params=[focal, *middle, posed.distortion])
    doubtful = pairs = 0
    with colmap.Database.open(database) as db:
        ids = {image.name: image.image_id for image in db.read_all_images()}
        for state in (0, 1):
            names = [f"{state}/{name}" for name in posed.names[state]]
            places = [np.asarray(camera.cam_from_img(np.asarray(db.read_keypoints(ids[name]))
                                                     [:, :2].astype(float))) for name in names]
            for a, b in combinations(range(len(names)), 2):
                if not db.exists_two_view_geometry(ids[names[a]], ids[names[b]]):
                    continue
                found = np.asarray(db.read_two_view_geometry(ids[names[a]], ids[names[b]]
                                                             ).inlier_matches)
                if len(found) < FEWEST_INLIERS:
                    continue
                move = posed.viewmats[state][b] @ np.linalg.inv(posed.viewmats[state][a])
                off = focal * epipolar_errors(places[a][found[:, 0]], places[b][found[:, 1]], move)
                pairs += 1
                doubtful += bool(np.median(off) > FAR_PX)
    return doubtful, pairs


def epipolar_errors(first: F64, second: F64, second_from_first: F64) -> F64:
    """Return [N] Sampson distances of matched points from a known motion of the camera.

    Args:
        first: [N, 2] points on the plane z = 1 of a camera.
        second: [N, 2] the same in another camera.
        second_from_first: [4, 4].

    Source: Hartley and Zisserman, Multiple View Geometry, equation 11.9.
    """
    x, y, z = second_from_first[:3, 3]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    essential = cross @ second_from_first[:3, :3]
    a, b = (np.c_[p[:, :2], np.ones(len(p))] for p in (first, second))
    lines, back = a @ essential.T, b @ essential
    slope = (lines[:, :2] ** 2).sum(1) + (back[:, :2] ** 2).sum(1)
    return np.asarray(np.abs((b * lines).sum(1)) / np.sqrt(np.maximum(slope, 1e-300)))


def import_colmap() -> Any:
    """Return pycolmap, quiet.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        import pycolmap
    except ImportError as err:
        raise ConfigError("scene: pycolmap is not installed. Expected it for cameras from plain "
                          "photos; run pip install 'part2gs-robotics[photos]' (or pip install "
                          "pycolmap).") from err
    pycolmap.logging.minloglevel = int(pycolmap.logging.ERROR.value)
    pycolmap.logging.alsologtostderr = False
    return pycolmap


def _extract(colmap: Any, database: Path, folder: Path,
             photos: tuple[list[str], float | None]) -> None:
    every, focal = photos
    options = colmap.FeatureExtractionOptions()
    options.num_threads, options.sift.max_num_features = THREADS, FEATURES
    reader = colmap.ImageReaderOptions()
    reader.camera_model = LENS
    if focal is not None:
        width, height = image_size(folder / every[0])
        reader.camera_params = f"{focal},{width / 2},{height / 2},0"
    colmap.extract_features(database, folder, image_names=every, reader_options=reader,
                            camera_mode=colmap.CameraMode.SINGLE, extraction_options=options)


def _match(colmap: Any, database: Path, folder: Path, every: list[str]) -> None:
    large = []
    with colmap.Database.open(database) as db:
        ids = {image.name: image.image_id for image in db.read_all_images()}
        for name in every:
            stored = db.read_descriptors(ids[name])
            large.append(largest_features(np.asarray(db.read_keypoints(ids[name])),
                                          np.asarray(getattr(stored, "data", stored))))
    pairs = choose_pairs(shared_features(large), np.array([int(name[0]) for name in every]))
    chosen = folder / "pairs.txt"
    chosen.write_text("".join(f"{every[a]} {every[b]}\n" for a, b in pairs), "utf-8")
    matching, pairing = colmap.FeatureMatchingOptions(), colmap.ImportedPairingOptions()
    matching.num_threads, pairing.match_list_path = THREADS, str(chosen)
    colmap.match_image_pairs(database, matching, pairing)


def _solve(colmap: Any, database: Path, folder: Path, state: int, names: list[str]) -> Model:
    """Return one state's cameras and points, from its own photos alone."""
    options = colmap.IncrementalPipelineOptions()
    options.num_threads, options.random_seed = THREADS, 0
    options.multiple_models, options.extract_colors = False, False
    options.image_names = names
    out = folder / f"model_{state}"
    out.mkdir()
    found = colmap.incremental_mapping(database, folder, out, options).values()
    best = max(found, key=lambda model: model.num_reg_images(), default=None)
    model = None if best is None else Model.read(best)
    done = set() if model is None else set(model.viewmats)
    lost = [name for name in names if name not in done]
    if model is None or len(done) < max(FEWEST_SHARE * len(names), 3):
        raise SceneError(f"state {state}: {len(done)} of {len(names)} photos register (not: "
                         f"{_some(lost)}). Expected most of them; photograph in small steps "
                         "(10 degrees), keep the background in the picture, and put a textured "
                         "mat or the sheet of part2gs-robot marker under the object.")
    if lost:
        log.warning("state %d: %d of %d photos do not register and are left out: %s", state,
                    len(lost), len(names), _some(lost))
    return model


def _shared_points(colmap: Any, database: Path, models: list[Model],
                   ) -> tuple[F64, F64, NDArray[np.int64]]:
    """Return matched points of both states [M, 3] each, and their ids [M, 2]."""
    pairs: dict[tuple[int, int], int] = {}
    with colmap.Database.open(database) as db:
        ids = {image.name: image.image_id for image in db.read_all_images()}
        for one, own in models[0].points_of.items():
            for two, other in models[1].points_of.items():
                if not db.exists_matches(ids[one], ids[two]):
                    continue
                # every match counts: the two-view check of COLMAP keeps one motion alone
                for a, b in np.asarray(db.read_matches(ids[one], ids[two])):
                    if own[a] >= 0 and other[b] >= 0:
                        key = int(own[a]), int(other[b])
                        pairs[key] = pairs.get(key, 0) + 1
    keys = _one_to_one(pairs)
    first, second = (np.array([model.points[int(k)] for k in keys[:, s]]).reshape(-1, 3)
                     for s, model in enumerate(models))
    return first, second, keys


def _one_to_one(votes: dict[tuple[int, int], int]) -> NDArray[np.int64]:
    """Return [M, 2] pairs, each point in one: that with most votes."""
    taken: tuple[set[int], set[int]] = (set(), set())
    kept = []
    for a, b in sorted(votes, key=lambda key: (-votes[key], key)):
        if a not in taken[0] and b not in taken[1]:
            taken[0].add(a)
            taken[1].add(b)
            kept.append((a, b))
    return np.array(kept, np.int64).reshape(-1, 2)


def _unlocked(lock: Lock | None, pairs: int) -> SceneError:
    if lock is not None and lock.kept.sum() >= 3 and lock.rival:
        what = (f"two motions explain the photos alike ({lock.cells} and {lock.rival} places "
                "agree), so what stayed is not clear")
    else:
        kept = 0 if lock is None else int(lock.kept.sum())
        what = f"{kept} of {pairs} points found in both states agree on where they stayed"
    return SceneError(f"states 0 and 1: {what}. Expected a background that stays and is seen in "
                      "both states; show more of the room, put a textured mat or the sheet of "
                      "part2gs-robot marker beside the object, and move nothing but the parts.")


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
