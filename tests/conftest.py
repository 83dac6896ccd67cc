"""Settings that must hold before any test imports mujoco."""

from __future__ import annotations

import os

# mujoco picks its OpenGL backend at import; capture draws off screen.
os.environ.setdefault("MUJOCO_GL", "egl")
