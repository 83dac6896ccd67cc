"""Write twin.usd: OpenUSD with UsdPhysics, for Isaac Sim, Omniverse and usdview."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from part2gs_robotics.errors import ExportError
from part2gs_robotics.exporters.dynamics import Physics, physics_of
from part2gs_robotics.exporters.inertia import MassProperties, link_origin, upright
from part2gs_robotics.exporters.meshfile import (
    CREASE,
    make_assets,
    mean_rgba,
    texture_name,
    write_texture,
)
from part2gs_robotics.exporters.mjcf import joint_name
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.kinematics import moves
from part2gs_robotics.model.twin import Part, PartMesh, Twin, corner_normals
from part2gs_robotics.runtime.atomic import write_bytes_atomic

if TYPE_CHECKING:
    from pxr import Usd, UsdPhysics

TURN_MASS, TURN_INERTIA = 1e-6, 1e-9  # of the link between turn and slide of a screw, as in URDF


def write_usd(twin: Twin, folder: Path) -> list[Path]:
    """Write twin.usd and the textures; return all files.

    Lengths are scene units and `metersPerUnit` says how long they are. Up is Y or Z as the scene
    has it; any other up is turned to Z by the root prim. Links stand on their joint's axis. A
    screw, which UsdPhysics does not know, is a turn and a slide with a link between them; its
    pitch stands in the slide's custom data, and no engine couples both by itself.

    Raises:
        ExportError: if usd-core is missing, or a number, name or mass cannot be written.
    """
    try:
        from pxr import Usd
    except ImportError:
        raise ExportError("usd: the package usd-core is not installed. Needed for --format usd; "
                          "pip install 'part2gs-robotics[usd]'.") from None
    physics, written = physics_of(twin), list[Path]()
    if any(part.mesh.texture is not None for part in twin.parts):
        make_assets(folder)
    for part in twin.parts:
        written += [file for file in write_texture(part, folder) if file.suffix == ".png"]
    stage = Usd.Stage.CreateInMemory()
    _fill(stage, twin, physics)
    with tempfile.TemporaryDirectory() as place:
        whole = Path(place) / "twin.usd"
        stage.GetRootLayer().Export(str(whole))
        write_bytes_atomic(folder / "twin.usd", whole.read_bytes())
    return [folder / "twin.usd", *written]


def _fill(stage: Usd.Stage, twin: Twin, physics: Physics) -> None:
    from pxr import Gf, Kind, Usd, UsdGeom, UsdPhysics

    y_up = twin.up is not None and bool(np.abs(twin.up - (0.0, 1.0, 0.0)).max() < 1e-9)
    UsdGeom.SetStageMetersPerUnit(stage, twin.meters)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y if y_up else UsdGeom.Tokens.z)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    path = f"/{_prim(twin.name)}"
    root = UsdGeom.Xform.Define(stage, path)
    stage.SetDefaultPrim(root.GetPrim())
    Usd.ModelAPI(root.GetPrim()).SetKind(Kind.Tokens.component)
    if not y_up:
        quat = se3.quat_from_rotation(upright(twin, (0.0, 0.0, 1.0)))
        root.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Quatd(*map(float, quat)))
    UsdPhysics.ArticulationRootAPI.Apply(root.GetPrim())
    UsdGeom.Scope.Define(stage, f"{path}/joints")
    for part, props in zip(twin.parts, physics.masses, strict=True):
        _link(stage, path, part, props)
    fixed = UsdPhysics.FixedJoint.Define(stage, f"{path}/joints/world_joint")
    fixed.CreateBody0Rel().SetTargets([path])
    _at(fixed, f"{path}/{_prim(twin.parts[0].name)}", np.zeros(3), (1.0, 0.0, 0.0, 0.0))
    for index in range(1, len(twin.parts)):
        _joint(stage, path, twin, index, physics)


def _prim(name: str) -> str:
    """Return a prim name: those may not begin with a digit."""
    return f"_{name}" if name[0].isdigit() else name


def _body(stage: Usd.Stage, path: str, origin: F64, mass: float) -> UsdPhysics.MassAPI:
    from pxr import Gf, UsdGeom, UsdPhysics

    body = UsdGeom.Xform.Define(stage, path)
    body.AddTranslateOp().Set(Gf.Vec3d(*map(float, origin)))
    UsdPhysics.RigidBodyAPI.Apply(body.GetPrim())
    found = UsdPhysics.MassAPI.Apply(body.GetPrim())
    found.CreateMassAttr(mass)
    return found


def _link(stage: Usd.Stage, root: str, part: Part, props: MassProperties) -> None:
    from pxr import Gf, UsdGeom, UsdPhysics

    origin, path = link_origin(part), f"{root}/{_prim(part.name)}"
    mass = _body(stage, path, origin, props.mass)
    moments, axes = np.linalg.eigh(props.inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))  # a rotation, no mirror
    mass.CreateCenterOfMassAttr(Gf.Vec3f(*map(float, props.center - origin)))
    mass.CreateDiagonalInertiaAttr(Gf.Vec3f(*map(float, moments)))
    mass.CreatePrincipalAxesAttr(Gf.Quatf(*map(float, se3.quat_from_rotation(axes))))
    visual = _mesh(stage, f"{path}/visual", part.mesh, origin)
    _look(stage, f"{path}/material", part, visual)
    for k, piece in enumerate(part.pieces):
        mesh = _mesh(stage, f"{path}/piece_{k:02d}", piece, origin)
        mesh.CreatePurposeAttr(UsdGeom.Tokens.guide)
        UsdPhysics.CollisionAPI.Apply(mesh.GetPrim())
        hull = UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim())
        hull.CreateApproximationAttr(UsdPhysics.Tokens.convexHull)


def _mesh(stage: Usd.Stage, path: str, mesh: PartMesh, origin: F64):  # type: ignore[no-untyped-def]
    from pxr import UsdGeom, Vt

    points = (mesh.vertices - origin).astype(np.float32)
    out = UsdGeom.Mesh.Define(stage, path)
    out.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    out.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(mesh.faces), 3, np.int32)))
    out.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.faces.astype(np.int32).ravel()))
    out.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    out.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(0), points.max(0)])))
    return out


def _look(stage: Usd.Stage, path: str, part: Part, visual) -> None:  # type: ignore[no-untyped-def]
    """Give a visual mesh normals, its picture or colour, and the material that shows it."""
    from pxr import Gf, Sdf, UsdGeom, UsdShade, Vt

    mesh = part.mesh
    normals = corner_normals(mesh.vertices, mesh.faces, CREASE).astype(np.float32).reshape(-1, 3)
    visual.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals))
    visual.SetNormalsInterpolation(UsdGeom.Tokens.faceVarying)
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
    color = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
    if mesh.texture is None:
        color.Set(Gf.Vec3f(*mean_rgba(mesh)[:3]))
    else:
        uv = np.ascontiguousarray(mesh.texture.uv, np.float32).reshape(-1, 2)
        UsdGeom.PrimvarsAPI(visual).CreatePrimvar(
            "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying).Set(
                Vt.Vec2fArray.FromNumpy(uv))
        reader = UsdShade.Shader.Define(stage, f"{path}/st")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        picture = UsdShade.Shader.Define(stage, f"{path}/picture")
        picture.CreateIdAttr("UsdUVTexture")
        picture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./{texture_name(part)}")
        picture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
        picture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
            reader.ConnectableAPI(), "result")
        picture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        color.ConnectToSource(picture.ConnectableAPI(), "rgb")
    shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(visual.GetPrim()).Bind(material)


def _joint(stage: Usd.Stage, root: str, twin: Twin, index: int, physics: Physics) -> None:
    from pxr import Gf, UsdPhysics

    part = twin.parts[index]
    joint, up = part.joint, twin.parts[part.parent]
    assert joint is not None  # every part but the base has one
    path, offset = f"{root}/joints/{_prim(joint_name(part))}", link_origin(part) - link_origin(up)
    carrier, link = f"{root}/{_prim(up.name)}", f"{root}/{_prim(part.name)}"
    if not moves(part):
        fixed = UsdPhysics.FixedJoint.Define(stage, path)
        fixed.CreateBody0Rel().SetTargets([carrier])
        _at(fixed, link, offset, (1.0, 0.0, 0.0, 0.0))
        return
    turn = f"{link}_turn" if joint.kind == "screw" else link
    kind = UsdPhysics.RevoluteJoint if joint.turns else UsdPhysics.PrismaticJoint
    limits = np.degrees(part.limits) if joint.turns else np.asarray(part.limits)
    _moving(kind.Define(stage, path), (carrier, turn), offset, joint.axis, limits)
    drive = UsdPhysics.DriveAPI.Apply(stage.GetPrimAtPath(path),
                                      "angular" if joint.turns else "linear")
    per = np.deg2rad(1.0) if joint.turns else 1.0  # angular drives count degrees
    drive.CreateDampingAttr(float(physics.joints[index].damping * per))
    if joint.kind == "screw":
        light = _body(stage, turn, link_origin(part), TURN_MASS)
        light.CreateDiagonalInertiaAttr((TURN_INERTIA,) * 3)
        light.CreatePrincipalAxesAttr(Gf.Quatf(1.0))
        slide = UsdPhysics.PrismaticJoint.Define(stage, f"{path}_slide")
        ends = np.sort(np.asarray(part.limits) * joint.pitch)
        _moving(slide, (turn, link), np.zeros(3), joint.axis, ends)
        slide.GetPrim().SetCustomDataByKey("screwPitchPerRadian", joint.pitch)
        slide.GetPrim().SetCustomDataByKey("screwLeader", joint_name(part))


def _moving(joint, bodies: tuple[str, str], offset: F64, axis: F64,  # type: ignore[no-untyped-def]
            limits: F64) -> None:
    """Fill in a joint along X of a frame that both bodies see turned to its axis."""
    joint.CreateAxisAttr("X")
    joint.CreateLowerLimitAttr(float(limits[0]))
    joint.CreateUpperLimitAttr(float(limits[1]))
    joint.CreateBody0Rel().SetTargets([bodies[0]])
    middle = np.array([1.0, 0.0, 0.0]) + axis
    across = np.array([0.0, 0.0, 1.0, 0.0])  # half a turn about y takes x to -x
    short = float(np.linalg.norm(middle)) < 1e-3
    quat = np.array([1.0 + axis[0], *np.cross((1.0, 0.0, 0.0), axis)])
    if short:  # nearly opposite: from -x, which half a turn reaches
        near = np.array([1.0 - axis[0], *np.cross((-1.0, 0.0, 0.0), axis)])
        quat = se3.quat_multiply(near / np.linalg.norm(near), across)
    _at(joint, bodies[1], offset, tuple(map(float, quat / np.linalg.norm(quat))))


def _at(joint, body: str, offset: F64, quat: tuple[float, ...]) -> None:  # type: ignore[no-untyped-def]
    from pxr import Gf

    joint.CreateBody1Rel().SetTargets([body])
    joint.CreateLocalPos0Attr(Gf.Vec3f(*map(float, offset)))
    joint.CreateLocalPos1Attr(Gf.Vec3f(0.0))
    joint.CreateLocalRot0Attr(Gf.Quatf(*quat))
    joint.CreateLocalRot1Attr(Gf.Quatf(*quat))
