"""States slightly out of one frame: state 1 is carried onto state 0 on what stayed."""

from __future__ import annotations
