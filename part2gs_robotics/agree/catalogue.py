"""Every check in plain words: what it looks at, where its threshold comes from, what to change."""

from __future__ import annotations

import difflib
from dataclasses import dataclass

from part2gs_robotics.errors import CheckError

MEASURED = "measured on finished twins"
CONTRACT = "contract of the twin folder, docs/conventions.md"
EXPLAINED = "explained"


@dataclass(frozen=True)
class Explained:
    """One check in words.

    Attributes:
        what: it looks at.  source: of its threshold.  change: what mends a failure.
    """

    what: str
    source: str
    change: str


def _x(what: str, source: str, change: str) -> Explained:
    return Explained(what, source, change)


CHECKS = {
    "compile": _x("every model file loads in the installed MuJoCo without a warning",
                  "no error, no warning", "correct the file at the place the engine names"),
    "same twin": _x("twin_actuated.xml is twin.xml with servos", CONTRACT,
                    "make both files say the same, or build the twin again"),
    "mesh": _x("every visual mesh is a closed solid whose faces look outwards",
               "manifold3d and its edges agree",
               "restore or repair the visual mesh in assets/: close its holes, turn its faces out"),
    "self-intersection": _x("faces of one mesh do not cut each other", "a warning only",
                            "nothing, or build with another --resolution"),
    "inertia": _x("what moves has a mass and an inertia that a body can have",
                  "A + B >= C for any body", "recompute <inertial> from the closed mesh"),
    "limits": _x("a joint's range is one, and holds both observed states", CONTRACT,
                 "widen the joint's range to both states in twin.xml, twin.urdf and twin.yaml"),
    "observed state": _x("parts do not overlap at the observed states",
                         "0.2 % of the size: a millimetre or two of a household object",
                         "correct the keyframe or the joint: parts stand in each other there"),
    "actuation": _x("every joint can be driven", "one position servo per joint",
                    "give the joint a name, a range and a position servo"),
    "warnings": _x("the engine says nothing while a joint is driven", "none",
                   "lower the servo's kp or the time step; look at masses near zero"),
    "reach": _x("a servo takes its joint from 5 % to 95 % of the range and back",
                "99 %: a servo of ours droops by 0.4 %",
                "something blocks the joint (see overlap, phantom contact), or its servo is too "
                "weak: raise forcerange and kp"),
    "tracking": _x("a joint follows its command", "10 %: a critically damped servo lags 4 %",
                   "raise kp and forcerange of the servo, or free the joint"),
    "others still": _x("driving one joint moves no other", "0.1 deg or 0.1 % of the size",
                       "part the collision pieces that push, or raise friction of the other"),
    "overlap": _x("true surfaces do not overlap anywhere in the ranges", "0.2 % of the size",
                  "correct the joint's axis, origin or range, or carve the meshes where they meet"),
    "blocking": _x("parts that stop each other as real ones do, and the order that works; nothing "
                   "of it fails", "0.6 % of the size, or against the face of a thin board",
                   "nothing: move the joints in the order told"),
    "phantom contact": _x("collision pieces do not touch where true surfaces do not",
                          "0.2 % of the size", "cut the collision pieces into smaller convex ones"),
    "collision": _x("collision pieces stand for the part: cover it, and do not stick out",
                    f"{MEASURED}: IoU 0.62 to 1, pieces stick out by up to 4.2 % of the size",
                    "make the part's collision pieces again from its visual mesh"),
    "part built": _x("every part that was decided on was built", "all",
                     "give views that show the part, or raise --resolution"),
    EXPLAINED: _x("what moved between the states is explained by the parts that were built",
                  "1 % of the moved surface, and what of the noise looks as wrong by chance",
                  "look at the marked photos in report.html: a part is missing there. Give more or "
                  "sharper views of it, or --parts if fewer were found"),
    "time step": _x("a halved time step ends in the same place", "1 % of the range",
                    "lower the time step in scene.xml, or the servo's gain"),
    "gain x 100": _x("a hundred times stiffer servo ends in the same place", "1 % of the range",
                     "lower the time step in scene.xml"),
    "hold": _x("servos hold every joint where it is: it neither creeps nor falls away",
               "0.1 % of the range per second, 1 % in all",
               "raise kp and forcerange of the servo in twin_actuated.xml, or lower the mass"),
    "passive": _x("without servos nothing gains energy, from either observed state",
                  "1 % of m g size", "part what overlaps there; lower the time step"),
    "push": _x("a finger opens every joint of the passive twin", "10 % of the carried weight",
               "lower friction and damping of the joint in twin.xml, or free it"),
    "others pushed": _x("a finger on one joint of the passive twin moves no other one, but what it "
                        "hangs on and what hangs on it", "0.1 deg or 0.1 % of the size",
                        "part the collision pieces that push, or raise friction of the other"),
    "overshoot": _x("a servo does not swing past its command", "25 % of a step; SimReady's 50 %",
                    "raise kv of the servo in twin_actuated.xml towards critical damping"),
    "settling": _x("a servo comes to rest after a step", "1.5 s to within 5 %; SimReady's 5 s",
                   "raise kv of the servo in twin_actuated.xml if it swings, kp and forcerange if "
                   "it creeps"),
    "jitter": _x("a servo does not tremble on its way to rest", "20 turns, of SimReady",
                 "raise kv of the servo in twin_actuated.xml, or lower the time step"),
    "fast drive": _x("a joint goes 0 to 100 % and back in half a second each",
                     "99 % of the way, at most 105 % of the speed commanded (SimReady)",
                     "raise forcerange and kp of the servo in twin_actuated.xml, kv if it is "
                     "too fast"),
    "motor limits": _x("each joint of a URDF goes its range within the effort and velocity of its "
                       "<limit>, gravity on", "99 % of the way; a warning only",
                       "raise effort or velocity in <limit>, or lighten what the joint carries"),
    "slow drive": _x("a joint goes 0 to 100 % and back in ten seconds each (--stress)",
                     "as the fast drive", "lower friction of the joint, or raise kp of its servo"),
    "effort": _x("a slow drive leaves force for a load (--stress)", "95 % of the force range",
                 "raise forcerange of the servo, or lower friction and mass"),
    "rest": _x("held for ten seconds at both observed states, nothing falls or trembles (--stress)",
               "1 % of the range away, 0.1 % in the last second",
               "raise kp and forcerange of the servo; part collision pieces that push there"),
    "determinism": _x("one drive done twice is the same to the last bit", "0",
                      "remove what is no part of the model: callbacks and plugins"),
    "drift": _x("let go, nothing moves by itself", "1 % of the range",
                "part the collision pieces that push each other at that state"),
    "stands": _x("let go under its weight, a part stands where it was photographed: it stood there",
                 "2 % of the range",
                 "raise frictionloss and keep solimpfriction of the joint in twin.xml"),
    "files": _x("a twin folder is whole", CONTRACT, "build the twin again"),
    "readable": _x("every file can be read", CONTRACT, "export that format again"),
    "provenance": _x("every number of twin.yaml has a value and says where it comes from", CONTRACT,
                     "give it a source: measured, fitted, derived or assumed"),
    "own numbers": _x("twin.yaml does not contradict itself", CONTRACT,
                      "correct the number in twin.yaml"),
    "mass of mesh": _x("masses, centres and inertias are those of the meshes and densities",
                       "1e-5: digits of meshes", "restore the mesh or the number in twin.yaml"),
    "loose bits": _x("no bit of a mesh floats away from everything", f"5 % of the size; {MEASURED}",
                     "remove the bit from the mesh"),
    "assets": _x("meshes, pieces, materials and pictures are there, and are those that twin.yaml "
                 "was written with", "sha256 in `files` of twin.yaml; none there, none asked",
                 "restore the file, build the twin again, or write the new sha256"),
    "same bodies": _x("all files have the same parts, hung on the same carriers", CONTRACT,
                      "name and hang the part as the other files do"),
    "same mass": _x("all files have the same masses", "1e-6: ten digits",
                    "write the mass that the other files say"),
    "same center": _x("all files have the same centres of mass", "1e-6 of the size: ten digits",
                      "write the centre that the other files say"),
    "same inertia": _x("all files have the same inertias", "1e-6: ten digits",
                       "write the inertia that the other files say"),
    "same joint": _x("a joint is of one kind, name, axis, origin and pitch in all files",
                     "1e-6 of the size at random positions",
                     "correct axis, origin or type in the file that differs"),
    "same motion": _x("joints together put every part at one place in all files",
                      "1e-6 of the size at random positions",
                      "correct the joint or carrier in the file that differs"),
    "same limits": _x("a joint has one range in all files", "1e-6: ten digits",
                      "write the range that the other files say"),
    "same dynamics": _x("damping, friction, efforts and servos are the same in all files",
                        "1e-5: six digits; kv within ten times what the engine derives",
                        "write the number that the other files say"),
    "same states": _x("the observed states are the same in all files", "1e-5: six digits",
                      "correct the keyframe or the state in the file that differs"),
    "same surface": _x("all files show the same meshes at the same place",
                       "1e-6 of the size: float32", "correct the mesh or its place in the file"),
    "collision there": _x("every part collides in every file", "one piece or more",
                          "give the part its collision pieces"),
    "same collision": _x("all files have the collision pieces of twin.yaml at the same place",
                         "1e-6 of the size: float32",
                         "correct the pieces in the file that differs"),
    "same pose": _x("an exported file stands upright, in its format's unit", "1e-6",
                    "export that format again"),
    "contact rules": _x("pieces meet whatever they touch, and press back",
                        "MuJoCo's manual: positive solref; margins below 0.2 % of the size",
                        "put contype, conaffinity, solref, solimp, margin, friction back"),
    "contact exclude": _x("no pair is excluded from contact that comes near each other",
                          "0.2 % of the size", "remove <exclude>, and part what overlaps"),
    "servos": _x("every joint has one servo in twin_actuated.xml, none in twin.xml, no stiffer "
                 "than the time step allows",
                 "frequency x step <= 4.83: implicit, critically damped",
                 "give each joint one position servo of the kp in twin.yaml"),
    "own settings": _x("a twin changes nothing beside it, and hangs on its joints alone", CONTRACT,
                       "move options into scene.xml; remove welds, tendons, springs"),
    "own words": _x("files of a twin have no element and no attribute that the program does not "
                    "write: engines read hundreds, and no other file could contradict them",
                    CONTRACT, "remove the word, or put it into a file of your own that includes "
                    "the twin"),
    "same look": _x("every file and export shows colours and pictures of the meshes, and pictures "
                    "fit the colours of their mesh's corners", f"1 % of colours; {MEASURED}",
                    "restore the material or picture, or build or export the twin again"),
    "options": _x("gravity, time step, solver and flags of scene.xml are those of twin.yaml",
                  "9.81 m/s2 along -up in scene units", "correct <option> in scene.xml"),
    "clear world": _x("ground and other things of scene.xml do not touch the twin, and viewers "
                      "show it", "no contact; a tenth of full light",
                      "move the ground away from the twin"),
    "own step": _x("the model's own time step and integrator end where a reference of known error "
                   "ends, in smooth motion and in contact (--stress)",
                   "1 % of the range as in `time step`, 5 % in contact: impacts fall between steps",
                   "take the step and integrator of `advised step` in scene.xml (--apply)"),
    "ladder": _x("time steps up to where each integrator diverges, and its order of accuracy "
                 "(--stress)", "none: a number only", "nothing"),
    "advised step": _x("the cheapest integrator and time step that keep the limits of `own step`, "
                       "half as coarse as where they diverge (--stress)", "none: advice only",
                       "nothing, or --apply"),
    "mass ratio": _x("a push on each joint, its load a millionth to a million times as heavy, "
                     "against its closed form (--stress)", "1 % of the range",
                     "give the joint an armature, or take the implicitfast integrator"),
    "gain span": _x("critically damped servos of gain 10 to 1e9 against their closed form "
                    "(--stress)", "1 % of the range", "take a smaller time step in scene.xml"),
    "solref span": _x("contacts of solref 0.1 to 1e-4 s end where a finer step ends (--stress)",
                      "5 % of the range", "take a smaller time step in scene.xml"),
    "solver span": _x("integrators, solvers and numbers of iterations that end where the reference "
                      "ends (--stress)", "5 % of the range",
                      "take a smaller time step in scene.xml"),
    "clearance span": _x("how thickly everything that collides can be wrapped until a joint no "
                         "longer goes all its way (--stress)", "99 % of the way",
                         "carve more room around the part that is stopped"),
    "scale span": _x("the model at 0.001 to 1000 times its size moves as it must (--stress)",
                     "5 % of the range", "keep to a scale within the span"),
    "tunnelling": _x("how fast a ball may be that the thinnest collision piece stops (--stress)",
                     "none: a number only", "thicken the piece, or take a smaller time step"),
    "chance free": _x("of joints drawn from their standard deviations, the share free of overlap "
                      "in their ranges (--samples)", "0.9, and overlap's 0.2 %: a warning only",
                      "give more photos of that joint, or carve more room around its part"),
    "chance reached": _x("of joints drawn from their standard deviations, the share that finds a "
                         "free way from state 0 to state 1 (--samples)", "0.9: a warning only",
                         "give more photos of that joint, or carve more room around its part"),
}  # fmt: skip


def check_id(name: str) -> str:
    """Return the id of a check, which has dashes where its name has blanks."""
    return name.replace(" ", "-")


def explain(wanted: str) -> str:
    """Return what a check looks at, its threshold's source and what mends it, as text.

    Args:
        wanted: id, or name with blanks.

    Raises:
        CheckError: if there is no such check.
    """
    name = next((n for n in CHECKS if wanted in (n, check_id(n))), "")
    if not name:
        near = difflib.get_close_matches(wanted, CHECKS, n=1, cutoff=0.0)[0]
        raise CheckError(f"{wanted[:60]}: no such check id. Nearest: {check_id(near)}; expected "
                         f"one of {', '.join(map(check_id, CHECKS))}.")
    found = CHECKS[name]
    return (f"{check_id(name)}: {found.what}.\nthreshold: {found.source}.\n"
            f"if it fails: {found.change}.\n")
