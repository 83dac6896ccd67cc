"""Listed kernels: which functions a build compiles, for which types, and which are kept already."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

LIST = Path(__file__).with_name("kernels.txt")
LATE = "volume", "boards", "collision", "texture"  # rooms that a build enters when parts are known


@dataclass(frozen=True)
class Kernel:
    """A function of this package that is compiled for one set of types.

    Attributes:
        module: its full name.
        name: of the function.
        types: of its arguments, as Numba spells a signature: "(float64[:,::1], int64,)".
    """

    module: str
    name: str
    types: str

    @property
    def line(self) -> str:
        """One line that tells it."""
        return f"{self.module} {self.name} {self.types}"

    @property
    def late(self) -> bool:
        """Whether a build calls it half of its time after it began, or later."""
        return self.module.split(".")[1] in LATE


def read(line: str) -> Kernel:
    """Return the kernel that a line tells of."""
    module, name, types = line.strip().split(" ", 2)
    return Kernel(module, name, types)


def listed() -> list[Kernel]:
    """Return the kernels of a build, those that take longest to compile first.

    `benchmarks/kernels.py` writes the list. One that it lacks is compiled when it is first called.
    """
    return [read(line) for line in LIST.read_text("utf-8").splitlines()]


def missing() -> list[Kernel]:
    """Return the listed kernels that were never compiled as their source is now.

    Raises:
        ConfigError: NUMBA_CACHE_DIR names a folder that cannot be written.
    """
    from part2gs_robotics.runtime.jit import kept

    return [one for one in listed() if not kept(one.module, one.name)]
