"""Draw the README's picture from a build: photos of both states beside the twin in MuJoCo.

python benchmarks/readme_figure.py examples/microwave out/demo docs/figure.png
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

Rgb = NDArray[np.uint8]
TILE = 360  # four tiles are as wide as the README's column on a dense screen
# By body: world, base, then the moving parts.
TINTS = ((0.6, 0.6, 0.6), (0.62, 0.65, 0.7), (0.16, 0.42, 0.8), (0.85, 0.4, 0.12), (0.2, 0.6, 0.35))
INK, PAPER = (40, 34, 27), (255, 255, 255)  # BGR


def main() -> int:
    """Write the picture; the camera is that of the named view of each state."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", type=Path, help="scene folder in the ArtGS layout")
    parser.add_argument("twin", type=Path, help="output folder of its build")
    parser.add_argument("figure", type=Path)
    parser.add_argument("--views", type=int, nargs=2, default=(14, 8), help="one view per state")
    args = parser.parse_args()
    first, _, _ = read_view(args.scene, "start", args.views[0])
    second, camera, focal = read_view(args.scene, "end", args.views[1])
    pictures = {
        "photo, state 0": first,
        "photo, state 1": second,
        "twin in MuJoCo, state 1": render(args.twin, 1.0, camera, focal, len(second)),
        "half way, coloured by part": render(args.twin, 0.5, camera, focal, len(second), tint=True),
    }
    tiles = [labelled(picture, name) for name, picture in pictures.items()]
    cv2.imwrite(str(args.figure), np.hstack(tiles), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return 0


def read_view(scene: Path, state: str, index: int) -> tuple[Rgb, NDArray[np.float64], float]:
    """Return a photo on white (BGR), world_from_camera (OpenGL) and the focal length."""
    cameras = json.loads((scene / f"transforms_train_{state}.json").read_text())
    frame = cameras["frames"][index]
    rgba = cv2.imread(str(scene / frame["file_path"]), cv2.IMREAD_UNCHANGED).astype(float)
    alpha = rgba[..., 3:] / 255
    photo = (rgba[..., :3] * alpha + 255 * (1 - alpha)).round().astype(np.uint8)
    return photo, np.array(frame["transform_matrix"]), float(cameras["fl_x"])


def render(
    twin: Path,
    share: float,
    world_from_camera: NDArray[np.float64],
    focal: float,
    size: int,
    *,
    tint: bool = False,
) -> Rgb:
    """Return the twin on white (BGR) as a camera sees it, `share` of the way to state 1."""
    spec = mujoco.MjSpec.from_file(str(twin / "twin.xml"))
    spec.worldbody.add_camera(name="view", fovy=float(np.rad2deg(2 * np.arctan(size / 2 / focal))))
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.4] * 3, [0.5] * 3
    spec.visual.global_.offwidth = spec.visual.global_.offheight = 2 * TILE
    model = spec.compile()
    data = mujoco.MjData(model)
    start, end = (model.key(key).qpos for key in ("state_0", "state_1"))
    data.qpos[:] = (1 - share) * start + share * end
    mujoco.mj_forward(model, data)
    data.cam_xpos[-1] = world_from_camera[:3, 3]
    data.cam_xmat[-1] = world_from_camera[:3, :3].ravel()
    if tint:
        model.geom_matid[:] = -1
        model.geom_rgba[:, :3] = [TINTS[int(body) % len(TINTS)] for body in model.geom_bodyid]
    option = mujoco.MjvOption()
    option.geomgroup[:] = [0, 0, 1, 0, 0, 0]
    with mujoco.Renderer(model, 2 * TILE, 2 * TILE) as renderer:
        renderer.update_scene(data, "view", option)
        colour = renderer.render()
        renderer.enable_segmentation_rendering()
        renderer.update_scene(data, "view", option)
        mask = renderer.render()[..., 0] >= 0
    picture = np.where(mask[..., None], colour, 255).astype(np.uint8)[..., ::-1]
    return cv2.resize(picture, (TILE, TILE), interpolation=cv2.INTER_AREA)


def labelled(picture: Rgb, text: str) -> Rgb:
    """Return a square tile with a caption below."""
    tile = cv2.resize(picture, (TILE, TILE), interpolation=cv2.INTER_CUBIC)
    tile = cv2.copyMakeBorder(tile, 0, 34, 4, 4, cv2.BORDER_CONSTANT, value=PAPER)
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, 0.55
    (width, _), _ = cv2.getTextSize(text, font, scale, 1)
    where = ((tile.shape[1] - width) // 2, tile.shape[0] - 12)
    cv2.putText(tile, text, where, font, scale, INK, 1, cv2.LINE_AA)
    return tile


if __name__ == "__main__":
    sys.exit(main())
