"""What an installation adds, what importing costs, and what the repository promises."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import pytest
import yaml

import part2gs_robotics
from part2gs_robotics.runtime.hashing import hash_of_code

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


# Where each part of the package lies in the repository.
PLACES = {"part2gs_robotics": "part2gs_robotics", "part2gs_robotics/exporters": "exporters",
          "part2gs_robotics/sim_checks": "sim_checks"}  # fmt: skip


def sources() -> set[str]:
    """Return every Python file of the package, by the name it has when installed."""
    return {f"{name}/{path.relative_to(ROOT / folder).as_posix()}"
            for name, folder in PLACES.items() for path in (ROOT / folder).rglob("*.py")}


def test_every_folder_with_code_is_packaged() -> None:
    settings = PROJECT["tool"]["setuptools"]
    folders = {name.rpartition("/")[0].replace("/", ".") for name in sources()}
    assert sorted(settings["packages"]) == sorted(folders)
    outside = {name.replace("/", "."): folder for name, folder in PLACES.items() if name != folder}
    assert settings["package-dir"] == outside
    for folder in folders:
        assert f"{folder.replace('.', '/')}/__init__.py" in sources(), f"{folder} has no face"


def test_every_file_beside_the_code_is_packaged() -> None:
    data = {path.relative_to(ROOT).as_posix() for folder in PLACES.values()
            for path in (ROOT / folder).rglob("*")
            if path.is_file() and path.suffix != ".py" and "__pycache__" not in path.parts}
    (package, names), = PROJECT["tool"]["setuptools"]["package-data"].items()
    assert data == {f"{package}/{name}" for name in names}


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the sdist of a clean copy, and the wheel of the unpacked sdist."""
    folder = tmp_path_factory.mktemp("built")
    ignored = shutil.ignore_patterns(".*", "out", "build", "dist", "*.egg-info", "__pycache__")
    shutil.copytree(ROOT, folder / "source", ignore=ignored)
    make = "import sys; from setuptools import build_meta as b; b.build_sdist(sys.argv[1])"
    subprocess.run([sys.executable, "-c", make, str(folder)], cwd=folder / "source", check=True,
                   capture_output=True)
    (sdist,) = folder.glob("*.tar.gz")
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation"]
    subprocess.run([*command, "-w", ".", str(sdist)], cwd=folder, check=True, capture_output=True)
    return folder


def test_the_sdist_holds_every_room(built: Path) -> None:
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    folders = {name: folder for name, folder in PLACES.items() if name != folder}
    for name in sources():
        place = next((f for f in folders if name.startswith(f"{f}/")), None)
        assert (name if place is None else name.removeprefix("part2gs_robotics/")) in names
    assert {"part2gs_robotics/measured_terms.json", "package.xml", "setup.py"} <= names


def test_the_wheel_holds_one_package_and_the_ros_files(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    assert wheel.stat().st_size < 1_100_000  # code and three.js; scenes and pictures are megabytes
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.partition("/")[0] for name in names}
    release = f"part2gs_robotics-{part2gs_robotics.__version__}"
    assert tops == {"part2gs_robotics", f"{release}.dist-info", f"{release}.data"}
    (listed,) = PROJECT["tool"]["setuptools"]["package-data"].values()
    data = {f"part2gs_robotics/{name}" for name in listed}
    assert {name for name in names if name.startswith("part2gs_robotics/")} == sources() | data
    share = f"{release}.data/data/share/part2gs_robotics"
    assert {f"{share}/package.xml", f"{share}/launch/display.launch.py"} <= set(names)


def test_the_wheel_runs_outside_of_the_checkout(built: Path, tmp_path: Path) -> None:
    (wheel,) = built.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(tmp_path)
    # The first folder of the path wins over the checkout, which an editable installation adds last.
    code = ("import sys; sys.path.insert(0, '.')\n"
            "from importlib import import_module\n"
            "from pathlib import Path\n"
            "from pkgutil import walk_packages\n"
            "import part2gs_robotics as p\n"
            "for found in walk_packages(p.__path__, 'part2gs_robotics.'):\n"
            "    if not found.name.endswith('__main__'):\n"
            "        import_module(found.name)\n"
            "places = {Path(m.__file__) for n, m in sys.modules.items()\n"
            "          if n.startswith('part2gs_robotics.')}\n"
            "assert all(place.is_relative_to(Path.cwd()) for place in places), places\n"
            "from part2gs_robotics.plan import _measured\n"
            "assert _measured('alignment')\n"
            "from part2gs_robotics.runtime.hashing import code_version\n"
            "print(code_version())")
    source = {name.partition("/")[2]: built / "source" / folder for name, folder in PLACES.items()}
    assert python(code, tmp_path) == hash_of_code(source)


def test_the_bundled_scene_has_its_licence_and_stays_small() -> None:
    scene = ROOT / "examples/microwave"
    assert "MIT License" in (scene / "LICENSE").read_text()
    assert sum(p.stat().st_size for p in scene.rglob("*") if p.is_file()) < 6e6
