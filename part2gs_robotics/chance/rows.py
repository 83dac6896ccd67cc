"""How likely a twin is free of collision and reaches its states, with intervals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.agree.finding import CheckResult, Status
from part2gs_robotics.chance.draws import drawn_twin, known
from part2gs_robotics.chance.passage import Passage
from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.read_twin import read_twin
from part2gs_robotics.model.kinematics import moving_parts

LIKELY = 0.9  # a twin that is wrong one time in ten is worth a word
SURE = 0.95  # of an interval


def chances(folder: Path, count: int) -> list[CheckResult]:
    """Return two rows: how likely drawn joints are free of collision, and reach their states.

    Free: true surfaces overlap by no more than the check `overlap` allows, each joint in its range
    and the others at state 0, or at state 1. Reached: the same from state 0 to the drawn state 1.

    Args:
        folder: with twin.yaml.
        count: number of draws, the same every time.

    Raises:
        CheckError: no twin folder, a mesh that is not closed, or no joint with a known deviation.
    """
    if not (folder / "twin.yaml").is_file():
        raise CheckError(f"{folder}: holds no twin.yaml. Needed a twin folder, whose joints have "
                         "standard deviations; leave --samples out for other models.")
    twin = read_twin(folder)
    names = {i: f"{twin.parts[i].name}_joint" for i in moving_parts(twin)}
    drawn = [i for i in names if (joint := twin.parts[i].joint) is not None and known(joint)]
    if not drawn:
        raise CheckError(f"{folder}: no joint has a known standard deviation to draw from. Needed "
                         "sigma of one joint in twin.yaml; build with --alignment.")
    passage, rng = Passage(twin), np.random.default_rng(0)
    found = np.array([list(passage.ways(drawn_twin(twin, rng)).values()) for _ in range(count)])
    left = [names[i] for i in names if i not in drawn]
    said = f"; not drawn, no deviation known: {', '.join(left)}" if left else ""
    cause = "overlap lies within the joint's own uncertainty: give more photos, or carve more room"
    return [_row(name, ok, list(names.values()), said, cause)
            for name, ok in (("chance free", found[..., 0]), ("chance reached", found[..., 1]))]


def interval(hits: int, count: int) -> tuple[float, float]:
    """Return the exact interval of a share (Clopper and Pearson 1934)."""
    from scipy.stats import beta

    tail = (1.0 - SURE) / 2
    low = float(beta.ppf(tail, hits, count - hits + 1)) if hits else 0.0
    high = float(beta.ppf(1.0 - tail, hits + 1, count - hits)) if hits < count else 1.0
    return low, high


def _row(name: str, good: NDArray[np.bool_], joints: list[str], said: str,
         cause: str) -> CheckResult:
    count = len(good)
    hits = int(good.all(1).sum())
    low, high = interval(hits, count)
    detail = f"{hits} of {count} draws, {SURE:.0%} interval {low:.3f} to {high:.3f}"
    worst = int(good.sum(0).argmin())
    if hits < count:
        detail += f"; {joints[worst]} most often not ({count - int(good[:, worst].sum())})"
    share = hits / count
    status: Status = "pass" if share >= LIKELY else "warn"
    return CheckResult(name, "", status, share, LIKELY, "probability >=", detail + said,
                       cause if status == "warn" else "")
