"""Small independent readers of exported twins, for laws: what another program makes of a file."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation


@dataclass
class Link:
    """What a reader found: its carrier, frames at rest, and a motion of one degree of freedom.

    `rest` is parent_from_link at joint position 0; kind, axis and pitch are in the link's frame.
    """

    parent: str | None
    rest: np.ndarray
    mass: float
    corners: np.ndarray
    kind: str = "fixed"
    axis: np.ndarray | None = None
    pitch: float = 0.0
    limits: tuple[float, float] | None = None


def frame(rot: np.ndarray, trans: np.ndarray) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rot, trans
    return out


def moved(link: Link, q: float) -> np.ndarray:
    if link.kind == "fixed":
        return np.eye(4)
    if link.kind == "prismatic":
        return frame(np.eye(3), q * link.axis)
    return frame(Rotation.from_rotvec(q * link.axis).as_matrix(), q * link.pitch * link.axis)


def world(links: dict[str, Link], name: str, q: dict[str, float]) -> np.ndarray:
    link = links[name]
    own = link.rest @ moved(link, q.get(name, 0.0))
    return own if link.parent is None else world(links, link.parent, q) @ own


class Tree:
    """Poses of links by the reader's own chain."""

    def __init__(self, links: dict[str, Link], root: np.ndarray, unit: float) -> None:
        self.links, self.root, self.unit = links, root, unit
        self.masses = {name: link.mass for name, link in links.items()}
        self.limits = {name: link.limits for name, link in links.items() if link.limits}

    def poses(self, q: dict[str, float]) -> dict[str, np.ndarray]:
        return {name: world(self.links, name, q) for name in self.links}

    def boxes(self) -> dict[str, np.ndarray]:
        """Return lowest and highest corner of every link's visual mesh at rest."""
        out = {}
        for name, place in self.poses({}).items():
            seen = self.links[name].corners @ place[:3, :3].T + place[:3, 3]
            out[name] = np.stack([seen.min(0), seen.max(0)])
        return out


