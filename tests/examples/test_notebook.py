"""The notebook runs from its first cell to its last, without Jupyter."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import numpy as np
import pytest
from synth import handled_twin

from part2gs_robotics import api

pytest.importorskip("PIL", reason="no pillow: pip install '.[view]'")
NOTEBOOK = Path(__file__).resolve().parents[2] / "examples/twin.ipynb"


def cells() -> list[dict[str, object]]:
    return json.loads(NOTEBOOK.read_text())["cells"]


def run(source: str, names: dict[str, object]) -> object:
    """Run a cell as Jupyter does; return the value of its last line if that is an expression."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    if last is None:
        return None
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)


def test_it_is_kept_without_what_cells_printed() -> None:
    for cell in cells():
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None
    ids = [cell["id"] for cell in cells()]
    assert len(ids) == len(set(ids))


def test_every_cell_runs(tmp_path: Path, monkeypatch, capsys) -> None:
    api.write_twin(handled_twin(), tmp_path / "out")
    monkeypatch.setenv("TWIN", str(tmp_path / "out"))
    names: dict[str, object] = {}
    shown = [run("".join(cell["source"]), names) for cell in cells() if cell["cell_type"] == "code"]
    said = capsys.readouterr().out
    assert "part_2: revolute on base" in said
    assert "0 to look at" in said
    np.testing.assert_allclose(names["share"], 0.5, atol=0.02)
    closed_open, way = (np.asarray(image) for image in shown if hasattr(image, "_repr_png_"))
    assert closed_open.shape == (240, 640, 3)
    closed, opened = closed_open[:, :320].astype(int), closed_open[:, 320:].astype(int)
    assert (np.abs(closed - opened).max(-1) > 30).mean() > 0.02, "the states look different"
    assert way.shape == (240, 960, 3)
