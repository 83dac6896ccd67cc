"""Let others judge exported twins, and put what they say into docs.

    python benchmarks/judges.py [--twins FOLDER ...]

Judges are programs that do not know this project: check_urdf, yourdfpy, simcheck, PyBullet. They
judge toy twins with known answers; `--twins` judges folders of finished builds and prints only.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import subprocess
import sys
import tempfile
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/judges.json", ROOT / "docs/judges.md"
KEPT = 0.001  # m: PyBullet drops contact points that drifted apart by more; its own 0.02 is wrong
SETTLE, TRAVEL = 120, 480  # steps of 1/240 s: half a second after two of travel
PACKAGES = ("cmeel-urdfdom", "yourdfpy", "simcheck", "pybullet", "mujoco")


def toys() -> dict:
    """Return a twin of every joint kind, a chain, and all of them in one."""
    sys.path.insert(0, str(ROOT / "tests"))
    from synth import toy_cabinet_twin

    whole = toy_cabinet_twin(4)
    base, drawer, door, lever, cap = whole.parts
    kinds = {"slide": (drawer,), "hinge": (door,), "screw": (cap,),
             "chain": (door, replace(lever, parent=1))}  # fmt: skip
    return {"cabinet": whole} | {
        name: replace(whole, name=name, parts=(base, *parts)) for name, parts in kinds.items()
    }


def export(twin, folder: Path) -> Path:
    """Write a twin as URDF and MJCF; return the URDF."""
    from part2gs_robotics.exporters.mjcf import write_mjcf
    from part2gs_robotics.exporters.urdf import write_urdf

    folder.mkdir(parents=True, exist_ok=True)
    write_mjcf(twin, folder)
    write_urdf(twin, folder)
    return folder / "twin.urdf"


def command(name: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a program of this Python's environment."""
    path = Path(sys.executable).with_name(name)
    return subprocess.run([str(path), *words], capture_output=True, text=True, check=False)


def check_urdf(urdf: Path) -> str:
    """Return the root link that urdfdom finds, or what it says against the file."""
    done = command("check_urdf", str(urdf))
    found = re.search(r"root Link: (\w+)", done.stdout)
    return f"root {found[1]}" if done.returncode == 0 and found else done.stderr.strip()[:200]


def yourdfpy_error(twin, urdf: Path, count: int = 50) -> float:
    """Return how far yourdfpy puts any part from where it belongs, over random positions."""
    import yourdfpy

    from part2gs_robotics.exporters.mjcf import joint_name
    from part2gs_robotics.model.kinematics import moving_parts, part_transforms

    robot = yourdfpy.URDF.load(str(urdf), load_meshes=False, build_scene_graph=True)
    moving = [twin.parts[i] for i in moving_parts(twin)]
    names = [joint_name(part) for part in moving]
    rest = {p.name: robot.get_transform(p.name, "world") for p in twin.parts}
    rng, worst = np.random.default_rng(0), 0.0
    for _ in range(count):
        q = [rng.uniform(*part.limits) for part in moving]
        robot.update_cfg(dict(zip(names, q, strict=True)))
        for part, place in zip(twin.parts, part_transforms(twin, q), strict=True):
            moved = robot.get_transform(part.name, "world") @ np.linalg.inv(rest[part.name])
            worst = max(worst, float(np.abs(moved - place).max()))
    return worst


def simcheck(files: list[Path]) -> list[dict]:
    """Return simcheck's report of every model: verdict, counts, findings."""
    done = command("simcheck", "check", "--no-config", "--no-cache", "--format", "json",
                   *map(str, files))  # fmt: skip
    found = json.loads(done.stdout)
    rows = found if isinstance(found, list) else [found]
    return [{"verdict": row["verdict"], "counts": row["counts"],
             "findings": [f"{one['id']}: {finding['message']}" for one in row["results"]
                          for finding in one["findings"] if finding["severity"] != "info"]}
            for row in rows]  # fmt: skip


def bullet_reach(urdf: Path, kept: float = KEPT) -> dict[str, float]:
    """Return how much of its range every joint passes in PyBullet, links colliding with each other.

    Position control with the effort and velocity of the URDF, to the upper end and to the lower,
    the other joints held at 0. PyBullet ignores <mimic>, so what mimics gets its own command.

    Args:
        urdf: of an exported twin, in metres.
        kept: PyBullet's contactBreakingThreshold, m.
    """
    import pybullet as bullet

    bullet.connect(bullet.DIRECT)
    try:
        bullet.setPhysicsEngineParameter(contactBreakingThreshold=kept)
        flags = (bullet.URDF_USE_INERTIA_FROM_FILE | bullet.URDF_USE_SELF_COLLISION
                 | bullet.URDF_USE_SELF_COLLISION_INCLUDE_PARENT)  # fmt: skip
        body = bullet.loadURDF(str(urdf), useFixedBase=True, flags=flags)
        infos = [bullet.getJointInfo(body, j) for j in range(bullet.getNumJoints(body))]
        free = {info[1].decode(): info for info in infos
                if info[2] in (bullet.JOINT_REVOLUTE, bullet.JOINT_PRISMATIC)}  # fmt: skip
        follows = mimics(urdf)
        return {name: _passed(bullet, body, free, name, follows) for name in free
                if name not in follows}  # fmt: skip
    finally:
        bullet.disconnect()


