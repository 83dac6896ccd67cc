"""Keys of code: which changed files count, for stages and for kernels."""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from part2gs_robotics.runtime import hashing
from part2gs_robotics.runtime.hashing import code_version, hash_of_code, hash_of_imports

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "part2gs_robotics"
ROOMS = ["", "exporters", "sim_checks",
         *sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))]
KERNELS = re.compile(r"^@(?:parallel_)?kernel\b", re.MULTILINE)
WITH_KERNELS = [path for path in sorted(PACKAGE.rglob("*.py")) if KERNELS.search(path.read_text())]


def lay_out(folder: Path) -> Path:
    """Copy the package as a wheel lays it out, every room inside."""
    ignored = shutil.ignore_patterns("__pycache__")
    package = shutil.copytree(PACKAGE, folder / "part2gs_robotics", ignore=ignored)
    for room in ("exporters", "sim_checks"):
        shutil.copytree(ROOT / room, package / room, ignore=ignored)
    return package


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """An installed package, to be changed."""
    return lay_out(tmp_path)


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An installed package that each test leaves as it was."""
    return lay_out(tmp_path_factory.mktemp("installed"))


def change(path: Path) -> None:
    path.write_text(path.read_text() + "# changed\n")


def name_of(path: Path) -> str:
    return ".".join(("part2gs_robotics", *path.relative_to(PACKAGE).with_suffix("").parts))


def version_of(installed: Path) -> str:
    """Return what a process says that runs this copy."""
    code = "from part2gs_robotics.runtime.hashing import code_version; print(code_version())"
    folder = installed.parent
    done = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True, check=True,
                          cwd=folder, env={**os.environ, "PYTHONPATH": str(folder)})
    return done.stdout.strip()


@pytest.mark.parametrize("room", ROOMS)
def test_a_changed_line_in_any_room_changes_the_key(shared: Path, room: str) -> None:
    before = hash_of_code({"": shared})
    for path in (shared / room).glob("*.py"):
        source = path.read_bytes()
        change(path)
        assert hash_of_code({"": shared}) != before, path
        path.write_bytes(source)
    assert hash_of_code({"": shared}) == before


def test_a_checkout_and_an_installation_of_the_same_code_have_one_key(shared: Path) -> None:
    assert version_of(shared) == code_version()


def test_a_process_sees_what_changed_in_its_own_code(installed: Path) -> None:
    before = version_of(installed)
    change(installed / "sim_checks/__init__.py")
    assert version_of(installed) != before


def test_names_count_as_much_as_contents(installed: Path) -> None:
    before = hash_of_code({"": installed})
    (installed / "model/grid.py").rename(installed / "model/lattice.py")
    renamed = hash_of_code({"": installed})
    (installed / "model/lattice.py").rename(installed / "mesh/grid.py")
    assert len({before, renamed, hash_of_code({"": installed})}) == 3


def test_only_source_counts(installed: Path) -> None:
    before = hash_of_code({"": installed})
    (installed / "fit/__pycache__").mkdir()
    (installed / "fit/__pycache__/hull.cpython-311.pyc").write_bytes(b"compiled")
    (installed / "fit/notes.txt").write_text("to do")
    assert hash_of_code({"": installed}) == before


def test_tests_and_benchmarks_do_not_count() -> None:
    folders = {"": PACKAGE, "exporters": ROOT / "exporters", "sim_checks": ROOT / "sim_checks"}
    assert code_version() == hash_of_code(folders)


@pytest.mark.parametrize("path", WITH_KERNELS, ids=name_of)
def test_a_kernel_depends_on_every_file_that_its_own_imports(path: Path) -> None:
    found = hashing._imported(name_of(path))
    assert path.relative_to(PACKAGE).as_posix() in found
    for name in found:
        for node in ast.parse(found[name]).body:
            if isinstance(node, ast.Import | ast.ImportFrom):
                assert wanted_files(node) <= set(found), name


def wanted_files(node: ast.Import | ast.ImportFrom) -> set[str]:
    """Return the files of the package that one statement reads."""
    if isinstance(node, ast.ImportFrom):
        assert node.level == 0, "a relative import is not followed"
        modules = [node.module or "", *(f"{node.module}.{a.name}" for a in node.names)]
    else:
        modules = [a.name for a in node.names]
    names = ["/".join(m.split(".")[1:]) for m in modules if m.split(".")[0] == PACKAGE.name]
    files = [f"{name}{end}" for name in names for end in ("/__init__.py", ".py")]
    return {file for file in files if (PACKAGE / file).is_file()}


def test_a_kernel_changes_with_a_helper_of_a_helper_alone(installed: Path,
                                                          monkeypatch: pytest.MonkeyPatch) -> None:
    def now() -> str:
        hashing._read.cache_clear()
        return hash_of_imports("part2gs_robotics.render.backward")

    monkeypatch.setattr(hashing, "ROOT", installed)
    before = now()
    change(installed / "report/html.py")
    assert now() == before
    change(installed / "runtime/simd.py")  # through fast_math too
    assert now() != before
    hashing._read.cache_clear()
