from dataclasses import replace

import numpy as np

from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.motion import Motion, with_part, without_part

AXIS = np.array([0.0, 1.0, 0.0])


def test_leaving_out_a_carried_part_renumbers_the_others():
    probs = np.array([[0.1, 0.2, 0.3, 0.4]], np.float32)
    joints = tuple(Joint("prismatic", AXIS, np.zeros(3), v) for v in (0.1, 0.2, 0.3))
    motion = Motion((probs, probs), joints, (0, 1, 1), tuple({"n": float(k)} for k in range(3)))
    left = without_part(motion, 2, "why")
    np.testing.assert_allclose(left.part_probs[0], [[0.1, 0.5, 0.4]])  # to its carrier, part 1
    assert (left.joints, left.parents) == ((joints[0], joints[2]), (0, 1))
    assert [d["n"] for d in left.diagnostics] == [0.0, 2.0]
    base = without_part(Motion((probs, probs), joints, (0, 0, 2)), 1, "why")
    np.testing.assert_allclose(base.part_probs[1], [[0.3, 0.3, 0.4]])
    assert base.parents == (0, 1)


def test_a_part_more_takes_what_is_its_own_of_another_and_moves_as_that_one_does():
    probs = np.array([[0.1, 0.2, 0.7], [0.3, 0.1, 0.6]], np.float32)
    joints = tuple(Joint("prismatic", AXIS, np.zeros(3), v) for v in (0.1, 0.2))
    motion = Motion((probs, probs), joints, (0, 1), ({"n": 0.0}, {"n": 1.0}), ("before",))
    mine, nothing = np.array([False, True]), np.array([False, False])
    more = with_part(motion, 2, (mine, nothing))
    np.testing.assert_array_equal(more.part_probs[0], np.float32([[0.1, 0.2, 0.7, 0.0],
                                                                  [0.3, 0.1, 0.0, 0.6]]))
    np.testing.assert_array_equal(more.part_probs[1][:, :3], probs)
    assert more.part_probs[0].dtype == np.float32
    assert (more.joints, more.parents) == ((*joints, joints[1]), (0, 1, 1))
    assert [d["n"] for d in more.diagnostics] == [0.0, 1.0, 1.0]
    assert more.notes == ("before",)
    back = without_part(replace(more, parents=(0, 1, 2)), 3, "no part after all")
    np.testing.assert_array_equal(back.part_probs[0], probs)
