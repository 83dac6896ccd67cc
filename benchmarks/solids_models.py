"""Twenty articulated things of plain solids, as MJCF: boxes, cylinders, capsules and balls.

They are made up and belong to this project; no setting was chosen by them alone. Metres.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

Vec = Sequence[float]
States = dict[str, tuple[float, float]]
WHITE, GREY, DARK = "0.86 0.87 0.88", "0.45 0.46 0.48", "0.15 0.15 0.17"
RED, BLUE, YELLOW = "0.7 0.2 0.15", "0.2 0.3 0.6", "0.85 0.7 0.2"
METAL, CARD, WOOD = "0.65 0.66 0.7", "0.72 0.55 0.35", "wood"
HEAD = """<mujoco model="{name}"><compiler angle="radian"/><asset>
<texture name="wood" type="2d" builtin="gradient" rgb1=".55 .38 .22" rgb2=".4 .26 .14"
 mark="random" markrgb=".65 .5 .3" random=".05" width="256" height="256"/>
<material name="wood" texture="wood" texuniform="true" texrepeat="2 2"/>
</asset><worldbody><body name="base">{solids}</body></worldbody></mujoco>
"""


@dataclass(frozen=True)
class Thing:
    """Solids of a base with jointed bodies in it, both positions of its joints, parts on parts."""

    solids: str
    states: States
    nested: bool = False


def mjcf(name: str, thing: Thing) -> str:
    """Return the model file of a thing."""
    return HEAD.format(name=name, solids=thing.solids)


def _paint(color: str) -> str:
    return 'material="wood"' if color == WOOD else f'rgba="{color} 1"'


def _text(numbers: Vec) -> str:
    return " ".join(f"{x:.5g}" for x in numbers)


def box(at: Vec, half: Vec, color: str, euler: Vec = (0, 0, 0)) -> str:
    """Return a box by its middle and half sizes."""
    return (f'<geom type="box" pos="{_text(at)}" size="{_text(half)}" euler="{_text(euler)}" '
            f"{_paint(color)}/>")


def bar(start: Vec, end: Vec, radius: float, color: str, kind: str = "capsule") -> str:
    """Return a round bar between two points; a cylinder has flat ends."""
    return f'<geom type="{kind}" fromto="{_text([*start, *end])}" size="{radius}" {_paint(color)}/>'


def disc(start: Vec, end: Vec, radius: float, color: str) -> str:
    """Return a cylinder between two points."""
    return bar(start, end, radius, color, "cylinder")


def ball(at: Vec, radius: float, color: str) -> str:
    """Return a sphere."""
    return f'<geom type="sphere" pos="{_text(at)}" size="{radius}" {_paint(color)}/>'


def part(joint: str, kind: str, axis: Vec, at: Vec, solids: str) -> str:
    """Return a body with one joint at `at`; its solids are measured from there."""
    return (f'<body name="{joint}_body" pos="{_text(at)}"><joint name="{joint}" type="{kind}" '
            f'axis="{_text(axis)}" limited="true" range="-7 7"/>{solids}</body>')


def hinge(joint: str, axis: Vec, at: Vec, solids: str) -> str:
    """Return a body that turns."""
    return part(joint, "hinge", axis, at, solids)


def slide(joint: str, axis: Vec, at: Vec, solids: str) -> str:
    """Return a body that slides."""
    return part(joint, "slide", axis, at, solids)


def shell(half: Vec, wall: float, color: str, shelves: Vec = ()) -> str:
    """Return a cupboard about the origin, open towards -y."""
    w, d, h = half
    walls = [((0, d - wall, 0), (w, wall, h)), ((wall - w, 0, 0), (wall, d, h)),
             ((w - wall, 0, 0), (wall, d, h)), ((0, 0, h - wall), (w, d, wall)),
             ((0, 0, wall - h), (w, d, wall)), *(((0, 0, z), (w, d, wall)) for z in shelves)]
    return "".join(box(at, size, color) for at, size in walls)


def tray(half: Vec, wall: float, color: str) -> str:
    """Return an open box about the origin."""
    w, d, h = half
    walls = [((0, 0, wall - h), (w, d, wall)), ((wall - w, 0, 0), (wall, d, h)),
             ((w - wall, 0, 0), (wall, d, h)), ((0, wall - d, 0), (w, wall, h)),
             ((0, d - wall, 0), (w, wall, h))]
    return "".join(box(at, size, color) for at, size in walls)


def ring(at: Vec, radii: tuple[float, float], thick: float, color: str, flat: bool = False) -> str:
    """Return a ring of bars in the xz plane, or in the xy plane if `flat`."""
    def place(k: int) -> Vec:
        a = 2 * math.pi * k / 18
        x, z = radii[0] * math.cos(a), radii[1] * math.sin(a)
        return (at[0] + x, at[1] + z, at[2]) if flat else (at[0] + x, at[1], at[2] + z)
    return "".join(bar(place(k), place(k + 1), thick, color) for k in range(18))


def fridge() -> Thing:
    """Two doors on one line, open by different angles."""
    def door(half: float, grip: float) -> str:
        return (box((-.3, -.02, 0), (.298, .018, half), WHITE)
                + box((-.55, -.06, grip), (.012, .02, .1), METAL)
                + box((-.3, .03, -.1), (.22, .03, .04), GREY))
    return Thing(shell((.3, .3, .8), .015, WHITE, (.25, -.2, -.5))
                 + hinge("upper", (0, 0, 1), (.3, -.302, .53), door(.265, -.1))
                 + hinge("lower", (0, 0, 1), (.3, -.302, -.27), door(.525, .2)),
                 {"upper": (.05, 1.3), "lower": (.1, .8)})


def sideboard() -> Thing:
    """Two drawers side by side over two doors."""
    out = (shell((.5, .25, .5), .012, WOOD, (.1,)) + box((0, 0, -.2), (.012, .24, .3), WOOD)
           + box((0, 0, .3), (.012, .24, .2), WOOD))
    for joint, x in (("left_drawer", -.25), ("right_drawer", .25)):
        out += slide(joint, (0, -1, 0), (x, -.02, .3), tray((.235, .23, .15), .008, WOOD)
                     + box((0, -.242, 0), (.243, .01, .18), WOOD)
                     + box((0, -.28, 0), (.06, .012, .012), METAL))
    for joint, side in (("left_door", -1), ("right_door", 1)):
        out += hinge(joint, (0, 0, side), (.5 * side, -.262, -.2),
                     box((-.245 * side, 0, 0), (.243, .01, .29), WOOD)
                     + box((-.42 * side, -.03, 0), (.01, .02, .05), METAL))
    return Thing(out, {"left_drawer": (.01, .2), "right_drawer": (0, .26),
                       "left_door": (.08, 1.1), "right_door": (.05, .75)})


def scissors() -> Thing:
    """Two flat blades on a pin, in the air."""
    def blade(y: float, side: int, color: str) -> str:
        return (box((.09, y, 0), (.09, .002, .012), METAL)
                + box((-.05, y, -.012 * side), (.05, .003, .008), color)
                + ring((-.13, y, -.035 * side), (.035, .028), .007, color))
    return Thing(blade(0, 1, RED) + disc((0, -.006, 0), (0, .009, 0), .008, DARK)
                 + hinge("pin", (0, 1, 0), (0, .0055, 0), blade(0, -1, BLUE)), {"pin": (.1, .75)})


def folding_chair() -> Thing:
    """Legs and seat that turn about neighbouring lines."""
    tubes = [((-.2, -.2, 0), (-.2, .15, .8)), ((.2, -.2, 0), (.2, .15, .8)),
             ((-.2, -.2, 0), (.2, -.2, 0))]
    legs = [((-.18, .24, -.41), (-.18, 0, 0)), ((.18, .24, -.41), (.18, 0, 0)),
            ((-.18, .24, -.41), (.18, .24, -.41)), ((-.19, 0, 0), (.19, 0, 0))]
    return Thing("".join(bar(a, b, .012, GREY) for a, b in tubes)
                 + box((0, .12, .74), (.19, .01, .07), BLUE, (-.41, 0, 0))
                 + hinge("legs", (1, 0, 0), (0, -.02, .42),
                         "".join(bar(a, b, .012, GREY) for a, b in legs))
                 + hinge("seat", (1, 0, 0), (0, -.02, .45),
                         box((0, -.12, 0), (.165, .17, .012), BLUE)),
                 {"legs": (-.45, 0), "seat": (-1, .05)})


def usb_stick() -> Thing:
    """A metal cap that turns about a stud."""
    cap = (box((.034, 0, .006), (.045, .0125, .0008), METAL)
           + box((.034, 0, -.006), (.045, .0125, .0008), METAL)
           + box((.0785, 0, 0), (.001, .0125, .006), METAL))
    return Thing(box((0, 0, 0), (.03, .012, .005), DARK)
                 + box((.04, 0, 0), (.012, .008, .003), METAL)
                 + disc((-.018, 0, -.0075), (-.018, 0, .0075), .006, YELLOW)
                 + hinge("cap", (0, 0, 1), (-.018, 0, 0), cap), {"cap": (.15, 1.9)})


def knife() -> Thing:
    """A blade in an open grip; it looks the same after half a turn."""
    grip = [((0, 0, -.012), (.08, .011, .002)), ((0, -.01, 0), (.08, .002, .011)),
            ((0, .01, 0), (.08, .002, .011)), ((-.078, 0, 0), (.002, .011, .011))]
    return Thing("".join(box(at, half, YELLOW) for at, half in grip)
                 + box((-.05, 0, .012), (.03, .011, .002), DARK)
                 + slide("blade", (1, 0, 0), (0, 0, 0),
                         box((.03, 0, -.003), (.05, .0015, .006), METAL)
                         + box((0, 0, .009), (.015, .006, .006), RED)), {"blade": (.005, .055)})


def washer() -> Thing:
    """A round door on a box with a drum."""
    front = [((0, -.3, .36), (.3, .012, .06)), ((0, -.3, -.36), (.3, .012, .06)),
             ((-.26, -.3, 0), (.04, .012, .42)), ((.26, -.3, 0), (.04, .012, .42))]
    door = (disc((.235, -.012, 0), (.235, .01, 0), .225, WHITE)
            + disc((.235, -.02, 0), (.235, -.005, 0), .16, DARK)
            + box((.43, -.03, 0), (.015, .012, .04), GREY)
            + disc((.235, .01, 0), (.235, .05, 0), .15, DARK))
    return Thing(shell((.3, .3, .42), .01, WHITE) + "".join(box(a, h, WHITE) for a, h in front)
                 + disc((.15, -.33, .36), (.15, -.31, .36), .03, DARK)
                 + box((-.15, -.315, .36), (.09, .004, .03), GREY)
                 + disc((0, -.2, 0), (0, .25, 0), .2, METAL)
                 + hinge("door", (0, 0, -1), (-.235, -.325, 0), door), {"door": (.06, 1.5)})


def oven() -> Thing:
    """A door that folds down, a rack behind it."""
    rack = "".join(box((.05 * k - .3, .05, -.08), (.004, .22, .004), METAL) for k in range(13))
    knobs = "".join(disc((x, -.33, .27), (x, -.3, .27), .025, METAL) for x in (-.2, -.07, .07, .2))
    door = (box((0, -.018, .265), (.345, .016, .262), DARK)
            + box((0, -.036, .25), (.25, .003, .15), METAL)
            + bar((-.25, -.07, .48), (.25, -.07, .48), .01, METAL)
            + bar((-.25, -.07, .48), (-.25, -.02, .48), .008, METAL)
            + bar((.25, -.07, .48), (.25, -.02, .48), .008, METAL))
    return Thing(shell((.35, .3, .35), .012, GREY) + box((0, -.3, .27), (.35, .01, .08), DARK)
                 + knobs + rack + hinge("door", (1, 0, 0), (0, -.3, -.34), door),
                 {"door": (.08, 1.3)})


def desk_lamp() -> Thing:
    """An arm on a foot, a head on the arm."""
    head = hinge("head", (0, 1, 0), (0, 0, .36), bar((0, 0, 0), (.16, 0, .03), .012, RED)
                 + disc((.16, 0, .05), (.2, 0, -.04), .06, RED))
    return Thing(disc((0, 0, 0), (0, 0, .03), .12, DARK) + bar((0, 0, .03), (0, 0, .08), .02, DARK)
                 + hinge("arm", (0, 1, 0), (0, 0, .09),
                         bar((0, -.02, 0), (0, -.02, .36), .01, METAL)
                         + bar((0, .02, 0), (0, .02, .36), .01, METAL) + head),
                 {"arm": (-.25, .35), "head": (.1, .75)}, nested=True)


FIRST: dict[str, Callable[[], Thing]] = {
    f.__name__: f for f in (fridge, sideboard, scissors, folding_chair, usb_stick, knife, washer,
                            oven, desk_lamp)}
