"""UsdPhysics in the words of MJCF: bodies, joints, limits, masses, what is seen and what collides.

OpenUSD's reader is C++ that a broken binary file may bring down, so it runs in a process of its own
(`python -m part2gs_robotics.assets.usd_model STAGE HOME OUT`); what it wrote is read by the engine.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

from part2gs_robotics.assets.usd_shapes import Shapes
from part2gs_robotics.errors import CheckError

KINDS = {"PhysicsRevoluteJoint": "hinge", "PhysicsPrismaticJoint": "slide",
         "PhysicsFixedJoint": ""}  # fmt: skip
MOST_LAYERS = 200  # as many as XML files of a model
SECONDS = 30.0  # for a stage; large ones take a few


def write_mjcf_of(path: Path, home: Path, folder: Path) -> Path:
    """Translate a stage in a process of its own and return the MJCF it wrote.

    Args:
        path: of the stage.
        home: folder that none of its layers may leave.
        folder: to write in.

    Raises:
        CheckError: without usd-core, or if the stage cannot be read.
    """
    if not path.is_file():
        raise CheckError(f"{path}: does not exist. Needed a twin folder, MJCF, URDF or USD file.")
    if importlib.util.find_spec("pxr") is None:
        raise CheckError(f"{path}: the package usd-core is not installed. Needed to check a USD "
                         "file; pip install 'part2gs-robotics[usd]'.")
    words = [sys.executable, "-m", "part2gs_robotics.assets.usd_model", path, home, folder]
    try:
        done = subprocess.run(list(map(str, words)), capture_output=True, text=True,
                              errors="replace", timeout=SECONDS, check=False)
        said = done.stderr.strip().splitlines()[-1:] or [f"its reader ended with {done.returncode}"]
    except subprocess.TimeoutExpired:
        done, said = None, [f"took more than {SECONDS:g} s"]
    out = folder / f"{path.name}.xml"
    if done is None or done.returncode or not out.is_file():
        raise CheckError(f"{path}: cannot be read as a USD stage ({said[0][:200]}). Expected "
                         "UsdPhysics bodies and joints; open it in usdview or export it again.")
    return out


def main() -> int:
    """Translate the stage named on the command line; return the exit code."""
    path, home, folder = map(Path, sys.argv[1:4])
    try:
        translate(path, home, folder)
    except Exception as error:  # pxr raises errors of many classes, none of them ours
        sys.stderr.write(f"{str(error).splitlines()[0] if str(error) else type(error).__name__}\n")
        return 1
    return 0


def translate(path: Path, home: Path, folder: Path) -> Path:
    """Write the MJCF of a stage; lengths in metres.

    Raises:
        ValueError: if a layer leaves `home`, or there is no body.
    """
    from pxr import Usd, UsdGeom, UsdPhysics

    check_layers(path, home)
    stage = Usd.Stage.Open(str(path))
    bodies = {str(p.GetPath()): p for p in stage.Traverse() if p.HasAPI(UsdPhysics.RigidBodyAPI)}
    if not bodies:
        raise ValueError("no prim has a rigid body")
    joints = [p for p in stage.Traverse() if p.GetTypeName() in KINDS]
    unit = float(UsdGeom.GetStageMetersPerUnit(stage))
    root = ET.Element("mujoco", model=path.stem)
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    down = "0 -9.81 0" if UsdGeom.GetStageUpAxis(stage) == "Y" else "0 0 -9.81"
    ET.SubElement(root, "option", gravity=down)
    shapes = Shapes(stage, unit, ET.SubElement(root, "asset"), folder)
    shapes.world(ET.SubElement(root, "worldbody"), bodies, joints)
    out = folder / f"{path.name}.xml"
    out.write_bytes(ET.tostring(root))
    return out


def check_layers(path: Path, home: Path) -> None:
    """Stop at a stage that is composed of a layer outside its home.

    Raises:
        ValueError: naming it.
    """
    from pxr import Sdf

    waiting, seen = [path.resolve()], set[Path]()
    while waiting:
        file = waiting.pop()
        if file in seen:
            continue
        seen.add(file)
        if not file.is_relative_to(home.resolve()) or len(seen) > MOST_LAYERS:
            raise ValueError(f"refers to {file}, which leaves the folder {home}")
        layer = Sdf.Layer.FindOrOpen(str(file))
        if layer is None:
            raise ValueError(f"{file.name} is no layer")
        names = [n for n in layer.GetCompositionAssetDependencies() if n]
        for name in names:
            if "://" in name or "[" in name:
                raise ValueError(f"refers to {name[:100]}, which is no plain file")
            waiting.append((file.parent / name).resolve())


if __name__ == "__main__":
    sys.exit(main())
