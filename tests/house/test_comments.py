"""The comments of numbers: each says in one line where it comes from, and tells of no one object.

Who meets a number wants its unit and its reason with the figure that justifies it: a line. What
one object did with other values is a story: it is true of that scene alone, nobody runs it again
where it stands, and it grows with every scene. It belongs in the benchmark or test that shows it.
A number's comment speaks of kinds: thin parts, alike fronts, glass, hinges, true and false parts.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PRODUCT = "part2gs_robotics", "exporters", "sim_checks"
NAME = re.compile(r"_?[A-Z][A-Z0-9_]*")
FOR_TOOLS = re.compile(r"# ?(?:(?:fmt|type|ruff|mypy|pragma):|noqa\b)")
# Not among them: door, drawer, lid, hinge, handle, panel and plain shapes, which name kinds.
MADE = """
    bin blade bottle bucket cabinet carton chair chest desk dishwasher eyeglasses faucet flap fridge
    glasses globe kettle lamp laptop latch magazine microwave oven pliers printer refrigerator
    scissors seat sektion sideboard stapler suitcase table toaster toilet trashcan tray wardrobe
    washer wheel window
""".split()
OBJECT = re.compile(rf"\b(?:{'|'.join(MADE)})(?:e?s)?\b", re.IGNORECASE)


def holds_number(value: ast.expr) -> bool:
    """Whether a number is written in it; which element is taken of something else is none."""
    picks = {id(n) for s in ast.walk(value) if isinstance(s, ast.Subscript)
             for n in ast.walk(s.slice)}
    return any(isinstance(n, ast.Constant) and type(n.value) in (int, float) and id(n) not in picks
               for n in ast.walk(value))


def numbers(body: list[ast.stmt]) -> Iterator[tuple[ast.Assign | ast.AnnAssign, str]]:
    """Yield the numbers that a module names, also under an `if` or `try`, each with its names."""
    for node in body:
        if isinstance(node, ast.If | ast.Try):
            yield from numbers([*node.body, *node.orelse])
            for handler in getattr(node, "handlers", []):
                yield from numbers(handler.body)
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        names = [n.id if isinstance(n, ast.Name) else "" for n in getattr(target, "elts", [target])]
        if all(map(NAME.fullmatch, names)) and holds_number(node.value):
            yield node, ", ".join(names)


def faults(source: str) -> list[str]:
    """Return what is wrong with the comments of a module's numbers.

    A line above serves the numbers that follow one another below it, up to the first with a
    comment of its own.
    """
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    said = {t.start[0]: t for t in tokens
            if t.type == tokenize.COMMENT and not FOR_TOOLS.match(t.string)}
    found, served = [], 0  # the line that one more number would stand on, to share a comment
    for node, name in numbers(ast.parse(source).body):
        first = node.lineno
        while first - 1 in said and not said[first - 1].line[: said[first - 1].start[1]].strip():
            first -= 1
        end = node.end_lineno or node.lineno
        above = [said[i].string for i in range(first, node.lineno)]
        beside = [said[i].string for i in range(node.lineno, end + 1) if i in said]
        if not above and not beside and served != node.lineno:
            found.append(f"{name}: where does it come from?")
        if len(above) > 1:
            found.append(f"{name}: {len(above)} lines above it; one says it")
        if named := OBJECT.search(" ".join(above + beside)):
            found.append(f"{name}: tells of one object ({named[0]})")
        served = end + 1 if not beside and (above or served == node.lineno) else 0
    return found


@pytest.mark.parametrize("room", PRODUCT)
def test_every_number_says_in_a_line_where_it_comes_from(room: str) -> None:
    wrong = {str(path.relative_to(ROOT)): found for path in sorted((ROOT / room).rglob("*.py"))
             if (found := faults(path.read_text()))}
    assert not wrong


@pytest.mark.parametrize(("source", "fault"), [
    ("A = 1\n", "A: where"),
    ("A = 1  # fmt: skip\n", "A: where"),
    ("# of both\nA = 1\n\nB = 2\n", "B: where"),
    ("# of A\nA = 1\nB = 2  # of B\nC = 3\n", "C: where"),
    ("try:\n    import x\nexcept ImportError:\n    A = -1.5\n", "A: where"),
    ("A, B = (f(0.5) for _ in 'ab')\n", "A, B: where"),
    ("# one line\n# and one more\nA: int = 1\n", "A: 2 lines"),
    ("A = 1  # the Latches held\n", "A: tells of one object (Latches)"),
    ("A = (\n    1,  # a lamp's arm\n)\n", "A: tells of one object (lamp)"),
])  # fmt: skip
def test_a_number_without_a_plain_reason_is_found(source: str, fault: str) -> None:
    (found,) = faults(source)
    assert found.startswith(fault)


@pytest.mark.parametrize("source", [
    "A = 1  # metres\n",
    "# bytes, and files\nA = 1\nB = (\n    2\n)\nC = 3\n",
    "# a line above\nA = 1  # and one beside\n",
    "# one comment\n# of a function's, of two lines\n\nA = 1  # px\n",
    "A = x.parents[1]\nB = True\nC = 'a1'\nlower = 2\n",
    "A = 1  # doors and drawers stable\n",
])  # fmt: skip
def test_a_plain_reason_is_enough(source: str) -> None:
    assert not faults(source)
