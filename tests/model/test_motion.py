import numpy as np

from part2gs_robotics.model.joint import Joint
from part2gs_robotics.model.motion import Motion, without_part

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
