"""Which stages and terms a scene needs, said before the build spends time on them."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from importlib import resources
from typing import Literal

from part2gs_robotics.config import Config
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.motion import Motion
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.twin import Part

TERMS = {"articulation": "articulation loss", "vector_field": "vector-field loss",
         "repel": "repel points", "velocity": "velocity loss", "contact": "contact loss"}
MEASURED = "measured_terms.json"  # sentences of benchmarks/ablation.py, by term


@dataclass(frozen=True)
class PlanItem:
    """One stage or term.

    Attributes:
        name: what it is.
        used: True = part of this build.
        reason: why it is used or left out.
        decided: "before" the build from the scene and flags, or "during" it from measurements;
            until then `used` is what holds unless the measurement says otherwise.
    """

    name: str
    used: bool
    reason: str
    decided: Literal["before", "during"] = "before"


@dataclass(frozen=True)
class Plan:
    """All decisions of one build, in the order of the corridor."""

    items: tuple[PlanItem, ...]

    def __getitem__(self, name: str) -> PlanItem:
        """Return the item of that name."""
        return next(item for item in self.items if item.name == name)

    def settle(self, name: str, used: bool, reason: str) -> Plan:
        """Return the plan with an open decision made."""
        items = tuple(replace(item, used=used, reason=reason) if item.name == name else item
                      for item in self.items)
        return Plan(items)

    def settle_terms(self, parts: int, pulled: int, repel_points: int, paper: bool) -> Plan:
        """Return the plan with what the images said about the terms that pull on joints.

        Args:
            parts: number of moving parts.
            pulled: number of them whose joint the images prefer as pulled.
            repel_points: number of repel points on seams.
            paper: paper mode asks no images.
        """
        plan = self
        for name in TERMS.values():
            if plan[name].decided == "before":
                continue
            used = pulled > 0
            said = f"images keep the pull on {pulled} of {parts} joints"
            said = f"paper mode: as printed, on {pulled} of {parts} joints" if paper else said
            if name == TERMS["repel"] and repel_points == 0:
                used, said = False, "no seam within reach"
            elif name == TERMS["repel"]:
                said = f"{repel_points} points between parts; {said}"
            reason = "; ".join([said, *plan[name].reason.split("; ")[1:]])
            plan = plan.settle(name, used, reason)
        return plan

    def rows(self) -> tuple[tuple[str, bool, str], ...]:
        """Return (name, used, reason) rows for the report."""
        return tuple((item.name, item.used, item.reason) for item in self.items)

    def lines(self) -> list[str]:
        """Return one line per item for people."""
        words = {("before", True): "yes", ("before", False): "no", ("during", True): "open",
                 ("during", False): "open"}
        return [f"  {words[item.decided, item.used]:4s} {item.name:24s} {item.reason}"
                for item in self.items]


def make_plan(scene: Scene, config: Config) -> Plan:
    """Return what this scene and these flags need; nothing slow is looked at."""
    return Plan((*_reading(scene), *_fitting(scene, config), *_articulation(scene, config),
                 *_geometry(config)))


def _reading(scene: Scene) -> tuple[PlanItem, ...]:
    notes = " ".join(scene.notes)
    undistorted = "distortion removed" in notes
    downscaled, cropped = "downscaled" in notes, "cropped" in notes
    return (
        PlanItem("undistortion", undistorted, "cameras have lens distortion" if undistorted
                 else "every camera is a pinhole"),
        PlanItem("downscaling", downscaled, "images are larger than --max-side" if downscaled
                 else "images are within --max-side"
                 + (" once cut round the object" if cropped else "")),
    )


def _fitting(scene: Scene, config: Config) -> tuple[PlanItem, ...]:
    with_depth = [state.depths is not None for state in scene.states]
    depth = {0: "the scene has no depth images", 1: "one state has depth images",
             2: "both states have depth images"}[sum(with_depth)]
    smooth = "depth images tell" if all(with_depth) else "plain walls have no depth of their own"
    smooth = smooth if config.fit.smooth_weight else "--smooth-weight is 0"
    views = " and ".join(f"{int((~state.held_out).sum())} + {int(state.held_out.sum())}"
                         for state in scene.states)
    device = {"cuda": "gsplat renders on the GPU", "cpu": "the CPU renders",
              "auto": "the device is picked when the build starts"}[config.fit.device]
    return (
        PlanItem("fit", True, f"{views} training and held-out views"),
        PlanItem("rendering on CUDA", config.fit.device == "cuda", device),
        PlanItem("depth term", any(with_depth) and config.fit.depth_weight > 0,
                 depth if config.fit.depth_weight else "--depth-weight is 0"),
        PlanItem("hollows by stereo", not all(with_depth) and config.stereo.stereo,
                 "depth images show them" if all(with_depth) else "off by --no-stereo"
                 if not config.stereo.stereo else "silhouettes cannot see into hollows"),
        PlanItem("flat faces without texture", not all(with_depth) and config.stereo.stereo
                 and config.stereo.plain_faces, "by --plain-faces" if config.stereo.plain_faces
                 else "off without --plain-faces: it looks through glass"),
        PlanItem("depth smoothness", not all(with_depth) and config.fit.smooth_weight > 0, smooth),
        PlanItem("view-dependent colour", True, "kept only if held-out views gain by it", "during")
        if config.fit.view_color else
        PlanItem("view-dependent colour", False, "off by --no-view-color"),
    )


def _articulation(scene: Scene, config: Config) -> tuple[PlanItem, ...]:
    parts = config.articulate.parts
    mode = config.articulate.paper_mode
    count = f"{parts} moving parts by --parts" if parts else "searched, --parts is absent"
    if parts == 1:
        competition = PlanItem("part competition", False, "one moving part by --parts")
    elif parts:
        competition = PlanItem("part competition", True, f"{parts} moving parts by --parts")
    else:
        competition = PlanItem("part competition", True, "decided by the number of parts found",
                               "during")
    return (
        PlanItem("search for number of parts", parts is None, count),
        PlanItem("centre averaging", False, "averaged centres (eq. 3) lie in neither state; both "
                 "states' Gaussians are kept, in paper mode as well"),
        competition,
        PlanItem("part identities", config.articulate.identity, "; ".join(
            ["neighbours and both states share out the parts" if config.articulate.identity
             else "off by --no-identity", *_measured("identity")])),
        *(_term(name, config) for name in TERMS),
        PlanItem("alignment to images", config.articulate.alignment and not mode, "; ".join(
            ["paper mode refines by its losses alone" if mode
             else "second-order steps" if config.articulate.alignment
             else "off by --no-alignment", *_measured("alignment")])),
        PlanItem("parts on parts", True, "searched where a part's motion leaves surface "
                 "unexplained", "during") if config.articulate.alignment and not mode else
        PlanItem("parts on parts", False, "needs the alignment to images"),
    )


def _term(name: str, config: Config) -> PlanItem:
    """Return the item of a term that pulls on joints; images judge its pull during the build."""
    flag = name.replace("_", "-")
    used = bool(getattr(config.articulate, name))
    decided = "as printed" if config.articulate.paper_mode else "kept where images agree"
    said = decided if used else f"off, --{flag} switches it on"
    reason = "; ".join([said, *_measured(name)])
    return PlanItem(TERMS[name], used, reason, "during" if used else "before")


def _measured(name: str) -> list[str]:
    """Return what the ablation found about a term, as a list of one or no sentence."""
    found = json.loads(resources.files(__package__).joinpath(MEASURED).read_text("utf-8"))
    return [f"ablation: {found[name]}"] if name in found else []


def _geometry(config: Config) -> tuple[PlanItem, ...]:
    return (
        PlanItem("meshing", True, f"{config.mesh.resolution} cells along the longest side"),
        PlanItem("convex decomposition", True, "decided per part: a convex part needs none",
                 "during") if config.mesh.convex else
        PlanItem("convex decomposition", False, "off by --no-convex: one hull per part"),
        PlanItem("texture", config.texture.texture, "photos of both states, at most "
                 f"{config.texture.texture_side} pixels a side and part"
                 if config.texture.texture else "off by --no-texture: one colour per part"),
        PlanItem("simulator checks", True,
                 f"{config.check.sweep_values} joint values per joint, MuJoCo and exact geometry"),
    )


def settle_plan(plan: Plan, gaussians: tuple[Gaussians, Gaussians], motion: Motion,
                parts: tuple[Part, ...], paper: bool = False) -> Plan:
    """Return the plan with the decisions that only measurements could make."""
    glossy = [f"state {s}" for s, g in enumerate(gaussians) if g.shN.shape[1]]
    if plan["view-dependent colour"].decided == "during":
        reason = ("held-out views gain by it in " + " and ".join(glossy) if glossy
                  else "held-out views gain nothing by it")
        plan = plan.settle("view-dependent colour", bool(glossy), reason)
    if plan["part competition"].decided == "during":
        many = len(motion.joints) > 1
        plan = plan.settle("part competition", many, f"{len(motion.joints)} moving parts found")
    if plan["parts on parts"].decided == "during":
        on = [f"part_{k + 1} on part_{p}" for k, p in enumerate(motion.parents) if p]
        plan = plan.settle("parts on parts", bool(on), ", ".join(on) or "all hang on the base")
    split = [part.name for part in parts if len(part.pieces) > 1]
    whole = [part.name for part in parts if len(part.pieces) <= 1]
    sentences = [f"{', '.join(names)} {fate}" for names, fate in
                 ((split, "cut into convex pieces"), (whole, "already convex")) if names]
    if plan["convex decomposition"].decided == "during":
        plan = plan.settle("convex decomposition", bool(split), "; ".join(sentences))
    pulled = sum(one.get("physics_kept", 0.0) for one in motion.diagnostics)
    points = sum(one.get("repel_points", 0.0) for one in motion.diagnostics)
    return plan.settle_terms(len(motion.joints), round(pulled), round(points), paper)
