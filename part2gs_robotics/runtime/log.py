"""What a build says: one line per stage, the same events as JSON lines, progress with time left."""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from part2gs_robotics.runtime.atomic import write_error

ROOT = "part2gs_robotics"
PLAIN_EVERY_S = 30.0  # without a terminal a line per half minute keeps logs short
TTY_EVERY_S = 0.2  # a terminal line faster than the eye only costs time
CLEAR_LINE = "\r\x1b[K"


class _JsonLines(logging.Handler):
    """Append every event to log.jsonl; text the event carries in `fields` becomes its own keys."""

    def __init__(self, path: Path) -> None:
        super().__init__(logging.DEBUG)
        try:
            self._file = path.open("a", encoding="utf-8")
        except OSError as err:
            raise write_error(path, err) from err

    def emit(self, record: logging.LogRecord) -> None:
        """Write one line and flush it: a killed build keeps what it said."""
        event = {"time": round(record.created, 3), "level": record.levelname.lower(),
                 "logger": record.name.removeprefix(ROOT + "."), "message": record.getMessage(),
                 **getattr(record, "fields", {})}
        try:
            self._file.write(json.dumps(event, default=str) + "\n")
            self._file.flush()
        except OSError:
            self.handleError(record)

    def handleError(self, record: logging.LogRecord) -> None:
        """Stop writing the file: a full disk is reported by the stage that needs the space."""
        logging.getLogger(ROOT).removeHandler(self)

    def close(self) -> None:
        """Close the file."""
        try:
            self._file.close()
        except OSError:
            pass  # the buffer cannot reach a full disk; the event was shown on the terminal
        super().close()


class _Console(logging.Handler):
    """Write lines to the current stderr, clearing a progress line first."""

    def emit(self, record: logging.LogRecord) -> None:
        prefix = "" if record.levelno <= logging.INFO else f"{record.levelname.lower()}: "
        clear = CLEAR_LINE if sys.stderr.isatty() else ""
        sys.stderr.write(f"{clear}{prefix}{record.getMessage()}\n")


@contextmanager
def logging_to(out: Path | None, quiet: bool = False, verbose: bool = False) -> Iterator[None]:
    """Send the package's events to stderr and, with a folder, to its log.jsonl."""
    logger = logging.getLogger(ROOT)
    console = _Console(logging.WARNING if quiet else logging.DEBUG if verbose else logging.INFO)
    handlers: list[logging.Handler] = [console]
    if out is not None:
        handlers.append(_JsonLines(out / "log.jsonl"))
    logger.setLevel(logging.DEBUG)
    logger.propagate = False
    for handler in handlers:
        logger.addHandler(handler)
    try:
        yield
    finally:
        for handler in handlers:
            logger.removeHandler(handler)
            handler.close()
        logger.propagate = True


def log_stage(name: str, seconds: float, number: str, resumed: bool = False) -> None:
    """Say that a stage is done: its time and the one number that matters."""
    took = "unchanged, loaded" if resumed else f"{seconds:6.1f} s"
    logging.getLogger(f"{ROOT}.build").info(
        "%-22s %-18s %s", name, took, number,
        extra={"fields": {"event": "stage", "stage": name, "seconds": round(seconds, 3),
                          "number": number, "resumed": resumed}})


class Progress:
    """Progress of one stage: call it with (step, steps, number that matters)."""

    def __init__(self, label: str, unit: str = "", stream: TextIO | None = None) -> None:
        """Start the clock.

        Args:
            label: name of the stage.
            unit: unit of the number, such as "dB".
            stream: where a terminal line goes; None = stderr.
        """
        self.label, self.unit = label, unit
        self._stream = stream or sys.stderr
        self._last = time.monotonic()
        self._first: tuple[int, float] | None = None

    def __call__(self, step: int, steps: int, number: float = float("nan"),
                 so_far: object = None) -> None:
        """Say how far the stage is, when it is time to again; `so_far` is for other listeners."""
        now = time.monotonic()
        on_terminal = self._stream.isatty()
        # The first step pays for start-up; the pace is that of the steps after it.
        first, began = self._first = self._first or (step, now)
        if now - self._last < (TTY_EVERY_S if on_terminal else PLAIN_EVERY_S):
            return
        self._last = now
        shown = f", {number:.4g} {self.unit}".rstrip() if number == number else ""
        left = (now - began) * (steps - step) / max(1, step - first)
        ahead = f", {_clock(left)} left" if step > first else ""
        text = f"{self.label}: {step}/{steps}{shown}{ahead}"
        if on_terminal:
            enabled = _console_level() <= logging.INFO
            self._stream.write(CLEAR_LINE + text if enabled else "")
            self._stream.flush()
        else:
            logging.getLogger(f"{ROOT}.build").info("%s", text)


def _console_level() -> int:
    levels = [handler.level for handler in logging.getLogger(ROOT).handlers
              if isinstance(handler, _Console)]
    return min(levels, default=logging.WARNING)


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"
