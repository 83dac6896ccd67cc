"""Ahead: what processes compile is found by a build; what goes wrong there only costs time."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from importlib import import_module
from io import StringIO
from pathlib import Path

import pytest
from numba.core import sigutils

from part2gs_robotics.ahead import compile_ahead as room
from part2gs_robotics.ahead.listed import Kernel, listed, read
from part2gs_robotics.ahead.worker import IDLE, serve
from part2gs_robotics.runtime import jit, jit_cache
from part2gs_robotics.runtime.threads import in_threads

FEW = [one for one in listed() if one.name in ("add_up", "depth_keys", "set_cursors", "share_out")]
LATE = [one for one in listed() if one.name in ("renumber", "gains")]
CALL = ("import numpy as np\nfrom part2gs_robotics.runtime.jit_cache import compile_seconds\n"
        "from part2gs_robotics.render.tiles import add_up\n"
        "add_up(np.arange(3))\nprint(compile_seconds())")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty folder for kernels."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    forget()
    yield tmp_path
    forget()


def forget() -> None:
    jit_cache.kept_in.cache_clear()
    jit._folder_of_module.cache_clear()


def few(monkeypatch: pytest.MonkeyPatch, kernels: list[Kernel]) -> None:
    monkeypatch.setattr("part2gs_robotics.ahead.listed.listed", lambda: kernels)


def test_every_kernel_of_the_list_exists_and_its_types_are_read() -> None:
    assert len(listed()) > 50
    for one in listed():
        function = getattr(import_module(one.module), one.name)
        types, _ = sigutils.normalize_signature(one.types)
        assert len(types) == function.py_func.__code__.co_argcount, one.line
        assert read(one.line + "\n") == one


def test_processes_share_out_kernels_each_once() -> None:
    kernels = [Kernel(f"module_{n % 7}", f"kernel_{n}", "()") for n in range(3000)]
    crew = room._Crew(kernels)

    def take() -> list[Kernel]:
        taken: list[Kernel] = []
        while kernel := crew._next(taken[-1].module if taken else ""):
            taken.append(kernel)
        return taken

    before = sys.getswitchinterval()
    try:
        sys.setswitchinterval(1e-6)  # threads take turns within a look through what is left
        taken = in_threads([take] * 8, most=8)
    finally:
        sys.setswitchinterval(before)
    assert sorted(one.name for own in taken for one in own) == sorted(k.name for k in kernels)


def test_a_process_goes_on_with_the_module_it_has_begun() -> None:
    kernels = [Kernel(f"module_{n % 2}", f"kernel_{n}", "()") for n in range(6)]
    crew = room._Crew(kernels)
    modules = [kernel.module for _ in range(3) if (kernel := crew._next("module_1"))]
    assert modules == ["module_1"] * 3
    assert crew._next("module_1") == kernels[0]


def test_a_build_finds_what_other_processes_compiled(folder: Path,
                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    few(monkeypatch, FEW)
    assert room.compile_ahead() == len(FEW) >= room.WORTH
    done = subprocess.run([sys.executable, "-c", CALL], check=True, text=True, capture_output=True)
    assert float(done.stdout) == 0.0
    assert room.compile_ahead() == 0  # once


def test_kernels_of_late_rooms_follow_while_a_build_goes_on(
        folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few(monkeypatch, [*LATE, *FEW])
    before = set(threading.enumerate())
    assert room.compile_ahead() == len(FEW)
    for thread in set(threading.enumerate()) - before:
        thread.join(60)
    assert all(one.late and jit.kept(one.module, one.name) for one in LATE)
    assert not room.missing()


def test_a_build_does_not_wait_for_another_that_compiles_for_late_rooms(
        folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few(monkeypatch, [*LATE, *FEW])
    with jit_cache.alone_in(jit_cache.kept_in() / room.LATER):
        before = set(threading.enumerate())
        assert room.compile_ahead() == len(FEW)
        assert room.missing() == LATE
    for thread in set(threading.enumerate()) - before:
        thread.join(60)
    assert not room.missing()


def test_what_follows_leaves_the_cores_to_others() -> None:
    command = [sys.executable, "-m", "part2gs_robotics.ahead.worker", IDLE]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as one:
        assert one.stdin is not None
        assert one.stdout is not None
        print(replace(FEW[0], module="no.such").line, file=one.stdin, flush=True)
        one.stdout.readline()
        assert os.getpriority(os.PRIO_PROCESS, one.pid) == 19


def test_what_cannot_be_compiled_is_told_and_the_rest_is(
        folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    wrong = [replace(FEW[0], name="no_such"), replace(FEW[1], types="(float32,)")]
    few(monkeypatch, [*wrong, *FEW[2:]])
    assert room.compile_ahead() == len(FEW) - 2
    assert "no_such of part2gs_robotics.render.tiles was not compiled ahead" in caplog.text
    assert caplog.text.count("was not compiled ahead") == 2


def test_a_process_that_dies_costs_time_alone(folder: Path, monkeypatch: pytest.MonkeyPatch,
                                              caplog: pytest.LogCaptureFixture) -> None:
    few(monkeypatch, FEW)
    dies = folder / "dies"
    dies.write_text("#!/bin/sh\nexit 3\n")
    dies.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(dies))
    assert room.compile_ahead() == 0
    assert "the process that compiles it has ended" in caplog.text
    monkeypatch.setattr(sys, "executable", str(folder / "missing"))
    assert room.compile_ahead() == 0
    assert "no process to compile kernels could be started" in caplog.text


def test_an_interrupt_ends_the_processes(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few(monkeypatch, listed())
    crew: list[room._Crew] = []

    def interrupted(self: room._Crew, worker: room.Worker, kernel: Kernel) -> bool:
        crew.append(self)
        raise KeyboardInterrupt

    monkeypatch.setattr(room._Crew, "_compiled", interrupted)
    with pytest.raises(KeyboardInterrupt):
        room.compile_ahead()
    assert crew[0].workers
    assert all(w.wait(10) is not None for w in crew[0].workers)


def test_a_folder_that_cannot_be_locked_costs_time_alone(
        folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    few(monkeypatch, FEW)
    (jit_cache.kept_in() / "lock").mkdir()
    assert room.compile_ahead() == 0
    assert "cannot be compiled ahead" in caplog.text


def test_nothing_is_compiled_where_numba_may_not() -> None:
    code = "from part2gs_robotics.ahead.listed import missing\nprint(missing())"
    done = subprocess.run([sys.executable, "-c", code], check=True, text=True, capture_output=True,
                          env={**os.environ, "NUMBA_DISABLE_JIT": "1"})
    assert done.stdout.strip() == "[]"


def test_a_worker_answers_line_by_line(folder: Path) -> None:
    answers = StringIO()
    serve(StringIO(f"{FEW[0].line}\n{replace(FEW[0], module='no.such').line}\n"), answers)
    good, bad = answers.getvalue().splitlines()
    assert good == "kept"
    assert bad.startswith("ModuleNotFoundError")
