"""Draw the tutorial's pictures: how to photograph an object in two states, and what fails.

python benchmarks/tutorial_pictures.py docs
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.photos.markers import marker_bits

Rgb = NDArray[np.uint8]
SIZE = 264, 352  # height, width of a photo: three side by side are as wide as a page
QUALITY = 82  # of JPEG: noise of the pictures' own stays below what is seen
LOW, HIGH = (1.25, 18.0), (1.25, 45.0)  # metres from the middle, degrees above: the two rounds
ROUND = 20  # photos of a round
MIDDLE = (0.06, -0.03, 0.74)  # of the cabinet on its table with its parts out, metres
CABINET = """
<body name="cabinet" pos="0 0 .6">
  <geom type="box" size=".149 .18 .01" pos="0 0 .011" rgba="{wood}"/>
  <geom type="box" size=".149 .18 .01" pos="0 0 .349" rgba="{wood}"/>
  <geom type="box" size=".14 .18 .01" pos="0 0 .13" rgba="{wood}"/>
  <geom type="box" size=".15 .01 .18" pos="0 -.19 .18" rgba="{wood}"/>
  <geom type="box" size=".15 .01 .18" pos="0 .19 .18" rgba="{wood}"/>
  <geom type="box" size=".01 .18 .168" pos="-.138 0 .18" rgba="{wood}"/>
  <body pos=".16 -.2 .24"><joint name="door" axis="0 0 -1"/>
    <geom type="box" size=".01 .2 .11" pos="0 .2 0" rgba=".16 .42 .7 1"/>
    <geom type="box" size=".012 .008 .05" pos=".02 .36 0" rgba=".8 .8 .8 1"/></body>
  <body pos="0 0 .07"><joint name="drawer" type="slide" axis="1 0 0"/>
    <geom type="box" size=".01 .2 .055" pos=".16 0 0" rgba=".85 .45 .15 1"/>
    <geom type="box" size=".15 .17 .004" pos="0 0 -.04" rgba=".85 .7 .5 1"/>
    <geom type="box" size=".15 .004 .035" pos="0 -.17 -.01" rgba=".85 .7 .5 1"/>
    <geom type="box" size=".15 .004 .035" pos="0 .17 -.01" rgba=".85 .7 .5 1"/>
    <geom type="box" size=".012 .06 .008" pos=".18 0 0" rgba=".8 .8 .8 1"/></body>
