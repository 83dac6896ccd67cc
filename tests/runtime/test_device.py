"""Memory that a room has freed goes back to the system."""

import ctypes
import subprocess
import sys

import pytest

GIVEN = """
import numpy as np
from part2gs_robotics.runtime.device import give_back

def held():
    return int(open("/proc/self/statm").read().split()[1]) * 4096

{first}
rooms = [np.ones({size}, np.uint8) for _ in range({count})]
stays = [np.ones(100_000, np.uint8) for _ in range(2)]  # on top of the heap: nothing below shrinks
full = held()
del rooms
{then}
assert full - held() > 0.8 * {size} * {count}, (full, held())
"""
glibc = pytest.mark.skipif(
    sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="not glibc")


def run(first: str, size: int, count: int, then: str) -> int:
    code = GIVEN.format(first=first, size=size, count=count, then=then)
    return subprocess.run([sys.executable, "-c", code], stderr=subprocess.DEVNULL,
                          check=False).returncode


# The C library maps what is larger than any array it has freed so far: one of 30 MB comes first.
RAISED = "np.ones(30_000_000, np.uint8).sum()"


@glibc
def test_small_arrays_go_back_between_rooms() -> None:
    assert run("", 100_000, 1000, "give_back()") == 0
    assert run("", 100_000, 1000, "pass") != 0  # or this tests nothing


@glibc
def test_large_arrays_go_back_as_soon_as_they_are_freed() -> None:
    assert run(f"{RAISED}; give_back()", 6_000_000, 20, "pass") == 0
    assert run(RAISED, 6_000_000, 20, "pass") != 0  # or this tests nothing
