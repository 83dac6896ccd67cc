"""Dependencies: what is declared is used, what is used is declared, and each has its reason."""

from __future__ import annotations

import ast
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
PRODUCT = "part2gs_robotics", "exporters", "sim_checks"
WORKSHOP = "tests", "benchmarks"
IMPORTED_AS = {  # where a package and its import differ by more than a dash
    "opencv-contrib-python-headless": "cv2", "pyyaml": "yaml", "scikit-image": "skimage",
    "usd-core": "pxr", "pillow": "PIL",
}  # fmt: skip
WITHOUT_IMPORT = {
    "tbb": "runtime/jit.py opens its library by path: it holds nothing to import",
    "ruff": "`make lint` runs it",
    "mypy": "`make lint` runs it",
    "types-pyyaml": "mypy reads it",
    "colcon-common-extensions": "test_launch.py runs its command",
    "catkin-pkg": "test_launch.py imports it where it is installed, by name",
    "cmeel-urdfdom": "benchmarks/judges.py runs its check_urdf",
    "simcheck": "benchmarks/judges.py runs its command",
    "pillow": "view/server.py hands pictures to viser with it",
    "submitit": "test_batch.py runs it through commands/batch_on.py",
    "onnxruntime": "tests/salient run it through salient/network.py",
    "setuptools": "setup.py and pip's builds without isolation import it",
}

HOST = ("part2gs_robotics/ci/pytest_plugin.py", "pytest")  # pytest loads it, so it is there


EXTRAS = ("gpu", "usd", "photos", "view", "masks", "batch", "slurm")


@cache
def requirements(kind: str) -> dict[str, str]:
    """Return what `pyproject.toml` asks for at run time or in an extra: package -> its line."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = project["dependencies"] if kind == "run" else project["optional-dependencies"][kind]
    return {canonicalize_name(Requirement(line).name): line for line in lines}


def import_name(package: str) -> str:
    return IMPORTED_AS.get(package, package.replace("-", "_"))


@cache
def imported(folders: tuple[str, ...]) -> dict[str, str]:
    """Return what the folders' files import from outside the repository: name -> one such file."""
    files = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    ours = {path.stem for path in files} if folders == WORKSHOP else set()  # bare names, no package
    found: dict[str, str] = {}
    for path in files:
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names = [node.module]
            for name in {name.partition(".")[0] for name in names}:
                found.setdefault(name, str(path.relative_to(ROOT)))
    return {name: file for name, file in found.items()
            if name not in sys.stdlib_module_names | ours | {"part2gs_robotics"}}


@pytest.mark.parametrize(("kind", "folders"), [("run", PRODUCT), ("gpu", PRODUCT), ("usd", PRODUCT),
                                               ("photos", PRODUCT), ("view", PRODUCT),
                                               ("masks", PRODUCT), ("batch", PRODUCT),
                                               ("slurm", PRODUCT),
                                               ("dev", WORKSHOP)])
def test_what_is_declared_is_imported(kind: str, folders: tuple[str, ...]) -> None:
    used = imported(folders)
    idle = {name for name in requirements(kind) if import_name(name) not in used}
    assert not idle - set(WITHOUT_IMPORT), "declared and never imported"


@pytest.mark.parametrize(("kinds", "folders"), [(("run", *EXTRAS), PRODUCT),
                                                (("run", "dev", "bench"), WORKSHOP)])
def test_what_is_imported_is_declared(kinds: tuple[str, ...], folders: tuple[str, ...]) -> None:
    known = {import_name(name) for kind in kinds for name in requirements(kind)}
    known |= {HOST[1]} if folders == PRODUCT else set()
    stray = {name: file for name, file in imported(folders).items() if name not in known}
    assert not stray, "imported and not declared"


def test_exceptions_are_still_needed() -> None:
    assert imported(PRODUCT)[HOST[1]] == HOST[0]
    plain = [path for path in (ROOT / "part2gs_robotics").rglob("*.py")
             if HOST[1] in path.read_text() and str(path.relative_to(ROOT)) != HOST[0]]
    assert all("import pytest" not in path.read_text() for path in plain)
    assert set(WITHOUT_IMPORT) | set(IMPORTED_AS) <= set(requirements("run") | requirements("dev"))
    for kind, folders in (("run", PRODUCT), ("dev", WORKSHOP)):
        for name in requirements(kind).keys() & WITHOUT_IMPORT.keys():
            assert import_name(name) not in imported(folders), f"{name} is imported after all"


@pytest.mark.parametrize("kind", ["run", "dev", *EXTRAS])
def test_every_dependency_has_its_reason_beside_it(kind: str) -> None:
    lines = (ROOT / "pyproject.toml").read_text().splitlines()
    for requirement in requirements(kind).values():
        beside = [line.partition(f'"{requirement}"')[2] for line in lines]
        assert any("#" in rest for rest in beside), f"{requirement}: what for?"
