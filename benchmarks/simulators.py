"""Score `part2gs-robot build` on objects out of two simulators, and put the table into docs.

    pip install --no-deps metaworld==3.1.1 gymnasium-robotics==1.4.2
    python benchmarks/simulators.py --kit PATH [--objects NAME ...]

Meta-World (MIT) and Gymnasium-Robotics (MIT; kitchen and Adroit models Apache-2.0) hold tables with
robots; one object is cut out of each. Rendering and scoring are the kit's, as in
reconstruction_suite.py. Objects that are not run keep their rows.
"""

from __future__ import annotations

import importlib.util
import itertools
import sys
from pathlib import Path

import mujoco
import yaml
from reconstruction_suite import ROOT, score_own

MW = "metaworld/assets/sawyer_xyz/sawyer_{}.xml"
ADROIT = "gymnasium_robotics/envs/assets/adroit_hand/adroit_door.xml"
KITCHEN = "gymnasium_robotics/envs/assets/kitchen_franka/kitchen_assets/kitchen_env_model.xml"
NAMELESS = "joint_{}"  # what a joint without a name is called, by its place among the object's
# Name: model, body, and per joint its value in both states (rad or metres).
OBJECTS: dict[str, tuple[str, str, dict[str, tuple[float, float]]]] = {
    "coffee_machine": (MW.format("coffee"), "coffee_machine", {"goal_slidey": (0.0, 0.03)}),
    "door_of_safe": (MW.format("door_pull"), "door", {"doorjoint": (-0.1, -1.1)}),
    "drawer": (MW.format("drawer"), "drawer", {"goal_slidey": (0.0, -0.12)}),
    "faucet": (MW.format("faucet"), "faucetBase", {"knob_Joint_1": (0.0, 1.0)}),
    "laptop": (MW.format("laptop"), "laptop", {"joint_0": (0.1, 0.9)}),
    "lever": (MW.format("lever_pull"), "lever", {"LeverAxis": (0.1, 1.2)}),
    "lock_of_safe": (MW.format("door_lock"), "door", {"joint_0": (0.0, 1.2)}),
    "sash_window": (MW.format("window"), "window", {"window_slide": (0.01, 0.15)}),
    "kitchen_hinged": (KITCHEN, "hingecabinet", {"left_hinge_cabinet": (-0.1, -1.2),
                                                 "right_hinge_cabinet": (0.05, 0.9)}),
    "kitchen_microwave": (KITCHEN, "microwave", {"microwave": (-0.1, -1.3)}),
    "kitchen_oven_knobs": (KITCHEN, "oven", {"knob_Joint_1": (0.0, -1.4),
                                             "knob_Joint_2": (0.0, -0.7)}),
    "kitchen_sliding": (KITCHEN, "slidecabinet", {"slide_cabinet": (0.02, 0.35)}),
    "room_door": (ADROIT, "frame", {"door_hinge": (0.05, 0.9)}),
    "room_door_latch": (ADROIT, "frame", {"door_hinge": (0.05, 0.9), "latch": (0.0, 1.2)}),
    # The same in other states: little, much, one closes while the other opens.
    "drawer_3_cm": (MW.format("drawer"), "drawer", {"goal_slidey": (0.0, -0.03)}),
    "faucet_115_deg": (MW.format("faucet"), "faucetBase", {"knob_Joint_1": (-1.0, 1.0)}),
    "laptop_9_deg": (MW.format("laptop"), "laptop", {"joint_0": (0.5, 0.65)}),
    "lever_90_deg": (MW.format("lever_pull"), "lever", {"LeverAxis": (0.0, 1.57)}),
    "kitchen_hinged_cross": (KITCHEN, "hingecabinet", {"left_hinge_cabinet": (-1.2, -0.1),
                                                       "right_hinge_cabinet": (0.05, 0.9)}),
    "kitchen_microwave_12_deg": (KITCHEN, "microwave", {"microwave": (-0.05, -0.26)}),
    "kitchen_microwave_115_deg": (KITCHEN, "microwave", {"microwave": (-0.05, -2.05)}),
    "kitchen_sliding_10_cm": (KITCHEN, "slidecabinet", {"slide_cabinet": (0.1, 0.2)}),
    "room_door_latch_92_deg": (ADROIT, "frame", {"door_hinge": (0.0, 0.3), "latch": (0.2, 1.8)}),
}
NESTED = ("room_door_latch", "room_door_latch_92_deg")


def main() -> int:
    """Run the kit if it is given, store its numbers, and write the table."""
    def flags(work: Path) -> list[str]:
        index = write_objects(work / "models")
        return ["--index", str(index), "--roots", str(index.parent)]

    return score_own(__doc__.splitlines()[0], list(OBJECTS), "benchmarks/simulators.py",
                     ROOT / "docs/simulators.md", flags)


def write_objects(folder: Path) -> Path:
    """Write every object's model and the kit's index of them; return the index."""
    entries = {}
    for name, (model, body, states) in OBJECTS.items():
        (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / name / "model.xml").write_text(cut_out(find(model), body))
        moves = {joint: list(values) for joint, values in states.items()}
        entries[name] = {"licence": "MIT or Apache-2.0", "units": "metres",
                         "nested": name in NESTED, "move": moves}
    index = folder.resolve() / "index.yaml"
    index.write_text(yaml.safe_dump({"objects": entries}))
    return index


def find(model: str) -> Path:
    """Return the path of a model in an installed package, which is not imported."""
    package, rest = model.split("/", 1)
    spec = importlib.util.find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise SystemExit(f"{package}: not installed. Expected: pip install --no-deps "
                         "metaworld==3.1.1 gymnasium-robotics==1.4.2")
    return Path(spec.submodule_search_locations[0]) / rest


def cut_out(model: Path, body: str) -> str:
    """Return MJCF of one body of a model and what hangs on it, with absolute paths of its files."""
    spec = mujoco.MjSpec.from_file(str(model))
    one = spec.body(body)
    above = set()
    while one.name != "world":
        above.add(one.name)
        one = one.parent
    for thing in itertools.chain(spec.actuators, spec.equalities, spec.tendons, spec.sensors,
                                 spec.excludes, spec.pairs, spec.keys, spec.cameras, spec.lights):
        spec.delete(thing)
    _prune(spec, spec.worldbody, body, above)
    for number, joint in enumerate(spec.joints):
        joint.name = joint.name or NAMELESS.format(number)
    spec.meshdir = str((model.parent / (spec.meshdir or ".")).resolve())
    spec.texturedir = str((model.parent / (spec.texturedir or ".")).resolve())
    spec.compile()
    return str(spec.to_xml())


def _prune(spec: mujoco.MjSpec, parent: mujoco.MjsBody, body: str, above: set[str]) -> None:
    """Delete all that hangs on a body, but for one body and those that carry it."""
    for thing in [*parent.geoms, *parent.sites]:
        spec.delete(thing)
    for child in list(parent.bodies):
        if child.name not in above:
            spec.delete(child)
        elif child.name != body:
            _prune(spec, child, body, above)


if __name__ == "__main__":
    sys.exit(main())
