"""More things of plain solids, see solids_models."""

from __future__ import annotations

import math
from collections.abc import Callable

from solids_models import (
    BLUE,
    CARD,
    DARK,
    FIRST,
    GREY,
    METAL,
    RED,
    WHITE,
    Thing,
    ball,
    bar,
    box,
    disc,
    hinge,
    ring,
    shell,
    slide,
    tray,
)


def glasses() -> Thing:
    """A frame with two temples."""
    out = "".join(ring((.033 * s, 0, 0), (.028, .0224), .007, DARK) for s in (-1, 1))
    out += bar((-.008, 0, .005), (.008, 0, .005), .004, DARK)
    for joint, side in (("left", -1), ("right", 1)):
        out += bar((.061 * side, 0, .004), (.07 * side, .004, .006), .004, DARK)
        out += hinge(joint, (0, 0, side), (.071 * side, .006, .006),
                     bar((0, 0, 0), (0, .1, .002), .0035, RED)
                     + bar((0, .1, .002), (0, .135, -.02), .004, RED))
    return Thing(out, {"left": (0, .9), "right": (-.2, .2)})


def office_chair() -> Thing:
    """A seat that turns about its own middle."""
    out = disc((0, 0, .08), (0, 0, .42), .03, METAL)
    for k in range(5):
        x, y = .28 * math.cos(.4 * math.pi * k), .28 * math.sin(.4 * math.pi * k)
        out += bar((0, 0, .1), (x, y, .06), .02, DARK) + ball((x, y, .03), .03, DARK)
    seat = (box((0, 0, 0), (.24, .23, .035), BLUE) + box((0, .23, .35), (.2, .025, .22), BLUE)
            + box((0, .24, .1), (.03, .012, .12), DARK))
    for side in (-1, 1):
        seat += (box((.26 * side, 0, .2), (.025, .14, .015), DARK)
                 + box((.26 * side, 0, .1), (.015, .03, .1), DARK))
    return Thing(out + hinge("seat", (0, 0, 1), (0, 0, .45), seat), {"seat": (0, .9)})


def window() -> Thing:
    """One of two panes slides."""
    def pane(x: float, y: float) -> str:
        frame = [((x - .18, y, 0), (.02, .012, .275)), ((x + .18, y, 0), (.02, .012, .275)),
                 ((x, y, .255), (.2, .012, .02)), ((x, y, -.255), (.2, .012, .02))]
        return ("".join(box(at, half, WHITE) for at, half in frame)
                + box((x, y, 0), (.17, .003, .24), "0.45 0.55 0.6"))
    frame = [((-.39, 0, 0), (.01, .04, .3)), ((.39, 0, 0), (.01, .04, .3)),
             ((0, 0, .29), (.4, .04, .01)), ((0, 0, -.29), (.4, .04, .01))]
    return Thing("".join(box(at, half, WHITE) for at, half in frame) + pane(-.18, .015)
                 + slide("pane", (1, 0, 0), (0, 0, 0),
                         pane(.18, -.015) + box((.02, -.03, 0), (.006, .006, .04), DARK)),
                 {"pane": (0, -.22)})


