"""The ablation: statistics against closed forms, fair variants, and a page made from numbers."""

from __future__ import annotations

import importlib
import json
import math
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import cv2
import numpy as np
import pytest

from part2gs_robotics.config import ArticulateConfig
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.motion import Motion
from part2gs_robotics.model.se3 import apply, quat_from_rotation
from part2gs_robotics.paper.joint_terms import terms_on

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))  # scripts import each other by name
statistics, variants, report, score, figure = (
    importlib.import_module(f"ablation_{name}")
    for name in ("statistics", "variants", "report", "score", "figure"))


def test_the_paired_test_has_its_closed_form() -> None:
    """Differences 1, 2, 3: mean 2, s = 1, t = 2 sqrt(3), two-sided p with 2 degrees of freedom."""
    found = statistics.paired([10.0, 20, 30], [11.0, 22, 33], larger_is_better=False)
    t = 2 * math.sqrt(3)
    p = 1 - t / math.sqrt(2 + t**2)  # Student's distribution with nu = 2 is algebraic
    assert (found.n, found.mean, found.better, found.worse) == (3, 2.0, 0, 3)
    assert found.effect == pytest.approx(2.0)
    assert found.p == pytest.approx(p, rel=1e-9)
    half = 4.302652729911275 / math.sqrt(3)  # 0.975 quantile: 0.95 sqrt(2 / (1 - 0.95^2))
    assert 0.95 * math.sqrt(2 / (1 - 0.95**2)) == pytest.approx(4.302652729911275)
    assert (found.low, found.high) == pytest.approx((2 - half, 2 + half))


def test_pairing_removes_what_objects_differ_in() -> None:
    rng = np.random.default_rng(0)
    objects = rng.normal(size=9) * 100
    before, after = objects, objects + 0.5 + 0.01 * rng.normal(size=9)
    assert statistics.paired(before, after, True).p < 1e-9
    swapped = statistics.paired(after, before, True)
    assert swapped.mean == pytest.approx(-statistics.paired(before, after, True).mean)
    assert swapped.worse == 9


def test_equal_values_and_single_pairs_give_no_false_certainty() -> None:
    same = statistics.paired([1.0, 2, 3], [1.0, 2, 3], True)
    assert (same.mean, same.p, same.better, same.worse) == (0.0, 1.0, 0, 0)
    assert math.isnan(same.effect)
    single = statistics.paired([1.0], [0.5], False)
    assert math.isnan(single.p)
    assert single.mean == -0.5
    assert statistics.verdict(single, single.p, False) == "not tested"
    constant = statistics.paired([1.0, 2], [2.0, 3], True)
    assert (constant.p, constant.low) == (0.0, 1.0)


def test_holm_is_stricter_than_none_and_milder_than_bonferroni() -> None:
    raw = {"a": 0.01, "b": 0.04, "c": 0.03, "d": math.nan}
    got = statistics.holm(raw)
    assert [got[k] for k in "abc"] == pytest.approx([0.03, 0.06, 0.06])  # steps 3, 2, 1, monotone
    assert math.isnan(got["d"])
    assert statistics.holm({"a": 0.9, "b": 0.8}) == {"a": 1.0, "b": 1.0}


@pytest.mark.parametrize(("shift", "larger", "word"), [
    (1.0, True, "helps"), (1.0, False, "hurts"), (-1.0, False, "helps"), (-1.0, True, "hurts")])
def test_verdicts_know_which_side_is_better(shift: float, larger: bool, word: str) -> None:
    rng = np.random.default_rng(1)
    before = rng.normal(size=9)
    test = statistics.paired(before, before + shift + 0.01 * rng.normal(size=9), larger)
    assert statistics.verdict(test, test.p, larger) == word
    assert statistics.verdict(test, 0.2, larger) == "no difference shown"


def test_one_word_for_several_metrics() -> None:
    none = "no difference shown"
    assert statistics.together([none, "helps"]) == "helps"
    assert statistics.together([none, none]) == none
    assert statistics.together(["helps", "hurts"]) == "helps and hurts"
    assert statistics.together(["not tested"] * 4) == "not tested"


