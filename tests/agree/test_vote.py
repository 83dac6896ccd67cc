"""Who is odd, by numbers that can be counted on fingers."""

from __future__ import annotations

import numpy as np
import pytest

from part2gs_robotics.agree.vote import apart, cloud, relative, vote


def values(**by_file: float) -> dict[str, np.ndarray]:
    return {name.replace("_", "."): np.array([v]) for name, v in by_file.items()}


def test_most_files_win_and_the_others_are_named() -> None:
    found = vote(values(a=1.0, b=2.0, c=2.0, d=3.0), apart, {})
    assert (found.winner, found.agreed, found.odd) == ("b", ("b", "c"), {"a": 1.0, "d": 1.0})
    assert found.said == "b, c say"


def test_of_equally_many_the_first_wins() -> None:
    assert vote(values(a=1.0, b=2.0), apart, {}).odd == {"b": 1.0}


def test_a_file_that_is_less_exact_may_be_less_exact() -> None:
    limits = {"c": 0.1}
    assert not vote(values(a=1.0, b=1.0, c=1.05), apart, limits).odd
    assert vote(values(a=1.0, b=1.05, c=1.0), apart, limits).odd == {"b": pytest.approx(0.05)}


def test_what_is_included_neither_votes_nor_is_blamed_twice() -> None:
    said = {"twin.yaml": np.ones(1), "twin_actuated.xml": np.zeros(1), "scene.xml": np.zeros(1)}
    found = vote(said, apart, {})
    assert found.winner == "twin.yaml"
    assert list(found.odd) == ["twin_actuated.xml"]
    said["twin_actuated.xml"] = np.ones(1)
    assert list(vote(said, apart, {}).odd) == ["scene.xml"]


def test_what_is_no_number_is_odd() -> None:
    assert list(vote(values(a=1.0, b=1.0, c=float("nan")), apart, {}).odd) == ["c"]
    assert vote(values(a=np.inf, b=np.inf), apart, {}).odd == {}


def test_distances() -> None:
    assert relative(np.array([2.0, 0.0]), np.array([1.0, 0.0])) == 0.5
    assert relative(np.zeros(2), np.zeros(2)) == 0.0
    assert apart(np.zeros(2), np.zeros(3)) == np.inf
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    assert cloud(square, square[[2, 0, 1, 3]]) == 0.0, "the order is no difference"
    assert cloud(square, square + np.array([0, 0, 0.25])) == 0.25
    assert cloud(square, np.vstack([square, [[1, 1, 2.0]]])) == 2.0, "both ways"
    assert cloud(np.vstack([square, [[1, 1, 2.0]]]), square) == 2.0
    assert cloud(np.zeros((0, 3)), square) == np.inf
    assert cloud(np.zeros((0, 3)), np.zeros((0, 3))) == 0.0
