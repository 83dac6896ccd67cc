"""How much longer a machine's first build takes, which compiles kernels.

    python benchmarks/kernels.py [--repeat 3]           seconds, to docs/raster.md
    python benchmarks/kernels.py --record SCENES ...    the list, from builds of these scenes

Every measurement starts with a new, empty folder for kernels: those of early rooms, on one core and
on all, and the bundled scene built twice, the second time with what the first has kept. A list is
recorded from whole builds in one process: every kernel that Python called, for every set of types,
those that take longest to compile first. Scenes that differ (with depth, several parts, one part
carried) call different ones.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numba
from numba.core.dispatcher import Dispatcher
from reconstruction_suite import git, insert

from part2gs_robotics.ahead.listed import LIST, Kernel, listed

ROOT = Path(__file__).resolve().parents[1]
RESULTS, PAGE = ROOT / "benchmarks/results/kernels.json", ROOT / "docs/raster.md"
SCENE = ROOT / "examples/microwave"
MARKS = "<!-- kernels:begin -->", "<!-- kernels:end -->"
AHEAD = ("import os, sys\nos.sched_setaffinity(0, range(int(sys.argv[1])))\n"
         "from part2gs_robotics.ahead.compile_ahead import compile_ahead\n"
         "from part2gs_robotics.ahead.listed import missing\n"
         "compile_ahead()\nassert all(one.late for one in missing())")


def main() -> int:
    """Measure or record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=3, help="runs of which the median counts")
    parser.add_argument("--record", type=Path, nargs="+", default=[], help="scenes to build")
    args = parser.parse_args()
    if args.record:
        return record(args.record)
    cores = sorted({1, len(os.sched_getaffinity(0))})
    rows = [{"cores": n, "seconds": [seconds(n) for _ in range(args.repeat)]} for n in cores]
    builds = [first_and_next() for _ in range(args.repeat)]
    found = {"commit": git("rev-parse", "--short", "HEAD"), "kernels": len(listed()),
             "early": sum(not one.late for one in listed()), "rows": rows, "builds": builds}
    RESULTS.write_text(json.dumps(found, indent=1) + "\n")
    PAGE.write_text(insert(PAGE.read_text(), markdown(found), *MARKS))
    sys.stdout.write(markdown(found))
    return 0


def seconds(cores: int) -> float:
    """Return how long the kernels of early rooms take to compile on some cores."""
    with tempfile.TemporaryDirectory() as place:
        began = time.monotonic()
        subprocess.run([sys.executable, "-c", AHEAD, str(cores)], check=True,
                       env={**os.environ, "NUMBA_CACHE_DIR": place})
        return round(time.monotonic() - began, 1)


def first_and_next() -> list[float]:
    """Return how long a machine's first build of the bundled scene takes, and the next."""
    with tempfile.TemporaryDirectory() as place:
        took = []
        for out in ("first", "next"):
            began = time.monotonic()
            subprocess.run([sys.executable, "-m", "part2gs_robotics", "build", str(SCENE), "-o",
                            f"{place}/{out}", "--quiet"], check=True,
                           env={**os.environ, "NUMBA_CACHE_DIR": f"{place}/kernels"})
            took.append(round(time.monotonic() - began, 1))
    return took


def markdown(found: dict) -> str:
    """Return the table."""
    early = [(f"{found['early']} kernels of early rooms, cores: {row['cores']}", row["seconds"])
             for row in found["rows"]]
    longer = [first - following for first, following in found["builds"]]
    lines = [f"{found['kernels']} kernels, medians (least to most) at commit {found['commit']}.",
             "", "| | s |", "|---|---|"]
    for name, all_ in [*early, ("a first build takes longer than the next by", longer)]:
        lines.append(f"| {name} | {statistics.median(all_):.0f} "
                     f"({min(all_):.0f} to {max(all_):.0f}) |")
    return "\n".join(lines) + "\n"


def record(scenes: list[Path]) -> int:
    """Write the list of what builds of these scenes call."""
    from part2gs_robotics.cli import main as command

    LIST.write_text("")  # nothing is compiled ahead meanwhile
    with tempfile.TemporaryDirectory() as place:
        for number, scene in enumerate(scenes):
            code = command(["build", str(scene), "-o", f"{place}/{number}", "--quiet"])
            assert code < 2, f"{scene}: exit {code}"
    kernels = called()
    with tempfile.TemporaryDirectory() as place:
        took = {k: time_of(k, place) for k in kernels}
    LIST.write_text("".join(k.line + "\n" for k in sorted(kernels, key=lambda k: -took[k])))
    return 0


def called() -> list[Kernel]:
    """Return the kernels that Python has called in this process."""
    found = []
    ours = {n: m for n, m in sys.modules.items() if n.startswith("part2gs_robotics.")}
    for name, module in sorted(ours.items()):
        for key, value in sorted(vars(module).items()):
            if isinstance(value, Dispatcher) and value.__module__ == name:
                found += [Kernel(name, key, f"({' '.join(spelled(t) + ',' for t in types)})")
                          for types in value.signatures]
    return found


def time_of(kernel: Kernel, place: str) -> float:
    """Return the seconds that a process of its own compiles a kernel, from nothing."""
    code = ("import sys, time\nfrom part2gs_robotics.ahead.worker import compiled, read\n"
            "import numba, part2gs_robotics.runtime.jit\nbegan = time.process_time()\n"
            "assert compiled(read(sys.argv[1])) == 'kept'\nprint(time.process_time() - began)")
    with tempfile.TemporaryDirectory(dir=place) as empty:
        done = subprocess.run([sys.executable, "-c", code, kernel.line], check=True, text=True,
                              capture_output=True, env={**os.environ, "NUMBA_CACHE_DIR": empty})
    return float(done.stdout)


def spelled(kind: numba.types.Type) -> str:
    """Return a type as a signature spells it."""
    if isinstance(kind, numba.types.Array):
        assert kind.mutable, f"no spelling for {kind}"
        assert kind.layout in "CA", f"no spelling for {kind}"
        last = "::1" if kind.layout == "C" else ":"
        return f"{spelled(kind.dtype)}[{','.join([':'] * (kind.ndim - 1) + [last])}]"
    if isinstance(kind, numba.types.UniTuple):
        return f"UniTuple({spelled(kind.dtype)}, {kind.count})"
    return "boolean" if isinstance(kind, numba.types.Boolean) else str(kind)


if __name__ == "__main__":
    raise SystemExit(main())
