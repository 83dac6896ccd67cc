"""Laws of the store: whole or absent, loaded only when nothing changed, one build at a time."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from part2gs_robotics.errors import StoreError
from part2gs_robotics.runtime.hashing import hash_of
from part2gs_robotics.runtime.store import (
    Saved,
    Store,
    read_stage,
    write_bytes_atomic,
    write_stage,
    write_text_atomic,
)

SAVED = Saved({"means": np.arange(6, dtype=np.float32).reshape(2, 3),
               "labels": np.array([1, 2], np.int64)}, {"curve": [[0.5, 20.0]], "name": "door"})


@pytest.fixture
def stored(tmp_path: Path) -> Store:
    store = Store(tmp_path / "out")
    store.prepare()
    return store


def same(saved: Saved | None) -> bool:
    return (saved is not None and saved.data == SAVED.data
            and all(np.array_equal(saved.arrays[k], v) for k, v in SAVED.arrays.items()))


def test_stage_round_trip(tmp_path: Path) -> None:
    write_stage(tmp_path / "01_fit", "key", SAVED)
    assert same(read_stage(tmp_path / "01_fit", "key"))


def test_stage_with_another_key_is_not_loaded(tmp_path: Path) -> None:
    write_stage(tmp_path / "01_fit", "key", SAVED)
    assert read_stage(tmp_path / "01_fit", "other") is None


def test_arrays_that_are_not_contiguous_survive(tmp_path: Path) -> None:
    turned = np.arange(12.0).reshape(3, 4).T
    write_stage(tmp_path / "s", "k", Saved({"a": turned}, {}))
    read = read_stage(tmp_path / "s", "k")
    assert read is not None
    assert np.array_equal(read.arrays["a"], turned)


@pytest.mark.parametrize("name", ["manifest.json", "data.json", "arrays.safetensors"])
@pytest.mark.parametrize("damage", ["flip", "cut", "empty", "remove"])
def test_a_damaged_stage_is_computed_again(tmp_path: Path, name: str, damage: str) -> None:
    write_stage(tmp_path / "s", "k", SAVED)
    file = tmp_path / "s" / name
    content = bytearray(file.read_bytes())
    if damage == "remove":
        file.unlink()
    else:
        content[len(content) // 2] ^= 0x01
        file.write_bytes({"flip": bytes(content), "cut": bytes(content[: len(content) // 2]),
                          "empty": b""}[damage])
    assert read_stage(tmp_path / "s", "k") is None


def test_stage_is_computed_once(stored: Store) -> None:
    calls = []

    def compute() -> int:
        calls.append(1)
        return 7

    for _ in range(3):
        value = stored.stage("01_x", "k", compute, lambda v: Saved({}, {"v": v}),
                             lambda s: int(str(s.data["v"])))
        assert value == 7
    assert len(calls) == 1
    assert stored.resumed == ["01_x", "01_x"]


def test_failing_compute_leaves_the_earlier_stage(stored: Store) -> None:
    folder = stored.out / "stages" / "01_x"
    write_stage(folder, "old", SAVED)

    def fail() -> Saved:
        raise RuntimeError

    with pytest.raises(RuntimeError):
        stored.stage("01_x", "new", fail, lambda s: s, lambda s: s)
    assert same(read_stage(folder, "old"))


def test_hash_depends_on_values_types_and_shapes() -> None:
    array = np.arange(6.0)
    keys = [hash_of(array), hash_of(array.reshape(2, 3)), hash_of(array.astype(np.float32)),
            hash_of(array + 1), hash_of("a", "b"), hash_of("ab"), hash_of(["a"], "b"),
            hash_of({"a": 1}), hash_of({"a": 2})]
    assert len(set(keys)) == len(keys)


def test_hash_ignores_memory_layout_and_key_order() -> None:
    array = np.arange(6.0).reshape(2, 3)
    assert hash_of(array) == hash_of(np.asfortranarray(array))
    assert hash_of({"a": 1, "b": 2}) == hash_of({"b": 2, "a": 1})


def test_atomic_write_keeps_the_old_file_when_it_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    file = tmp_path / "twin.xml"
    write_text_atomic(file, "old")

    def broken(source: object, target: object) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "replace", broken)
    with pytest.raises(StoreError, match="Input/output error"):
        write_text_atomic(file, "new")
    assert file.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["twin.xml"]


WRITER = """
import sys
from pathlib import Path
from part2gs_robotics.runtime.store import write_bytes_atomic
sys.stdout.write("ready\\n"); sys.stdout.flush()
for n in range(10**9):
    write_bytes_atomic(Path(sys.argv[1]), bytes([n % 256]) * 1_000_000)
