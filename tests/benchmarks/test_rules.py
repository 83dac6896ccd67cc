"""Rules switched off: every one is off meanwhile and on again, and the table counts what it does.

Steps that stand in are asked as the product asks them: a wrong number of arguments would tell of a
rule what is an error's.
"""

from __future__ import annotations

import inspect
from dataclasses import make_dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from part2gs_robotics.decide import grow, loose
from part2gs_robotics.decide.candidate import on_base
from part2gs_robotics.decide.labelling import Unary


@pytest.fixture
def off(load):
    return load("rules_off")


def rules_of(off):
    return [*off.DECIDED, *off.SETTLED]


def test_every_rule_has_a_name_and_something_that_goes(off):
    rules = rules_of(off)
    assert len({r.name for r in rules}) == len({r.told for r in rules}) == len(rules)
    assert all(r.changes or r.study is not off.Rule("", "").study for r in rules)


def test_a_rule_is_off_meanwhile_and_on_again(off):
    for rule in rules_of(off):
        before = [getattr(place, name) for place, name, _ in rule.changes]
        with off.off(rule):
            for place, name, instead in rule.changes:
                assert getattr(place, name) is instead, rule.name
        for (place, name, _), was in zip(rule.changes, before, strict=True):
            assert getattr(place, name) is was, rule.name


def test_what_stands_in_takes_what_the_product_gives(off):
    for rule in rules_of(off):
        for place, name, instead in rule.changes:
            was = getattr(place, name)
            assert callable(was) == callable(instead), (rule.name, name)
            if callable(was):
                asked = inspect.signature(was).parameters.values()
                asked = [p for p in asked if p.default is p.empty]  # those that must be given
                inspect.signature(instead).bind(*asked)


def test_a_limit_that_is_off_limits_nothing(off):
    """One surfel lands, which saves 1, and eleven hide, which save 1 each: one too many."""
    n = 12
    match = np.zeros((n, 2))
    target = np.full((n, 2), -1)
    target[0, 1] = 0
    miss = np.stack([np.ones(n), np.zeros(n)], 1)
    unary, hard = Unary(match, target, miss), np.ones(n, np.int64)
    rule = next(r for r in off.DECIDED if r.name == "hides")
    assert loose.vanished(unary, hard)[0] == pytest.approx(1.0)
    with off.off(rule):
        assert loose.vanished(unary, hard)[0] == 0.0


@pytest.mark.parametrize("name", ["halved", "beside"])
def test_the_search_without_moves_that_split_proposes_none(off, monkeypatch, name):
    """The names that `grow` calls its steps by are those that are switched off."""
    asked = []
    monkeypatch.setattr(grow, "_one_more", lambda judge, best, pool: best)
    monkeypatch.setattr(grow, "thinned", lambda judge, best: best)
    monkeypatch.setattr(grow, "calmed", lambda judge, new, pool: new)
    monkeypatch.setattr(grow, "_swapped", lambda judge, best, pool: best)
    best = SimpleNamespace(cost=1.0)
    cheaper = SimpleNamespace(cost=0.5)
    judge = SimpleNamespace(polished=lambda c: c, best_of=lambda sets, few: asked.append(sets)
                            or cheaper)
    for way in ("halved", "beside"):
        monkeypatch.setattr(grow, way, lambda *_, own=way == name: [best] if own else [])
    assert grow._cheaper(judge, best, [])[1] is cheaper
    with off.off(next(r for r in off.DECIDED if r.name == name)):
        assert grow._cheaper(judge, best, [])[1] is best
    assert len(asked) == 1


def test_a_study_without_a_term_is_without_it_alone(off):
    made = {name: make_dataclass(name, fields) for name, fields in {
        "Study": ("bonds", "lands", "light", "views"), "Views": ("floor",), "Land": ("shades",),
        "Light": ("shades",)}.items()}
    views, land, light = made["Views"](np.ones(2)), made["Land"](np.ones(8)), made["Light"](
        np.ones(8))
    study = made["Study"](np.ones(3), (land, land), light, (views, views))
    seams, floor, even = off.without_seams(study), off.unfloored(study), off.evenly(study)
    assert not seams.bonds.any()
    assert seams.lands is study.lands
    assert [v.floor for v in floor.views] == [None, None]
    assert floor.bonds is study.bonds
    assert not any(one.shades.any() for one in (even.light, *even.lands))
    assert even.views is study.views
    assert all(array.all() for array in (study.bonds, views.floor, light.shades, land.shades))


def row(rule, name, **more):
    return {"rule": rule, "object": name, "parts": 2, "found": 2, "right": 2, "miou": 0.9,
            "axis": 0.1, "cost": -10.0, "seconds": 10.0, "commit": "x", **more}


def test_the_table_counts_what_a_rule_is_worth(load):
    rules = load("rules")
    rows = [row("", "a"), row("", "b"), row("renewed", "a", seconds=5.0),
            row("renewed", "b", right=1, found=3, miou=0.5, axis=7.0, cost=-4.0, seconds=5.0)]
    made = rules.markdown(rows)
    line = next(text for text in made.splitlines() if "labels from a second start" in text)
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells[1:] == ["2 → 1 of 2", "4, 0 → 3, 2 of 4", "0.900 → 0.700", "0.10 → 7.00", "+3.00",
                         "x 0.50", "`b`"]
    assert "2 objects: a, b." in made
    assert "screws" not in made  # not asked


def test_seconds_of_a_search_that_ran_anew_are_not_compared(load):
    made = load("rules").markdown([row("", "a"), row("snapped", "a", seconds=50.0)])
    assert "| +0.00 | - | none |" in made


def test_what_is_the_same_without_a_rule_is_told_once(load):
    made = load("rules").markdown([row("", "a"), row("renewed", "a", seconds=5.0)])
    assert ("| labels from a second start | 1 of 1 | 2, 0 of 2 | 0.900 | 0.10 | +0.00 | x 0.50 "
            "| none |") in made


def test_a_set_is_told_by_its_motions_and_labels(load):
    """Two of three motions are true ones; each surfel of the third is nobody's."""
    rules = load("rules")
    from part2gs_robotics.model.joint import Joint

    def slide(way):
        return Joint("prismatic", np.eye(3)[way], np.zeros(3), 0.2)

    points = np.random.default_rng(0).uniform(size=(60, 3))
    true = np.repeat([0, 1, 2], 20)
    case = SimpleNamespace(name="toy", candidate=on_base([slide(0), slide(1)]),
                           labels=lambda surfels: true, own=lambda k: points[true == k + 1])
    judge = SimpleNamespace(study=SimpleNamespace(surfels=(points[:30], points[30:]), diag=1.0),
                            judge=lambda c: SimpleNamespace(cost=0.0023 * (5 - len(c))))
    hard = np.repeat([0, 2, 1, 3], [20, 20, 10, 10])
    found = rules.row(case, rules.Rule("x", ""), judge,
                      on_base([slide(1), slide(0), slide(2)], hard), 1.0)
    assert (found["found"], found["right"], found["axis"]) == (3, 2, 0.0)
    # IoU of both states: of the base 1 and none there, of the parts 1 and 1, none there and 1/2
    assert found["miou"] == pytest.approx((0.5 + 1.0 + 0.25) / 3, abs=1e-3)
    assert found["cost"] == pytest.approx(-3.0)
