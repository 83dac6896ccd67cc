import numpy as np
import pytest

from part2gs_robotics.mesh.board_parts import yielded


def test_what_yields_is_what_is_taken_deeper_than_a_gap():
    inside = np.zeros((20, 20, 20), bool)
    inside[5:15, 5:15, 5:15] = True
    for deep, share in ((0, 0.0), (1, 0.0), (2, 0.0), (3, 0.3), (10, 1.0)):
        taken = np.zeros_like(inside)
        taken[:5 + deep] = True
        assert yielded(inside, taken) == pytest.approx(share)
    assert yielded(np.zeros_like(inside), inside) == 0.0
