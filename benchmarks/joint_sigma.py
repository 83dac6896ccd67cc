"""Simulated alignments: how often the truth lies inside the 90 % intervals of a joint.

Every draw is an object of textured boxes: a base with a door, a drawer or a door that rises as it
turns, its joint, its place in the world and its cameras all random. Photos of both states are drawn
from the true Gaussians; `align` starts from a wrong joint. Two conditions:

- pixels: the Gaussians are true, every colour of every photo has noise of a few grey levels.
- geometry: besides, the Gaussians of each state are bent by a smooth random field of their own and
  miscoloured in patches, as fits are: errors that all views share.

Run: NUMBA_NUM_THREADS=1 python benchmarks/joint_sigma.py [draws of a kind] [json]
(100 of each: about 9 min on one core)
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from part2gs_robotics.evidence.cross_render import move_gaussians
from part2gs_robotics.joints.align import AlignmentProblem, align
from part2gs_robotics.model import se3
from part2gs_robotics.model.gaussians import SH_C0, Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.scene import Camera
from part2gs_robotics.model.small_views import SmallViews
from part2gs_robotics.render.dispatch import render
from part2gs_robotics.runtime.buffers import Workspace

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
GREY = 1 / 255
LINE = 1.645  # 90 % of a normal variable lie within
DISC = 1.58  # times the root of the summed variances: 89 % (a line) to 92 % (a round normal) within
QUANTITIES = {"axis": DISC, "origin": DISC, "value": LINE, "rise": LINE}
KINDS = ("revolute", "prismatic", "screw")


@dataclass(frozen=True)
class Draw:
    """One simulated object.

    Attributes:
        truth: the joint.  start: the joint alignment begins with.  labels: [N] 0 base, 1 part.
        gaussians: true ones of both states.  Ks, viewmats: cameras of both states.
        side: pixels of an image.  diag: diagonal of the object.
    """

    truth: Joint
    start: Joint
    gaussians: tuple[Gaussians, Gaussians]
    labels: I64
    Ks: tuple[F64, F64]
    viewmats: tuple[F64, F64]
    side: int
    diag: float


def waves(points: F64, length: float, rng: np.random.Generator) -> F64:
    """Return [n, 3]: a smooth random field of unit variance, waves of about `length`."""
    turns = rng.normal(size=(24, 3)) / length
    phases = rng.uniform(0, 2 * np.pi, 24)
    return np.asarray(np.sin(points @ turns.T + phases) @ rng.normal(size=(24, 3)) / np.sqrt(12))


def box(lo: F64, hi: F64, spacing: float, rng: np.random.Generator) -> Gaussians:
    """Return flat opaque Gaussians on the faces of a box, painted in smooth waves."""
    means, logs = [], []
    for axis in range(3):
        counts = np.maximum(1, np.round((hi - lo) / spacing)).astype(int)
        steps = [a + (np.arange(n) + 0.5) * (b - a) / n
                 for a, b, n in zip(lo, hi, counts, strict=True)]
        steps[axis] = np.array([lo[axis], hi[axis]])
        means.append(np.stack(np.meshgrid(*steps, indexing="ij"), -1).reshape(-1, 3))
        flat = np.full(3, np.log(0.6 * spacing))
        flat[axis] = np.log(0.02 * spacing)
        logs.append(np.tile(flat, (len(means[-1]), 1)))
    points = np.concatenate(means)
    n = len(points)
    colors = np.clip(rng.uniform(0.35, 0.65, 3) + 0.17 * waves(points, 0.12, rng), 0.05, 0.95)
    return Gaussians(
        points.astype(np.float32), np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
        np.concatenate(logs).astype(np.float32), np.full(n, 3.0, np.float32),
        ((colors - 0.5) / SH_C0).astype(np.float32), np.zeros((n, 0, 3), np.float32))


def joined(one: Gaussians, two: Gaussians) -> Gaussians:
    """Return all Gaussians of both."""
    return Gaussians(*(np.concatenate([getattr(one, f), getattr(two, f)])
                       for f in one.__dataclass_fields__))


def cameras(count: int, side: int, centre: F64, diag: float, turn: F64) -> tuple[F64, F64]:
    """Return Ks and viewmats spread over a sphere that is turned by a [3, 3] rotation."""
    k = np.arange(count) + 0.5
    up, around = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    level = np.sqrt(1 - up**2)
    viewmats = np.tile(np.eye(4), (count, 1, 1))
    for v, way in enumerate(np.stack([level * np.cos(around), level * np.sin(around), up], 1)):
        x = np.cross(-way, [0.0, 0, 1])
        x /= np.linalg.norm(x)
        rot = np.stack([x, np.cross(-way, x), -way]) @ turn.T
        viewmats[v, :3, :3], viewmats[v, :3, 3] = rot, -rot @ (centre + 2.2 * diag * turn @ way)
    focal = 1.9 * side
    K = np.array([[focal, 0, side / 2], [0, focal, side / 2], [0, 0, 1.0]])
    return np.repeat(K[None], count, 0), viewmats


def random_rotation(rng: np.random.Generator) -> F64:
    """Return a rotation, uniform over all."""
    rot, upper = np.linalg.qr(rng.normal(size=(3, 3)))
    rot = rot * np.sign(np.diag(upper))
    return np.asarray(rot * np.sign(np.linalg.det(rot)))


def draw(kind: str, rng: np.random.Generator, count: int = 8, side: int = 72) -> Draw:
    """Return a random base with a door (revolute, or a screw, which rises) or a drawer."""
    size = rng.uniform(0.35, 0.6, 3)
    thick = rng.uniform(0.15, 0.3) if kind == "prismatic" else rng.uniform(0.05, 0.12)
    lo, hi = np.array([0.0, -thick, 0.0]), np.array([size[0], -0.005, size[2]])
    lo[2], hi[0] = rng.uniform(0, 0.3) * size[2], rng.uniform(0.7, 1.0) * size[0]
    spacing = 0.055
    parts = box(np.zeros(3), size, spacing, rng), box(lo, hi, spacing, rng)
    both = joined(*parts)
    labels = np.repeat([0, 1], [len(p) for p in parts])
    tilt = se3.rotation_from_rotvec(rng.normal(scale=0.1, size=3))
    if kind != "prismatic":
        origin = np.array([0.0, -thick / 2, 0.5 * (lo[2] + hi[2])]) + rng.normal(scale=0.02, size=3)
        joint = Joint(kind, tilt @ np.array([0.0, 0, -1]), origin, float(rng.uniform(0.35, 1.5)))
        if kind == "screw":
            joint = replace(joint, pitch=float(rng.uniform(0.03, 0.15)) / joint.value)
    else:
        joint = Joint("prismatic", tilt @ np.array([0.0, -1, 0]), 0.5 * (lo + hi),
                      float(rng.uniform(0.08, 0.3)))
    diag = float(np.linalg.norm(size + np.array([0, thick, 0])))
    place = se3.make(random_rotation(rng), rng.normal(size=3))
    truth = replace(joint, axis=place[:3, :3] @ joint.axis, origin=se3.apply(place, joint.origin))
    zero = moved(both, np.ones(len(both), np.int64), place)
    centre = se3.apply(place, 0.5 * size)
    eyes = [cameras(count, side, centre, 1.1 * diag, random_rotation(rng)) for _ in range(2)]
    one = moved(zero, labels, truth.state1_from_0)
    return Draw(truth, wrong(truth, diag, rng), (zero, one), labels,
                (eyes[0][0], eyes[1][0]), (eyes[0][1], eyes[1][1]), side, diag)


def moved(gaussians: Gaussians, labels: I64, move: F64) -> Gaussians:
    """Return the Gaussians with those of label 1 moved."""
    there = move_gaussians(gaussians, labels, [np.eye(4), move])
    return replace(gaussians, means=there.means, quats=there.quats)


def wrong(truth: Joint, diag: float, rng: np.random.Generator) -> Joint:
    """Return the joint, off by half a degree and half a percent of the diagonal."""
    tilt = se3.rotation_from_rotvec(rng.normal(scale=np.deg2rad(0.5), size=3))
    off = rng.normal(scale=0.005 * diag, size=3)
    off -= truth.axis * (truth.axis @ off)
    scale = diag if truth.kind == "prismatic" else 1.0
    rise = 0.005 * diag * rng.normal() if truth.kind == "screw" else 0.0
    return replace(truth, axis=tilt @ truth.axis, origin=truth.origin + off,
                   value=truth.value + rng.normal(scale=0.005) * scale,
                   pitch=truth.pitch + rise / truth.value)


def photos(d: Draw, grey: float, rng: np.random.Generator) -> tuple[SmallViews, SmallViews]:
    """Return images of both states, with noise of `grey` levels in every colour of the object."""
    out, work = [], Workspace()
    for g, Ks, viewmats in zip(d.gaussians, d.Ks, d.viewmats, strict=True):
        colors, alphas = [], []
        for K, view in zip(Ks, viewmats, strict=True):
            image = render(g.splats, Camera(view, K, d.side, d.side), workspace=work)
            noise = grey * GREY * rng.normal(size=image.color.shape) * image.alpha[..., None]
            colors.append((image.color + noise).astype(np.float32))
            alphas.append(image.alpha.copy())
        out.append(SmallViews(np.stack(colors), np.stack(alphas), Ks, viewmats))
    return out[0], out[1]


def bent(g: Gaussians, labels: I64, diag: float, rng: np.random.Generator) -> Gaussians:
    """Return the Gaussians with the smooth errors of a fit, each part bent on its own.

    Waves of a tenth of the diagonal, 0.2 % of it high; colours off by 3 grey levels in patches.
    """
    means, sh0 = g.means.astype(np.float64), g.sh0.astype(np.float64)
    for k in (0, 1):
        own = labels == k
        means[own] += 0.002 * diag * waves(means[own], 0.1 * diag, rng)
        sh0[own] += 3 * GREY / SH_C0 * waves(means[own], 0.1 * diag, rng)
    return replace(g, means=means.astype(np.float32), sh0=sh0.astype(np.float32))


def errors(found: Joint, truth: Joint) -> dict[str, float]:
    """Return the errors in the units of the standard deviations."""
    off = np.cross(found.origin - truth.origin, truth.axis)
    return {
        "axis": float(np.arctan2(np.linalg.norm(np.cross(found.axis, truth.axis)),
                                 found.axis @ truth.axis)),
        "origin": float("nan") if truth.kind == "prismatic" else float(np.linalg.norm(off)),
        "value": abs(found.value - truth.value),
        "rise": abs(found.rise - truth.rise)
        if truth.kind == "screw" else float("nan"),
    }


def trial(kind: str, condition: str, seed: int, grey: float = 3.0, count: int = 8
          ) -> tuple[dict[str, float], Joint, float]:
    """Return errors, the joint with its standard deviations and the seconds of one alignment."""
    rng = np.random.default_rng(seed)
    d = draw(kind, rng, count)
    views = photos(d, grey, rng)
    pair = d.gaussians
    if condition == "geometry":
        pair = bent(pair[0], d.labels, d.diag, rng), bent(pair[1], d.labels, d.diag, rng)
    start = time.perf_counter()
    found, = align(AlignmentProblem(pair, (d.labels, d.labels), views, d.diag), [d.start])
    return errors(found, d.truth), found, time.perf_counter() - start


def ratios(kind: str, condition: str, count: int, first: int = 0) -> dict[str, F64]:
    """Return error / standard deviation of every quantity over `count` draws, and seconds."""
    rows: dict[str, list[float]] = {q: [] for q in (*QUANTITIES, "seconds")}
    for seed in range(first, first + count):
        error, joint, seconds = trial(kind, condition, seed)
        for q in QUANTITIES:
            rows[q].append(error[q] / getattr(joint, f"sigma_{q}"))
        rows["seconds"].append(seconds)
    return {q: np.array(r) for q, r in rows.items()}


def summary(rows: dict[str, F64]) -> dict[str, float]:
    """Return the share inside the 90 % intervals and the root mean square of the ratios."""
    out: dict[str, float] = {}
    for q, width in QUANTITIES.items():
        some = rows[q][~np.isnan(rows[q])]  # a slide has no axis position, a turn no rise
        known = some[some > 0]  # an infinite standard deviation promises nothing
        if len(known):
            out[f"{q}_unobservable"] = len(some) - len(known)
            out[f"{q}_inside"] = round(float((known < width).mean()), 3)
            out[f"{q}_rms"] = round(float(np.sqrt((known**2).mean())), 3)
    return out | {"seconds": round(float(np.median(rows["seconds"])), 3)}


def main() -> None:
    """Write a table, and the JSON if a path is given."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    result: dict[str, dict[str, float]] = {}
    sys.stdout.write("| condition | axis | origin | value | rise |\n|---|---|---|---|---|\n")
    for condition in ("pixels", "geometry"):
        kinds = [ratios(kind, condition, count) for kind in KINDS]
        result |= {f"{condition}_{kind}": summary(rows)
                   for kind, rows in zip(KINDS, kinds, strict=True)}
        # Turns and slides together; screws, with a sixth parameter, on their own.
        both = summary({q: np.concatenate([k[q] for k in kinds[:2]]) for q in kinds[0]})
        result[condition] = both
        for name, row in ((condition, both), (f"{condition}, screws", summary(kinds[2]))):
            shares = " | ".join(f"{100 * row[f'{q}_inside']:.0f} %" if f"{q}_inside" in row else "-"
                                for q in QUANTITIES)
            sys.stdout.write(f"| {name} | {shares} |\n")
        sys.stdout.flush()
    if len(sys.argv) > 2:
        found = {"draws_of_a_kind": count, "interval": 0.9, "conditions": result}
        text = json.dumps(found, indent=1)
        Path(sys.argv[2]).write_text(text + "\n")


if __name__ == "__main__":
    main()
