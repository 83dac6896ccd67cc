"""Gaussians in the browser while they train: `build --view`."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from scipy.spatial.transform import Rotation

from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.view.page import close_page, open_page

EVERY = 2.0  # s between pictures: each sends 32 bytes a Gaussian, 0.8 MB of a standard fit
PORT = 8080  # of the page, as of `view`
logger = logging.getLogger(__name__)
Progress = Callable[[int, int, float, Callable[[], Gaussians]], None]


class Training:
    """A page that shows the last Gaussians of a fit.

    Attributes:
        address: of the page.  shown: pictures sent so far.
    """

    def __init__(self, port: int) -> None:
        """Start the server.

        Raises:
            ConfigError: viser is not installed.
        """
        self._server, self.address = open_page(port)
        self._told = self._server.gui.add_markdown("waiting for the first fit")
        self._last = -EVERY
        self.shown = 0

    def beside(self, progress: Callable[[int, int, float], None], label: str) -> Progress:
        """Return a progress that shows the Gaussians as well, when it is time to.

        A fit does the same with it: Gaussians are read, nothing of the fit is touched.

        Args:
            progress: called as before.
            label: what is fitted.
        """
        def both(step: int, steps: int, number: float, gaussians: Callable[[], Gaussians]) -> None:
            progress(step, steps, number)
            if step == steps or time.monotonic() - self._last > EVERY:
                self.show(gaussians(), f"{label}: step {step} of {steps}, {number:.1f} dB")
                self._last = time.monotonic()

        return both

    def show(self, gaussians: Gaussians, told: str) -> None:
        """Send Gaussians to whoever looks."""
        turns = Rotation.from_quat(gaussians.quats[:, [1, 2, 3, 0]]).as_matrix()
        wide = turns * gaussians.scales[:, None, :]
        with self._server.atomic():
            self._server.scene.add_gaussian_splats(
                "/gaussians", gaussians.means, wide @ wide.transpose(0, 2, 1),
                np.minimum(gaussians.colors, 1.0), gaussians.opacities[:, None])
            self._told.content = told
        self.shown += 1

    def close(self) -> None:
        """Stop the server."""
        close_page(self._server)


@contextmanager
def watched(wanted: bool) -> Iterator[Training | None]:
    """Yield the page that shows fits, closed at the end; None where nobody wants one.

    Raises:
        ConfigError: viser is not installed.
    """
    if not wanted:
        yield None
        return
    training = Training(PORT)
    logger.info("fits are shown at %s while they train", training.address)
    try:
        yield training
    finally:
        training.close()