def test_neighbours_in_a_chain_differ_in_one_switch() -> None:
    configs = variants.variants(3)
    assert configs["vanilla"] == ArticulateConfig(
        seed=3, identity=False, contact=False, vector_field=False, alignment=False)
    assert configs["ours"] == ArticulateConfig(seed=3)
    assert len(terms_on(configs["contact"])) == 5
    for c in variants.comparisons():
        one, two = vars(configs[c.before]), vars(configs[c.after])
        changed = {name for name in one if one[name] != two[name]} - {"paper_mode"}
        if c.after == variants.AVERAGED:
            assert one == two
        elif c.form == "printed for corrected":
            assert not changed
            assert two["paper_mode"] > one["paper_mode"]
        else:
            group = {"physics": {"vector_field", "velocity", "contact"},
                     "pull before alignment": {"vector_field", "contact"}}
            assert changed == group.get(c.key, {c.key})
            assert two["paper_mode"] == (c.form == "printed")


def flat(points: np.ndarray, opacity: float = 5.0) -> Gaussians:
    """Return discs of radius 0.05 that face z."""
    n = len(points)
    return Gaussians(np.float32(points), np.tile(np.float32([1, 0, 0, 0]), (n, 1)),
                     np.tile(np.log(np.float32([0.05, 0.05, 0.001])), (n, 1)),
                     np.full(n, opacity, np.float32), np.zeros((n, 3), np.float32),
                     np.zeros((n, 0, 3), np.float32))


def moved_pair() -> tuple[tuple[Gaussians, Gaussians], Motion, Joint]:
    """A base square and one that turns about y through the origin by a quarter."""
    x, y = (m.ravel() for m in np.meshgrid(np.arange(0.05, 1, 0.1), np.arange(0.05, 1, 0.1)))
    part = np.stack([x, y, 0 * x], 1)
    base = part - [2.0, 0, 0]
    joint = Joint("revolute", np.array([0.0, 1, 0]), np.zeros(3), np.pi / 2)
    there = joint.transform(joint.value)
    zero = flat(np.concatenate([base, part]))
    one = flat(np.concatenate([base, apply(there, part)]))
    one.quats[100:] = quat_from_rotation(there[:3, :3])
    probs = np.repeat(np.eye(2, dtype=np.float32), 100, 0)
    return (zero, one), Motion((probs, probs), (joint,), (0,)), joint


def test_a_right_motion_lays_both_states_onto_one_surface_and_a_wrong_one_doubles_it() -> None:
    gaussians, motion, joint = moved_pair()
    twin = score.GaussianTwin(gaussians, motion)
    for state, normal in ((0, 2), (1, 0)):
        corners, faces = twin.mesh(1, state)
        assert np.abs(corners[:, normal]).max() < 1e-6
        sides = corners[faces[:, 1:]] - corners[faces[:, :1]]
        area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()
        assert area == pytest.approx(2.0, rel=1e-5)  # a unit square seen twice
    wrong = Motion(motion.part_probs, (Joint("revolute", joint.axis, joint.origin, 1.2),), (0,))
    assert np.abs(score.GaussianTwin(gaussians, wrong).mesh(1, 0)[0][:, 2]).max() > 0.2
    assert twin.parts[0]["motion"] == np.pi / 2
    alone = score.GaussianTwin(gaussians, motion, (1,))
    assert len(alone.mesh(1, 0)[0]) == 400, "one state's Gaussians"
    faint = (flat(gaussians[0].means, -1.0), gaussians[1])
    assert len(score.GaussianTwin(faint, motion).mesh(1, 0)[0]) == 400, "haze is no surface"


def test_motion_error_is_the_mean_distance_from_the_true_place() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(50, 3))
    slide = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), 0.5)
    there = {0: points, 1: points + np.array([0.5, 0, 0])}
    truth = SimpleNamespace(mesh=lambda _, s: (there[s], None), diag=4.0)
    kit = SimpleNamespace(sample_surface=lambda v, f, n, seed: v)
    assert score.motion_error(kit, truth, 1, slide.transform(0.5)) == pytest.approx(0.0, abs=1e-12)
    longer = score.motion_error(kit, truth, 1, slide.transform(0.54))
    assert longer == pytest.approx(1.0)  # 0.04 of 4


def test_averaged_centres_lie_between_the_states() -> None:
    gaussians, _, _ = moved_pair()
    both, (lead,) = score.averaged(gaussians)
    assert both[1 - lead] is gaussians[1 - lead]
    radius = np.linalg.norm(both[lead].means[100:, [0, 2]], axis=1)
    before = np.linalg.norm(gaussians[lead].means[100:, [0, 2]], axis=1)
    assert (radius <= before + 1e-6).all()
    assert radius.mean() < 0.9 * before.mean(), "a turned door shrinks"