def mimics(urdf: Path) -> dict[str, tuple[str, float]]:
    """Return leader and multiplier of every joint that mimics another."""
    joints = ET.parse(urdf).getroot().findall("joint")
    return {j.attrib["name"]: (m.attrib["joint"], float(m.attrib["multiplier"]))
            for j in joints if (m := j.find("mimic")) is not None}  # fmt: skip


def _passed(bullet, body: int, free: dict, name: str, follows: dict) -> float:
    low, high = free[name][8:10]
    if high <= low:
        return 1.0
    for info in free.values():
        bullet.resetJointState(body, info[0], 0.0)
    reached, start = [], 0.0
    for goal in (high, low):
        for step in range(TRAVEL + SETTLE):
            at = start + (goal - start) * min(1.0, (step + 1) / TRAVEL)
            for other, info in free.items():
                leader, factor = follows.get(other, (other, 1.0))
                bullet.setJointMotorControl2(
                    body, info[0], bullet.POSITION_CONTROL, force=info[10], maxVelocity=info[11],
                    targetPosition=at * factor if leader == name else 0.0)  # fmt: skip
            bullet.stepSimulation()
        reached.append(bullet.getJointState(body, free[name][0])[0])
        start = goal
    return (reached[0] - reached[1]) / (high - low)


def judged(folder: Path) -> dict:
    """Return what all judges say of all toys."""
    twins = toys()
    urdfs = {name: export(twin, folder / name) for name, twin in twins.items()}
    files = [path for urdf in urdfs.values() for path in (urdf, urdf.with_name("scene.xml"))]
    reports = simcheck(files)
    rows = []
    for i, (name, urdf) in enumerate(urdfs.items()):
        rows.append({
            "twin": name,
            "check_urdf": check_urdf(urdf),
            "yourdfpy": float(f"{yourdfpy_error(twins[name], urdf):.0e}"),
            "simcheck": dict(zip(("urdf", "mjcf"), reports[2 * i : 2 * i + 2], strict=True)),
            "pybullet": round(min(bullet_reach(urdf).values()), 4),
        })  # fmt: skip
    return {"versions": {name: version(name) for name in PACKAGES},
            "machine": platform.machine(), "rows": rows}  # fmt: skip


def table(result: dict) -> str:
    """Return the page's table."""
    lines = ["| twin | check_urdf | yourdfpy: farthest part | simcheck: URDF, MJCF "
             "| PyBullet: least reach |", "|---|---|---|---|---|"]  # fmt: skip
    for row in result["rows"]:
        said = ", ".join(
            f"{one['verdict']} ({one['counts']['error']} errors, "
            f"{one['counts']['warning']} warnings)" for one in row["simcheck"].values())
        lines.append(f"| {row['twin']} | {row['check_urdf']} | {row['yourdfpy']:.0e} m | {said} "
                     f"| {100 * row['pybullet']:.1f} % |")  # fmt: skip
    used = ", ".join(f"{name} {number}" for name, number in result["versions"].items())
    return "\n".join([*lines, "", f"With {used}. Made by `benchmarks/judges.py`.", ""])


def main() -> int:
    """Judge the toys and write page and numbers, or judge the folders given."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--twins", nargs="+", type=Path, help="folders with a twin.urdf")
    given = parser.parse_args().twins
    for folder in given or ():
        urdf = folder / "twin.urdf"
        sizes = {kept: bullet_reach(urdf, kept) for kept in (0.02, KEPT)}
        for joint in sizes[KEPT]:
            sys.stdout.write(f"{folder.name} {joint} {check_urdf(urdf)}; PyBullet "
                             f"{sizes[0.02][joint]:.4f}, {sizes[KEPT][joint]:.4f}\n")  # fmt: skip
    if given:
        return 0
    with tempfile.TemporaryDirectory() as work:
        result = judged(Path(work))
    RESULTS.write_text(json.dumps(result, indent=1) + "\n")
    begin, end = "<!-- judges:begin -->\n", "<!-- judges:end -->"
    before, rest = PAGE.read_text().split(begin)
    PAGE.write_text(before + begin + table(result) + end + rest.split(end)[1])
    return 0


if __name__ == "__main__":
    sys.exit(main())
