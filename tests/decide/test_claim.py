"""Reach: ties between labels go to the part that is nearest along the surface."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from part2gs_robotics.decide import claim as claim_file
from part2gs_robotics.decide.candidate import on_base
from part2gs_robotics.decide.claim import (
    FAR_COST,
    LEAD,
    SHELLS,
    STAYS,
    _cores,
    _far,
    _gone,
    _proofs,
    claim,
)
from part2gs_robotics.decide.labelling import NEUTRAL_COST, Unary
from part2gs_robotics.evidence.graph import Graph, build_graph, ways_along, web_of
from part2gs_robotics.evidence.landing import MATCHED
from part2gs_robotics.model.joint import Joint

COUNT = 41  # surfels in a row, a unit apart


def unbound(graph):
    """Return that no neighbours hold together."""
    return np.zeros(graph.weights.shape, np.float32)


def row_of_surfels(gap_after: int | None = None) -> SimpleNamespace:
    """Return a study of a straight row; a gap cuts the surface after one surfel."""
    points = np.stack([np.arange(COUNT, dtype=float), np.zeros(COUNT), np.zeros(COUNT)], 1)
    index = np.arange(COUNT)
    low, high = np.maximum(index - 1, 0), np.minimum(index + 1, COUNT - 1)
    if gap_after is not None:
        high[gap_after], low[gap_after + 1] = gap_after, gap_after + 1
    graph = Graph(np.stack([low, high], 1), np.ones((COUNT, 2)))
    up = np.tile([0.0, 0.0, 1.0], (COUNT, 1))
    states = tuple(SimpleNamespace(points=points[s], normals=up[s])
                   for s in (slice(20), slice(20, None)))
    return SimpleNamespace(surfels=states, graph=graph)


def ways_of(study: SimpleNamespace) -> csr_matrix:
    return ways_along(study.surfels, study.graph)


def ends() -> np.ndarray:
    proven = np.zeros((COUNT, 2), bool)
    proven[0, 0] = proven[-1, 1] = True
    return proven


def test_the_nearer_end_wins_if_the_part_is_clearly_nearer_than_the_base() -> None:
    far = _far(ends(), ways_of(row_of_surfels()), 10 / LEAD, STAYS)
    index = np.arange(COUNT)
    nearer = 2 * index - (COUNT - 1) - 10 * STAYS / LEAD  # the part than the base, in surfels
    np.testing.assert_allclose(far[:, 0], FAR_COST * np.clip(nearer / 10, 0, 1))
    np.testing.assert_allclose(far[:, 1], FAR_COST * np.clip(-nearer / 10, 0, 1))


def test_between_moving_parts_the_middle_is_a_tie() -> None:
    proven = np.insert(ends(), 0, False, axis=1)  # a base that is nowhere
    far = _far(proven, ways_of(row_of_surfels()), 10 / LEAD, STAYS)
    index = np.arange(COUNT)
    lead = np.clip((2 * index - (COUNT - 1)) / 10, 0, 1)  # how much nearer the far end is
    np.testing.assert_allclose(far[:, 1], FAR_COST * lead)
    np.testing.assert_allclose(far[:, 2], FAR_COST * lead[::-1])


def test_what_no_proof_reaches_stays() -> None:
    far = _far(np.zeros((COUNT, 2), bool), ways_of(row_of_surfels()), 100.0, STAYS)
    np.testing.assert_allclose(far, np.tile([0.0, FAR_COST], (COUNT, 1)))


def test_a_gap_cannot_be_crossed() -> None:
    far = _far(ends(), ways_of(row_of_surfels(gap_after=9)), 100.0, STAYS)
    np.testing.assert_allclose(far[:10], np.tile([0.0, FAR_COST], (10, 1)))
    np.testing.assert_allclose(far[11:], np.tile([FAR_COST, 0.0], (COUNT - 11, 1)))


def test_a_way_does_not_lead_through_a_wall() -> None:
    study = row_of_surfels()
    study.surfels[1].normals[:] *= -1.0  # the other half faces away
    far = _far(ends(), ways_of(study), 100.0, STAYS)
    np.testing.assert_allclose(far[:20], np.tile([0.0, FAR_COST], (20, 1)))
    np.testing.assert_allclose(far[20:], np.tile([FAR_COST, 0.0], (COUNT - 20, 1)))


def test_proofs_are_clear_and_stand_amid_proofs() -> None:
    costs = np.full((COUNT, 2), NEUTRAL_COST)
    hard = (np.arange(COUNT) >= 20).astype(np.int64)
    costs[:20], costs[20:] = (0.0, 1.0), (1.0, MATCHED + 0.01)  # the right half is too dear
    costs[30] = 1.0, 0.0  # clear, but alone
    proven = _cores(_proofs(costs, hard), row_of_surfels().graph)
    assert proven[: 20 - SHELLS, 0].all()
    assert proven.sum() == 20 - SHELLS + 1  # the lone one is all its label has


def test_a_narrow_part_keeps_its_proofs() -> None:
    costs = np.tile([0.0, 1.0], (COUNT, 1))
    hard = np.zeros(COUNT, np.int64)
    hard[18:23], costs[18:23] = 1, (1.0, 0.0)
    proven = _cores(_proofs(costs, hard), row_of_surfels().graph)
    assert 0 < proven[:, 1].sum() <= 5
    assert proven[:18, 0].any()


def test_what_is_seen_gone_is_a_proof_where_one_part_is_nearest_by_far() -> None:
    contradicted, hidden = 1.0, NEUTRAL_COST
    costs = np.array([[contradicted, hidden, hidden],  # another part is farther along the surface
                      [contradicted, hidden, hidden],  # both are as near
                      [hidden, hidden, hidden],  # may rest
                      [contradicted, contradicted, hidden]])  # its own place was seen empty as well
    extra = np.array([[0.0, 0.0, FAR_COST], [0.0, 0.0, 0.0], [0.0, 0.0, FAR_COST], [0.0] * 3])
    gone = _gone(costs, extra, np.ones(4, np.int64))
    assert gone.tolist() == [[False, True, False], *[[False] * 3] * 3]


@pytest.mark.parametrize("kind", ["prismatic", "revolute"])
def test_what_hangs_on_a_pulled_out_floor_is_the_drawers_and_no_rooms_wall_is_the_doors(
    monkeypatch, kind
) -> None:
    """From left to right: cabinet, floor still inside, floor pulled out, the drawer's front."""
    costs = np.full((COUNT, 2), NEUTRAL_COST)
    costs[:8], costs[33:] = (0.0, 1.0), (1.0, 0.0)
    costs[20:33] = 1.0, NEUTRAL_COST
    none = np.full(costs.shape, -1)
    study = row_of_surfels()
    study.tau, study.diag, study.ways = 0.0, 60.0, ways_of(study)
    study.web = web_of(study.graph, unbound(study.graph))
    monkeypatch.setattr(claim_file, "unary_costs", lambda *_: Unary(costs, none, costs))
    monkeypatch.setattr(claim_file, "_passing", lambda *_: np.zeros(costs.shape))
    monkeypatch.setattr(claim_file, "joined", lambda hard, *_: hard)
    joint = Joint(kind, np.array([1.0, 0.0, 0.0]), np.zeros(3), 1.0)
    start = on_base([joint], (np.arange(COUNT) >= 33).astype(np.int64))
    hard = claim(study, None, start, STAYS)
    assert not hard[:10].any()
    assert hard[20:].all()
    assert hard[18] == (kind == "prismatic")


def test_a_hidden_side_goes_with_the_part_it_hangs_on(slid) -> None:
    """A block slides; where both motions hide a surfel, its neighbours on the block decide."""
    from part2gs_robotics.evidence.landing import unclaimed

    pair = tuple(s.surfels for s in slid.states)
    lands = tuple(s.land for s in slid.states)
    graph = build_graph(pair)
    study = SimpleNamespace(surfels=pair, lands=lands, graph=graph, tau=0.03, diag=1.0,
                            ways=ways_along(pair, graph), web=web_of(graph, unbound(graph)))
    joint = Joint("prismatic", slid.axis, np.array([0.2, 0.3, 0.4]), slid.value)
    start = on_base([joint], np.zeros(len(pair[0]) + len(pair[1]), np.int64))
    hard = claim(study, tuple(map(unclaimed, lands)), start)
    own = np.concatenate([s.points[:, 2] > slid.block.lo[2] + 0.04 for s in pair])
    below = np.concatenate([s.points[:, 2] < slid.block.lo[2] - 0.04 for s in pair])
    assert hard[own].mean() > 0.99
    assert hard[below].mean() < 0.01
