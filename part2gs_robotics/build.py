"""The corridor: the only place that knows the order of the rooms."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from part2gs_robotics import __version__
from part2gs_robotics.ahead.compile_ahead import compile_ahead
from part2gs_robotics.config import Config
from part2gs_robotics.errors import FitError
from part2gs_robotics.model.gaussians import Gaussians
from part2gs_robotics.model.motion import LeftOver, Motion
from part2gs_robotics.model.scene import Scene
from part2gs_robotics.model.scene_frame import frame_of, internal
from part2gs_robotics.model.twin import Part, Texture, Twin
from part2gs_robotics.outputs import (
    output_folder,
    twin_in_scene,
    twin_name,
    verdict,
    write_outputs,
)
from part2gs_robotics.plan import make_plan, settle_plan
from part2gs_robotics.readers.read_scene import read_scene
from part2gs_robotics.render.pick_device import describe, pick_device
from part2gs_robotics.result import BuildResult, Told
from part2gs_robotics.runtime.device import rendering_on
from part2gs_robotics.runtime.hashing import code_version, hash_of
from part2gs_robotics.runtime.jit_cache import compile_seconds, kept_in, prepare_jit_cache
from part2gs_robotics.runtime.log import Progress, log_stage, logging_to
from part2gs_robotics.runtime.store import STAGES, Saved, Store
from part2gs_robotics.stages import (
    Fitted,
    load_built,
    load_fit,
    load_left,
    load_motion,
    load_textures,
    parts_of_key,
    save_built,
    save_fit,
    save_left,
    save_motion,
    save_textures,
)
from part2gs_robotics.view.training import Training, watched

if TYPE_CHECKING:
    from part2gs_robotics.evidence.canonical import Canonical
    from part2gs_robotics.sim_checks.result import CheckReport

T = TypeVar("T")
Written = tuple["CheckReport", str]  # and a summary for people
COMPILE_WORTH_A_WORD = 0.5  # seconds: less is a kernel or two that this scene alone needs
logger = logging.getLogger(__name__)


def build(path: Path, config: Config) -> int:
    """Build the twin of a scene folder.

    Args:
        path: scene folder.
        config: resolved settings.

    Returns:
        0 when all checks pass, 1 when the twin is built but a check fails.

    Raises:
        Part2GSError: the input, a setting or the output folder cannot be used; the results of an
            earlier build in the output folder stay as they were.

    Example:
        code = build(Path("scene"), resolve({"preset": "draft"}))
    """
    out = output_folder(path, config.output.out)
    cache_note = prepare_jit_cache()
    store = Store(out)
    store.refuse_early()
    began = time.monotonic()
    scene = read_scene(path, config.read)
    # After the scene is found good: the first use of a GPU compiles kernels, which takes minutes.
    device = pick_device(config.fit.device)
    on_device = describe(config.fit.device, device)
    # What is written down, and what stages depend on, is the device that renders, never "auto".
    config = replace(config, fit=replace(config.fit, device=device))
    store.prepare()
    output = config.output
    with store.locked(), logging_to(out, output.quiet, output.verbose), rendering_on(device):
        logger.info("part2gs-robot %s, seed %d: %s (%s layout) to %s", __version__, config.fit.seed,
                    path, scene.layout, out)
        logger.info("rendering on %s", on_device)
        for note in scene.notes:
            logger.info("%s", note)
        if cache_note:
            logger.warning("%s", cache_note)
        with watched(output.view) as training:
            return _Corridor(scene, config, store, time.monotonic() - began, training).run()


class _Corridor:
    """One build: every room entered once, in order; in internal units up to the exporters."""

    def __init__(self, scene: Scene, config: Config, store: Store, read_seconds: float,
                 training: Training | None = None) -> None:
        self.metres, self.frame = scene.meters_per_unit, frame_of(scene)
        self.scene, self.config, self.store = internal(scene, self.frame), config, store
        self.training, self.code = training, code_version()
        self.seconds: dict[str, float] = {}
        self.good = ""  # the last finished stage
        self.both: Canonical | None = None  # no need of it where later stages are taken over
        self._done("read", read_seconds, f"{sum(map(len, scene.states))} images")
        logger.info("internal unit %g scene units, internal origin at %g %g %g", self.frame.unit,
                    *self.frame.centre)

    def run(self) -> int:
        """Return the exit code of the build."""
        from part2gs_robotics.fit.brightness import alike

        plan = make_plan(self.scene, self.config)
        logger.info("plan:\n%s", "\n".join(plan.lines()))
        compile_ahead()
        fits, keys = zip(*(self._fit(index) for index in (0, 1)), strict=True)
        self.scene = alike(self.scene, (fits[0][2], fits[1][2]))
        gaussians = (fits[0][0], fits[1][0])
        motion, key = self._articulate(gaussians, keys)
        motion, parts, key = self._mesh(gaussians, motion, key)
        name = twin_name(self.scene.path.resolve(), self.store.out.resolve())
        twin = Twin(name, parts, self.scene.meters_per_unit, self.scene.up,
                    (*self.scene.notes, *motion.notes))
        left = self._left_over(gaussians, motion, key)
        told, bare = Told(plan, (fits[0], fits[1]), motion, left, key), self._separate(twin)
        report, summary = self._mended(bare, told, self._written(bare, told))
        if self.config.output.json:
            sys.stdout.write((self.store.out / "report.json").read_text("utf-8"))
        elif not self.config.output.quiet:
            sys.stdout.write(summary)
        return report.exit_code

    def _written(self, bare: Twin, told: Told) -> Written:
        """Give the twin its looks and scale; write and check it."""
        gaussians, parts = (told.fits[0][0], told.fits[1][0]), bare.parts
        if self.config.texture.texture:
            parts = self._texture(gaussians, parts, told.key)
        paper = self.config.articulate.paper_mode
        plan = settle_plan(told.plan, gaussians, told.motion, parts, paper)
        twin = twin_in_scene(replace(bare, parts=parts), self.frame, self.metres, self.config)
        began = time.monotonic()
        result = BuildResult(self.scene, self.frame, told.fits, told.motion, told.left,
                             twin, plan, self.config, self.seconds)
        with self.store.new_files() as folder:
            report, summary = write_outputs(folder, self.store.out, result)
        self._done("export and check", time.monotonic() - began, verdict(report))
        return report, summary

    def _mended(self, bare: Twin, told: Told, written: Written) -> Written:
        """Give the evidence of failed checks back to the meshes, and write what comes of it."""
        from part2gs_robotics.mend import mendable, mended

        twin, rounds = mended(bare, written[0]) if mendable(written[0]) else (bare, ())
        for number, (note, seconds) in enumerate(rounds, 1):
            self._done(f"mend {number}", seconds, note)
        notes = tuple(note for note, _ in rounds)
        twin, key = replace(twin, notes=(*bare.notes, *notes)), hash_of("mend", told.key, notes)
        return self._written(twin, replace(told, key=key)) if rounds else written

    def _fit(self, index: int) -> tuple[Fitted, str]:
        state = self.scene.states[index]
        # The device is in the key: CPU builds repeat bit for bit, not from a GPU's Gaussians.
        fit, stereo = self.config.fit, self.config.stereo
        key = hash_of("fit", self.code, asdict(fit), asdict(stereo), *parts_of_key(state))

        def compute() -> Fitted:
            from part2gs_robotics.fit.fit_state import fit_state

            progress = Progress(f"fit state {index}", "dB")
            told = self.training.beside(progress, f"state {index}") if self.training else progress
            result = fit_state(state, None, fit, told, f"state {index}", stereo)
            return result.gaussians, tuple((t, db) for t, db, _ in result.curve), result.gains

        fitted = self._stage(f"0{index + 1}_fit_{index}", key, compute, save_fit, load_fit,
                             lambda f: f"{f[1][-1][1]:.1f} dB, {len(f[0])} Gaussians")
        return fitted, key

    def _articulate(self, gaussians: tuple[Gaussians, Gaussians],
                    keys: tuple[str, ...]) -> tuple[Motion, str]:
        settings, search = self.config.articulate, self.config.search
        key = hash_of("articulate", self.code, asdict(settings), asdict(search), *keys)

        def compute() -> Motion:
            from part2gs_robotics.articulate import articulate

            began, both = time.monotonic(), self._canonical(gaussians)
            self._done("canonical", time.monotonic() - began, both.told)
            found = articulate(both, settings, Progress("articulate"), search)
            notes = (f"Canonical field: {both.told}.", *filter(None, [both.exposure]))
            return replace(found, notes=(*notes, *found.notes))

        motion = self._stage("03_articulate", key, compute, save_motion, load_motion,
                             lambda m: f"{len(m.joints)} moving parts: "
                                       + ", ".join(joint.kind for joint in m.joints))
        return motion, key

    def _canonical(self, gaussians: tuple[Gaussians, Gaussians]) -> Canonical:
        """Return both states comparable, once for the rooms that look at them."""
        from part2gs_robotics.evidence.canonical import canonical

        if self.both is None:
            self.both = canonical(self.scene, gaussians, self.config.search)
        return self.both

    def _mesh(self, gaussians: tuple[Gaussians, Gaussians], motion: Motion,
              key: str) -> tuple[Motion, tuple[Part, ...], str]:
        settings, key = self.config.mesh, hash_of("mesh", asdict(self.config.mesh), key)

        def compute() -> tuple[Motion, tuple[Part, ...]]:
            from part2gs_robotics.joints.alike import each_aligned
            from part2gs_robotics.mesh.real_parts import build_existing

            both, asked = self._canonical(gaussians), self.config.articulate.parts
            return build_existing(both.scene, both.gaussians, motion, settings, asked,
                                  lambda found: each_aligned(both, found, self.config))

        motion, parts = self._stage(
            "04_mesh", key, compute, save_built, load_built,
            lambda b: f"{sum(len(part.mesh.faces) for part in b[1])} triangles")
        return motion, parts, key

    def _left_over(self, gaussians: tuple[Gaussians, Gaussians], motion: Motion,
                   key: str) -> LeftOver:
        """Return what the parts that were built do not explain."""
        def compute() -> LeftOver:
            from part2gs_robotics.joints.left_over import left_over

            return left_over(self._canonical(gaussians), motion)

        return self._stage("05_left_over", hash_of("left over", key), compute, save_left, load_left,
                           lambda left: f"{left.share:.1%} of what moved is not explained")

    def _texture(self, gaussians: tuple[Gaussians, Gaussians], parts: tuple[Part, ...],
                 key: str) -> tuple[Part, ...]:
        """Return the parts with textures."""
        settings = self.config.texture

        def compute() -> tuple[Texture, ...]:
            from part2gs_robotics.texture.bake import bake

            return bake(self._canonical(gaussians).scene, parts, settings)

        textures = self._stage("05_texture", hash_of("texture", asdict(settings), key), compute,
                               save_textures, load_textures,
                               lambda t: f"{sum(one.image.size for one in t) / 3e6:.1f} megapixels")
        return tuple(replace(part, mesh=part.mesh.painted(texture))
                     for part, texture in zip(parts, textures, strict=True))

    def _separate(self, twin: Twin) -> Twin:
        """Return the twin with ranges of joints, and neighbours' collision pieces apart on them."""
        from part2gs_robotics.mesh.clearance import gap_share, with_apart_pieces
        from part2gs_robotics.mesh.free_range import with_free_ranges

        began = time.monotonic()
        free = with_free_ranges(twin) if self.config.mesh.free_range else twin
        apart = with_apart_pieces(free, gap_share(free, self.config.mesh.collision_gap,
                                                  self._metres(free)))
        self._done("separate", time.monotonic() - began,
                   f"{sum(len(part.pieces) for part in apart.parts)} collision pieces")
        return apart

    def _metres(self, twin: Twin) -> float:
        """Return metres per internal unit, known or assumed."""
        from part2gs_robotics.model.scale import longest_side

        if self.config.read.known_length is not None:
            return self.config.read.known_length / longest_side(twin)
        return self.frame.unit * (self.metres or self.frame.assumed_meters)

    def _stage(self, name: str, key: str, compute: Callable[[], T], save: Callable[[T], Saved],
               load: Callable[[Saved], T], number: Callable[[T], str]) -> T:
        began, compiled = time.monotonic(), compile_seconds()
        try:
            result = self.store.stage(name, key, compute, save, load)
        except FitError as err:
            kept = (f"Last good result: {self.store.out / STAGES / self.good}; the same command "
                    "goes on from it." if self.good else "No stage was finished before it.")
            raise FitError(f"{name[3:]}: {err} {kept}") from err
        self.good = name
        if (compiled := compile_seconds() - compiled) > COMPILE_WORTH_A_WORD:
            logger.info("%s: %.1f s of it compiled kernels for this machine, kept in %s",
                        name[3:], compiled, kept_in())
        self._done(name[3:], time.monotonic() - began, number(result), name in self.store.resumed)
        return result

    def _done(self, name: str, seconds: float, number: str, resumed: bool = False) -> None:
        self.seconds[name] = seconds
        log_stage(name, seconds, number, resumed)
