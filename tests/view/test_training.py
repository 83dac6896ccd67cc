"""Fits shown while they train: the same Gaussians with and without a page, and pictures of them."""

from __future__ import annotations

import logging
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from browser import CHROMIUM, Browser
from toys import Box, cameras, cast

from part2gs_robotics.config import FitConfig
from part2gs_robotics.errors import ConfigError
from part2gs_robotics.fit.fit_state import fit_state
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.view.training import Training, watched

try:
    import viser
except ImportError:
    viser = None
needs_viser = pytest.mark.skipif(viser is None, reason="no viser: pip install '.[view]'")


@needs_viser
def test_a_watched_fit_is_the_same_and_is_shown_at_its_end(
        monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    eyes = cameras(12, 48, np.array([0.5, 0.5, 0.25]), 1.2)
    state = cast((Box((0, 0, 0), (1, 1, 0.5), 1),), *eyes, 48)
    config = FitConfig(steps=30, half_steps=10, start_gaussians=400, max_gaussians=800,
                       hull_resolution=32, view_color=False)
    steps: list[int] = []
    plain = fit_state(state, config=config).gaussians
    monkeypatch.setattr("part2gs_robotics.view.training.PORT", 0)
    caplog.set_level(logging.INFO)
    with watched(True) as training:
        seen = fit_state(state, config=config, progress=training.beside(
            lambda step, steps_, number: steps.append(step), "state 0")).gaussians
        told, shown = training._told.content, training.shown
    assert steps == list(range(1, 31))
    assert told.startswith("state 0: step 30 of 30")
    assert shown >= 2
    assert "fits are shown at http://127.0.0.1:" in caplog.text
    for item in fields(Gaussians):
        np.testing.assert_array_equal(getattr(seen, item.name), getattr(plain, item.name))


@needs_viser
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")
def test_a_browser_gets_what_was_shown(tmp_path: Path) -> None:
    training = Training(0)
    try:
        with Browser(tmp_path) as browser:
            browser.visit(training.address)
            browser.wait("document.body.innerText.includes('waiting for the first fit')")
            one = np.ones((1, 3), np.float32)
            training.show(Gaussians(0 * one, np.float32([[1, 0, 0, 0]]), -2 * one, one[:, 0], one,
                                    np.zeros((1, 0, 3), np.float32)), "state 1: step 7")
            browser.wait("document.body.innerText.includes('state 1: step 7')")
    finally:
        training.close()


def test_nobody_needs_viser_who_does_not_watch(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    with watched(False) as training:
        assert training is None
    with pytest.raises(ConfigError, match=r"part2gs-robotics\[view\]"), watched(True):
        pass
