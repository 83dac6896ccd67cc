"""Inspect MJCF and URDF files of others before MuJoCo opens them."""

from __future__ import annotations

import math
import re
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
# What makes the engine reserve memory, and how much: a large terrain, more copies than needed.
_COUNTS = {"width": 1 << 14, "height": 1 << 14, "nrow": 1 << 12, "ncol": 1 << 12, "count": 10_000,
           "nuserdata": 1 << 20, "nuser_body": 1 << 12, "nconmax": 1 << 22, "njmax": 1 << 22}
_FORMAT = re.compile(r"%[-+ #0-9.*]*(?:[hlLqjzt]*)[ns]")  # of C: %s reads and %n writes anywhere
_REPEATS = "replicate"  # whose counts multiply where one stands in another
# MuJoCo parses what these name as XML, whatever the file is called.
_XML_TAGS = frozenset(["include", "model"])


def home_of(path: Path, root: Path | None = None) -> Path:
    """Return the folder that nothing of a model may leave.

    The one the user named; else the ROS package the file lies in, which a package.xml marks; else
    the file's own folder.

    Args:
        path: main MJCF or URDF file.
        root: named by the user; the file must lie in it.

    Raises:
        CheckError: if the file does not lie in `root`.
    """
    own = path.resolve().parent
    if root is not None:
        if not own.is_relative_to(root.resolve()):
            raise CheckError(f"{path}: does not lie in {root}. Expected --root to be a folder "
                             "above the model, where all its files are.")
        return root.resolve()
    return next((f for f in (own, *own.parents) if (f / "package.xml").is_file()), own)


def package_file(name: str, path: Path, home: Path) -> Path | None:
    """Return the file that `package://PACKAGE/place` means, None if there is none.

    PACKAGE is a folder above the model, or beside one of those, within its home.

    Args:
        name: as it stands in the model.
        path: of the model.
        home: of `home_of`.
    """
    package, _, place = name.removeprefix("package://").partition("/")
    own = path.resolve().parent
    above = [f for f in (own, *own.parents) if f.is_relative_to(home)]
    tried = [f / package / place for f in above]
    tried += [f / place for f in above if f.name == package or (f / "package.xml").is_file()]
    tried += [own / place, own / Path(place).name]
    return next((f.resolve() for f in tried
                 if f.is_file() and f.resolve().is_relative_to(home)), None)


def check_model_files(path: Path, root: Path | None = None) -> tuple[Path, ...]:
    """Return every XML file of a model whose references stay inside its own folder.

    MuJoCo itself follows `../`, absolute paths and links, so this runs before it sees the file.
    What `<include>` and `<model>` name is inspected in turn, whatever its suffix.

    Args:
        path: main MJCF or URDF file.
        root: folder that nothing may leave, if not that of `home_of`.

    Returns:
        The main file and every included file.

    Raises:
        CheckError: unreadable or malformed XML, a document type declaration (entities), more than
            200 files or 64 MB, or a reference that leaves the folder of `path`.
    """
    folder, own = home_of(path, root), path.resolve().parent
    bases, named, seen = [own], dict[tuple[str, bool], Path](), list[Path]()
    waiting, budget = [path], MAX_XML_BYTES
    while waiting:
        current = waiting[0]
        seen.append(current)
        content = _read(current, budget)
        budget -= len(content)
        folders, files = _references(content, current)
        named = dict.fromkeys(files, current) | named
        places = [own, current.resolve().parent]
        bases += places + [f for name in folders for f in _inside(name, places, folder, current)]
        bases = list(dict.fromkeys(bases))
        # a folder set in one file holds in all of them: names found earlier are looked up again
        documents = {name: where for (name, xml), where in named.items() if xml}
        waiting = _unseen(documents, bases, folder, seen)
    for (name, _), where in named.items():
        if not (name.startswith("package://") and package_file(name, path, folder)):
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
    folders, files, copies = list[str](), list[tuple[str, bool]](), [1.0]

    def start(tag: str, attributes: dict[str, str]) -> None:
        odd = next((v for v in attributes.values() if _FORMAT.search(v)), None)
        if odd is not None:
            raise CheckError(f"{where}: <{tag}> says {odd[:60]!r}, which the engine's messages "
                             "take for a format, and abort. Expected plain names; remove the %.")
        copies.append(copies[-1] * _counted(tag, attributes, copies[-1], where))
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
    parser.EndElementHandler = lambda _: copies.pop()
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise CheckError(
            f"{where}:{error.lineno}: is not well-formed XML ({expat.ErrorString(error.code)}). "
            "Expected an MJCF or URDF file; repair it or give another file."
        ) from None
    except (LookupError, ValueError) as error:  # an encoding that Python knows not, or not singly
        raise CheckError(
            f"{where}: has an encoding that cannot be read ({error}). Expected UTF-8; correct the "
            "<?xml ...?> line."
        ) from None
    return folders, files


def _counted(tag: str, attributes: dict[str, str], copies: float, where: Path) -> float:
    """Return how often an element's content is repeated; refuse what would fill the memory."""
    for key, most in _COUNTS.items():
        words = attributes.get(key, "").split() if key in attributes else []
        sizes = [abs(float(w)) for w in words if w.replace(".", "", 1).lstrip("+").isdigit()]
        total = math.prod(sizes) * (copies if tag == _REPEATS else 1.0)
        if total > most:
            raise CheckError(f"{where}: <{tag} {key}={attributes[key][:60]!r}> asks for {total:g}, "
                             f"more than {most}. Expected an object of ordinary size; lower it.")
    repeated = attributes.get("count", "1") if tag == _REPEATS else "1"
    return max(float(repeated), 1.0) if repeated.isdigit() else 1.0


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
            "folder; copy the file there and use a relative path, or name a folder above it with "
            "--root."
        )
    return inside
