"""The house: which room may import which, how large rooms and files are, and that nothing loops."""

from __future__ import annotations

import ast
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "part2gs_robotics"
# Left may import right; errors and config are open to all.
MAY = {
    "runtime": "", "model": "", "ahead": "runtime",
    "align": "model", "readers": "align model runtime", "render": "model runtime",
    "evidence": "model runtime render", "plain": "evidence model runtime",
    "fit": "plain evidence render model runtime",
    "search": "evidence model runtime", "paper": "evidence model runtime",
    "decide": "search evidence render model runtime",
    "joints": "decide search paper evidence render model runtime",
    "volume": "evidence render model runtime", "boards": "model runtime",
    "collision": "model runtime",
    "mesh": "collision boards volume evidence render model runtime",
    "texture": "render model runtime",
    "exporters": "model runtime", "report": "model runtime",
    "agree": "exporters model runtime", "assets": "model runtime",
    "contract": "agree exporters model runtime",
    "sim_checks": "agree contract assets collision exporters model runtime",
    "capture": "assets model",
    "chance": "sim_checks agree collision exporters model runtime",
    "mend": "mesh sim_checks collision exporters model runtime",
    "stress": "sim_checks assets agree exporters model runtime",
    "ci": "chance stress sim_checks report assets agree exporters model runtime",
    "salient": "model", "photos": "salient readers model runtime",
    "view": "exporters assets model runtime",
    "commands": "photos readers model runtime",
}  # fmt: skip
ALONE = {  # from that room, these files alone
    ("plain", "evidence"): {"depth_maps", "edges", "segments"},
    ("fit", "plain"): {"plain_faces", "planes"}, ("fit", "evidence"): {"depth_maps", "surfels"},
    ("volume", "evidence"): {"depth_maps"},
    ("mesh", "evidence"): {"depth_maps", "edges", "segments"},
    ("agree", "exporters"): {"inertia", "meshfile", "read_twin", "twin_yaml"},
    ("sim_checks", "exporters"): {"twin_yaml"},
    ("sim_checks", "collision"): {"depth"},
    ("contract", "agree"): {"finding", "folder", "of_glb"},
    ("contract", "exporters"): {"meshfile", "mjcf", "read_twin", "sound"},
    ("sim_checks", "agree"): {"__init__", "catalogue", "finding", "folder"},
    ("chance", "collision"): {"depth"}, ("chance", "agree"): {"finding"},
    ("chance", "exporters"): {"read_twin"},
    ("chance", "sim_checks"): {"geometry", "interpenetration", "subject"},
    ("mend", "mesh"): {"make_room"}, ("mend", "exporters"): {"mjcf"},
    ("mend", "collision"): {"depth"}, ("mend", "sim_checks"): {
        "__init__", "geometry", "interpenetration", "result", "subject"},
    ("stress", "agree"): {"finding", "of_yaml"}, ("stress", "exporters"): {"twin_yaml"},
    ("stress", "sim_checks"): {"response", "subject"},
    ("ci", "assets"): {"model_files"}, ("capture", "assets"): {"model_files", "engine"},
    ("view", "exporters"): {"read_twin"}, ("view", "assets"): {"model_files"},
}  # fmt: skip
# Files that know rooms by their order.
ORDER = {"build", "outputs", "pictures", "articulate", "cli", "api"}
MOST_FILES, MOST_LINES, MOST_FUNCTION, MOST_ARGUMENTS = 16, 300, 40, 6
# A kernel takes arrays one by one: Numba compiles no dataclass, and nothing but a room's own
# wrapper calls it.
KERNELS = {"kernel", "inlined", "intrinsic"}


@cache
def files() -> dict[str, ast.Module]:
    """Return the package's modules, part2gs_robotics left away, with their code."""
    found = {}
    for folder, prefix in ((PACKAGE, ""), (ROOT / "exporters", "exporters."),
                           (ROOT / "sim_checks", "sim_checks.")):
        for path in sorted(folder.rglob("*.py")):
            name = prefix + ".".join(path.relative_to(folder).with_suffix("").parts)
            found[name] = ast.parse(path.read_text())
    return found


