"""part2gs-robot: parse, call one room, turn what happened into an exit code."""

from __future__ import annotations

import json
import os
import shlex
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, cast, get_args

from part2gs_robotics import __version__
from part2gs_robotics.config import Config, resolve
from part2gs_robotics.errors import ConfigError, Part2GSError
from part2gs_robotics.flags import ALWAYS, COMMANDS, Call, Format, command_options, parse
from part2gs_robotics.stop import stoppable

if TYPE_CHECKING:
    from part2gs_robotics.ci import Wishes

OK, FAILED, BAD_INPUT, OUR_BUG, INTERRUPTED = 0, 1, 2, 3, 130  # see flags.EXIT_CODES; 128 + SIGINT


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code; never raises for bad input.

    Args:
        argv: words after the program's name; None = those of this process.
    """
    words = sys.argv[1:] if argv is None else list(argv)
    with stoppable() as stopped:
        try:
            call = parse(words)
            return RUN[call.command](call)
        except SystemExit as done:  # --help and --version
            return int(done.code or 0)
        except Part2GSError as err:
            sys.stderr.write(f"error: {err}\n")
            if "--json" in words:
                sys.stdout.write(json.dumps({"exit_code": BAD_INPUT, "error": str(err)}) + "\n")
            return BAD_INPUT
        except BrokenPipeError:  # the reader of our output went away: nobody is left to tell
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return INTERRUPTED
        except KeyboardInterrupt:
            return _interrupted(words)
        except Exception as err:
            return _interrupted(words) if stopped() else _failed(err)


def _interrupted(words: Sequence[str]) -> int:
    sys.stderr.write("interrupted; finished stages are kept, the same command continues:\n"
                     f"  part2gs-robot {shlex.join(words)}\n")
    return INTERRUPTED


def _failed(err: BaseException) -> int:
    sys.stderr.write(f"internal error: {type(err).__name__}: {str(err)[:300]}\nThis is a bug "
                     f"of part2gs-robotics {__version__}, not of the scene. The traceback is "
                     f"in {_write_traceback()}; please report it with that file.\n")
    return OUR_BUG


def _write_traceback() -> str:
    handle, path = tempfile.mkstemp(prefix="part2gs-robot-error-", suffix=".log")
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(f"part2gs-robotics {__version__}, {time.strftime('%Y-%m-%d %H:%M:%S')}\n"
                   f"{' '.join(sys.argv)}\n\n{traceback.format_exc()}")
    return path


def _build(call: Call) -> int:
    from part2gs_robotics.build import build
    from part2gs_robotics.commands.from_photos import scene_of_photos, settings_for
    from part2gs_robotics.outputs import output_folder
    from part2gs_robotics.readers.read_scene import read_scene_yaml

    scene, flags = Path(call.paths[0]), call.flags
    if len(call.paths) == 2:  # plain photos, or videos
        out = output_folder(scene, (config := resolve(flags)).output.out)
        scene = scene_of_photos((scene, Path(call.paths[1])), out, config)
        flags = settings_for(flags, read_scene_yaml(scene)) | {"out": str(out)}
    return build(scene, resolve(flags, read_scene_yaml(scene), str(scene / "scene.yaml")))


def _batch(call: Call) -> int:
    from dataclasses import asdict

    from part2gs_robotics.commands.batch import BatchWishes, run_batch, words_of
    from part2gs_robotics.commands.batch_page import counts

    available = command_options("batch")
    given = {key: option.default for key, option in available.items()} | call.flags
    own = {"out", "on", "workers", "retries", *ALWAYS}
    forwarded = {key: value for key, value in call.flags.items() if key not in own}
    resolve(forwarded)  # refused before the first scene, not by each of them
    wishes = BatchWishes(Path(str(given["out"])), str(given["on"]), cast(int, given["workers"]),
                         cast(int, given["retries"]), words_of(forwarded, available),
                         bool(given["quiet"]), bool(given["verbose"]))
    rows, pages = run_batch([Path(path) for path in call.paths], wishes)
    _say(call, {"rows": [asdict(row) for row in rows], "files": list(map(str, pages))},
         f"{counts(rows)}; {', '.join(map(str, pages))}\n")
    return OK if all(row.outcome == "built" for row in rows) else FAILED


def _check(call: Call) -> int:
    from part2gs_robotics.ci import check_assets
    from part2gs_robotics.report.ci import formatted
    from part2gs_robotics.runtime.log import logging_to
    from part2gs_robotics.sim_checks.result import format_text

    own = {option.name for option in COMMANDS["check"].extra}
    config: Config = resolve({k: v for k, v in call.flags.items() if k not in own})
    wishes = _wishes(call, config.check.sweep_values)
    kind = str(call.flags.get("format", "json" if call.flags.get("json") else "text"))
    with logging_to(None, config.output.quiet, config.output.verbose):
        reports = check_assets([Path(path) for path in call.paths], wishes)
    for report in reports:
        if report.unusable:
            sys.stderr.write(f"error: {report.unusable}\n")
    usable = [report for report in reports if not report.unusable]
    text = ("\n".join(map(format_text, usable)) if kind == "text"
            else formatted([report.to_dict() for report in reports], kind))
    sys.stdout.write(text.rstrip() + "\n" if text else "")
    if call.flags.get("apply"):
        from part2gs_robotics.stress.advice import apply

        for report in reports:
            written = apply(Path(report.path) / "scene.xml", report.stress.get("advice", {}))
            sys.stderr.write(f"{report.path}: scene.xml: {written}\n")
    return max(report.exit_code for report in reports)


def _wishes(call: Call, steps: int) -> Wishes:
    """Return how `check` is to check."""
    from part2gs_robotics.ci import Wishes
    from part2gs_robotics.ci.accepted import reasons_of

    flags = call.flags
    if flags.get("apply") and not flags.get("stress"):
        raise ConfigError("command line: --apply is given without --stress. Expected both: only "
                          "--stress measures which time step and integrator to advise.")
    for name in ("samples", "jobs"):
        if cast(int, flags.get(name, 0)) < 0:
            raise ConfigError(f"command line: --{name} is {flags[name]}. Expected a whole number "
                              "from 0 up; see part2gs-robot check --help.")
    root, cache, baseline = (Path(str(flags[key])) if flags.get(key) else None
                             for key in ("root", "cache", "baseline"))
    return Wishes(
        steps, cast(int, flags.get("samples", 0)), bool(flags.get("stress")), root,
        cast(int, flags.get("jobs", 0)), cache,
        reasons_of(cast("tuple[str, ...]", flags.get("disable") or ())), baseline,
        bool(flags.get("write_baseline")))


def _explain(call: Call) -> int:
    from part2gs_robotics.agree.catalogue import explain

    text = explain(call.paths[0])
    return _say(call, {"id": call.paths[0], "text": text}, text)


def _capture(call: Call) -> int:
    from part2gs_robotics.capture.capture import Shots, capture
    from part2gs_robotics.capture.joint_states import parse_states
    from part2gs_robotics.runtime.log import logging_to

    given = {key: option.default for key, option in command_options("capture").items()} | call.flags
    quiet, verbose, depth = (bool(given[name]) for name in ("quiet", "verbose", "depth"))
    views, test_views, size, seed = (
        cast(int, given[name]) for name in ("views", "test_views", "size", "seed"))
    words = cast("tuple[str, ...] | None", given["state"])
    states = parse_states(words) if words else None
    with logging_to(None, quiet, verbose):
        done = capture(Path(call.paths[0]), Path(call.paths[1]),
                       Shots(views, test_views, size, seed, depth), states)
    return _say(call, {"scene": str(done.scene), "images": done.frames,
                       "joints": list(done.joints), "truth": str(done.truth)},
                f"{done.scene}: {done.frames} images, {len(done.joints)} moving joints "
                f"({', '.join(done.joints)}), {done.seconds:.1f} s; truth in {done.truth}\n")


def _export(call: Call) -> int:
    from part2gs_robotics.outputs import export_twin

    kind = call.flags.get("format")
    if kind is None:
        raise ConfigError("command line: export got no --format. Expected "
                          f"{'|'.join(get_args(Format))}; see --help.")
    folder = Path(call.paths[0])
    files, notes = export_twin(folder, str(kind), Path(str(call.flags.get("out")
                                                           or folder / str(kind))))
    shown = [file for file in files if file.parent.name != "assets"] or files
    return _say(call, {"files": list(map(str, files)), "repaired": list(notes)},
                "".join(f"repaired: {note}\n" for note in notes)
                + f"{len(files)} files: {', '.join(map(str, shown[:6]))}\n")


def _view(call: Call) -> int:
    from part2gs_robotics.view.server import serve

    def on_start(address: str) -> None:
        sys.stdout.write(f"{address}: open it in a browser of this machine; Ctrl-C ends it\n")
        sys.stdout.flush()

    serve(Path(call.paths[0]), cast(int, call.flags.get("port", 8080)), on_start)
    return OK


def _scene(call: Call) -> int:
    from part2gs_robotics.photos.make_scene import Wishes, make_scene
    from part2gs_robotics.runtime.log import logging_to

    given = {key: option.default for key, option in command_options("scene").items()} | call.flags
    length = cast("float | None", given["known_length"])
    wishes = Wishes(cast(int, given["side"]), cast(int, given["frames"]), length,
                    cast(float, given["marker_size"]), None if given["mask_model"] is None
                    else Path(str(given["mask_model"])))
    out = Path(str(given["out"]))
    with logging_to(None, bool(given["quiet"]), bool(given["verbose"])):
        made = make_scene((Path(call.paths[0]), Path(call.paths[1])), out, wishes)
    scale = ("unknown scale (print the sheet of part2gs-robot marker, or give --known-length)"
             if wishes.known_length is None else "scale by --known-length")
    if made.scale is not None:
        by = f"{made.scale.markers} {made.scale.source}"
        scale = f"metres by {by}, spread {made.scale.spread:.2%}"
    return _say(call, {"scene": str(out), **made.facts},
                f"{out}: {made.registered[0]} of {made.taken[0]} and {made.registered[1]} of "
                f"{made.taken[1]} photos registered; {scale}. Next: part2gs-robot inspect {out}, "
                f"then part2gs-robot build {out}\n")


def _marker(call: Call) -> int:
    from part2gs_robotics.photos.markers import write_marker_sheet

    out = Path(str(call.flags.get("out", "sheet.pdf")))
    write_marker_sheet(out, bool(call.flags.get("charuco")))
    return _say(call, {"file": str(out)}, f"{out}: print at 100 %, lay it beside the object\n")


def _inspect(call: Call) -> int:
    from part2gs_robotics.photos.inspect_scene import inspect_scene
    from part2gs_robotics.readers.read_scene import read_scene_yaml

    scene = Path(call.paths[0])
    config: Config = resolve(call.flags, read_scene_yaml(scene), str(scene / "scene.yaml"))
    told = inspect_scene(scene, config.read)
    return _say(call, {"found": list(told.found), "advice": list(told.advice)},
                "".join(f"{line}\n" for line in told.found)
                + ("".join(f"do better: {line}\n" for line in told.advice)
                   or "nothing to do better\n"))


def _doctor(call: Call) -> int:
    from part2gs_robotics.commands.doctor import as_data, examine, told

    found = examine(Path())
    _say(call, as_data(found), told(found))
    return OK if as_data(found)["ok"] else FAILED


def _completion(call: Call) -> int:
    from part2gs_robotics.commands.completion import script

    flags = {name: tuple(command_options(name).values()) for name in COMMANDS}
    summaries = {name: command.summary for name, command in COMMANDS.items()}
    text = script(call.paths[0], flags, summaries)
    return _say(call, {"shell": call.paths[0], "script": text}, text)


def _say(call: Call, data: dict[str, object], text: str) -> int:
    """Say a result to programs or to people; return that all went well."""
    if call.flags.get("json"):
        sys.stdout.write(json.dumps(data, indent=1) + "\n")
    elif not call.flags.get("quiet"):
        sys.stdout.write(text)
    return OK


RUN: dict[str, Callable[[Call], int]] = {
    "build": _build, "batch": _batch, "check": _check, "explain": _explain, "export": _export,
    "capture": _capture, "view": _view, "scene": _scene, "marker": _marker, "inspect": _inspect,
    "doctor": _doctor,
    "completion": _completion}
