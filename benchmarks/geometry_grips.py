"""A parallel gripper on the handles of twins."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from geometry_kit import Case


def grips(case: Case, pictures: Path | None) -> list[dict[str, Any]]:
    """Return what the kit's gripper did with the handles of an object."""
    return []
