"""Every file against every other: parts, joints, ways, limits, masses, states and shapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from part2gs_robotics.agree.described import Body, Described, Drive, moved, step
from part2gs_robotics.agree.finding import CheckResult, fails, passes
from part2gs_robotics.agree.vote import Far, Vote, apart, cloud, relative, vote
from part2gs_robotics.model.arrays import F64

DRAWS = 8  # random joint values per joint: one wrong number shows at each of them
SHORT = 1e-5  # relative, of assumed numbers: files have six digits
DAMPED = 0.9  # of a servo's damping: the engine's own inertia makes it 0.68 another on chains
FLOAT = 1e-6  # of places: the engine keeps corners as float32, eight digits of the coordinate
TOLD = 4  # rows per check: more files or parts with one fault say nothing new
LOOSE = {"kv": DAMPED}
STATES = ("state_0", "state_1", "command state_0", "command state_1")
Value = Callable[[Body], F64 | None]


def compared(files: Sequence[Described], size: float) -> list[CheckResult]:
    """Return a row per check, or one per file and part that says something else than most.

    Args:
        files: two or more, in order of trust.
        size: of the object, scene units.
    """
    found = _bodies(files)
    shared = [n for n in files[0].bodies if all(n in f.bodies for f in files)]
    whole = [f for f in files if set(shared) <= set(f.bodies)]
    same = {f.file: f.same for f in whole}
    drives = [n for n in shared if any(f.bodies[n].drive is not None for f in whole)]
    found += _rows("same mass", "kg", relative, same, _parts(whole, shared, "mass", _mass))
    found += _rows("same center", "of size", apart, same,
                   _parts(whole, shared, "center", lambda b: b.center / size))
    found += _rows("same inertia", "", relative, same,
                   _parts(whole, shared, "inertia", lambda b: b.inertia))
    found += _joints(whole, drives, size)
    found += _rows("same limits", "", relative, same, _parts(whole, drives, "range", _limits))
    found += _numbers(whole, drives)
    found += _states(whole, drives)
    near = dict.fromkeys(same, FLOAT * _coordinates(whole, size))
    found += _rows("same surface", "units", cloud, near,
                   _parts(whole, shared, "visual mesh", lambda b: b.surface))
    found += _pieces(whole, shared, near)
    return found + [fails(*fault) for f in files for fault in f.faults]


def _mass(body: Body) -> F64:
    return np.array([body.mass])


def _limits(body: Body) -> F64 | None:
    drive = body.drive
    return None if drive is None or drive.kind == "fixed" else np.array(drive.limits)


def _coordinates(files: Sequence[Described], size: float) -> float:
    """Return the size, or the largest coordinate of the first file where that is more."""
    return max([size, *(float(np.abs(b.surface).max(initial=0.0))
                        for b in files[0].bodies.values())])


def _bodies(files: Sequence[Described]) -> list[CheckResult]:
    """Return which parts and carriers a file has that others do not."""
    names = {f.file: np.array(sorted(f"{n} on {b.parent or 'world'}" for n, b in f.bodies.items()))
             for f in files}
    found = vote(names, lambda a, b: 0.0 if a.tolist() == b.tolist() else 1.0, {})
    out = []
    for file in found.odd:
        more = sorted(set(names[file]) - set(names[found.winner]))
        less = sorted(set(names[found.winner]) - set(names[file]))
        text = "; ".join([*(f"has {m}" for m in more), *(f"lacks {m}" for m in less)])
        out.append(fails("same bodies", file, f"{text or 'a name twice'}; {found.said} otherwise",
                         f"{file}: name and hang its parts as {found.winner} does"))
    titles = {f.file: np.array([f.title]) for f in files if f.title}
    named = vote(titles, lambda a, b: float(a[0] != b[0]), {}) if len(titles) > 1 else None
    out += [fails("same bodies", file, f"is called {titles[file][0]!r}; {named.said} "
                  f"{titles[named.winner][0]!r}", f"{file}: call it {titles[named.winner][0]!r}")
            for file in (named.odd if named else ()) if named]
    return out or [passes("same bodies", "", f"{', '.join(names)} have the same "
                           f"{len(files[0].bodies)} parts")]


Table = dict[tuple[str, str], dict[str, F64]]  # (what, part): value by file


def _parts(files: Sequence[Described], names: Sequence[str], what: str, of: Value) -> Table:
    return {(what, n): {f.file: v for f in files if (v := of(f.bodies[n])) is not None}
            for n in names}


def _rows(check: str, unit: str, far: Far, limits: Mapping[str, float], table: Table
          ) -> list[CheckResult]:
    """Vote on every entry of a table and return failing rows, or one that passes."""
    out, worst, files, limit = [], 0.0, set[str](), max(limits.values())
    for (what, name), values in table.items():
        files |= set(values)
        if len(values) < 2:
            continue
        found = vote(values, far, limits)
        worst = max(worst, found.worst)
        for file, gap in found.odd.items():
            said, other = _shown(values[file]), _shown(values[found.winner])
            out.append(CheckResult(
                check, f"{file}: {name}", "fail", gap if np.isfinite(gap) else None, limits[file],
                unit,
                f"{what} is {said}; {found.said} {other}",
                f"{file}: correct {what} of {name}{_goal(other)}, or build the twin again"))
    if out or not files:
        return out[:TOLD]
    alike = f"alike in {', '.join(sorted(files))}"
    return [CheckResult(check, "", "pass", worst, limit, unit, alike)]


def _goal(text: str) -> str:
    return "" if "points" in text else f" to {text}"


def _shown(value: F64) -> str:
    if value.ndim == 2 and value.shape != (3, 3):
        if not len(value):
            return "nothing"
        low, high = value.min(0), value.max(0)
        return f"{len(value)} points from {_shown(low)} to {_shown(high)}"
    if value.ndim == 2:
        value = value[np.triu_indices(3)]
    return " ".join(f"{v:.6g}" for v in np.atleast_1d(value))


def _joints(files: Sequence[Described], names: Sequence[str], size: float) -> list[CheckResult]:
    """Drive every joint alone, then all of them together, in every file by its own numbers."""
    values, same = _draws(files[0], names), {f.file: f.same for f in files}
    out = list[CheckResult]()
    blamed: set[tuple[str, str]] = set()
    for name in names:
        points = _box(files[0].bodies[name].surface)
        ways = {f.file: _way([step(d, v[name]) for v in values], points) / size
                for f in files if (d := f.bodies[name].drive) is not None}
        found = vote(ways, apart, same)
        drives = {f.file: f.bodies[name].drive for f in files}
        for file, gap in found.odd.items():
            blamed.add((file, name))
            out.append(_joint_fault((file, name), found, drives, gap, same[file]))
        lacking = [f.file for f in files if f.bodies[name].drive is None]
        out += [fails("same joint", f"{f}: {name}", f"no joint; {found.said} otherwise",
                      f"{f}: hang {name} on a joint as {found.winner} does") for f in lacking]
        blamed |= {(f, name) for f in lacking}
        out += _joint_names(files, name)
    out += _chains(files, names, values, size, blamed)
    return out[:TOLD] or [passes("same motion", "", f"{DRAWS} random "
                                  f"positions of {len(names)} joint(s) put parts at one place")]


def _draws(file: Described, names: Sequence[str]) -> list[dict[str, float]]:
    rng, out = np.random.default_rng(0), []
    for _ in range(DRAWS):
        ends = {n: (d.limits if (d := file.bodies[n].drive) is not None else (0.0, 0.0))
                for n in names}
        out.append({n: float(rng.uniform(*np.clip(np.nan_to_num(e), -10.0, 10.0)))
                    for n, e in ends.items()})
    return out


def _box(points: F64) -> F64:
    """Return [8, 3] corners of the box around points."""
    if not len(points):
        return np.concatenate([np.zeros((1, 3)), np.eye(3)])
    ends = np.stack([points.min(0), points.max(0)])
    return np.array([[ends[i, 0], ends[j, 1], ends[k, 2]]
                     for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def _way(poses: Sequence[F64], points: F64) -> F64:
    return np.stack([points @ p[:3, :3].T + p[:3, 3] for p in poses])


def _joint_fault(where: tuple[str, str], found: Vote, drives: Mapping[str, Drive | None],
                 gap: float, limit: float) -> CheckResult:
    """Return what of a joint differs, in words of joints; where: file and part."""
    file, name = where
    own, other = drives[file], drives[found.winner]
    assert own is not None  # only files with one vote
    assert other is not None
    angle = float(np.degrees(np.arccos(np.clip(own.axis @ other.axis, -1.0, 1.0))))
    off = own.origin - other.origin
    off = off - other.axis * float(other.axis @ off)
    if own.kind != other.kind:
        text, goal = f"is {own.kind}, not {other.kind}", f"its type to {other.kind}"
    elif angle > 1e-4:
        text, goal = f"has an axis turned by {angle:.3g} deg", f"its axis to {_shown(other.axis)}"
    elif abs(own.pitch - other.pitch) > limit * abs(other.pitch):
        text, goal = f"has pitch {own.pitch:.6g}", f"its pitch to {other.pitch:.6g}"
    else:
        text = f"turns about a line {np.linalg.norm(off):.4g} units away"
        goal = f"its origin to {_shown(other.origin)} (world, state 0)"
    return CheckResult("same joint", f"{file}: {name}", "fail", gap, limit, "of size",
                   f"the joint of {name} {text}; {found.said} otherwise", f"{file}: set {goal}")


def _joint_names(files: Sequence[Described], name: str) -> list[CheckResult]:
    said = {f.file: np.array([d.name]) for f in files
            if (d := f.bodies[name].drive) is not None and d.name}
    if len(said) < 2:
        return []
    found = vote(said, lambda a, b: float(a[0] != b[0]), {})
    return [fails("same joint", f"{file}: {name}",
                  f"its joint is called {said[file][0]}; {found.said} {said[found.winner][0]}",
                  f"{file}: call it {said[found.winner][0]}") for file in found.odd]


def _chains(files: Sequence[Described], names: Sequence[str], values: list[dict[str, float]],
            size: float, blamed: set[tuple[str, str]]) -> list[CheckResult]:
    """Return parts that get elsewhere though no joint on the way is at fault."""
    out, same = [], {f.file: f.same for f in files}
    for name in names:
        points = _box(files[0].bodies[name].surface)
        ways = {f.file: _way([moved(f, name, v) for v in values], points) / size for f in files}
        found = vote(ways, apart, same)
        out += [CheckResult("same motion", f"{file}: {name}", "fail", gap, same[file], "of size",
                        f"joints alike, but {name} gets elsewhere; {found.said} otherwise",
                        f"{file}: hang {name} on the part that carries it in {found.winner}")
                for file, gap in found.odd.items()
                if not {(file, n) for n in _up(files, file, name)} & blamed]
    return out


def _up(files: Sequence[Described], file: str, name: str) -> set[str]:
    bodies = next(f.bodies for f in files if f.file == file)
    seen: set[str] = set()
    while name in bodies and name not in seen:
        seen.add(name)
        name = bodies[name].parent
    return seen


def _said(files: Sequence[Described], names: Sequence[str], of: Callable[[Drive], dict[str, float]]
          ) -> Table:
    """Return the named numbers of all joints; a file that does not say one has no vote on it."""
    out: Table = {}
    for name in names:
        for file in files:
            drive = file.bodies[name].drive
            for key, value in ({} if drive is None else of(drive)).items():
                if not np.isnan(value):
                    out.setdefault((key, name), {})[file.file] = np.array([value])
    return out


def _all(files: Sequence[Described], limit: float) -> dict[str, float]:
    return {f.file: limit for f in files}


def _numbers(files: Sequence[Described], names: Sequence[str]) -> list[CheckResult]:
    """Return friction, damping, effort and servo numbers that differ."""
    table = _said(files, names, lambda d: {k: v for k, v in d.numbers.items()
                                           if k not in ("servos", "motors")})
    own = {k: v for k, v in table.items() if k[0] not in LOOSE}
    out = _rows("same dynamics", "", relative, _all(files, SHORT), own)
    for key, limit in LOOSE.items():
        out += [r for r in _rows("same dynamics", "", relative, _all(files, limit),
                                 {k: v for k, v in table.items() if k[0] == key})
                if r.status != "pass"]
    return out


def _states(files: Sequence[Described], names: Sequence[str]) -> list[CheckResult]:
    table = _said(files, names, lambda d: {k: v for k, v in d.states.items()
                                           if k.removeprefix("command ") in ("state_0", "state_1")})
    moving = any(d.kind != "fixed" for d in files[0].drives().values())
    keys = {f.file: set().union(*(d.states for n in names
                                  if (d := f.bodies[n].drive) is not None)) for f in files}
    out = [fails("same states", f, f"has no {k}", f"{f}: add the keyframe {k.split()[-1]}"
                 f"{' with its ctrl' if ' ' in k else ''}, or build the twin again")
           for f, own in keys.items() if f.endswith(".xml") and moving
           for k in STATES if k not in own and (f != "twin.xml" or " " not in k)]
    return out[:TOLD] or _rows("same states", "", relative, _all(files, SHORT), table)


def _pieces(files: Sequence[Described], names: Sequence[str], near: Mapping[str, float]
            ) -> list[CheckResult]:
    """Return parts that do not collide in a file, or with other pieces than in others."""
    out, table, counts = list[CheckResult](), {}, {}
    for name in names:
        pieces = {f.file: p for f in files if (p := f.bodies[name].pieces) is not None}
        out += [fails("collision there", f"{file}: {name}", "nothing of it collides",
                      f"{file}: give {name} its collision pieces, enabled (contype, conaffinity 1)")
                for file, own in pieces.items() if not own]
        table["collision pieces", name] = {f: np.concatenate(own) for f, own in pieces.items()
                                           if own}
        counts["number of collision pieces", name] = {f: np.array([float(len(own))])
                                                      for f, own in pieces.items()}
    out = out[:TOLD] or [CheckResult("collision there", "", "pass",
                                 detail="every part collides in every file")]
    number = _rows("same collision", "", apart, _all(files, 0.0), counts) if counts else []
    return [*out, *(r for r in number if r.status != "pass"),
            *_rows("same collision", "units", cloud, near, table)]
