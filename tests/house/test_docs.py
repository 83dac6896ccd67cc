"""The documents: short where they must be; paths, links and error texts in them exist."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CODE = ("part2gs_robotics", "exporters", "sim_checks")
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), ROOT / "examples/README.md"])
USER_ERRORS = {"SceneError", "ConfigError", "FitError", "MeshError", "EmptyPartError",
               "ExportError", "CheckError", "StoreError"}  # fmt: skip
FOLDER = re.compile(r"(?:part2gs_robotics|exporters|sim_checks|benchmarks|tests|docs|launch)/")
# What docs name and the repository does not hold: files of a scene or twin, and of other tools.
ELSEWHERE = {"suite.py", "setup.py", "control.launch.py"}


def ids(pages: list[Path]) -> list[str]:
    return [str(page.relative_to(ROOT)) for page in pages]


def prose(text: str) -> list[str]:
    """Return a page's lines but for code, tables and what scripts write between markers."""
    text = re.sub(r"^(<!-- (\w+):begin -->).*?(<!-- \2:end -->)$", "", text,
                  flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)
    return [line for line in text.splitlines() if not line.startswith(("|", "    "))]


def spans(text: str) -> list[str]:
    """Return what stands in backticks."""
    return re.findall(r"`([^`\n]+)`", text)


@cache
def names() -> dict[str, list[Path]]:
    """Return every Python file of the repository by its bare name."""
    found: dict[str, list[Path]] = {}
    for folder in (*CODE, "benchmarks", "tests", "launch", "examples"):
        for path in (ROOT / folder).rglob("*.py"):
            found.setdefault(path.name, []).append(path)
    return found


@cache
def literals() -> tuple[str, ...]:
    """Return every unbroken text of the program's strings, documentation left out."""
    found = []
    for folder in CODE:
        for path in sorted((ROOT / folder).rglob("*.py")):
            tree = ast.parse(path.read_text())
            said = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
            found += [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant)
                      and isinstance(n.value, str) and id(n) not in said]
    return tuple(found)


def quoted() -> list[str]:
    """Return the texts in the first column of the troubleshooting page."""
    text = (ROOT / "docs/troubleshooting.md").read_text()
    cells = [line.split("|")[1] for line in text.splitlines() if line.startswith("|")]
    return [span for cell in cells for span in spans(cell)]


@pytest.mark.parametrize("page", PAGES, ids=ids(PAGES))
def test_every_file_that_a_page_names_exists(page: Path) -> None:
    for span in spans(page.read_text()):
        for word in re.findall(r"[\w./*{},-]+\.py\b|[\w./-]+/", span):
            path = word.removeprefix("python ").rstrip("/")
            if FOLDER.match(word):
                assert list(ROOT.glob(path)), f"{page.name}: `{span}`"
            elif path.endswith(".py") and path not in ELSEWHERE:
                same = names().get(Path(path).name, [])
                assert any(str(one).endswith(f"/{path}") for one in same), f"{page.name}: `{span}`"


@pytest.mark.parametrize("page", PAGES, ids=ids(PAGES))
def test_every_link_leads_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if not target.startswith(("http", "mailto:")):
            path, _, anchor = target.partition("#")
            found = (page.parent / path).resolve() if path else page
            assert found.exists(), f"{page.name}: {target}"
            if anchor:
                titles = [re.sub(r"[^\w -]", "", line.lstrip("# ").lower()).replace(" ", "-")
                          for line in found.read_text().splitlines() if line.startswith("#")]
                assert anchor in titles, f"{page.name}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=ids(PAGES))
def test_prose_is_wrapped(page: Path) -> None:
    for line in prose(page.read_text()):
        assert len(line) <= 120 or "](" in line, f"{page.name}: {line}"


def test_the_index_names_every_page() -> None:
    index = (ROOT / "docs/README.md").read_text()
    for page in (ROOT / "docs").glob("*.md"):
        assert page.name == "README.md" or f"({page.name})" in index, page.name


def test_pages_that_are_read_first_are_short() -> None:
    readme = (ROOT / "README.md").read_text()
    assert len(readme.splitlines()) <= 120
    assert len(readme.split("\n## ")[0].splitlines()) <= 45, "the first screen"
    assert len((ROOT / "CONTRIBUTING.md").read_text().splitlines()) <= 40
    rooms = (ROOT / "docs/method.md").read_text().split("\n## ")[1:]
    assert all(len(room.splitlines()) <= 35 for room in rooms)


def test_method_has_a_page_for_every_folder_and_names_its_files() -> None:
    pages = {page.split("\n")[0]: page
             for page in (ROOT / "docs/method.md").read_text().split("\n## ")[1:]}
    rooms = [path.parent for path in (ROOT / "part2gs_robotics").glob("*/__init__.py")]
    for room in (*rooms, ROOT / "exporters", ROOT / "sim_checks"):
        page = next((text for title, text in pages.items() if room.name in title.split()), "")
        for path in room.glob("*.py"):
            named = path.name == "__init__.py" or f"`{path.name}`" in page
            assert named, f"{room.name}: {path.name}"


@pytest.mark.parametrize("text", quoted())
def test_every_text_to_search_for_is_said_by_the_program(text: str) -> None:
    assert any(text in literal for literal in literals())


def test_every_error_of_a_user_is_on_the_page() -> None:
    known = quoted()
    for folder in CODE:
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if not (isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)):
                    continue
                name = ast.unparse(node.exc.func)
                if name in USER_ERRORS:
                    said = [n.value for n in ast.walk(node.exc) if isinstance(n, ast.Constant)
                            and isinstance(n.value, str)]
                    if max(map(len, said), default=0) < 5:  # it hands on another's message
                        continue
                    assert any(text in part for text in known for part in said), (
                        f"docs/troubleshooting.md lacks {path.name}:{node.lineno}: {said}")
