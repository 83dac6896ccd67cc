"""Build the twin of a scene, and say what was found and whether it holds in MuJoCo.

python examples/build_twin.py examples/microwave out/microwave    # a few minutes on 2 cores
"""

import sys
from pathlib import Path

from part2gs_robotics import api
from part2gs_robotics.errors import Part2GSError


def main(scene: Path, out: Path) -> int:
    """Build and report; return the exit code: 0 good, 1 a check fails, 2 bad input."""
    try:
        # Settings are the flags of `part2gs-robot build` by name; keys of scene.yaml count too.
        code = api.build(scene, out, preset="draft", quiet=True)
    except Part2GSError as err:  # says what was wrong, where, what was expected and what to do
        print(f"error: {err}")
        return 2
    twin = api.read_twin(out)
    for part in twin.parts:
        joint = part.joint
        if joint is None:  # the base
            continue
        print(f"{part.name} on {twin.parts[part.parent].name}: {joint.kind}, axis "
              f"{joint.axis.round(3)}, {joint.value:+.3f} between the states, range "
              f"{part.limits[0]:.3f} to {part.limits[1]:.3f} ({part.limits_source})")
    for note in twin.notes:  # what was assumed
        print(note)
    print(f"checks {'pass' if code == 0 else 'FAIL'}: {out / 'report.html'}")
    return code


if __name__ == "__main__":
    sys.exit(main(*map(Path, sys.argv[1:3])))