def fabricated(effect: float = 0.1) -> list[dict]:
    """Runs of two objects and three seeds; identities lower every error, nothing else matters."""
    rng, runs = np.random.default_rng(0), []
    for name, scale in (("box", 1.0), ("chest", 5.0)):
        for seed in range(3):
            noise = 0.002 * rng.normal()
            for variant in variants.variants(seed):
                better = effect * (variant != "vanilla") + 0.001 * rng.normal() + noise
                part = {"part": "door", "found": True, "axis_deg": scale - better,
                        "motion_pct": scale - better, "cd_m": scale - better}
                lost = {"part": "lid", "found": variant == "vanilla", "axis_deg": 90.0,
                        "motion_pct": 90.0, "cd_m": 90.0}
                runs.append({"object": name, "seed": seed, "variant": variant, "seconds": 1.0,
                             "parts": [part, lost], "parts_found": 1 + lost["found"],
                             "joints_pulled": 0.0, "miou": 0.5 + better})
    return runs


OPTIONS = {"views": 64, "size": 400, "seeds": [0, 1, 2], "objects": ["box", "chest"], "failed": []}


@pytest.fixture
def page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    for name, place in (("PAGE", "page.md"), ("FIGURE", "page.png"), ("QUOTED", "terms.json")):
        monkeypatch.setattr(report, name, tmp_path / place)
    (tmp_path / "page.md").write_text(f"above\n{report.BEGIN}\nold\n{report.END}\nbelow\n")
    return report


def test_a_planted_effect_is_found_and_absent_ones_are_not(page: ModuleType) -> None:
    result = json.loads(json.dumps(page.summary(fabricated(), OPTIONS)))
    words = {(t["term"], t["form"]): t["verdict"] for t in result["tests"] if t["metric"] == "miou"}
    assert words["identity", "corrected"] == words["identity", "printed"] == "helps"
    assert set(words.values()) == {"helps", "no difference shown"}
    row = next(t for t in result["tests"] if (t["term"], t["metric"]) == ("identity", "axis_deg"))
    assert row["mean"] == pytest.approx(-0.1, abs=0.005), "the lost lid's 90 deg count nowhere"
    assert row["n"] == 6
    quoted = page.quoted(result)
    assert quoted["identity"].startswith("helps: axis, deg -0.10")
    assert quoted["repel"].startswith("no difference shown")
    assert set(quoted) == set(variants.SWITCHES)


def test_the_page_the_figure_and_the_plans_sentences_are_written(page: ModuleType) -> None:
    text = page.publish(json.loads(json.dumps(page.summary(fabricated(), OPTIONS))))
    written = page.PAGE.read_text()
    assert written.startswith("above\n")
    assert written.endswith("below\n")
    assert "old" not in written
    assert text in written
    assert "| vanilla | 12 of 12 |" in written
    assert "| + parts | 6 of 12 |" in written
    assert "- **Part identities**, corrected: helps. axis, deg -0.1" in written
    assert "- **Repel points**, printed: no difference shown." in written
    image = cv2.imread(str(page.FIGURE))
    assert image is not None
    assert image.std() > 5
    assert set(json.loads(page.QUOTED.read_text())) == set(variants.SWITCHES)


def test_numbers_carry_signs_and_nothing_has_none() -> None:
    assert [report.signed(x) for x in (0.1234, -2.0, -0.0001, 0.0)] == [
        "+0.123", "-2.000", "0", "0"]


def test_one_run_is_shown_but_not_tested(page: ModuleType) -> None:
    runs = [run for run in fabricated() if (run["object"], run["seed"]) == ("box", 0)]
    result = json.loads(json.dumps(page.summary(runs, OPTIONS | {"failed": ["chest: no hull"]})))
    assert {t["verdict"] for t in result["tests"]} == {"not tested"}
    text = page.markdown(result)
    assert "Tests per family: 0 corrected, 0 printed, 0 printed for corrected" in text
    assert "Failed: chest: no hull" in text
    assert "nan" not in text.lower()
    assert page.quoted(result) == {}, "a build's plan quotes tests, not single runs"


def test_the_repositorys_page_has_both_markers_and_the_plan_quotes_the_results() -> None:
    text = (ROOT / "docs/ablation.md").read_text()
    assert text.count(report.BEGIN) == text.count(report.END) == 1
    result = json.loads((ROOT / "benchmarks/results/ablation.json").read_text())
    quoted = json.loads((ROOT / "part2gs_robotics/measured_terms.json").read_text())
    assert quoted == report.quoted(result)
    assert report.markdown(result) in text