def wardrobe() -> Thing:
    """Four drawers and three doors, alike."""
    out, states = shell((.6, .22, .5), .012, WHITE), {}
    out += "".join(box((x, 0, 0), (.01, .21, .49), WHITE) for x in (-.2, .2))
    out += box((0, 0, -.05), (.59, .21, .01), WHITE)
    for k, way in enumerate((.22, .13, .17, .25)):
        x, z = (-.4, .4)[k // 2], (.32, .08)[k % 2]
        out += slide(f"drawer_{k}", (0, -1, 0), (x, -.02, z), tray((.175, .19, .09), .008, GREY)
                     + box((0, -.207, 0), (.188, .01, .115), WHITE)
                     + box((0, -.235, 0), (.04, .01, .01), DARK))
        states[f"drawer_{k}"] = (.005 * k, way)
    for k, turn in enumerate((1.2, .7, 1.0)):
        out += hinge(f"door_{k}", (0, 0, -1), (.4 * k - .59, -.235, -.27),
                     box((.19, 0, 0), (.188, .01, .205), WHITE)
                     + box((.34, -.025, 0), (.008, .015, .04), DARK))
        states[f"door_{k}"] = (.06 + .02 * k, turn)
    return Thing(out, states)


def toilet() -> Thing:
    """A seat and a lid on one line."""
    lid = (disc((0, -.2, 0), (0, -.2, .016), .19, BLUE)
           + box((0, -.04, .008), (.1, .05, .008), BLUE))
    return Thing(disc((0, 0, 0), (0, 0, .2), .12, WHITE)
                 + disc((0, -.05, .2), (0, -.05, .4), .19, WHITE)
                 + box((0, .25, .5), (.2, .08, .2), WHITE)
                 + hinge("seat", (-1, 0, 0), (0, .14, .425),
                         ring((0, -.2, 0), (.16, .176), .022, GREY, flat=True))
                 + hinge("lid", (-1, 0, 0), (0, .14, .46), lid),
                 {"seat": (0, .8), "lid": (.15, 1.6)})


def pliers() -> Thing:
    """Two legs alike on a pin."""
    def leg(side: int) -> str:
        return (bar((0, 0, 0), (-.14, 0, -.05 * side), .011, RED)
                + box((.04, 0, .008 * side), (.04, .006, .008), METAL))
    return Thing(leg(1) + disc((0, -.012, 0), (0, .014, 0), .013, DARK)
                 + hinge("pin", (0, 1, 0), (0, .013, 0), leg(-1)), {"pin": (.05, .55)})


def suitcase() -> Thing:
    """Two shells of one colour."""
    upper = [((0, -.2, .112), (.3, .2, .008)), ((-.292, -.2, .06), (.008, .2, .06)),
             ((.292, -.2, .06), (.008, .2, .06)), ((0, -.008, .06), (.3, .008, .06)),
             ((0, -.392, .06), (.3, .008, .06))]
    return Thing(tray((.3, .2, .06), .008, BLUE) + box((0, -.22, 0), (.06, .02, .012), DARK)
                 + hinge("lid", (-1, 0, 0), (0, .2, .062),
                         "".join(box(at, half, BLUE) for at, half in upper)
                         + box((0, -.41, .03), (.03, .01, .02), METAL)), {"lid": (.06, 1.5)})


def carton() -> Thing:
    """Four flaps, up to beyond upright."""
    flaps = {"front": ((0, -.15, .122), (1, 0, 0), (.195, .07), (0, 1), (.05, 2.4)),
             "back": ((0, .15, .122), (-1, 0, 0), (.195, .07), (0, -1), (.1, 1.9)),
             "left": ((-.2, 0, .128), (0, -1, 0), (.09, .145), (1, 0), (.05, 2.0)),
             "right": ((.2, 0, .128), (0, 1, 0), (.09, .145), (-1, 0), (.1, 1.4))}
    out = tray((.2, .15, .12), .004, CARD)
    for joint, (at, axis, half, way, _) in flaps.items():
        middle = way[0] * half[0], way[1] * half[1], 0
        out += hinge(joint, axis, at, box(middle, (*half, .002), CARD))
    return Thing(out, {joint: flap[4] for joint, flap in flaps.items()})


def tap() -> Thing:
    """A spout that swivels and a lever."""
    spout = (disc((0, 0, -.008), (0, 0, .03), .031, METAL)
             + bar((0, -.02, .01), (0, -.18, .06), .013, METAL)
             + bar((0, -.18, .06), (0, -.185, .02), .013, METAL))
    return Thing(disc((0, 0, 0), (0, 0, .12), .03, METAL) + disc((0, 0, 0), (0, 0, .01), .06, METAL)
                 + hinge("spout", (0, 0, 1), (0, 0, .13), spout)
                 + hinge("lever", (-1, 0, 0), (0, 0, .165), ball((0, 0, .01), .028, METAL)
                         + bar((0, .01, .02), (0, .1, .05), .009, DARK)),
                 {"spout": (-.4, .5), "lever": (0, .5)})


def hand_wheel() -> Thing:
    """A wheel that nearly looks the same after a third of a turn."""
    spokes = "".join(bar((0, -.01, 0), (.09 * math.cos(a), -.01, .09 * math.sin(a)), .008, RED)
                     for a in (0, 2 * math.pi / 3, 4 * math.pi / 3))
    return Thing(box((0, .06, 0), (.1, .02, .1), GREY)
                 + disc((0, .06, 0), (0, 0, 0), .015, METAL)
                 + hinge("wheel", (0, 1, 0), (0, 0, 0), ring((0, -.01, 0), (.09, .09), .008, RED)
                         + spokes + ball((.09, -.03, 0), .014, DARK)), {"wheel": (0, .9)})


def monitor() -> Thing:
    """A carriage that slides up, a screen that tilts on it."""
    screen = hinge("tilt", (1, 0, 0), (0, -.02, 0), box((0, -.02, .02), (.28, .012, .16), DARK)
                   + box((0, -.0335, .02), (.27, .002, .15), BLUE))
    return Thing(box((0, 0, .01), (.14, .1, .01), DARK) + box((0, .05, .2), (.02, .012, .2), METAL)
                 + slide("lift", (0, 0, 1), (0, .03, .25),
                         box((0, 0, 0), (.035, .008, .04), DARK) + screen),
                 {"lift": (0, .12), "tilt": (-.1, .35)}, nested=True)


THINGS: dict[str, Callable[[], Thing]] = FIRST | {
    f.__name__: f for f in (glasses, office_chair, window, wardrobe, toilet, pliers, suitcase,
                            carton, tap, hand_wheel, monitor)}
