"""Rules of the decision, and how each is switched off: what rules.py asks about."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import patch

import numpy as np

from part2gs_robotics import articulate
from part2gs_robotics.decide import claim, grow, hang, judge, labelling, loose, screws
from part2gs_robotics.evidence import study as studies
from part2gs_robotics.evidence.study import Study
from part2gs_robotics.joints import align, labels, settle
from part2gs_robotics.search import pool

Change = tuple[object, str, Any]


@dataclass(frozen=True)
class Rule:
    """A rule, and what stands in its place when it is off.

    Attributes:
        name: of its rows.  told: how the table names it.
        changes: (module or class, name, what stands there instead).
        study: what becomes of the study.  searches: whether the first search must run anew.
    """

    name: str
    told: str
    changes: tuple[Change, ...] = ()
    study: Callable[[Study], Study] = lambda study: study
    searches: bool = False


@contextmanager
def off(rule: Rule) -> Iterator[None]:
    """Switch a rule off meanwhile."""
    with ExitStack() as stack:
        for place, name, instead in rule.changes:
            stack.enter_context(patch.object(place, name, instead))
        yield


def same(_: object, found: Any, *__: object) -> Any:
    """Stand for a step that would change a set: it stays as it is."""
    return found


def none(*_: object) -> list[Any]:
    """Stand for a step that proposes: it proposes nothing."""
    return []


def nought(*_: object) -> float:
    """Stand for a term of the cost."""
    return 0.0


def still(_: object, motions: Any, __: object) -> Any:
    """Stand for a term of the cost that every motion has."""
    return np.zeros(len(motions))


def without_seams(study: Study) -> Study:
    """Return the study in which no neighbours hold together firmly."""
    return replace(study, bonds=np.zeros_like(study.bonds))


def evenly(study: Study) -> Study:
    """Return the study in which light falls alike on all faces of what turns."""
    even = np.zeros_like(study.light.shades)
    zero, one = (replace(land, shades=even) for land in study.lands)
    return replace(study, lands=(zero, one), light=replace(study.light, shades=even))


def unfloored(study: Study) -> Study:
    """Return the study in which halos of the fits count."""
    zero, one = study.views
    return replace(study, views=(replace(zero, floor=None), replace(one, floor=None)))


def full(share: Any) -> Any:
    """Stand for the price of small parts: that of large ones."""
    return np.ones_like(np.asarray(share, np.float64))


# Terms of the cost, moves of the search over sets, and where motions come from.
DECIDED = (
    Rule("images", "photos in the cost", ((judge, "both_cost", nought),)),
    Rule("floor", "what no motion mends, taken off the photos' cost", study=unfloored),
    Rule("light", "light that turned faces meet", study=evenly),
    Rule("seams", "bonds that labels cut", study=without_seams),
    Rule("hides", "a limit to what parts hide", ((loose, "HIDES", 1e9),)),
    Rule("hung", "a price for bodies in the air", ((judge, "hung", nought),)),
    Rule("price", "small parts at half a price", ((judge, "price", full),)),
    Rule("askew", "slides askew to walls are strange", ((judge, "askew", nought),)),
    Rule("crooked", "axes off all edges are strange", ((judge, "crooked", nought),)),
    Rule("air", "hinges away from parts are strange", ((judge.Judge, "air", still),)),
    Rule("moves", "what may as well rest rests",
         ((labelling, "MOVES", 0.0), (labelling, "UNSEEN_MOVES", 0.0))),
    Rule("renewed", "labels from a second start", ((judge.Judge, "renewed", same),)),
    Rule("polished", "joints refined on their own surfels", ((judge.Judge, "polished", same),)),
    Rule("thinned", "parts that do not pay leave",
         ((grow, "thinned", same),)),
    Rule("swapped", "another in the place of one",
         ((grow, "_swapped", lambda judge, best, pool: best),)),
    Rule("halved", "two parallel ones in the place of one", ((grow, "halved", none),)),
    Rule("beside", "a slide nearly as another", ((grow, "beside", none),)),
    Rule("calmed", "less of what looks alike after half a turn", ((grow, "calmed", same),)),
    Rule("risen", "screws", ((grow, "risen", same),)),
    Rule("more", "a second search in what is left", ((pool, "find_more", none),)),
    Rule("bodies", "bodies that are left, whole", ((pool, "propose_bodies", none),)),
    Rule("snapped", "motions turned to faces and edges", ((pool, "snapped", none),), searches=True),
    Rule("families", "slides of all lengths along one direction",
         ((pool, "slide_families", none),), searches=True),
    Rule("neared", "motions refined from afar",
         ((grow, "neared", lambda judge, best, pool: list(pool)),), searches=True),
    Rule("coarse", "refinement from coarse to fine",
         ((studies, "COARSE_TO_FINE", (1.0, 1.0, 1.0)),), searches=True),
)  # fmt: skip

# From decided motions to joints and labels.
SETTLED = (
    Rule("alternate", "alignment and labels in turn", ((settle, "_settled", settle._alone),)),
    Rule("kept", "joints taken back that cost a price more",
         ((settle, "_kept", lambda judge, before, after, sharp: after),)),
    Rule("retuned", "slides tuned once aligned", ((settle, "tune", same),)),
    Rule("again", "labels and joints once more where images hold none",
         ((settle, "_held", lambda joint: True),)),
    Rule("clues", "faces and edges that draw joints",
         ((align, "_drawn", lambda problem, known, clues: [j for j, _ in known]),)),
    Rule("far", "the nearest proven part has what nobody sees",
         ((claim, "_far", lambda proofs, *_: np.zeros(proofs.shape)),)),
    Rule("gone", "what is seen not to rest draws what is hidden",
         ((claim, "_gone", lambda costs, *_: np.zeros(costs.shape, bool)),)),
    Rule("stays", "the base a little nearer than parts", ((labels, "STAYS", 0.0),)),
    Rule("passage", "no way through another part's front",
         ((claim, "_passing", lambda study, costs, *_: np.zeros_like(costs)),)),
    Rule("joined", "faces amid another part join it",
         ((claim, "joined", lambda hard, *_: hard),)),
    Rule("proven", "screws whose rise is proven", ((screws, "_proven", lambda *_: True),)),
    Rule("hung_on", "parts that others carry",
         ((articulate, "hang", lambda judge, found, *_: found),)),
    Rule("rehung", "parts hung on another part", ((hang, "_rehung", same),)),
    Rule("sides", "no half turn of a carrier within itself",
         ((hang, "_swaps_sides", lambda *_: False),)),
    Rule("paying", "parts that do not pay, settled, leave",
         ((articulate, "thinned", same), (articulate, "least", same), (hang, "thinned", same))),
    Rule("bodiless", "parts without surface leave",
         ((articulate, "_with_bodies", lambda judge, found, config: replace(
             found, labels=labels.final_labels(judge, found, config))),)),
)  # fmt: skip