"""


def wait_for_writes(target: Path, count: int) -> None:
    """Wait until the file was replaced some times: a new inode each, the next one under way."""
    deadline = time.monotonic() + 60
    for _ in range(count):
        before = target.stat().st_ino, target.stat().st_mtime_ns
        while (target.stat().st_ino, target.stat().st_mtime_ns) == before:
            assert time.monotonic() < deadline, "the child writes nothing"
            time.sleep(0.001)


def test_kill_during_writing_never_tears_a_file(tmp_path: Path) -> None:
    target = tmp_path / "big.bin"
    write_bytes_atomic(target, bytes(1_000_000))
    rng = np.random.default_rng(0)
    for _ in range(4):
        child = subprocess.Popen([sys.executable, "-c", WRITER, str(target)],
                                 stdout=subprocess.PIPE, text=True)
        assert child.stdout is not None
        assert child.stdout.readline() == "ready\n"
        wait_for_writes(target, int(rng.integers(1, 6)))
        child.send_signal(signal.SIGKILL)
        child.wait()
        child.stdout.close()
        content = target.read_bytes()
        assert len(content) == 1_000_000
        assert len(set(content)) == 1


HOLDER = """
import sys, time
from pathlib import Path
from part2gs_robotics.runtime.store import Store
store = Store(Path(sys.argv[1])); store.prepare()
with store.locked():
    sys.stdout.write("locked\\n"); sys.stdout.flush()
    time.sleep(60)
"""


def test_lock_names_its_holder_and_ends_with_it(stored: Store) -> None:
    child = subprocess.Popen([sys.executable, "-c", HOLDER, str(stored.out)],
                             stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    assert child.stdout.readline() == "locked\n"
    with pytest.raises(StoreError, match=f"pid {child.pid} on"), stored.locked():
        pass
    with pytest.raises(StoreError, match="another build"):
        stored.refuse_early()
    child.kill()
    child.wait()
    child.stdout.close()
    with stored.locked():
        pass


def test_leftovers_of_killed_builds_are_removed(stored: Store) -> None:
    left = [stored.out / ".new-999", stored.out / "stages" / "01_fit.tmp-999"]
    for folder in left:
        folder.mkdir()
        (folder / "half").write_text("x")
    (stored.out / "twin.xml.tmp-999").write_text("x")
    (stored.out / "notes.txt").write_text("mine")
    with stored.locked():
        pass
    assert not any(folder.exists() for folder in left)
    assert not (stored.out / "twin.xml.tmp-999").exists()
    assert (stored.out / "notes.txt").read_text() == "mine"


def test_new_files_replace_the_earlier_ones_and_stale_ones_go(stored: Store) -> None:
    with stored.new_files() as folder:
        (folder / "twin.xml").write_text("first")
        (folder / "assets").mkdir()
        (folder / "assets/part_2_visual.obj").write_text("two parts")
    (stored.out / "notes.txt").write_text("mine")
    with stored.new_files() as folder:
        (folder / "twin.xml").write_text("second")
    assert (stored.out / "twin.xml").read_text() == "second"
    assert not (stored.out / "assets/part_2_visual.obj").exists()
    assert (stored.out / "notes.txt").read_text() == "mine"


def test_failure_while_writing_leaves_the_earlier_twin(stored: Store) -> None:
    with stored.new_files() as folder:
        (folder / "twin.xml").write_text("first")

    def fail_half_way() -> None:
        with stored.new_files() as folder:
            (folder / "twin.xml").write_text("half")
            raise ValueError("exporter")

    with pytest.raises(ValueError, match="exporter"):
        fail_half_way()
    assert (stored.out / "twin.xml").read_text() == "first"
    assert not list(stored.out.glob(".new-*"))


def test_disk_error_of_a_writer_is_a_store_error(stored: Store) -> None:
    def fill_the_disk() -> None:
        with stored.new_files():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(StoreError, match=r"No space left.*free some space"):
        fill_the_disk()
