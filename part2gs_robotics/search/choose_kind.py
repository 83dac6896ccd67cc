"""Joint parameters, and the choice between slide, turn and screw by model selection."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from part2gs_robotics.evidence.landing import Landing
from part2gs_robotics.evidence.study import distances
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3
from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.joint import PARAMETERS, Joint, JointKind
from part2gs_robotics.search.refine import matches, misfit, refine

CORRELATED = 20.0  # neighbouring surfels share their depth error: this many count as one
OUTLIER = 9.0  # squared residual in sigmas beyond which a surfel is no evidence (3 sigma)
FAR_HINGE = 0.3  # of the diagonal: a hinge line this far from its part is attached to nothing
FAR_PRICE = 20.0  # twice a "very strong" BIC difference
# Of a slide's misfit that a far hinge must explain: bent depth saves 4 %, true ones 45 % and more.
FAR_SHARE = 0.2
SMALL_TURN = np.deg2rad(8.0)  # rad; bent depth makes a slide look like a turn of a few degrees
KINDS: tuple[JointKind, ...] = ("prismatic", "revolute", "screw")  # tried in this order
DECIDED = 10.0  # a "very strong" BIC difference
LEAST_RISE = 0.008  # of the diagonal: half the matching distance, above what depth bends on average


def choose_joint(
    h: Joint,
    own: tuple[Surfels, Surfels],
    lands: tuple[Landing, Landing],
    tau: float,
    diag: float,
    confidence: float,
) -> Joint:
    """Return the joint whose kind explains the part's surfels best for its number of parameters.

    BIC with the noise measured in the scene; a hinge far from its part pays extra.
    """
    # A slide that the images preferred is no screw, and carried ones are not looked for.
    tried = KINDS if h.turns and h.carrier is None else KINDS[:2]
    fits = {kind: _as_kind(h, kind, own, lands, tau) for kind in tried}
    # The images' length of a slide may be off by a label or two: kinds are compared at their best.
    best = fits | {"prismatic": _nearer(fits["prismatic"], own, lands, tau)}
    sigma = min(_noise(f, own, lands, tau) for f in best.values())
    bic: dict[str, float] = {name: _bic(f, own, lands, tau, sigma, PARAMETERS[name])
                             for name, f in best.items()}
    still = Joint("prismatic", h.axis, h.origin, 0.0, carrier=h.carrier)
    bic["fixed"] = _bic(still, own, lands, tau, sigma, 0)  # told, not chosen: it moved
    # The images preferred this kind already; a screw had one number more to please them.
    bic["revolute" if h.turns else "prismatic"] -= DECIDED
    points = np.concatenate([own[0].points, se3.apply(se3.inverse(h.move), own[1].points)])
    turn = fits["revolute"]
    arm = np.linalg.norm(np.cross(points - turn.origin, turn.axis), axis=1).min()
    price = hinge_price(float(arm), turn.value, bic["prismatic"], diag)
    bic |= {name: bic[name] + price for name in tried[1:]}
    likely = [k for k in tried if k != "screw" or abs(fits[k].rise) > LEAST_RISE * diag]
    kind = min(likely, key=lambda name: bic[name])
    return _joint(kind, fits[kind], points.mean(0), bic, confidence)


def hinge_price(arm: float, angle: float, slide: float, diag: float) -> float:
    """Return what a turn pays beside its parameters, in units of BIC.

    Args:
        arm: distance from the line to the nearest surfel of the part, scene units.
        angle: radians.
        slide: BIC of the best slide.
        diag: diagonal of the object.
    """
    far = max(FAR_PRICE, FAR_SHARE * slide) if arm > FAR_HINGE * diag else 0.0
    return far + (FAR_PRICE if abs(angle) < SMALL_TURN else 0.0)


def _joint(kind: JointKind, h: Joint, centre: F64, bic: dict[str, float],
           confidence: float) -> Joint:
    axis, value = (h.axis, h.value) if h.value >= 0 else (-h.axis, -h.value)
    origin = h.origin + axis * (axis @ (centre - h.origin)) if h.turns else centre
    return Joint(kind, axis, origin, value, h.pitch, bic=bic, confidence=confidence)


def _as_kind(
    h: Joint,
    kind: JointKind,
    own: tuple[Surfels, Surfels],
    lands: tuple[Landing, Landing],
    tau: float,
) -> Joint:
    taus = distances(tau)
    if h.kind == kind:  # refined already, and judged by the images
        return h
    if h.turns and kind != "prismatic":  # turn and screw, one from the other
        return refine(replace(h, kind=kind, pitch=0.0), own, lands, taus)
    centre = np.concatenate([own[0].points, se3.apply(se3.inverse(h.move), own[1].points)]).mean(0)
    if kind == "prismatic":
        way = se3.apply(h.own, centre) - centre
        length = float(np.linalg.norm(way))
        # A knob that turns about its own centre goes nowhere: any direction will do.
        axis = way / length if length > 0 else h.axis
        start = Joint("prismatic", axis, centre, length, carrier=h.carrier)
        return refine(start, own, lands, taus)
    # A slide is a small turn about a far line: start from one that moves the centre alike.
    tries = []
    for side in np.linalg.svd(h.axis[None])[2][1:]:
        for sign in (1.0, -1.0):
            angle = 0.05  # rad; small enough to stay in the capture range of the fit
            origin = centre + sign * np.cross(h.axis, side) * h.value / angle
            # across arm and slide
            start = Joint("revolute", sign * side, origin, -angle, carrier=h.carrier)
            start = min(_flip(start), start, key=lambda t: misfit(t, own, lands, tau))
            tries.append(refine(start, own, lands, taus))
    return min(tries, key=lambda t: misfit(t, own, lands, tau))


def _nearer(h: Joint, own: tuple[Surfels, Surfels], lands: tuple[Landing, Landing],
            tau: float) -> Joint:
    """Return the motion refined on its surfels, or as it is where that lands them no better."""
    tries = h, refine(h, own, lands, distances(tau))
    return min(tries, key=lambda t: misfit(t, own, lands, tau))


def _flip(h: Joint) -> Joint:
    return replace(h, value=-h.value)


def _residuals(
    h: Joint, own: tuple[Surfels, Surfels], lands: tuple[Landing, Landing], tau: float
) -> F64:
    zero, _, one, normals = matches(h.move, own, lands, tau)
    return np.asarray(((se3.apply(h.move, zero) - one) * normals).sum(1))


def _noise(
    h: Joint, own: tuple[Surfels, Surfels], lands: tuple[Landing, Landing], tau: float
) -> float:
    r = _residuals(h, own, lands, tau)
    return (
        float(1.4826 * np.median(np.abs(r)) + 1e-4 * tau) if len(r) else tau
    )  # 1.4826: MAD to sigma


def _bic(
    h: Joint,
    own: tuple[Surfels, Surfels],
    lands: tuple[Landing, Landing],
    tau: float,
    sigma: float,
    count: int,
) -> float:
    r = _residuals(h, own, lands, tau)
    total = len(own[0]) + len(own[1])
    misfit = np.minimum((r / sigma) ** 2, OUTLIER).sum() + OUTLIER * (total - len(r))
    return float(misfit / CORRELATED + count * np.log(max(total / CORRELATED, 2.0)))