class MujocoTree:
    """The same of a file that MuJoCo compiles."""

    unit, root = 1.0, np.eye(3)

    def __init__(self, path: Path, names: list[str]) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(path))
        self.names = names
        self.masses = {name: float(self.model.body(name).mass[0]) for name in names}
        joints = {self.model.joint(j).name: j for j in range(self.model.njnt)}
        self.limits = {n: tuple(self.model.jnt_range[joints[f"{n}_joint"]]) for n in names
                       if f"{n}_joint" in joints}
        self.joints = joints

    def _at(self, q: dict[str, float], pitch: dict[str, float]) -> mujoco.MjData:
        data = mujoco.MjData(self.model)
        for name, value in q.items():
            data.qpos[self.model.jnt_qposadr[self.joints[f"{name}_joint"]]] = value
            if f"{name}_joint_slide" in self.joints:
                slot = self.model.jnt_qposadr[self.joints[f"{name}_joint_slide"]]
                data.qpos[slot] = pitch[name] * value
        mujoco.mj_kinematics(self.model, data)
        return data

    def poses(self, q: dict[str, float]) -> dict[str, np.ndarray]:
        data = self._at(q, self.pitches())
        return {n: frame(data.body(n).xmat.reshape(3, 3), data.body(n).xpos) for n in self.names}

    def pitches(self) -> dict[str, float]:
        """Return scene units per radian of every screw, as its equality constraint says."""
        if hasattr(self, "told"):
            return self.told
        m = self.model
        return {m.joint(m.eq_obj2id[e]).name.removesuffix("_joint"): float(m.eq_data[e, 1])
                for e in range(m.neq)}

    def boxes(self) -> dict[str, np.ndarray]:
        data, out = self._at({}, {}), {}
        for name in self.names:
            geom = self.model.geom(f"{name}_visual").id
            mesh = self.model.geom_dataid[geom]
            start, count = self.model.mesh_vertadr[mesh], self.model.mesh_vertnum[mesh]
            seen = (self.model.mesh_vert[start:start + count].astype(float)
                    @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
            out[name] = np.stack([seen.min(0), seen.max(0)])
        return out


def read_urdf(path: Path, names: list[str]) -> MujocoTree:
    found = MujocoTree(path, names)
    found.told = {j.get("name").removesuffix("_joint_slide"): float(j.find("mimic").get(
        "multiplier")) for j in ET.parse(path).iter("joint") if j.find("mimic") is not None}
    return found


def obj_corners(path: Path) -> np.ndarray:
    rows = [line.split()[1:4] for line in path.read_text().splitlines() if line.startswith("v ")]
    return np.array(rows, float)


def _pose(element: ET.Element) -> np.ndarray:
    numbers = [float(w) for w in element.findtext("pose").split()]
    return frame(Rotation.from_euler("xyz", numbers[3:]).as_matrix(), numbers[:3])


def read_sdf(path: Path, unit: float) -> Tree:
    model = ET.parse(path).getroot().find("model")
    placed = {link.get("name"): _pose(link) for link in model.iter("link")}
    links = {}
    for link in model.iter("link"):
        name, visual = link.get("name"), link.find("visual")
        joint = next(j for j in model.iter("joint") if j.findtext("child") == name)
        parent = joint.findtext("parent")
        rest = placed[name] if parent == "world" else np.linalg.inv(placed[parent]) @ placed[name]
        local = _pose(visual)
        corners = obj_corners(path.parent / visual.findtext("geometry/mesh/uri"))
        found = Link(None if parent == "world" else parent, rest,
                     float(link.findtext("inertial/mass")), corners @ local[:3, :3].T
                     + local[:3, 3], joint.get("type"))
        if found.kind != "fixed":
            found.axis = np.array([float(w) for w in joint.findtext("axis/xyz").split()])
            found.limits = tuple(float(joint.findtext(f"axis/limit/{e}")) for e in
                                 ("lower", "upper"))
            found.pitch = float(joint.findtext("screw_thread_pitch", "0")) / (2 * np.pi)
        links[name] = found
    return Tree(links, _pose(model)[:3, :3], unit)


def read_glb(path: Path) -> Tree:
    import trimesh

    scene = trimesh.load(path, process=False)
    graph, links = scene.graph, {}
    root = next(n for n in graph.transforms.children[graph.base_frame])
    top = graph.get(root)[0]
    unit = float(np.cbrt(np.linalg.det(top[:3, :3])))
    for name in graph.nodes:
        edge = graph.transforms.edge_data.get((graph.transforms.parents.get(name), name), {})
        extras = edge.get("metadata", {}).get("extras", edge.get("metadata", {})) or {}
        if "mass" not in extras:
            continue
        parent, joint = graph.transforms.parents[name], extras.get("joint", {})
        _, geometry = graph.get(name)
        links[name] = Link(
            None if parent == root else parent, np.array(edge["matrix"]), extras["mass"],
            np.asarray(scene.geometry[geometry].vertices, float), joint.get("type", "fixed"),
            np.array(joint.get("axis", [0, 0, 1.0])), joint.get("pitch", 0.0),
            tuple(joint["range"]) if joint.get("type", "fixed") != "fixed" else None)
    return Tree(links, top[:3, :3] / unit, unit)


def read_usd(path: Path) -> Tree:
    from pxr import Gf, Usd, UsdGeom, UsdPhysics

    stage = Usd.Stage.Open(str(path))
    root, links = stage.GetDefaultPrim(), {}
    top = np.array(UsdGeom.Xformable(root).GetLocalTransformation()).T

    def local(joint: UsdPhysics.Joint, side: int) -> np.ndarray:
        quat = getattr(joint, f"GetLocalRot{side}Attr")().Get()
        turn = np.array(Gf.Matrix3d(Gf.Quatd(quat).GetNormalized())).T
        return frame(turn, np.array(getattr(joint, f"GetLocalPos{side}Attr")().Get(), float))

    for prim in stage.Traverse():
        joint = UsdPhysics.Joint(prim)
        if not joint:
            continue
        parent, child = (Path(str(getattr(joint, f"GetBody{s}Rel")().GetTargets()[0])).name
                         for s in (0, 1))
        body = stage.GetPrimAtPath(f"{root.GetPath()}/{child}")
        visual = body.GetChild("visual")
        corners = (np.array(UsdGeom.Mesh(visual).GetPointsAttr().Get(), float) if visual
                   else np.zeros((1, 3)))
        start = local(joint, 0) @ np.linalg.inv(local(joint, 1))
        axis = local(joint, 1)[:3, 0]
        kind = {"PhysicsRevoluteJoint": "revolute", "PhysicsPrismaticJoint": "prismatic",
                "PhysicsFixedJoint": "fixed"}[prim.GetTypeName()]
        found = Link(None if parent == root.GetName() else parent, start,
                     UsdPhysics.MassAPI(body).GetMassAttr().Get(), corners, kind, axis)
        if kind != "fixed":
            ends = [prim.GetAttribute(f"physics:{e}Limit").Get() for e in ("lower", "upper")]
            found.limits = tuple(np.deg2rad(ends) if kind == "revolute" else ends)
        found.pitch = prim.GetCustomDataByKey("screwPitchPerRadian") or 0.0
        links[child] = found
    for name in [n for n in links if n.endswith("_turn") and n.removesuffix("_turn") in links]:
        turn, slide = links.pop(name), links[name.removesuffix("_turn")]
        slide.parent, slide.rest = turn.parent, turn.rest @ slide.rest
        slide.kind, slide.limits = "screw", turn.limits
    return Tree(links, top[:3, :3], 1.0)
