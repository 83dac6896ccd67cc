"""The second half: joints settled, parts that do not stay replaced, and switches that matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.articulate import Clock, Found, _settled, settled_motion
from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.decide.candidate import on_base
from part2gs_robotics.decide.leave_out import saved, thinned
from part2gs_robotics.joints.settle import Photos
from part2gs_robotics.model.joint import Joint

pytestmark = pytest.mark.usefixtures("one_numba_thread", "one_torch_thread")

PLAIN = ArticulateConfig(identity=False, contact=False, vector_field=False, alignment=False)


@pytest.mark.parametrize("known", [True, False])
def test_a_part_that_does_not_pay_leaves_and_the_true_one_has_its_place(
        judge, right, look_alikes, known, monkeypatch):
    first, second = (Joint("prismatic", h.axis, h.origin, h.value) for h in look_alikes.truth)
    false = replace(second, value=-second.value)
    settled = []

    def settle(_judge, found, *_photos_and_config):
        settled.append(len(found))
        return found

    monkeypatch.setattr("part2gs_robotics.articulate.settle", settle)
    # What the true one leaves where nothing else competes might hang on the other part.
    monkeypatch.setattr("part2gs_robotics.articulate.hang", lambda _judge, found, *_: found)
    pool = look_alikes.truth if known else []
    start = on_base([first, false], right.labels)
    found = _settled(judge, start, Photos((), ()), ArticulateConfig(), pool)
    ways = [0.3, 0.2] if known else [0.3]
    assert [j.value for j in found.motions] == pytest.approx(ways, abs=5e-3)
    assert settled == [2, len(found)]
    sound = on_base([first, second], right.labels)
    assert _settled(judge, sound, Photos((), ()), ArticulateConfig(), pool).motions == sound.motions
    assert settled == [2, len(found), 2], "nothing left: settled once"


@pytest.mark.parametrize("asked", [None, 3])
def test_a_part_that_its_last_alignment_led_astray_leaves(
        judge, right, look_alikes, asked, monkeypatch):
    """It pays when it is compared and not where it ends: the others are aligned without it."""
    first, second = (Joint("prismatic", h.axis, h.origin, h.value) for h in look_alikes.truth)
    astray, aligned_sets = replace(second, value=-second.value), []

    def keep(_judge, found, *_):
        return found

    def led(_judge, found, _views):
        aligned_sets.append(len(found))
        return found.with_motions([*found.motions[:2], astray]) if len(found) == 3 else found

    for name, stub in {"settle": keep, "nearly": keep, "least": keep, "thinned": thinned,
                       "finely": led, "aligned": led}.items():
        monkeypatch.setattr(f"part2gs_robotics.articulate.{name}", stub)
    monkeypatch.setattr("part2gs_robotics.articulate.hang", lambda _judge, found, *_: found.plus(
        astray, 1))
    start = on_base([first, second], right.labels)
    found = _settled(judge, start, Photos((), ()), ArticulateConfig(parts=asked), [])
    assert len(found) == (asked or 2)
    assert aligned_sets == ([3] if asked else [3, 2])
    if not asked:
        assert found.motions == (first, second)
        assert min(saved(judge, found)) > 0.0


@pytest.mark.parametrize("last", [False, True])
@pytest.mark.parametrize("asked", [None, 2])
def test_parts_that_alignment_leads_astray_where_they_hang_stay_on_the_base(
        judge, right, look_alikes, last, asked, monkeypatch):
    """Hung on each other, two slides explain the same; what photos make of them then may not."""
    first, second = (Joint("prismatic", h.axis, h.origin, h.value) for h in look_alikes.truth)
    astray, looked_at = replace(second, value=-second.value), []

    def keep(_judge, found, *_):
        return found

    def led(_judge, found, _views):
        looked_at.append(found.parents)
        return found.with_motions([first, astray])

    stubs = {"settle": keep, "nearly": keep if last else led, "finely": led, "least": keep}
    stubs["hang"] = lambda _judge, found, *_: found.swapped(1, second, 1)
    for name, stub in stubs.items():
        monkeypatch.setattr(f"part2gs_robotics.articulate.{name}", stub)
    start = on_base([first, second], right.labels)
    found = _settled(judge, start, Photos((), ()), ArticulateConfig(parts=asked), [])
    assert looked_at == [(0, 1)]
    assert found.motions == (first, second)
    assert found.parents == (0, 0)


def settled_of(look_alikes, judge, decided, config):
    """Return the motion of a decision, with no pool to take other parts from."""
    return settled_motion(look_alikes.scene, Found(judge, decided, [], False, Clock(None)), config)


def test_identity_and_alignment_switches_change_the_motion(look_alikes, judge):
    decided = judge.judge(on_base(replace(h, value=h.value + 0.02) for h in look_alikes.truth))
    motions = {
        name: settled_of(look_alikes, judge, decided, config)
        for name, config in {
            "none": PLAIN, "identity": replace(PLAIN, identity=True),
            "printed": replace(PLAIN, identity=True, paper_mode=True, alignment=True),
            "aligned": replace(PLAIN, identity=True, alignment=True),
        }.items()}  # fmt: skip
    way = {name: [j.value for j in m.joints] for name, m in motions.items()}
    probs = {name: m.part_probs[0].argmax(1) for name, m in motions.items()}
    assert (probs["none"] != probs["identity"]).any()
    assert (probs["printed"] != probs["identity"]).any()
    truth = [h.value for h in look_alikes.truth]
    error = {name: np.abs(np.subtract(w, truth)).max() for name, w in way.items()}
    assert error["aligned"] < 0.005 < error["identity"]
    assert way["printed"] == way["identity"], "paper mode never aligns"
    assert all(row["physics_kept"] == 0.0 for m in motions.values() for row in m.diagnostics)


def test_the_pull_is_kept_joint_by_joint_where_images_agree(look_alikes, judge):
    """Half a per cent of the diagonal too long: within the reach of the robust scale."""
    near = judge.judge(on_base(replace(h, value=h.value + 0.006) for h in look_alikes.truth))
    motions = []
    for config in (PLAIN, replace(PLAIN, vector_field=True)):
        config = replace(config, identity=True)
        motions.append(settled_of(look_alikes, judge, near, config))
    still, pulled = motions
    same = [a.value == b.value for a, b in zip(*(m.joints for m in motions), strict=True)]
    assert [row["physics_kept"] for row in pulled.diagnostics] == [float(not s) for s in same]
    assert not all(same)
    truth = [h.value for h in look_alikes.truth]
    error = [np.abs(np.subtract([j.value for j in m.joints], truth)).sum() for m in motions]
    assert error[1] < error[0]
    assert still.diagnostics[0]["physics_kept"] == 0.0
