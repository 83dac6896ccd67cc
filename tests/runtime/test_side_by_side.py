"""Tasks side by side return what they would in turn, in order, and pass on what goes wrong."""

from __future__ import annotations

import threading
from dataclasses import replace
from functools import partial

import numba
import numpy as np
import pytest

from part2gs_robotics.decide.candidate import on_base
from part2gs_robotics.decide.judge import Judge
from part2gs_robotics.joints.align import FINE, AlignmentProblem, _systems
from part2gs_robotics.joints.solver import at
from part2gs_robotics.model.small_views import small_views
from part2gs_robotics.runtime.device import current_device, rendering_on
from part2gs_robotics.runtime.side_by_side import SAFE, _layer, side_by_side

two_threads = pytest.mark.skipif(numba.config.NUMBA_NUM_THREADS < 2, reason="one core")


@pytest.fixture
def threads(look_alikes):
    """Set the number of kernel threads; kernels have run, so their layer is known."""
    before = numba.get_num_threads()
    Judge(look_alikes.study).sort_out(on_base(look_alikes.truth))
    yield numba.set_num_threads
    numba.set_num_threads(before)


@two_threads
def test_tasks_run_at_once_and_come_back_in_order(threads):
    threads(2)
    assert _layer() in SAFE
    meet = threading.Barrier(2, timeout=60)  # broken, an error, if tasks ran in turn

    def task(k):
        meet.wait()
        return k, numba.get_num_threads(), threading.current_thread() is threading.main_thread()

    assert side_by_side([partial(task, k) for k in range(4)]) == [(k, 1, False) for k in range(4)]


def test_one_thread_and_one_task_stay_where_they_are(threads):
    threads(1)
    here = threading.current_thread()
    assert side_by_side([threading.current_thread] * 3) == [here] * 3
    threads(numba.config.NUMBA_NUM_THREADS)
    assert side_by_side([threading.current_thread]) == [here]
    assert side_by_side([]) == []


@two_threads
@pytest.mark.parametrize("layer", ["workqueue", ""])
def test_layers_that_abort_get_one_task_at_a_time(threads, layer, monkeypatch):
    threads(2)
    monkeypatch.setattr("part2gs_robotics.runtime.side_by_side._layer", lambda: layer)
    assert side_by_side([threading.current_thread] * 2) == [threading.current_thread()] * 2


@two_threads
def test_tasks_of_tasks_run_in_turn(threads):
    threads(2)
    inner = side_by_side([lambda: side_by_side([threading.current_thread] * 2)] * 2)
    assert all(one is two for one, two in inner)


def test_the_device_is_the_callers(threads):
    threads(numba.config.NUMBA_NUM_THREADS)
    assert side_by_side([current_device] * 2) == ["cpu"] * 2
    with rendering_on("cuda"):
        assert side_by_side([current_device, threading.current_thread]) == [
            "cuda", threading.current_thread()], "one rendering at a time on a GPU"


def test_what_goes_wrong_in_a_task_is_raised(threads):
    threads(numba.config.NUMBA_NUM_THREADS)

    def fails():
        raise FloatingPointError("loss is nan")

    with pytest.raises(FloatingPointError, match="loss is nan"):
        side_by_side([fails, current_device])


@two_threads
def test_a_decision_and_an_alignment_are_the_same_bits_on_one_thread_and_on_two(
        look_alikes, threads):
    study, truth = look_alikes.study, look_alikes.truth
    sets = [on_base([h, replace(h, value=way)]) for h in truth for way in (0.1, 0.24, 0.31)]
    views = tuple(small_views(s, 8, 56) for s in look_alikes.scene.states)
    poses = [at(replace(h, value=0.97 * h.value), study.diag) for h in truth]
    found = []
    for count in (1, 2):
        threads(count)
        best = Judge(study).best_of(sets)
        labels = study.gaussian_labels(best.labels)
        problem = AlignmentProblem(study.gaussians, labels, views, study.diag)
        systems = _systems(problem, poses, FINE[0])
        found.append((best.cost, best.labels, [(s.h, s.g) for pair in systems for s in pair]))
    (cost, hard, one), (other, labels, two) = found
    assert cost == other
    np.testing.assert_array_equal(hard, labels)
    for (h, g), (same_h, same_g) in zip(one, two, strict=True):
        np.testing.assert_array_equal(h, same_h)
        np.testing.assert_array_equal(g, same_g)
    assert any(h.any() for h, _ in one)
