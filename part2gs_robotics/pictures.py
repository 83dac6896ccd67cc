"""Pictures of the report: photos of both states, and what the fits show from their cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.model.gaussians import Splats
from part2gs_robotics.model.kinematics import facing, part_motions, to_state
from part2gs_robotics.model.se3 import inverse, inverses
from part2gs_robotics.model.solids import bounds
from part2gs_robotics.report.data import Picture
from part2gs_robotics.result import BuildResult

PICTURES = 3  # held-out photos of each state in the report: sides of the object


def _views(result: BuildResult) -> tuple[list[int], list[int]]:
    """Return the views of both states to show: the one to look at first, then held-out ones.

    Of state 1 the first is on the side of the object to which its parts move, of state 0 the one
    that looks most like it.
    """
    middle, wanted = bounds((result.twin.parts[0].mesh,)).mean(0), facing(result.twin)
    shown = []
    for state in reversed(result.scene.states):
        eyes = result.frame.points(inverses(state.viewmats)[:, :3, 3])
        ways = (eyes - middle) / np.linalg.norm(eyes - middle, axis=1, keepdims=True)
        first = int(np.argmax(ways @ wanted))
        wanted = ways[first]
        views = np.flatnonzero(state.held_out)
        views = np.roll(views, -int(np.argmax(ways[views] @ wanted)) if len(views) else 0)
        shown.append([first, *views[:: max(1, len(views) // PICTURES)][:PICTURES].tolist()])
    return shown[1], shown[0]


def pictures_of(result: BuildResult) -> tuple[Picture, ...]:
    """Return photos of both states, the held-out ones with renders."""
    from part2gs_robotics.evidence.cross_render import move_gaussians

    moves = part_motions(result.motion.joints, result.motion.parents)
    moved = [move_gaussians(result.fits[source][0], result.motion.labels(source), there)
             for source, there in ((1, [inverse(move) for move in moves]), (0, moves))]
    out = []
    for index, (first, *held_out) in enumerate(_views(result)):
        out.append(_photo(result, index, first, "photo"))
        for view in held_out:
            plain = _photo(result, index, view, "held-out view")
            out.append(replace(plain, render=_drawn(result, index, view)[..., :3],
                               mesh=_meshes(result, index, view, plain),
                               moved=_drawn(result, index, view, moved[index])))
    return (*out, *_left(result))


def _left(result: BuildResult) -> list[Picture]:
    """Return the photos that show most of what no part explains."""
    return [replace(_photo(result, index, view, "photo"), left=result.left.marks[index])
            for index, view in enumerate(result.left.views) if view >= 0]


def _photo(result: BuildResult, index: int, view: int, kind: str) -> Picture:
    """Return a photo over white, its mask and where it was taken."""
    state = result.scene.states[index]
    alpha = state.alphas[view][..., None] / 255.0
    photo = state.images[view] * alpha + 255.0 * (1.0 - alpha)
    pose = inverse(state.viewmats[view])
    pose[:3, 3] = result.frame.points(pose[:3, 3])
    return Picture(f"state {index}, {kind} {state.names[view]}", index,
                   np.rint(photo).astype(np.uint8), mask=alpha[..., 0] > 0.5,
                   world_from_camera=pose,
                   fov=2 * float(np.arctan(state.height / 2 / state.Ks[view, 1, 1])))


def _meshes(result: BuildResult, index: int, view: int, photo: Picture) -> NDArray[np.uint8]:
    from part2gs_robotics.render.mesh_pictures import draw_meshes

    twin, camera = result.twin, result.scene.states[index].camera(view)
    placed = replace(camera, viewmat=inverse(np.asarray(photo.world_from_camera)))
    return draw_meshes([part.mesh for part in twin.parts], to_state(twin, index), placed)


def _drawn(result: BuildResult, index: int, view: int,
           moved: Splats | None = None) -> NDArray[np.uint8]:
    """Return [H, W, 4] what a state's Gaussians show over white, or moved ones of the other."""
    from part2gs_robotics.fit.view_color import WHITE, drawn_over
    from part2gs_robotics.render.dispatch import render

    state = result.scene.states[index]
    seen = (drawn_over(result.fits[index][0], state, view, WHITE) if moved is None
            else render(moved, state.camera(view), background=WHITE))
    both = np.concatenate([seen.color, seen.alpha[..., None]], -1)
    return np.rint(np.clip(both * 255.0, 0, 255)).astype(np.uint8)
