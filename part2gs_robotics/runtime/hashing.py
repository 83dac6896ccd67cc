"""Keys of stages and kernels: hashes of everything a result depends on, source files included."""

from __future__ import annotations

import hashlib
import json
import re
import sys
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

PACKAGE = "part2gs_robotics"
ROOT = Path(__file__).resolve().parents[1]
BESIDE = ("exporters", "sim_checks")  # rooms that a checkout keeps beside the package, not in it
# Everything whose version can change a number of the report.
ENGINES = (
    "mujoco", "manifold3d", "trimesh", "pymeshlab", "numpy", "numba", "torch", "scipy",
    "scikit-image",
)  # fmt: skip
_IMPORT = re.compile(rf"^(?:from|import) +{PACKAGE}\b([.\w]*)", re.MULTILINE)


def hash_of(*parts: object) -> str:
    """Return a sha256 of plain data, arrays and bytes, in order."""
    digest = hashlib.sha256()
    for part in parts:
        _update(digest, part)
    return digest.hexdigest()


def _update(digest: hashlib._Hash, part: object) -> None:
    numpy = sys.modules.get("numpy")  # where nobody has loaded it, nothing is an array
    if numpy is not None and isinstance(part, numpy.ndarray):
        digest.update(f"{part.dtype}{part.shape}".encode())
        digest.update(numpy.ascontiguousarray(part).tobytes())
    elif isinstance(part, bytes):
        digest.update(part)
    elif isinstance(part, tuple | list):
        digest.update(f"[{len(part)}".encode())
        for item in part:
            _update(digest, item)
    else:
        digest.update(json.dumps(part, sort_keys=True, default=str).encode())


def code_version() -> str:
    """Return a hash of the package's source: changed code never reuses old stages.

    All rooms count, those behind the last stage too: a list of exceptions would be wrong without
    a sign once a stage uses one of them. Installed or in a checkout, the same code has one hash.
    """
    return hash_of_code({"": ROOT, **{name: _folder_of(name) for name in BESIDE}})


def engine_versions(*more: str) -> dict[str, str]:
    """Return the installed version of every package that can change a number, and of some more."""
    found = {}
    for name in (*ENGINES, *more):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def hash_of_code(folders: Mapping[str, Path]) -> str:
    """Return a hash of the names and contents of all Python files.

    Args:
        folders: place inside the package, "" for its root -> folder, read with those below it.
    """
    return _hash_of_files({(Path(place) / path.relative_to(folder)).as_posix(): path.read_bytes()
                           for place, folder in folders.items()
                           for path in folder.rglob("*.py")})


def hash_of_imports(module: str) -> str:
    """Return a hash of a module's file and of all that it imports at its top, to the last one.

    A compiled kernel holds the functions and constants that its file imported, so this changes
    whenever the kernel may.

    Args:
        module: full name of a module of this package, outside of the rooms beside it.

    Raises:
        FileNotFoundError: there is no such module, or it imports one that is not there.
    """
    return _hash_of_files(_imported(module))


def _imported(module: str) -> dict[str, bytes]:
    """Return a module's file and all files of the package that its imports may read, by name."""
    found: dict[str, bytes] = {}
    waiting = [module.removeprefix(PACKAGE)]
    while waiting:
        for path in _files_of(waiting.pop()):
            name = path.relative_to(ROOT).as_posix()
            if name not in found:
                found[name] = _read(path)
                waiting += _IMPORT.findall(found[name].decode())
    return found


def _files_of(name: str) -> list[Path]:
    """Return the files that an import of a dotted name below the package may read."""
    path = ROOT.joinpath(*name.split(".")[1:])
    # Of a folder any file may be meant: `from room import file` looks like `from room import name`.
    return sorted(path.glob("*.py")) if path.is_dir() else [path.with_suffix(".py")]


@cache
def _read(path: Path) -> bytes:
    return path.read_bytes()  # kernels share most of what they import


def _hash_of_files(files: Mapping[str, bytes]) -> str:
    digest = hashlib.sha256()
    for name, content in sorted(files.items()):
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


def _folder_of(room: str) -> Path:
    """Return the folder of a room; it is looked up, not imported."""
    spec = find_spec(f"{PACKAGE}.{room}")
    if spec is None or not spec.submodule_search_locations:
        raise ModuleNotFoundError(f"{PACKAGE}.{room} is missing. Expected it to be installed with "
                                  "the package; install part2gs-robotics again.")
    return Path(next(iter(spec.submodule_search_locations)))


def digest_of_text_or_picture(path: Path) -> str:
    """Return the sha256 of a file, the same whether its lines end as on Windows or not."""
    data = path.read_bytes()
    return hashlib.sha256(data if path.suffix == ".png" else data.replace(b"\r\n", b"\n")
                          ).hexdigest()
