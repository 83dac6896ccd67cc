"""Errors a user can meet; each message says what, where, what was expected and what to do."""

from __future__ import annotations


class Part2GSError(Exception):
    """Base of every error that is the input's fault, not ours: exit code 2."""


class SceneError(Part2GSError):
    """The scene folder cannot be used."""


class ConfigError(Part2GSError):
    """A flag or a key of scene.yaml cannot be used."""


class FitError(Part2GSError):
    """The optimiser cannot go on (NaN, nothing visible, nothing moves)."""


class MeshError(Part2GSError):
    """No watertight mesh can be made of a part."""


class EmptyPartError(MeshError):
    """A moving part has no surface or no volume: most likely there is no such part.

    Attributes:
        part: its index, 0 = base.
    """

    def __init__(self, message: str, part: int) -> None:
        """Keep the index beside the message."""
        super().__init__(message)
        self.part = part


class ExportError(Part2GSError):
    """The twin cannot be written."""


class CheckError(Part2GSError):
    """The twin or model given to `check` or `export` cannot be read."""


class StoreError(Part2GSError):
    """The output folder cannot be written, is locked, or is corrupt."""
