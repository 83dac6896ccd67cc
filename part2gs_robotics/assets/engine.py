"""MuJoCo's own words: collected here instead of left in a file in the user's folder."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def engine_messages() -> Iterator[list[str]]:
    """Collect the engine's warnings, which else go to MUJOCO_LOG.TXT where the user stands.

    The engine still counts them in `MjData.warning`.

    Yields:
        A list that grows with every warning, in order.

    Example:
        with engine_messages() as said:
            mujoco.mj_step(model, data)
    """
    import mujoco

    messages: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(messages.append)
    try:
        with warnings.catch_warnings():  # what its compiler says comes as one of Python's
            warnings.simplefilter("always", UserWarning)
            warnings.showwarning = lambda message, *_: messages.append(str(message))
            yield messages
    finally:
        mujoco.set_mju_user_warning(before)


@contextmanager
def logged_messages(where: str) -> Iterator[None]:
    """Log every distinct warning of the engine once, at the end, as one of `where`."""
    with engine_messages() as messages:
        try:
            yield
        finally:
            for line in distinct(messages):
                logging.getLogger(__name__).warning("%s: MuJoCo: %s", where, line)


def distinct(messages: list[str]) -> tuple[str, ...]:
    """Return the first line of every warning once, without the time it came at."""
    lines = (message.strip().partition("\n")[0].partition(" Time =")[0] for message in messages)
    return tuple(dict.fromkeys(line for line in lines if line))
