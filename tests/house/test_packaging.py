"""What an installation adds, what importing costs, and what the repository promises."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import pytest
import yaml

import part2gs_robotics

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
# What `--help` must not pay for: each of these takes 0.2 to 2 s to import.
HEAVY = ("torch", "numba", "mujoco", "scipy", "cv2", "trimesh", "pymeshlab", "skimage")


def python(code: str, folder: Path) -> str:
    """Run code in a fresh interpreter whose folder is not the checkout."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, env=clean, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize("name", ["exporters", "sim_checks", "launch", "tests", "benchmarks"])
def test_only_one_import_name_is_added(tmp_path: Path, name: str) -> None:
    found = python(f"import importlib.util as u; print(u.find_spec({name!r}))", tmp_path)
    assert found == "None" or str(ROOT) not in found


def test_the_three_folders_are_one_package(tmp_path: Path) -> None:
    code = "import part2gs_robotics.exporters, part2gs_robotics.sim_checks, part2gs_robotics as p"
    assert python(f"{code}; print(p.__version__)", tmp_path) == part2gs_robotics.__version__


@pytest.mark.parametrize("module", ["part2gs_robotics", "part2gs_robotics.cli"])
def test_start_up_imports_nothing_heavy(tmp_path: Path, module: str) -> None:
    code = f"import sys, json, {module}; print(json.dumps(sorted(sys.modules)))"
    loaded = {name.partition(".")[0] for name in json.loads(python(code, tmp_path))}
    assert not loaded & set(HEAVY)


def test_help_lists_the_commands(tmp_path: Path) -> None:
    command = [str(Path(sys.executable).with_name("part2gs-robot")), "--help"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert all(word in done.stdout for word in ("build", "check", "capture"))


def test_versions_agree() -> None:
    version = PROJECT["project"]["version"]
    assert part2gs_robotics.__version__ == version
    assert ET.parse(ROOT / "package.xml").getroot().findtext("version") == version
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == version


def test_licences_agree() -> None:
    name = PROJECT["project"]["license"]
    assert ET.parse(ROOT / "package.xml").getroot().findtext("license") == name
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["license"] == name
    assert "Apache License" in (ROOT / "LICENSE").read_text()


def test_files_for_ros_exist() -> None:
    for target, patterns in PROJECT["tool"]["setuptools"]["data-files"].items():
        for pattern in patterns:
            assert list(ROOT.glob(pattern)), f"{target}: nothing matches {pattern}"


def test_constraints_lie_inside_the_declared_ranges() -> None:
    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = [Requirement(line) for line in lines if line and line[0] != "#"]
    pinned = {canonicalize_name(p.name): str(p.specifier).removeprefix("==") for p in pins}
    for text in PROJECT["project"]["dependencies"]:
        wanted = Requirement(text)
        assert wanted.specifier.contains(pinned[canonicalize_name(wanted.name)]), text


def test_the_readme_names_only_make_targets_that_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = set(re.findall(r"\bmake ([a-z-]+)", (ROOT / "README.md").read_text()))
    assert {"demo", "test"} <= named <= targets


@pytest.mark.parametrize("folder", ["part2gs_robotics", "exporters", "sim_checks"])
def test_folders_stay_flat_and_files_short(folder: str) -> None:
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    for path in files:
        assert path.parent == ROOT / folder, f"{path}: a sub-folder needs a line in `packages`"
        assert len(path.read_text().splitlines()) <= 300, f"{path}: split it by idea"


def test_the_wheel_holds_one_package_and_the_ros_files(tmp_path: Path) -> None:
    ignored = shutil.ignore_patterns(".*", "out", "build", "dist", "*.egg-info", "__pycache__")
    shutil.copytree(ROOT, tmp_path / "source", ignore=ignored)
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation"]
    subprocess.run([*command, "-w", ".", "./source"], cwd=tmp_path, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.stat().st_size < 500_000  # Python files alone; scenes and pictures are megabytes
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.partition("/")[0] for name in names}
    release = f"part2gs_robotics-{part2gs_robotics.__version__}"
    assert tops == {"part2gs_robotics", f"{release}.dist-info", f"{release}.data"}
    assert "part2gs_robotics/py.typed" in names
    assert "part2gs_robotics/exporters/__init__.py" in names
    share = f"{release}.data/data/share/part2gs_robotics"
    assert {f"{share}/package.xml", f"{share}/launch/display.launch.py"} <= set(names)


def test_the_bundled_scene_has_its_licence_and_stays_small() -> None:
    scene = ROOT / "examples/microwave"
    assert "MIT License" in (scene / "LICENSE").read_text()
    assert sum(p.stat().st_size for p in scene.rglob("*") if p.is_file()) < 6e6