def imports(tree: ast.Module) -> set[str]:
    """Return the modules of the package that a file imports anywhere, lazily too."""
    out = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            out |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            deeper = {f"{node.module}.{a.name}" for a in node.names}
            out |= {d if d.partition(".")[2] in files() else node.module for d in deeper}
    names = {n.partition(".")[2] for n in out if n.split(".")[0] == "part2gs_robotics"}
    return {n if n in files() else f"{n}.__init__" if n else "__init__" for n in names}


def room(module: str) -> str:
    """Return the folder of a module; its own name where it stands in none."""
    return module.split(".")[0]


def functions() -> list[tuple[str, ast.FunctionDef]]:
    """Return every function of the package with its module."""
    return [(module, node) for module, tree in files().items() for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef)]


@pytest.mark.parametrize("name", sorted(MAY))
def test_a_room_imports_only_rooms_below_it(name):
    below = {*MAY[name].split(), name, "errors", "config", "config_rooms", "__init__"}
    for module, tree in files().items():
        if room(module) == name:
            for found in imports(tree):
                assert room(found) in below, f"{module} imports {found}"
                alone = ALONE.get((name, room(found)))
                assert alone is None or found.split(".")[1] in alone, f"{module} imports {found}"


def test_only_the_corridor_knows_the_rooms():
    ends = {"fit", "mesh", "texture", "exporters", "sim_checks", "report"}
    for module, tree in files().items():
        used = {room(found) for found in imports(tree)}
        if room(module) == module and module not in ORDER:
            assert not used & set(MAY) - {"model", "runtime"}, f"{module} imports {used}"
        if module == "articulate":
            assert not used & ends


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Return a circle of a graph, empty if it has none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as err:
        return list(err.args[1])
    return []


def test_nothing_imports_in_a_circle():
    graph = {module: imports(tree) - {module} for module, tree in files().items()}
    assert circle(graph) == []
    assert "model.se3" in graph["model.joint"]
    assert circle(graph | {"model.se3": {"model.joint"}}), "a planted one is found"


def test_every_room_is_small_and_says_what_it_is():
    rooms = {room(module) for module in files() if "." in module}
    assert rooms == set(MAY)
    for name in rooms:
        own = [m for m in files() if room(m) == name]
        assert len(own) <= MOST_FILES, f"{name}: {len(own)} files"
        assert all(module.count(".") == 1 for module in own), f"{name}: a folder in a folder"
        face = files()[f"{name}.__init__"]
        assert ast.get_docstring(face), f"{name}/__init__.py says nothing"
        handed = [a.name for n in ast.walk(face) if isinstance(n, ast.ImportFrom) for a in n.names]
        assert len([h for h in handed if h != "annotations"]) <= 2, f"{name} hands on {handed}"


def test_files_and_functions_are_short():
    for folder in (PACKAGE, *(ROOT / name for name in ("exporters", "sim_checks", "launch",
                                                       "tests", "benchmarks"))):
        for path in folder.rglob("*.py"):
            lines = len(path.read_text().splitlines())
            assert lines <= MOST_LINES, f"{path.relative_to(ROOT)}: {lines} lines"
    for module, node in functions():
        length = node.end_lineno - node.lineno + 1
        if node.body and isinstance(node.body[0], ast.Expr):  # what it says of itself is not code
            length -= node.body[0].end_lineno - node.body[0].lineno + 1
        assert length <= MOST_FUNCTION, f"{module}.{node.name}: {length} lines"


def test_nothing_public_takes_more_than_six_arguments():
    for module, node in functions():
        marks = {mark.id for mark in node.decorator_list if isinstance(mark, ast.Name)}
        names = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
        count = len([n for n in names if n not in ("self", "cls")])
        public = not node.name.startswith("_") and not marks & KERNELS
        assert not public or count <= MOST_ARGUMENTS, f"{module}.{node.name} takes {count}"
