"""ArtGS layout: transforms_train_{start,end}.json beside {start,end}/train/{rgba,depth}."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from part2gs_robotics.errors import SceneError
from part2gs_robotics.readers.image_files import inside
from part2gs_robotics.readers.nerfstudio import PosedImage, read_transforms

FILES = ("transforms_train_start.json", "transforms_train_end.json")


def is_artgs(scene: Path) -> bool:
    """Tell whether the folder holds (at least half of) an ArtGS scene."""
    return any((scene / name).exists() for name in FILES)


def read_artgs(
    scene: Path, allow_missing: bool, depth: bool = True
) -> tuple[list[PosedImage], list[PosedImage]]:
    """Return the posed training images of both states.

    transforms_test_*.json are the benchmark's held-out views, num_slots.json and
    joint_types_*.json its answers: none of them is read.

    Args:
        scene: folder of the scene.
        allow_missing: drop frames without camera or image, go on when some have no depth.
        depth: look for `depth/` beside `rgba/`: 16-bit PNG of the photos' names, millimetres.

    Raises:
        SceneError: cameras that cannot be used, or photos without depth beside others with it.
    """
    start, end = (read_transforms(scene / name, scene, allow_missing) for name in FILES)
    if not depth:
        return start, end
    return _with_depth(start, scene, allow_missing), _with_depth(end, scene, allow_missing)


def _with_depth(posed: list[PosedImage], scene: Path, allow_missing: bool) -> list[PosedImage]:
    """Return the images with the depth file of each; a file that the json names stays."""
    found = [image if image.depth else replace(image, depth=_beside(image, scene))
             for image in posed]
    missing = [image.name for image in found if image.depth is None]
    if missing and len(missing) < len(found) and not allow_missing:
        raise SceneError(
            f"{posed[0].path.parent.parent / 'depth'}: {len(missing)} of {len(found)} images have "
            f"no depth file ({', '.join(missing[:3])}{', ...' if len(missing) > 3 else ''}). "
            "Expected one 16-bit PNG of the same name for each image; add them, or go on without "
            "depth with --no-depth.")
    return found


def _beside(image: PosedImage, scene: Path) -> Path | None:
    folder, name = image.path.parent.parent / "depth", f"{image.path.stem}.png"
    there = (folder / name).is_file()
    return inside(scene, folder, name, str(image.path)) if there else None
