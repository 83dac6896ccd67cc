"""A view's share of an alignment: only pixels around a part have a say, wherever they are cut."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.joints import view as view_file
from part2gs_robotics.joints.solver import System, at
from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.small_views import small_views
from part2gs_robotics.render.dispatch import Near, render

SIDE, VIEWS, DIAG = 96, 6, 1.2
JOINT = Joint("revolute", np.array([0.0, 0, -1]), np.array([0.0, -0.05, 0.3]), 0.8)


@pytest.fixture(scope="module")
def seen(toy):
    """A small plate before a base, drawn with shares, and photos of it a little off its place."""
    boxes = [toy.Box((0, 0, 0), (0.8, 0.5, 0.6), 1), toy.Box((0, -0.05, 0), (0.3, -0.02, 0.4), 2)]
    g, owner = toy.gaussians_of(boxes, 0.03)
    Ks, viewmats = toy.cameras(VIEWS, SIDE, np.array([0.4, 0.1, 0.3]), 0.9)
    off = np.array([0.01, 0.0, -0.01], np.float32) * (owner == 1)[:, None]
    photos = toy.drawn(replace(g, means=g.means + off), Ks, viewmats, SIDE)
    small = small_views(photos, VIEWS, SIDE)
    return drawn_of(g.splats, owner, small), small, g.splats, owner


def drawn_of(splats, owner, small, near=None):
    """Return every view of the splats, with the share of part 1."""
    hot = np.eye(2, dtype=np.float32)[owner, 1:]
    return [render(splats, small.camera(v), extra=hot, near=near) for v in range(len(small))]


def system_of(seen, blur):
    drawn, small, *_ = seen
    pose = at(JOINT, DIAG)
    n = len(pose.offset)
    system = System(np.zeros((n, n)), np.zeros(n))
    for v, out in enumerate(drawn):
        view_file.add_view([system], [pose.rates(1)], out, small.photo(v), DIAG,
                           view_file.Level(blur, 0.1, 1))
    return system


@pytest.mark.parametrize("blur", [0.5, 2.0])
def test_a_parts_window_tells_what_the_whole_image_does(seen, blur, monkeypatch):
    cut = system_of(seen, blur)
    monkeypatch.setattr(view_file, "BLURRED", SIDE / blur)  # windows as large as the image
    whole = system_of(seen, blur)
    assert cut.count == whole.count > 100
    assert cut.error == pytest.approx(whole.error, rel=1e-6)
    np.testing.assert_allclose(cut.h, whole.h, atol=1e-6 * np.abs(whole.h).max())
    np.testing.assert_allclose(cut.g, whole.g, atol=1e-6 * np.abs(whole.g).max())


def test_a_window_that_is_too_small_tells_something_else(seen, monkeypatch):
    right = system_of(seen, 2.0)
    monkeypatch.setattr(view_file, "BLURRED", 0.0)
    monkeypatch.setattr(view_file, "RIM", 0)
    assert system_of(seen, 2.0).error != pytest.approx(right.error, rel=1e-3)


@pytest.mark.parametrize("blur", [0.5, 1.0, 2.0])
def test_what_lies_beyond_reach_of_a_part_tells_nothing(seen, blur):
    """Equations are the same, to the last bit, where pictures end as far as `reach_of` says."""
    _, small, splats, owner = seen
    level = view_file.Level(blur, 0.1, 1)
    near = drawn_of(splats, owner, small, Near(owner > 0, view_file.reach_of(level)))
    cut, whole = system_of((near, small), blur), system_of(seen, blur)
    assert sum((n.alpha == 0).sum() > (w.alpha == 0).sum() for n, w in zip(near, seen[0],
                                                                           strict=True)) > 0
    assert cut.count == whole.count > 100
    np.testing.assert_array_equal(cut.h, whole.h)
    np.testing.assert_array_equal(cut.g, whole.g)


def test_a_part_that_no_pixel_shows_adds_nothing(seen):
    drawn, small, *_ = seen
    pose = at(JOINT, DIAG)
    n = len(pose.offset)
    system = System(np.zeros((n, n)), np.zeros(n))
    unseen = replace(drawn[0], extra=np.zeros_like(drawn[0].extra))
    view_file.add_view([system], [pose.rates(1)], unseen, small.photo(0), DIAG,
                       view_file.Level(1.0, 0.1, 1))
    assert system.count == 0
    assert not system.h.any()
