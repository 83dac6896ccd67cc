"""Light is found from one object's faces, and taken out of what turned parts look like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from part2gs_robotics.evidence.cross_render import both_cost, move_gaussians
from part2gs_robotics.evidence.light import Light, light_of, unshaded
from part2gs_robotics.evidence.surfels import Surfels
from part2gs_robotics.model import se3
from part2gs_robotics.model.gaussians import SH_C0
from part2gs_robotics.model.small_views import small_views

SUN = np.array([0.3, -0.5, 0.81])
PAINT = np.array([0.5, 0.4, 0.3])
TURN = se3.screw_motion(np.array([1.0, 0, 0]), np.zeros(3), 1.3, 0.0)


def lit(normals, sun=SUN):
    """Matt faces under a sun and the sky."""
    return 0.5 + 0.6 * np.maximum(normals @ sun, 0.0)


def ball(rng, paint=PAINT, sun=SUN, count=4000):
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    colors = np.asarray(paint) * lit(normals, sun)[:, None]
    return Surfels(normals.copy(), normals, colors, np.full(count, 5))


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def spread(colors):
    return float(np.std(np.log(colors.mean(1))))


def test_paint_is_one_again_without_the_light(rng):
    one, two = ball(rng), ball(rng)
    shades = light_of((one, two))
    assert spread(unshaded(one, shades).colors) < 0.25 * spread(one.colors)
    assert np.allclose(unshaded(one, shades).colors / unshaded(one, shades).colors.mean(1)[:, None],
                       PAINT / PAINT.mean())  # brightness changes, hue does not


def test_two_paints_of_one_hue_do_not_pass_for_light(rng):
    plain = light_of((ball(rng), ball(rng)))
    paint = np.where(rng.random(4000)[:, None] < 0.2, 2.0, 1.0) * PAINT * 0.8
    mixed = light_of((ball(rng, paint), ball(rng, paint)))
    assert np.abs(mixed - plain).max() < 0.15 * np.abs(plain).max()


def test_hues_say_nothing_of_the_light(rng):
    """Each side of a cube in a colour of its own."""
    one = ball(rng)
    side = np.abs(one.normals).argmax(1) + 3 * (one.normals.max(1) > -one.normals.min(1))
    colors = np.eye(6)[side] @ np.array([[.9, .2, .2], [.2, .6, .2], [.1, .1, .8],
                                         [.8, .8, .1], [.1, .6, .6], [.7, .1, .7]])
    flat = Surfels(one.points, one.normals, colors, one.views)
    assert not light_of((flat, flat)).any()


def test_even_light_and_a_plain_face_are_left_alone(rng):
    noise = ball(rng, PAINT + rng.normal(0, 0.01, (4000, 3)), np.zeros(3))
    assert not light_of((noise, noise)).any()
    face = Surfels(rng.random((500, 3)), np.tile([0.0, 0, 1], (500, 1)),
                   np.tile(PAINT, (500, 1)), np.full(500, 5))
    assert not light_of((face, face)).any()
    empty = face.select(np.zeros(0, np.int64))
    assert not light_of((empty, empty)).any()


@pytest.fixture
def scene(toy, rng):
    gaussians, labels = toy.gaussians_of([toy.Box((0, 0, 0), (1, 1, 0.4), 1),
                                          toy.Box((0, 0, 0.4), (1, 1, 0.5), 3)], 0.06)
    one = ball(rng)
    normals = one.normals[rng.integers(0, len(one), len(gaussians.means))]
    return gaussians, labels, Light(light_of((one, one)), (normals, normals))


def test_only_what_turns_changes_its_brightness(scene):
    gaussians, labels, light = scene
    slide = se3.make(np.eye(3), np.array([0.0, 0, 0.3]))
    assert np.array_equal(light.colors(0, gaussians, labels, [np.eye(4), slide]), gaussians.colors)
    turned = light.colors(0, gaussians, labels, [np.eye(4), TURN])
    own = labels == 1
    assert np.array_equal(turned[~own], gaussians.colors[~own])
    truth = lit(light.normals[0] @ TURN[:3, :3].T) / lit(light.normals[0])
    found = turned[own].mean(1) / gaussians.colors[own].mean(1)
    assert np.median(np.abs(np.log(found / truth[own]))) < 0.06


def test_even_light_changes_nothing(scene):
    gaussians, labels, light = scene
    even = Light(np.zeros(8), light.normals)
    assert even.even
    assert "even" in even.told()
    assert not light.even
    assert 1.5 < float(light.told().split()[3]) < 2.5  # 1.1 under the sun, 0.5 away from it
    assert np.array_equal(even.colors(0, gaussians, labels, [np.eye(4), TURN]), gaussians.colors)


def test_the_images_of_a_turned_part_fit_in_its_light(toy, scene):
    gaussians, labels, light = scene
    moves = [np.eye(4), TURN]
    there = move_gaussians(gaussians, labels, moves)
    eyes = toy.cameras(6, 48, np.array([0.5, 0.4, 0.4]), 1.2)

    def cost(colors, way):
        """Where the photos show these colours."""
        shone = replace(gaussians, means=there.means, quats=there.quats,
                        sh0=((colors - 0.5) / SH_C0).astype(np.float32))
        views = small_views(toy.drawn(shone, *eyes, 48), 6, 48)
        return both_cost((gaussians, gaussians), (labels, labels), moves, (views, views),
                         (1.0, 0.0), way)

    turned = light.colors(0, gaussians, labels, moves)
    even = Light(np.zeros(8), light.normals)
    floor, plain, fair = (cost(c, way) for c, way in (
        (gaussians.colors, even), (turned, even), (turned, light)))
    assert plain > 1.5 * floor
    assert fair == pytest.approx(floor, abs=0.05 * (plain - floor))
