"""A model file as MuJoCo can open it: names of packages resolved, OpenUSD translated."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.sax.saxutils import quoteattr

from part2gs_robotics.assets.model_files import check_model_files, home_of, package_file
from part2gs_robotics.errors import CheckError

USD = frozenset([".usd", ".usda", ".usdc", ".usdz"])
PACKAGE = re.compile(r"""(["'])(package://[^"']*)\1""")


@contextmanager
def opened(path: Path, root: Path | None = None) -> Iterator[Path]:
    """Inspect a model, and give a file of the same name that the engine opens.

    It is the file itself unless something must be said otherwise; then a copy beside nothing of the
    user's, gone afterwards.

    Args:
        path: MJCF, URDF or USD.
        root: folder that nothing may leave; None = that of `home_of`.

    Raises:
        CheckError: as `check_model_files`, and if a package or a stage cannot be used.
    """
    home = home_of(path, root)
    if path.suffix.lower() in USD:
        from part2gs_robotics.assets.usd_model import write_mjcf_of

        with tempfile.TemporaryDirectory(prefix="part2gs-usd-") as folder:
            yield write_mjcf_of(path, home, Path(folder))
        return
    check_model_files(path, root)
    text = path.read_text("utf-8", "replace")
    if "package://" not in text:
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="part2gs-urdf-") as folder:
        copy = Path(folder) / path.name
        copy.write_text(_absolute(text, path, home), "utf-8")
        yield copy


def _absolute(text: str, path: Path, home: Path) -> str:
    """Return XML with every package:// and relative mesh replaced by the file it means."""

    def found(match: re.Match[str]) -> str:
        file = package_file(match[2], path, home)
        if file is None:
            raise CheckError(
                f"{path}: refers to {match[2][:200]!r}, which is not found. Expected the package's "
                f"folder above the model within {home}, or named with --root.")
        return quoteattr(str(file))

    def beside(match: re.Match[str]) -> str:
        file = path.resolve().parent / match[2]
        return f"{match[1]}{quoteattr(str(file))}" if file.is_file() else match[0]

    text = PACKAGE.sub(found, text)
    return re.sub(r"""(filename=)["']([^"':]+)["']""", beside, text)