</body>"""
WORLD = """<mujoco><compiler eulerseq="zyx"/>
<visual><global offwidth="704" offheight="528" fovy="42"/><map znear=".005"/>
<headlight ambient=".35 .35 .35" diffuse=".25 .25 .25" specular="0 0 0"/></visual>
<asset>{textures}
<material name="table" texture="table"/><material name="sheet" texture="sheet"/>
<material name="floor" texture="floor" texrepeat="3 3"/>
<material name="wall" texture="wall" texrepeat="2 1"/></asset>
<worldbody>
<light directional="true" pos="1 1 3" dir="-.4 -.5 -1" diffuse=".5 .5 .5" castshadow="true"/>
<light directional="true" pos="1 -2 3" dir="-.4 .6 -1" diffuse=".25 .25 .25" castshadow="false"/>
<geom type="plane" size="4 4 .1" material="floor"/>
<geom type="box" size=".5 .65 .02" pos="0 0 .58" material="table"/>
<geom type="box" size=".03 .03 .28" pos=".42 .57 .28" rgba=".4 .3 .2 1"/>
<geom type="box" size=".03 .03 .28" pos="-.42 .57 .28" rgba=".4 .3 .2 1"/>
<geom type="box" size=".03 .03 .28" pos=".42 -.57 .28" rgba=".4 .3 .2 1"/>
<geom type="box" size=".03 .03 .28" pos="-.42 -.57 .28" rgba=".4 .3 .2 1"/>
<geom type="box" size=".13 .09 .001" pos=".32 .42 .601" euler="20 0 0" material="sheet"/>
<geom type="box" size=".01 2.5 1.4" pos="-2.5 0 1.4" material="wall"/>
<geom type="box" size="2.5 .01 1.4" pos="0 -2.5 1.4" material="wall"/>
<geom type="box" size=".3 .3 .5" pos="-1.2 -1.3 .5" rgba=".35 .45 .35 1"/>
<geom type="cylinder" size=".12 .6" pos="-1.6 1.5 .6" rgba=".6 .3 .3 1"/>
{cabinet}{cameras}</worldbody></mujoco>"""


def main() -> int:
    """Write the three pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    with tempfile.TemporaryDirectory() as scratch:
        write_textures(Path(scratch))
        for name, picture in {"states": states(Path(scratch)), "walk": walk(Path(scratch)),
                              "fails": fails(Path(scratch))}.items():
            cv2.imwrite(str(folder / f"tutorial_{name}.jpg"), picture[..., ::-1],
                        [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return 0


def write_textures(folder: Path) -> None:
    """Write patterns of table, floor and wall, a sheet of markers, and a plain white."""
    rng = np.random.default_rng(0)
    for name, color, deep in (("table", (180, 140, 95), 14), ("floor", (130, 125, 120), 6),
                              ("wall", (190, 186, 172), 6)):
        noise = np.zeros((512, 512), np.float32)
        for level in range(3, 9):
            grid = rng.normal(size=(2**level, 2**level)).astype(np.float32)
            noise += cv2.resize(grid, (512, 512), interpolation=cv2.INTER_CUBIC)
        image = np.clip(np.array(color) + deep * noise[..., None], 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / f"{name}.png"), image[..., ::-1])
    sheet = np.full((36, 52), 255, np.uint8)
    for k in range(6):
        top, left = 6 + 16 * (k // 3), 6 + 16 * (k % 3)
        sheet[top:top + 8, left:left + 8] = np.where(marker_bits(k), 0, 255)
    large = cv2.resize(sheet, None, fx=10, fy=10, interpolation=cv2.INTER_NEAREST)
    cv2.imwrite(str(folder / "sheet.png"), large)
    cv2.imwrite(str(folder / "plain.png"), np.full((8, 8), 245, np.uint8))


def room(folder: Path, *, plain: bool = False, cameras: str = "") -> mujoco.MjModel:
    """Return the room; plain: no pattern on table, floor and walls."""
    names = ("table", "floor", "wall", "sheet")
    textures = "".join(
        f'<texture name="{name}" type="2d" file="{folder}/{"plain" if plain else name}.png"/>'
        for name in names)
    cabinet = CABINET.format(wood=".78 .6 .42 1")
    return mujoco.MjModel.from_xml_string(WORLD.format(
        textures=textures, cabinet=cabinet, cameras=cameras))


def photo(model: mujoco.MjModel, state: int, turn: float, where: tuple[float, float] = LOW,
          aim: tuple[float, float, float] = MIDDLE) -> Rgb:
    """Return a photo from `turn` degrees round the object; state 1 has its parts open."""
    data = mujoco.MjData(model)
    data.joint("door").qpos = state * 1.3
    data.joint("drawer").qpos = state * 0.16
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat, camera.distance = aim, where[0]
    camera.azimuth, camera.elevation = 180 + turn, -where[1]
    with mujoco.Renderer(model, 2 * SIZE[0], 2 * SIZE[1]) as renderer:
        renderer.update_scene(data, camera)
        return cv2.resize(renderer.render(), SIZE[::-1], interpolation=cv2.INTER_AREA)


def labelled(image: Rgb, text: str) -> Rgb:
    """Return the picture with a line of text below it, on white."""
    foot = np.full((34, image.shape[1], 3), 255, np.uint8)
    cv2.putText(foot, text, (6, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.47, (40, 34, 27), 1, cv2.LINE_AA)
    return np.pad(np.vstack([image, foot]), ((4, 0), (4, 4), (0, 0)), constant_values=255)


def sheet_of(rows: list[list[Rgb]]) -> Rgb:
    """Return rows of pictures as one."""
    return np.vstack([np.hstack(row) for row in rows])


def states(folder: Path) -> Rgb:
    """Both states, from three places of the same walk."""
    model = room(folder)
    names = "closed: round it low ...", "... every 18 degrees, then ...", "... once more from above"
    places = ((10.0, LOW), (28.0, LOW), (40.0, HIGH))
    top = [labelled(photo(model, 0, *place), name)
           for place, name in zip(places, names, strict=True)]
    below = [labelled(photo(model, 1, *place), "open: nothing else has moved")
             for place in places]
    return sheet_of([top, below])


def walk(folder: Path) -> Rgb:
    """The walk as seen from outside, with a box where every photo is taken."""
    boxes = []
    for (distance, above), color in ((LOW, ".1 .35 .8 1"), (HIGH, ".85 .4 .1 1")):
        for k in range(ROUND):
            turn, rise = 2 * np.pi * k / ROUND, np.deg2rad(above)
            x, y = distance * np.cos(rise) * np.array([np.cos(turn), np.sin(turn)])
            z = MIDDLE[2] + distance * np.sin(rise)
            angles = f"{np.degrees(turn):.1f} {-above:.1f} 0"
            boxes.append(f'<body pos="{x:.3f} {y:.3f} {z:.3f}" euler="{angles}"><geom type="box" '
                         f'size=".008 .04 .06" rgba="{color}"/></body>')
    model = room(folder, cameras="".join(boxes))
    return np.hstack([
        labelled(photo(model, 0, 30.0, (3.0, 25.0)), "two rounds of 20 photos"),
        labelled(photo(model, 0, 30.0, (3.4, 89.0)), "the same from the ceiling")])


def fails(folder: Path) -> Rgb:
    """What a good photo is, and photos that fail."""
    good = room(folder)
    sharp = photo(good, 1, 15.0)
    kernel = np.zeros((15, 15), np.float32)
    kernel[np.arange(15), np.arange(15)] = 1 / 15
    lamp = np.hypot(*np.meshgrid(np.linspace(-1.4, 0.6, SIZE[1]), np.linspace(-0.5, 1.5, SIZE[0])))
    dark = np.clip(sharp * (1.9 * np.exp(-1.5 * lamp))[..., None], 0, 255).astype(np.uint8)
    far = photo(good, 1, 15.0, (3.2, 18.0))
    cut = photo(good, 1, 15.0, (0.7, 18.0), (0.1, 0.18, 0.7))
    return sheet_of([
        [labelled(sharp, "good: whole, sharp, half of the picture"),
         labelled(far, "too far: few pixels on the object"),
         labelled(cut, "cut off: its outline is not seen")],
        [labelled(cv2.filter2D(sharp, -1, kernel), "shaken: hold still, or take a video slowly"),
         labelled(dark, "one lamp: no detail in the shadows"),
         labelled(photo(room(folder, plain=True), 1, 15.0), "plain: nothing to find cameras by")],
    ])


if __name__ == "__main__":
    sys.exit(main())
