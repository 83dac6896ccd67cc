"""Check one asset in a process of its own: what ends that process ends no other.

MuJoCo and OpenUSD are C and C++: a hostile file may crash them or fill the memory, one that says it
is a twin as well. The child runs `main`; request and report are JSON.
"""

from __future__ import annotations

import json
import logging
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from part2gs_robotics.errors import Part2GSError

if TYPE_CHECKING:
    from part2gs_robotics.sim_checks.result import CheckReport

MEMORY = 12 << 30  # bytes of address space: a check of half a million faces takes a quarter
SECONDS = 900.0  # the slowest of forty models of public packages takes 30
PER_DRAW = 1.0  # seconds more for each of --samples: a joint takes a tenth
# The folder a user stands in may hold a json.py of others: the child imports nothing from there.
START = ("import sys; sys.path = [p for p in sys.path if p]; "
         "from part2gs_robotics.ci.alone import main; main()")
_running: set[subprocess.Popen[str]] = set()  # of `check_alone`, in several threads


@dataclass(frozen=True)
class Request:
    """What to check and how.

    Attributes:
        path: of the asset.  root: folder that nothing it names may leave; "" = its own.
        steps: positions per joint.  samples: draws of the joints.  stress: the long rows.
    """

    path: str
    root: str = ""
    steps: int = 21
    samples: int = 0
    stress: bool = False


def is_ours(path: Path) -> bool:
    """Return whether an asset says that it is a twin folder."""
    return (path / "twin.yaml").is_file()


def check_alone(request: Request) -> CheckReport:
    """Return the report of one asset, checked in a process of its own."""
    from part2gs_robotics.sim_checks.result import report_of

    most = SECONDS + PER_DRAW * request.samples
    with tempfile.TemporaryDirectory(prefix="part2gs-check-") as folder:
        place = Path(folder) / "report.json"
        words = [sys.executable, "-c", START, json.dumps(asdict(request)), str(place)]
        with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                              errors="replace") as child:
            _running.add(child)
            try:
                said = child.communicate(timeout=most)[1]
            except subprocess.TimeoutExpired:
                return _unusable(request.path, f"{request.path}: its check takes more than {most:g}"
                                 " s. Expected an object of ordinary size; give simpler meshes.")
            finally:
                child.kill()  # nothing, where it has ended
                _running.discard(child)
        if child.returncode or not place.is_file():
            return _unusable(request.path, _ended(request.path, child.returncode, said))
        sys.stderr.write(said)
        return report_of(json.loads(place.read_text("utf-8")))


def stop_all() -> None:
    """End all processes of checks: the program is to end, and their reports are not wanted."""
    for child in list(_running):
        child.kill()


def check_here(request: Request) -> CheckReport:
    """Return the report of one asset, checked in this process; also of one that cannot be used."""
    try:
        return _checked(request)
    except Part2GSError as error:
        return _unusable(request.path, str(error))
    except MemoryError:
        return _unusable(request.path, f"{request.path}: its check needs more than the memory "
                         f"there is, or than {MEMORY >> 30} GB. Expected an object of ordinary "
                         "size; give simpler meshes.")


def _checked(request: Request) -> CheckReport:
    from part2gs_robotics.sim_checks import check

    path = Path(request.path)
    report = check(path, steps=request.steps, stress=request.stress,
                   root=Path(request.root) if request.root else None)
    began, compiled = time.perf_counter(), bool(report.joints)
    if request.stress and compiled:  # a model that does not compile has said so
        report = _stressed(report, path, Path(request.root) if request.root else None)
    if request.samples:
        from part2gs_robotics.chance import chances

        report = replace(report, results=(*report.results, *chances(path, request.samples)))
    return replace(report, seconds=report.seconds + time.perf_counter() - began)


def _stressed(report: CheckReport, path: Path, root: Path | None) -> CheckReport:
    """Return the report with the rows, numbers and pictures of extremes."""
    from part2gs_robotics.stress import stress

    study = stress(path, root)
    if study is None:
        return report
    return replace(report, results=(*report.results, *study.rows), stress=study.numbers)


def _ended(path: str, code: int, said: str) -> str:
    last = said.strip().splitlines()[-1][:200] if said.strip() else "no word"
    why = signal.Signals(-code).name if code < 0 else f"code {code}"
    return (f"{path}: the engine ended with {why} on it ({last}). Expected a model that the "
            "installed MuJoCo can load; simplify it until it does.")


def _unusable(path: str, said: str) -> CheckReport:
    from part2gs_robotics.sim_checks.result import CheckReport, CheckResult

    row = CheckResult("compile", Path(path).name, "fail", detail=said)  # which ends with what to do
    return CheckReport(path, "", (row,), unusable=said)


def main() -> None:
    """Answer the request on the command line, in the file named after it."""
    limit_memory()
    report = check_here(Request(**json.loads(sys.argv[1])))
    Path(sys.argv[2]).write_text(json.dumps(report.to_dict()), "utf-8")


def limit_memory() -> None:
    """Let this process have MEMORY and no more."""
    try:
        import resource  # POSIX alone; elsewhere the memory is the machine's

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    except (ImportError, ValueError, OSError) as error:
        logging.getLogger(__name__).warning("memory of the check is not limited: %s", error)
