"""Toy scenes and twins that the tests draw as well, for benchmarks that need no kit."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))

from layout_writers import write_colmap, write_dta, write_paris
from synth import toy_cabinet_twin, write_all
from synth_photos import viewmats_around, write_ball_scene, write_tiny_scene

__all__ = ["toy_cabinet_twin", "viewmats_around", "write_all", "write_ball_scene", "write_colmap",
           "write_dta", "write_paris", "write_tiny_scene"]
