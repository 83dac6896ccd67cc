"""The twin on a page of this machine: sliders and a hand in 3D ask, MuJoCo answers."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from part2gs_robotics.model.arrays import F64
from part2gs_robotics.model.kinematics import facing, up_of
from part2gs_robotics.model.se3 import quat_from_rotation
from part2gs_robotics.model.solids import bounds
from part2gs_robotics.model.twin import PartMesh
from part2gs_robotics.view.page import close_page, open_page
from part2gs_robotics.view.simulation import Simulation

if TYPE_CHECKING:
    import trimesh
    import viser

FRAME = 1 / 30  # s between pictures, as in video; a step of MuJoCo is a fifteenth of it
STEPS = 500  # of a slider's range, which is drawn on fewer pixels
SHOWN = ("photos' colours", "collision pieces")


def serve(folder: Path, port: int, on_start: Callable[[str], None]) -> None:
    """Serve a twin until interrupted.

    Args:
        folder: of a finished twin.
        port: wanted; the next free one where it is taken.
        on_start: called with the address once the page can be opened.

    Raises:
        ConfigError: viser is not installed.
        CheckError: the folder holds no whole twin.
    """
    viewer = Viewer(Simulation(folder), port)
    on_start(viewer.address)
    try:
        before = time.monotonic()
        while True:
            time.sleep(FRAME)
            now = time.monotonic()
            viewer.advance(now - before)
            before = now
    finally:
        viewer.close()


class Viewer:
    """A page with one slider per joint, in step with a simulation.

    Attributes:
        simulation: what it shows.  address: of the page.
        sliders: of the moving parts, degrees or scene units; setting `value` moves the joint.
    """

    def __init__(self, simulation: Simulation, port: int) -> None:
        """Start the server.

        Raises:
            ConfigError: viser is not installed.
        """
        self.simulation = simulation
        box = bounds(tuple(part.mesh for part in simulation.twin.parts))
        self._centre, self._size = box.mean(0), float(np.linalg.norm(box[1] - box[0]))
        self._server, self.address = open_page(port)
        self._look()
        self._frames = [self._server.scene.add_frame(f"/{i}", show_axes=False)
                        for i in range(len(simulation.twin.parts))]
        self._meshes: dict[str, list[viser.MeshHandle | viser.GlbHandle]] = {
            kind: [] for kind in SHOWN}
        for index in range(len(simulation.twin.parts)):
            self._add_part(index)
        self._show(SHOWN[0])
        self.sliders = [self._add_slider(number) for number in range(len(simulation.moving))]
        self._add_buttons()
        self._told = self._server.gui.add_markdown("")
        self.advance(0.0)

    def advance(self, seconds: float) -> None:
        """Let time pass in the simulation, and show what came of it."""
        self.simulation.advance(seconds)
        with self._server.atomic():
            for frame, pose in zip(self._frames, self.simulation.poses(), strict=True):
                wxyz, position = self._placed(pose)
                if abs(frame.position - position).max() + abs(frame.wxyz - wxyz).max() > 1e-7:
                    frame.position, frame.wxyz = position, wxyz
        told = self._words()
        if told != self._told.content:
            self._told.content = told

    def close(self) -> None:
        """Stop the server."""
        close_page(self._server)

    def _look(self) -> None:
        """Put new eyes where the parts come towards them, and a floor below the twin."""
        twin, camera = self.simulation.twin, self._server.initial_camera
        up, way = up_of(twin), facing(twin)
        aside = np.cross(up, way)  # a third of it: a front is seen better from its side
        camera.position, camera.look_at, camera.up = 1.1 * way + 0.4 * aside, np.zeros(3), up
        self._server.scene.set_up_direction((float(up[0]), float(up[1]), float(up[2])))
        lowest = min(float((self._points(part.mesh) @ up).min()) for part in twin.parts)
        turn, _ = Rotation.align_vectors(up[None], [[0.0, 0.0, 1.0]])
        self._server.scene.add_grid("/floor", 4.0, 4.0, position=lowest * up,
                                    wxyz=quat_from_rotation(turn.as_matrix()))

    def _placed(self, pose: F64) -> tuple[F64, F64]:
        """Return wxyz and position of a part's frame; the page's unit is the object's size."""
        turn = pose[:3, :3]
        shift = (turn @ self._centre + pose[:3, 3] - self._centre) / self._size
        return quat_from_rotation(turn), shift

    def _add_part(self, index: int) -> None:
        part, scene = self.simulation.twin.parts[index], self._server.scene
        surface = scene.add_mesh_trimesh(f"/{index}/surface", self._drawn(part.mesh))
        pieces = [scene.add_mesh_simple(
            f"/{index}/piece_{n}", self._points(piece), piece.faces.astype(np.uint32),
            color=_tint(n + 7 * index), flat_shading=True) for n, piece in enumerate(part.pieces)]
        self._meshes[SHOWN[0]].append(surface)
        self._meshes[SHOWN[1]] += pieces
        if index in self.simulation.moving:
            number = self.simulation.moving.index(index)
            for node in (surface, *pieces):
                node.on_drag("left")(lambda event: self._dragged(number, event))

    def _dragged(self, number: int, event: viser.SceneNodeDragEvent[viser.MeshHandle]) -> None:
        """Pull a part after the hand; its slider shows what is asked, and stays at the end."""
        if event.phase == "end":
            return
        held, hand = (np.array(place) * self._size + self._centre
                      for place in (event.start_position, event.end_position))
        self.simulation.pull(number, held, hand)
        self.sliders[number].value = self.simulation.targets[number] * self._unit(number)[0]

    def _points(self, mesh: PartMesh) -> F64:
        return np.asarray((mesh.vertices - self._centre) / self._size)

    def _drawn(self, mesh: PartMesh) -> trimesh.Trimesh:
        """Return a mesh with the picture of its surface, corner by corner, or its colours."""
        import trimesh
        from PIL import Image

        points = self._points(mesh)
        if mesh.texture is None:
            return trimesh.Trimesh(points, mesh.faces, vertex_colors=mesh.colors, process=False)
        look = trimesh.visual.TextureVisuals(
            mesh.texture.uv.reshape(-1, 2), material=trimesh.visual.material.PBRMaterial(
                baseColorTexture=Image.fromarray(mesh.texture.image), metallicFactor=0.0,
                roughnessFactor=1.0))
        corners = np.arange(mesh.faces.size).reshape(-1, 3)
        return trimesh.Trimesh(points[mesh.faces].reshape(-1, 3), corners, visual=look,
                               process=False)

    def _add_slider(self, number: int) -> viser.GuiSliderHandle[float]:
        part = self.simulation.twin.parts[self.simulation.moving[number]]
        factor, unit = self._unit(number)
        low, high = (float(f"{limit * factor:.4g}") for limit in part.limits)
        slider = self._server.gui.add_slider(
            f"{part.name} ({unit})", low, max(high, low + 1e-9), max(high - low, 1e-9) / STEPS,
            min(max(0.0, low), high))

        @slider.on_update
        def _(_: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            self.simulation.ask(number, slider.value / factor)

        return slider

    def _add_buttons(self) -> None:
        gui = self._server.gui
        states = gui.add_button_group("go to", ("state 0", "state 1"))
        shown = gui.add_dropdown("show", SHOWN)

        @states.on_click
        def _(_: object) -> None:
            for number, slider in enumerate(self.sliders):
                joint = self.simulation.twin.parts[self.simulation.moving[number]].joint
                value = joint.value if joint is not None and states.value == "state 1" else 0.0
                slider.value = value * self._unit(number)[0]

        @shown.on_update
        def _(_: object) -> None:
            self._show(shown.value)

    def _show(self, wanted: str) -> None:
        for kind, nodes in self._meshes.items():
            for node in nodes:
                node.visible = kind == wanted

    def _unit(self, number: int) -> tuple[float, str]:
        joint = self.simulation.twin.parts[self.simulation.moving[number]].joint
        turns = joint is not None and joint.turns
        return (180 / math.pi, "°") if turns else (1.0, "units")

    def _words(self) -> str:
        """Return where joints are and what touches."""
        lines = []
        for number, position in enumerate(self.simulation.positions()):
            factor, unit = self._unit(number)
            name = self.simulation.twin.parts[self.simulation.moving[number]].name
            lines.append(f"{name} is at {position * factor:.{1 if unit == '°' else 3}f} {unit}")
        touching = self.simulation.touching()
        lines += [f"**{t.one} touches {t.other}**, {t.depth:.2g} units deep" for t in touching]
        return "\n\n".join([*lines, "" if touching else "nothing touches"])


def _tint(number: int) -> tuple[int, int, int]:
    """Return a colour; golden steps of the hue, so that neighbours never look alike."""
    import colorsys

    red, green, blue = colorsys.hls_to_rgb(0.61803 * number % 1, 0.65, 0.5)
    return round(255 * red), round(255 * green), round(255 * blue)
