"""Corners of mesh files, each read once, none outside of the twin folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from part2gs_robotics.errors import CheckError
from part2gs_robotics.exporters.meshfile import read_obj
from part2gs_robotics.model.arrays import F64


class Meshes:
    """The OBJ files below one folder, by the names other files give them."""

    def __init__(self, folder: Path, place: str = ".") -> None:
        """Read below `folder`; names start from `place` in it."""
        self.folder, self.place = folder.resolve(), folder / place
        self.known: dict[Path, F64] = {}

    def corners(self, name: str) -> F64:
        """Return [V, 3] places of a file's vertices, in its own units.

        Raises:
            ValueError: if it is not there, outside of the folder, or no such mesh.
        """
        path = (self.place / name.removeprefix("package://")).resolve()
        if not path.is_relative_to(self.folder) or not path.is_file():
            raise ValueError(f"the mesh {name[:100]!r} is not in the folder")
        if path not in self.known:
            try:
                self.known[path] = np.asarray(read_obj(path).vertices)
            except CheckError as error:
                raise ValueError(str(error)) from None
        return self.known[path]
