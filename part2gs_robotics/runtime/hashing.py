"""Keys of stages: a hash of everything a result depends on."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np

from part2gs_robotics import __version__


def hash_of(*parts: object) -> str:
    """Return a sha256 of plain data, arrays and bytes, in order."""
    digest = hashlib.sha256()
    for part in parts:
        _update(digest, part)
    return digest.hexdigest()


def _update(digest: hashlib._Hash, part: object) -> None:
    if isinstance(part, np.ndarray):
        digest.update(f"{part.dtype}{part.shape}".encode())
        digest.update(np.ascontiguousarray(part).tobytes())
    elif isinstance(part, bytes):
        digest.update(part)
    elif isinstance(part, tuple | list):
        digest.update(f"[{len(part)}".encode())
        for item in part:
            _update(digest, item)
    else:
        digest.update(json.dumps(part, sort_keys=True, default=str).encode())


def code_version() -> str:
    """Return a hash of this package's source: changed code never reuses old stages."""
    import part2gs_robotics.exporters as exporters

    digest = hashlib.sha256(__version__.encode())
    for folder in (Path(__file__).parent, Path(exporters.__file__ or "").parent):
        for file in sorted(folder.glob("*.py")):
            digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()
