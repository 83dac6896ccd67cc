"""Photos of two states in, a scene folder out: register, stand, scale, cut out, write."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.config import BOUNDS
from part2gs_robotics.errors import ConfigError, SceneError
from part2gs_robotics.photos.frames import FEWEST, Photo, read_photos
from part2gs_robotics.photos.markers import (
    MarkerScale,
    board_scale,
    find_board,
    find_markers,
    marker_scale,
)
from part2gs_robotics.photos.masks import make_masks
from part2gs_robotics.photos.posed import Posed
from part2gs_robotics.photos.register import import_colmap, register
from part2gs_robotics.photos.support import find_support
from part2gs_robotics.photos.write_scene import check_out, check_space, disk_needed, write_scene
from part2gs_robotics.readers.image_files import Undistorter
from part2gs_robotics.salient.network import load_network

log = logging.getLogger(__name__)

SAME_FOCAL = 0.02  # relative: 26 mm are rounded to 2 %; a phone's next lens has half or double

U8 = NDArray[np.uint8]
Photos = tuple[list[Photo], list[Photo]]


@dataclass(frozen=True)
class Wishes:
    """What may be asked for.

    Attributes:
        side: longest side of the photos used and written, pixels.
        frames: taken from a video.
        known_length: metres of the object's longest side, written for `build`; None = unknown.
        marker_m: side of a printed marker's black square, metres.
        mask_model: ONNX file of a network that makes the masks; None = they are made without.
    """

    side: int = 1024
    frames: int = 40
    known_length: float | None = None
    marker_m: float = 0.060
    mask_model: Path | None = None


@dataclass(frozen=True)
class Made:
    """What became of the photos.

    Attributes:
        registered, taken: photos with a camera, and photos given, per state.
        scale: what the markers say, None = nothing.
        facts: as in scene.json.
    """

    registered: tuple[int, int]
    taken: tuple[int, int]
    scale: MarkerScale | None
    facts: dict[str, object]


def make_scene(sources: tuple[Path, Path], out: Path, wishes: Wishes | None = None) -> Made:
    """Write a scene folder from plain photos of both states.

    The scene's world stands on what the object stands on: z up, the origin below it; metres where
    a printed marker is seen, else in units of the cameras' distance.

    Args:
        sources: of state 0 and 1: folder of photos, or a video.
        out: new folder.
        wishes: None = their defaults.

    Returns:
        What was found.

    Raises:
        ConfigError: a number that cannot be used, or pycolmap is missing.
        SceneError: photos that cannot be used; says which and what to do.
        StoreError: the scene cannot be written.
    """
    wishes = wishes or Wishes()
    _check(wishes)
    check_out(out)
    import_colmap()
    photos = _same_size((read_photos(sources[0], wishes.frames, wishes.side),
                         read_photos(sources[1], wishes.frames, wishes.side)), sources)
    photos = masked(photos, wishes.mask_model)
    check_space(out, disk_needed([[p.rgb for p in state] for state in photos]))
    posed = _registered(photos)
    used = tuple([_by_name(photos[s])[Path(n).stem] for n in posed.names[s]] for s in (0, 1))
    posed, pictures, given = _flattened(posed, used)
    scale = _scale(pictures, posed, wishes.marker_m)
    support = find_support(posed)
    standing = posed.moved(1.0, support.stand_from_world)
    if given is None:
        made = make_masks((pictures[0], pictures[1]), standing)
        masks, agree = made.masks, [round(float(np.median(a)), 4) for a in made.agree]
    else:
        masks, agree = given, None
    unit = scale.meters_per_unit if scale else 1.0 / support.radius
    final = standing.moved(unit, np.eye(4))
    facts = _facts(final, photos, scale, agree, wishes)
    write_scene(out, pictures, masks, final, dict(facts))
    taken = len(photos[0]), len(photos[1])
    return Made((len(final.names[0]), len(final.names[1])), taken, scale, facts)


def _scale(pictures: Sequence[Sequence[U8]], posed: Posed, size_m: float) -> MarkerScale | None:
    """Return what a printed board says, else what single markers do."""
    board = find_board(pictures[0], 0) | find_board(pictures[1], 1)
    single = find_markers(pictures[0], 0) | find_markers(pictures[1], 1)
    return (board_scale(board, posed.K, posed.viewmats, size_m)
            or marker_scale(single, posed.K, posed.viewmats, size_m))


def _check(wishes: Wishes) -> None:
    for name, value in (("side", wishes.side), ("frames", wishes.frames)):
        low, high = BOUNDS[name]
        if not low <= value <= high:
            raise ConfigError(f"scene: --{name} {value} is out of range. Expected {low:g} to "
                              f"{high:g}; change --{name}.")
    for name, length in (("known-length", wishes.known_length), ("marker-size", wishes.marker_m)):
        if length is not None and not 0 < length < np.inf:
            raise ConfigError(f"scene: --{name} {length}. Expected metres above 0; change "
                              f"--{name}.")


def _same_size(photos: Photos, sources: tuple[Path, Path]) -> Photos:
    """Return the photos of the size that most have; one lens took them all."""
    shapes = [p.rgb.shape for state in photos for p in state]
    common = max(set(shapes), key=shapes.count)
    kept = []
    for state, source in zip(photos, sources, strict=True):
        good = [p for p in state if p.rgb.shape == common]
        odd = [p.name for p in state if p.rgb.shape != common]
        if odd:
            log.warning("%s: %d photos of another size or turned are left out: %s", source,
                        len(odd), ", ".join(odd[:6]))
        if len(good) < FEWEST:
            raise SceneError(f"{source}: {len(good)} of {len(state)} photos are {common[1]} x "
                             f"{common[0]} pixels (not: {', '.join(odd[:6])}). Expected at least "
                             f"{FEWEST} per state of one size; hold the phone one way, and use "
                             "one lens without zoom.")
        kept.append(good)
    return kept[0], kept[1]


def masked(photos: Photos, model: Path | None) -> Photos:
    """Return the photos with masks by a network where they have none; unchanged without one.

    Raises:
        ConfigError: the file is no network that can be run here.
    """
    if model is None:
        return photos
    network = load_network(model)
    first, second = ([photo if photo.mask is not None else
                      replace(photo, mask=network.mask(photo.rgb)) for photo in state]
                     for state in photos)
    return first, second


def _by_name(photos: Sequence[Photo]) -> dict[str, Photo]:
    return {photo.name: photo for photo in photos}


def _registered(photos: Photos) -> Posed:
    """Return the cameras; the photos lie in a temporary folder while they are looked for."""
    with tempfile.TemporaryDirectory(prefix="part2gs-photos-") as work:
        names: tuple[list[str], list[str]] = ([], [])
        for s in (0, 1):
            (Path(work) / str(s)).mkdir()
            for photo in photos[s]:
                names[s].append(f"{photo.name}.png")
                cv2.imwrite(str(Path(work) / str(s) / names[s][-1]), photo.rgb[..., ::-1],
                            [cv2.IMWRITE_PNG_COMPRESSION, 1])
        return register(Path(work), names, _focal(photos))


def _focal(photos: Photos) -> float | None:
    """Return the focal length that the phone wrote, pixels; None unless all photos agree on it."""
    said = [photo.focal for state in photos for photo in state]
    known = [focal for focal in said if focal is not None]
    if not known:
        return None
    middle = float(np.median(known))
    other = sum(focal is None or abs(focal / middle - 1) > SAME_FOCAL for focal in said)
    if other:
        log.warning("%d of %d photos say another focal length than %.0f pixels, or none: it is "
                    "found from the photos alone; use one lens without zoom", other, len(said),
                    middle)
        return None
    log.info("focal length %.0f pixels, as the phone wrote it, is where the search begins", middle)
    return middle


def _flattened(posed: Posed, used: Sequence[Sequence[Photo]],
               ) -> tuple[Posed, list[list[U8]], tuple[list[U8], list[U8]] | None]:
    """Return cameras, photos and given masks without lens distortion."""
    height, width = used[0][0].rgb.shape[:2]
    lens = Undistorter(posed.K, (posed.distortion, 0.0, 0.0, 0.0, 0.0), (width, height))
    pictures: list[list[U8]] = []
    masks: list[list[U8]] = []
    blank = np.full((height, width), 255, np.uint8)
    whole = all(photo.mask is not None for state in used for photo in state)
    for state in used:
        both = [lens.color(p.rgb, blank if p.mask is None else p.mask) for p in state]
        pictures.append([rgb for rgb, _ in both])
        masks.append([mask for _, mask in both])
    if not whole and any(photo.mask is not None for state in used for photo in state):
        log.warning("some photos have masks and some have none: all are made anew")
    flat = replace(posed, K=lens.K, distortion=0.0)
    return flat, pictures, (masks[0], masks[1]) if whole else None


def _facts(posed: Posed, photos: Photos, scale: MarkerScale | None, agree: list[float] | None,
           wishes: Wishes) -> dict[str, object]:
    """Return what scene.json says, and the settings for `build`."""
    settings: dict[str, object] = {"up": "[0, 0, 1]"}
    if scale is not None:
        settings["scale"] = 1.0
    elif wishes.known_length is not None:
        settings["known_length"] = wishes.known_length
    lost = [[p.name for p in photos[s] if f"{p.name}.png" not in posed.names[s]] for s in (0, 1)]
    return {"settings": settings,
            "photos": [len(photos[0]), len(photos[1])],
            "registered": [len(posed.names[0]), len(posed.names[1])], "not_registered": lost,
            "reprojection_px": round(posed.error_px, 3),
            "points": [int(posed.seen[:, 0].sum()), int(posed.seen[:, 1].sum())],
            "points_that_stayed": int(posed.seen.all(axis=1).sum()),
            "states_apart": posed.apart,
            "scale": None if scale is None else {
                "from": scale.source, "meters_per_unit": 1.0, "markers": scale.markers,
                "spread": round(scale.spread, 4)},
            "masks": "given" if agree is None else "made", "masks_agree": agree}
