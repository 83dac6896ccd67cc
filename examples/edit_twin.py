"""Change a twin by hand: name, material and how far a part moves; write it anew and check it.

python examples/edit_twin.py out/demo out/edited
"""

import sys
from dataclasses import replace
from pathlib import Path

from part2gs_robotics import api


def main(folder: Path, edited: Path) -> int:
    """Edit the first moving part; return 0 if the edited twin passes all checks."""
    twin = api.read_twin(folder)

    # A twin is frozen dataclasses: what changes is made anew, the rest is shared.
    base, part, *others = twin.parts
    if part.joint is None:
        raise SystemExit(f"{folder}: nothing moves")
    low, high = sorted((0.0, part.joint.value))  # what was observed, rad or scene units
    stopped = replace(part, name="front", limits=(low, high),
                      limits_source="assumed")  # provenance in twin.yaml: set by hand
    twin = replace(twin, name="kitchen_thing", parts=(base, stopped, *others),
                   material="1050")  # kg/m3, or a name such as plastic

    # Masses, inertias, friction and servos follow from meshes, scale and material.
    for repaired in api.write_twin(twin, edited):
        print(repaired)
    api.export(edited, "glb")  # or usd, sdf, ros; mjcf and urdf are in the folder already

    report = api.check(edited)
    for row in report.results:
        if row.status not in ("pass", "skipped"):
            print(f"{row.status}: {row.name} {row.subject} {row.detail}")
    print(f"{part.name} is {stopped.name}, from {stopped.limits[0]:.3f} to "
          f"{stopped.limits[1]:.3f}; checks {'pass' if report.ok else 'FAIL'}: {edited}")
    return report.exit_code


if __name__ == "__main__":
    sys.exit(main(*map(Path, sys.argv[1:3])))
