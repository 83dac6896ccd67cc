"""Photos are matched along the walk, and where they share features, across the states too."""

from __future__ import annotations

import numpy as np

from part2gs_robotics.photos import pairs


def test_neighbours_of_a_state_are_always_matched_and_never_a_photo_with_itself():
    state = np.repeat([0, 1], 20)
    chosen = pairs.choose_pairs(np.zeros((40, 40), np.int64), state)
    assert all(a < b for a, b in chosen)
    for a in range(39):
        assert ((a, a + 1) in chosen) or state[a] != state[a + 1]


def test_the_photos_that_share_most_are_matched_across_the_states():
    state = np.repeat([0, 1], 20)
    votes = np.zeros((40, 40), np.int64)
    votes[3, 37] = votes[37, 3] = 50
    assert (3, 37) in pairs.choose_pairs(votes, state)


def test_shared_features_are_counted_as_planted():
    rng = np.random.default_rng(0)
    one, two = (rng.normal(size=(40, 128)).astype(np.float32) for _ in range(2))
    two[:15] = one[:15] + rng.normal(0, 0.02, (15, 128))
    unit = [x / np.linalg.norm(x, axis=1, keepdims=True) for x in (one, two)]
    votes = pairs.shared_features([*unit, np.zeros((0, 128), np.float32)])
    assert votes[0, 1] == votes[1, 0] == 15
    assert not votes[2].any()


def test_large_features_are_those_of_large_scale_in_both_forms():
    rng = np.random.default_rng(0)
    scale = rng.uniform(1, 9, 900)
    places = rng.uniform(0, 99, (900, 2))
    kinds = rng.integers(0, 256, (900, 128)).astype(np.uint8)
    plain = np.c_[places, scale, np.zeros(900)].astype(np.float32)
    shaped = np.c_[places, scale, np.zeros(900), np.zeros(900), scale].astype(np.float32)
    found = [pairs.largest_features(points, kinds) for points in (plain, shaped)]
    assert len(found[0]) == pairs.LARGEST
    np.testing.assert_array_equal(*found)
    first = kinds[scale.argmax()].astype(float)
    np.testing.assert_allclose(found[0][0], first / np.linalg.norm(first), rtol=1e-5)
