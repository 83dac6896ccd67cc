"""ArtGS layout: transforms_train_{start,end}.json beside {start,end}/train/rgba."""

from __future__ import annotations

from pathlib import Path

from part2gs_robotics.reader_nerfstudio import PosedImage, read_transforms

FILES = ("transforms_train_start.json", "transforms_train_end.json")


def is_artgs(scene: Path) -> bool:
    """Tell whether the folder holds (at least half of) an ArtGS scene."""
    return any((scene / name).exists() for name in FILES)


def read_artgs(scene: Path, allow_missing: bool) -> tuple[list[PosedImage], list[PosedImage]]:
    """Return the posed training images of both states.

    transforms_test_*.json are the benchmark's held-out views, num_slots.json and
    joint_types_*.json its answers: none of them is read.
    """
    start, end = (read_transforms(scene / name, scene, allow_missing) for name in FILES)
    return start, end
