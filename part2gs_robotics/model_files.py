"""Inspect MJCF and URDF files of others before MuJoCo opens them."""

from __future__ import annotations

from pathlib import Path
from xml.parsers import expat

from part2gs_robotics.errors import CheckError

# A large robot with all its includes stays far below; a bomb does not.
MAX_XML_BYTES = 64 << 20
MAX_XML_FILES = 200
_FOLDER_ATTRIBUTES = ("meshdir", "texturedir", "assetdir")
_FILE_ATTRIBUTES = frozenset(
    ["file", "filename", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback"]
)
_XML_SUFFIXES = (".xml", ".mjcf", ".urdf")


def check_model_files(path: Path) -> tuple[Path, ...]:
    """Return every XML file of a model whose references stay inside its own folder.

    MuJoCo itself follows `../`, absolute paths and links, so this runs before it sees the file.

    Args:
        path: main MJCF or URDF file.

    Returns:
        The main file and every included file.

    Raises:
        CheckError: unreadable or malformed XML, a document type declaration (entities), more than
            200 files or 64 MB, or a reference that leaves the folder of `path`.
    """
    folder = path.resolve().parent
    waiting, seen, budget = [path], list[Path](), MAX_XML_BYTES
    while waiting:
        current = waiting.pop()
        if current in seen:
            continue
        seen.append(current)
        content = _read(current, budget)
        budget -= len(content)
        folders, files = _references(content, current)
        bases = [folder, current.resolve().parent] + [
            _inside(name, [folder], folder, current) for name in folders
        ]
        for name in files:
            target = _inside(name, bases, folder, current)
            if target.suffix.lower() in _XML_SUFFIXES and target.is_file():
                waiting.append(target)
        if len(seen) + len(waiting) > MAX_XML_FILES:
            raise CheckError(
                f"{path}: includes more than {MAX_XML_FILES} files. "
                "Expected one model; check for includes that repeat themselves."
            )
    return tuple(seen)


def _read(path: Path, budget: int) -> bytes:
    try:
        if path.stat().st_size > budget:
            raise CheckError(
                f"{path}: the model's XML exceeds {MAX_XML_BYTES >> 20} MB. "
                "Expected text that refers to mesh files; move inline vertices into mesh files."
            )
        return path.read_bytes()
    except OSError as error:
        raise CheckError(
            f"{path}: cannot be read ({error.strerror}). "
            "Expected an MJCF or URDF file; check the path."
        ) from None


def _references(content: bytes, where: Path) -> tuple[list[str], list[str]]:
    """Return the asset folders and the file names that one XML document mentions."""
    folders, files = list[str](), list[str]()

    def start(tag: str, attributes: dict[str, str]) -> None:
        for key, value in attributes.items():
            if tag == "compiler" and key in _FOLDER_ATTRIBUTES:
                folders.append(value)
            elif key in _FILE_ATTRIBUTES and value:
                files.append(value)

    def refuse(*_: object) -> None:
        raise CheckError(
            f"{where}: has a document type declaration. Models are read without entities; "
            "expected plain MJCF or URDF: remove the <!DOCTYPE ...> line."
        )

    parser = expat.ParserCreate()
    parser.StartElementHandler = start
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise CheckError(
            f"{where}:{error.lineno}: is not well-formed XML ({expat.ErrorString(error.code)}). "
            "Expected an MJCF or URDF file; repair it or give another file."
        ) from None
    return folders, files


def _inside(name: str, bases: list[Path], folder: Path, where: Path) -> Path:
    """Return where `name` points, refusing whatever could leave `folder`."""
    plain = name.removeprefix("package://")
    candidates = [(base / plain).resolve() for base in bases]
    inside = [c for c in candidates if c.is_relative_to(folder)]
    outside = [c for c in candidates if not c.is_relative_to(folder) and c.exists()]
    if "://" in plain or "\\" in plain or Path(plain).is_absolute() or outside or not inside:
        raise CheckError(
            f"{where}: refers to {name!r}, which leaves the folder {folder}. "
            "Expected every mesh, texture and include below the model's own folder; "
            "copy the file there and use a relative path."
        )
    return next((c for c in inside if c.exists()), inside[0])
