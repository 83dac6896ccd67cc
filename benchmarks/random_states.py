"""Score `part2gs-robot build` on the kit's objects in states drawn at random.

    python benchmarks/random_states.py --kit PATH [--objects NAME ...]

The kit's states, and those of other_states.py, were thought of; these were drawn, those that are
called `again_` a second time: every joint of the kit's list from 25 to 90 % of a range a quarter
wider than the kit's, within its limits, and of objects with several joints two in five have one
that stays. Objects with parts behind doors are not among them. Rendering and scoring are the kit's;
objects that are not run keep their rows.
"""

from __future__ import annotations

import sys

from other_states import Moves, write_index
from reconstruction_suite import ROOT, score_own

# Name of the row: the kit's object, per joint its value in both states (rad or scene units), and
# the values of joints that stay.
DRAWN: dict[str, tuple[str, Moves, dict[str, float]]] = {
    "random_libero_microwave": ("libero_microwave", {"microjoint": (-1.05, -0.061)}, {}),
    "random_libero_short_cabinet": (
        "libero_short_cabinet", {"bottom_region": (0.123, -0.003), "top_region": (0.021, 0.062)},
         {"middle_level": 0.036}),
    "random_libero_wooden_cabinet": (
        "libero_wooden_cabinet", {"bottom_level": (-0.1, -0.046),
         "middle_level": (-0.013, -0.076), "top_level": (-0.012, -0.109)}, {}),
    "random_100221_box": ("pm_100221_box", {"joint_0": (-0.844, 1.138)}, {}),
    "random_101619_safe": ("pm_101619_safe", {"joint_0": (-0.007, 1.635)}, {}),
    "random_10211_laptop": ("pm_10211_laptop", {"joint_1": (-0.372, 0.066)}, {}),
    "random_102209_trashcan": ("pm_102209_trashcan", {"joint_2": (2.011, -0.27)}, {}),
    "random_102703_toilet": ("pm_102703_toilet", {"joint_3": (0.038, 0.386)}, {"joint_2": 1.337}),
    "random_103275_stapler": ("pm_103275_stapler", {"joint_1": (1.885, 0.376)}, {}),
    "random_103508_washer": ("pm_103508_washer", {"joint_0": (-0.319, 0.339)}, {}),
    "random_103755_suitcase": (
        "pm_103755_suitcase", {"joint_0": (-1.331, 0.411), "joint_1": (0.351, -0.425)}, {}),
    "random_1370_faucet": ("pm_1370_faucet", {"joint_0": (1.067, 0.529)}, {}),
    "random_22301_table": (
        "pm_22301_table", {"joint_0": (1.016, 0.501), "joint_2": (0.19, 0.062)},
         {"joint_1": 0.554}),
    "random_22692_table": (
        "pm_22692_table", {"joint_0": (0.018, 0.141), "joint_1": (0.178, 0.576)}, {}),
    "random_23472_table": (
        "pm_23472_table", {"joint_0": (-0.208, 0.821), "joint_1": (0.179, -0.247)}, {}),
    "random_25308_table": ("pm_25308_table", {"joint_0": (0.272, 0.023)}, {"joint_1": 0.203}),
    "random_31249_table": (
        "pm_31249_table", {"joint_0": (0.153, 0.236), "joint_1": (0.099, 0.204),
         "joint_3": (0.255, 0.91), "joint_4": (1.052, 0.253)}, {}),
    "random_32761_table": (
        "pm_32761_table", {"joint_0": (0.167, 0.005), "joint_1": (0.016, 0.237),
         "joint_3": (0.162, 0.051)}, {"joint_2": 0.137}),
    "random_48492_box": (
        "pm_48492_box", {"joint_1": (0.738, 1.437), "joint_2": (0.175, 0.89)}, {"joint_0": 1.39}),
    "random_robosuite_door": ("robosuite_door", {"hinge": (0.006, 0.171)}, {}),
    "random_sektion_cabinet": (
        "sektion_cabinet", {"door_left_joint": (-0.304, -0.677),
         "door_right_joint": (1.169, 0.652), "drawer_top_joint": (0.104, 0.256)},
         {"drawer_bottom_joint": 0.302}),
    "again_100221_box": ("pm_100221_box", {"joint_0": (-0.585, -0.003)}, {}),
    "again_101619_safe": ("pm_101619_safe", {"joint_0": (-0.292, 0.579)}, {}),
    "again_10211_laptop": ("pm_10211_laptop", {"joint_1": (-0.401, 0.193)}, {}),
    "again_102209_trashcan": ("pm_102209_trashcan", {"joint_2": (0.397, 1.801)}, {}),
    "again_102703_toilet": (
        "pm_102703_toilet", {"joint_2": (0.742, 1.698), "joint_3": (0.639, 0.915)}, {}),
    "again_103275_stapler": ("pm_103275_stapler", {"joint_1": (0.149, 1.354)}, {}),
    "again_103508_washer": ("pm_103508_washer", {"joint_0": (0.465, -0.655)}, {}),
    "again_103755_suitcase": (
        "pm_103755_suitcase", {"joint_1": (0.114, -0.745)}, {"joint_0": 0.255}),
    "again_1370_faucet": ("pm_1370_faucet", {"joint_0": (0.076, 1.097)}, {}),
    "again_22301_table": (
        "pm_22301_table", {"joint_0": (0.685, 0.222), "joint_1": (0.37, 0.83)}, {"joint_2": 0.075}),
    "again_22692_table": ("pm_22692_table", {"joint_0": (0.08, 0.284)}, {"joint_1": 0.363}),
    "again_23472_table": (
        "pm_23472_table", {"joint_0": (0.815, -0.067), "joint_1": (-0.202, -0.077)}, {}),
    "again_25308_table": (
        "pm_25308_table", {"joint_0": (0.031, 0.333), "joint_1": (0.001, 0.237)}, {}),
    "again_31249_table": (
        "pm_31249_table", {"joint_0": (0.044, 0.259), "joint_1": (0.244, 0.132), "joint_3": (1.134,
         0.266), "joint_4": (1.215, 0.854)}, {}),
    "again_32761_table": (
        "pm_32761_table", {"joint_0": (0.086, 0.16), "joint_1": (0.199, 0.309), "joint_2": (0.036,
         0.215), "joint_3": (0.179, 0.047)}, {}),
    "again_48492_box": (
        "pm_48492_box", {"joint_0": (1.822, 0.072), "joint_1": (0.5, 1.472), "joint_2": (0.837,
         1.804)}, {}),
    "again_libero_microwave": ("libero_microwave", {"microjoint": (-0.613, -0.181)}, {}),
    "again_libero_short_cabinet": (
        "libero_short_cabinet", {"middle_level": (-0.0, 0.063), "top_region": (0.108, 0.011)},
         {"bottom_region": 0.102}),
    "again_libero_wooden_cabinet": (
        "libero_wooden_cabinet", {"bottom_level": (-0.133, -0.062), "middle_level": (-0.098,
         -0.023), "top_level": (-0.046, -0.106)}, {}),
    "again_robosuite_door": ("robosuite_door", {"hinge": (0.254, 0.116)}, {}),
    "again_sektion_cabinet": (
        "sektion_cabinet", {"door_right_joint": (1.133, 0.633), "drawer_bottom_joint": (0.218,
         0.12), "drawer_top_joint": (0.038, 0.267)}, {"door_left_joint": -0.307}),
}  # fmt: skip


def main() -> int:
    """Run the kit if it is given, store its numbers, and write the table."""
    return score_own(__doc__.splitlines()[0], list(DRAWN), "benchmarks/random_states.py",
                     ROOT / "docs/random_states.md",
                     lambda work: ["--index", str(write_index(work, DRAWN).resolve())])


if __name__ == "__main__":
    sys.exit(main())
