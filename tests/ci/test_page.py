"""The page about CI: its files are YAML, and every command in them runs on a twin."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from synth import toy_cabinet_twin

from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.twin_yaml import write_twin_yaml
from part2gs_robotics.exporters.urdf import write_urdf

ROOT = Path(__file__).resolve().parents[2]
WORKFLOW, HOOKS = (yaml.safe_load(text) for text in re.findall(
    r"```yaml\n(.*?)```", (ROOT / "docs/ci.md").read_text(), re.DOTALL))
STEPS = WORKFLOW["jobs"]["check"]["steps"]


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("repository")
    folder = root / "twins" / "cabinet"
    folder.mkdir(parents=True)
    for write in (write_mjcf, write_urdf, write_twin_yaml):
        write(toy_cabinet_twin(1), folder)
    return root


def run(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a line of shell with this environment's commands first."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(command, shell=True, cwd=folder, text=True, capture_output=True,
                          env=os.environ | {"PATH": path}, check=False)


def test_the_steps_of_the_workflow_run(repository: Path) -> None:
    commands = [step["run"] for step in STEPS if "part2gs-robot check" in step.get("run", "")]
    assert len(commands) == 2
    for command in commands:
        done = run(command, repository)
        assert done.returncode == 0, done.stderr
    sarif = next(s["with"]["sarif_file"] for s in STEPS if "sarif" in s.get("uses", ""))
    assert json.loads((repository / sarif).read_text())["runs"][0]["results"] == []
    cache = next(s["with"]["path"] for s in STEPS if "actions/cache" in s.get("uses", ""))
    assert len(list((repository / cache).iterdir())) == 1, "the second step took it from there"


def test_the_hook_runs_on_what_it_is_handed(repository: Path) -> None:
    ((hook,),) = (repo["hooks"] for repo in HOOKS["repos"])
    file = "twins/cabinet/twin.xml"
    assert re.search(hook["files"], file)
    assert not re.search(hook["files"], "twins/cabinet/scene.xml")
    assert run(f"{hook['entry']} {file}", repository).returncode == 0
    text = (repository / file).read_text()
    (repository / file).write_text(text.replace('mass="', 'mass="-'))
    assert run(f"{hook['entry']} {file}", repository).returncode == 1
    (repository / file).write_text(text)
