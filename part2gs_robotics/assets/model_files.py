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
# MuJoCo parses what these name as XML, whatever the file is called.
_XML_TAGS = frozenset(["include", "model"])


def check_model_files(path: Path) -> tuple[Path, ...]:
    """Return every XML file of a model whose references stay inside its own folder.

    MuJoCo itself follows `../`, absolute paths and links, so this runs before it sees the file.
    What `<include>` and `<model>` name is inspected in turn, whatever its suffix.

    Args:
        path: main MJCF or URDF file.

    Returns:
        The main file and every included file.

    Raises:
        CheckError: unreadable or malformed XML, a document type declaration (entities), more than
            200 files or 64 MB, or a reference that leaves the folder of `path`.
    """
    folder = path.resolve().parent
    bases, named, seen = [folder], dict[tuple[str, bool], Path](), list[Path]()
    waiting, budget = [path], MAX_XML_BYTES
    while waiting:
        current = waiting[0]
        seen.append(current)
        content = _read(current, budget)
        budget -= len(content)
        folders, files = _references(content, current)
        named = dict.fromkeys(files, current) | named
        own = [folder, current.resolve().parent]
        bases += own + [f for name in folders for f in _inside(name, own, folder, current)]
        bases = list(dict.fromkeys(bases))
        # a folder set in one file holds in all of them: names found earlier are looked up again
        documents = {name: where for (name, xml), where in named.items() if xml}
        waiting = _unseen(documents, bases, folder, seen)
    for (name, _), where in named.items():
        _inside(name, bases, folder, where)
    return tuple(seen)


def _unseen(
    documents: dict[str, Path], bases: list[Path], folder: Path, seen: list[Path]
) -> list[Path]:
    """Return every file the names can mean: which base wins is the simulator's affair."""
    if len(documents) >= MAX_XML_FILES or len(seen) > MAX_XML_FILES:
        raise CheckError(
            f"{seen[0]}: includes more than {MAX_XML_FILES} files. "
            "Expected one model; check for includes that repeat themselves."
        )
    known = {file.resolve() for file in seen}
    meant = [f for name, where in documents.items() for f in _inside(name, bases, folder, where)]
    return [file for file in dict.fromkeys(meant) if file not in known and file.is_file()]


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


def _references(content: bytes, where: Path) -> tuple[list[str], list[tuple[str, bool]]]:
    """Return asset folders and (file name, whether it is XML) that one document mentions."""
    folders, files = list[str](), list[tuple[str, bool]]()

    def start(tag: str, attributes: dict[str, str]) -> None:
        for key, value in attributes.items():
            if tag == "compiler" and key in _FOLDER_ATTRIBUTES:
                folders.append(value)
            elif key in _FILE_ATTRIBUTES and value:
                files.append((value, tag in _XML_TAGS))

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


def _inside(name: str, bases: list[Path], folder: Path, where: Path) -> list[Path]:
    """Return where `name` may point, refusing whatever could leave `folder`."""
    plain = name.removeprefix("package://")
    try:
        candidates = [(base / plain).resolve() for base in bases]
        inside = [c for c in candidates if c.is_relative_to(folder)]
        outside = [c for c in candidates if c.exists() and not c.is_relative_to(folder)]
    except (OSError, ValueError, RuntimeError):  # too long a name, a loop of links
        inside, outside = [], []
    if "://" in plain or "\\" in plain or Path(plain).is_absolute() or outside or not inside:
        raise CheckError(
            f"{where}: refers to {name[:200]!r}, which leaves the folder {folder} "
            "or is no file name. Expected every mesh, texture and include below the model's own "
            "folder; copy the file there and use a relative path."
        )
    return inside
