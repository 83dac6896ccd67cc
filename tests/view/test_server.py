"""The page of `view`: a running server on this machine alone, whose sliders drive MuJoCo."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from browser import CHROMIUM, Browser
from synth import toy_cabinet_twin

from part2gs_robotics import cli
from part2gs_robotics.exporters.mjcf import write_mjcf
from part2gs_robotics.exporters.twin_yaml import write_twin_yaml
from part2gs_robotics.view.server import Viewer
from part2gs_robotics.view.simulation import LONGEST, Simulation

try:
    import viser
except ImportError:
    viser = None
needs_viser = pytest.mark.skipif(viser is None, reason="no viser: pip install '.[view]'")
TWIN = toy_cabinet_twin(4)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("twin")
    write_mjcf(TWIN, found)
    write_twin_yaml(TWIN, found, {})
    return found


@pytest.fixture(scope="module")
def viewer(folder: Path) -> Iterator[Viewer]:
    found = Viewer(Simulation(folder), 0)
    yield found
    found.close()


def listening(port: int) -> set[str]:
    """Return the addresses on which this machine listens at a port, as the kernel writes them."""
    found = set()
    for name in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]:
            address, _, at = line.split()[1].rpartition(":")
            if int(at, 16) == port and line.split()[3] == "0A":
                found.add(address)
    return found


@needs_viser
def test_a_slider_moves_its_joint_through_the_simulation(viewer: Viewer) -> None:
    viewer.sliders[1].value = 60.0
    for _ in range(20):
        viewer.advance(LONGEST)
    assert viewer.simulation.positions()[1] == pytest.approx(np.radians(60), abs=0.02)
    assert "part_2 is at 60" in viewer._told.content
    frame = viewer._frames[2]
    assert 2 * np.arccos(frame.wxyz[0]) == pytest.approx(np.radians(60), abs=0.02)
    viewer.sliders[1].value = 0.0


@needs_viser
def test_a_dragged_part_is_asked_to_follow_and_its_slider_with_it(viewer: Viewer) -> None:
    """The drawer comes out along +x: a hand 0.1 m in front of what it holds."""
    held = (np.array([0.5, 0.3, 0.2]) - viewer._centre) / viewer._size
    hand = held + np.array([0.1 / viewer._size, 0.2, 0.0])
    event = SimpleNamespace(start_position=held, end_position=hand, phase="update")
    viewer._dragged(0, event)
    assert viewer.simulation.targets[0] == pytest.approx(0.1, abs=0.01)
    assert viewer.sliders[0].value == pytest.approx(viewer.simulation.targets[0])
    viewer.sliders[0].value = 0.0


@needs_viser
def test_it_listens_on_this_machine_alone_and_shares_nothing(viewer: Viewer) -> None:
    port = int(viewer.address.rpartition(":")[2])
    assert listening(port) == {"0100007F"}, "127.0.0.1"
    assert viewer._server.request_share_url() is None
    with urllib.request.urlopen(viewer.address, timeout=20) as answer:
        assert b"viser" in answer.read().lower()


@needs_viser
@pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium")
def test_a_browser_shows_it_and_asks_nobody_else(viewer: Viewer, tmp_path: Path) -> None:
    with Browser(tmp_path) as browser:
        browser.visit(viewer.address)
        browser.wait("document.body.innerText.includes('part_2 (°)')")
        asked = {re.sub(r"^ws", "http", url) for url in browser.requests
                 if not url.startswith(("data:", "blob:"))}
        assert all(url.startswith(viewer.address) for url in asked), asked


@needs_viser
def test_the_command_serves_until_it_is_interrupted(folder: Path) -> None:
    code = "import sys; from part2gs_robotics.cli import main; sys.exit(main())"
    done = subprocess.Popen([sys.executable, "-c", code, "view", str(folder), "--port", "0"],
                            stdout=subprocess.PIPE, text=True)
    line = done.stdout.readline()
    address = re.match(r"(http://127\.0\.0\.1:\d+): open it", line)
    assert address, line
    with urllib.request.urlopen(address[1], timeout=20) as answer:
        assert answer.status == 200
    time.sleep(0.2)
    done.send_signal(signal.SIGINT)
    assert done.wait(20) == 130
    done.stdout.close()


def test_without_viser_the_message_says_how_to_install_it(
        folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    assert cli.main(["view", str(folder)]) == 2
    assert "pip install 'part2gs-robotics[view]'" in capsys.readouterr().err
