"""Where compiled kernels are kept, and which of them are found again."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from part2gs_robotics.errors import ConfigError
from part2gs_robotics.runtime import jit_cache

PACKAGE = Path(__file__).resolve().parents[2] / "part2gs_robotics"
HELPER = ("from part2gs_robotics.runtime.jit import inlined\n\n"
          "@inlined\ndef twice(x): return x * 2\n")
PROBE = ("from part2gs_robotics.model.helper import twice\n"
         "from part2gs_robotics.runtime.jit import kernel\n\n"
         "@kernel\ndef probe(x): return twice(x) + 1\n")
RUN = ("from part2gs_robotics.model.probe import probe\n"
       "from part2gs_robotics.runtime.jit_cache import compile_seconds\n"
       "print(probe(3), compile_seconds() == 0)")


def install(folder: Path) -> Path:
    """Lay out a package of few files with one small kernel and a helper that it inlines."""
    package = folder / "part2gs_robotics"
    shutil.copytree(PACKAGE / "runtime", package / "runtime",
                    ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("__init__.py", "errors.py"):
        shutil.copy(PACKAGE / name, package)
    for name, text in (("__init__", ""), ("helper", HELPER), ("probe", PROBE)):
        (package / "model").mkdir(exist_ok=True)
        (package / f"model/{name}.py").write_text(text)
    return folder


def start(folder: Path, code: str = RUN, **variables: str) -> subprocess.Popen[str]:
    clean = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    return subprocess.Popen([sys.executable, "-c", code], text=True, stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, cwd=folder,
                            env={**clean, "PYTHONPATH": str(folder), **variables})


def run(folder: Path, code: str = RUN, **variables: str) -> tuple[str, str]:
    """Return what a process prints, and what it warns of."""
    process = start(folder, code, **variables)
    out, err = process.communicate()
    assert process.returncode == 0, err
    return out.strip(), err


@pytest.fixture
def place(tmp_path: Path) -> Path:
    return install(tmp_path / "place")


@pytest.fixture
def home(tmp_path: Path) -> str:
    """The user's folder for caches."""
    return str(tmp_path / "home")


@pytest.fixture
def decide_again() -> Iterator[None]:
    """Let a test of this process decide anew where kernels are kept, and forget it after."""
    jit_cache.kept_in.cache_clear()
    yield
    jit_cache.kept_in.cache_clear()


def test_kernels_are_found_again_after_a_reinstall(place: Path, home: str, tmp_path: Path) -> None:
    assert run(place, XDG_CACHE_HOME=home) == ("7 False", "")
    assert run(place, XDG_CACHE_HOME=home) == ("7 True", "")
    shutil.rmtree(place)
    assert run(install(tmp_path / "place"), XDG_CACHE_HOME=home) == ("7 True", "")  # new times
    assert run(install(tmp_path / "other"), XDG_CACHE_HOME=home) == ("7 True", "")
    assert not list(tmp_path.glob("*/part2gs_robotics/**/*.nbi"))


def test_a_changed_helper_in_another_file_is_seen(place: Path, home: str) -> None:
    run(place, XDG_CACHE_HOME=home)
    helper = place / "part2gs_robotics/model/helper.py"
    helper.write_text(HELPER.replace("x * 2", "x * 5"))
    assert run(place, XDG_CACHE_HOME=home) == ("16 False", "")
    helper.write_text(HELPER)
    assert run(place, XDG_CACHE_HOME=home) == ("7 True", "")  # back and forth compiles once


def test_processes_that_compile_at_once_do_not_mix_up_kernels(place: Path, home: str) -> None:
    values = ["3", "3.0", "3j", "True"]
    together = [start(place, RUN.replace("3", value), XDG_CACHE_HOME=home)
                for value in values]
    for process in together:
        _, err = process.communicate()
        assert (process.returncode, err) == (0, "")
    everything = RUN.replace("probe(3)", f"*map(probe, ({', '.join(values)}))")
    assert run(place, everything, XDG_CACHE_HOME=home) == ("7 7.0 (1+6j) 3 True", "")


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_a_torn_file_is_compiled_again(place: Path, home: str, kind: str) -> None:
    run(place, XDG_CACHE_HOME=home)
    (file,) = Path(home).rglob(f"*.{kind}")
    file.write_bytes(file.read_bytes()[:20])
    out, err = run(place, XDG_CACHE_HOME=home)
    assert out == "7 False"
    assert "cannot be read and is compiled again" in err
    assert run(place, XDG_CACHE_HOME=home) == ("7 True", "")


def test_a_numba_of_other_insides_keeps_kernels_its_own_way(place: Path, home: str) -> None:
    gone = f"import numba.core.caching as c\ndel c._CacheLocator\n{RUN}"
    out, err = run(place, gone, XDG_CACHE_HOME=home)
    assert out == "7 False"
    assert "in a way that this version does not know" in err
    assert run(place, gone, XDG_CACHE_HOME=home)[0] == "7 True"
    helper = place / "part2gs_robotics/model/helper.py"
    helper.write_text(HELPER.replace("x * 2", "x * 5"))
    assert run(place, gone, XDG_CACHE_HOME=home)[0] == "16 False"


def test_a_cache_that_breaks_later_costs_time_alone(place: Path, home: str) -> None:
    broken = ("import shutil\nfrom part2gs_robotics.runtime.jit_cache import kept_in\n"
              "shutil.rmtree(kept_in())\nkept_in().write_text('in the way')\n")
    out, err = run(place, RUN.replace("print", f"{broken}print"), XDG_CACHE_HOME=home)
    assert out == "7 False"
    assert "cannot be kept" in err


def test_a_kernel_outside_of_the_package_is_not_kept(place: Path, home: str) -> None:
    (place / "foreign.py").write_text(PROBE)
    code = RUN.replace("part2gs_robotics.model.probe", "foreign")
    for _ in range(2):
        assert run(place, code, XDG_CACHE_HOME=home) == ("7 False", "")


def test_the_users_own_choice_is_honoured(place: Path, home: str, tmp_path: Path) -> None:
    chosen = {"XDG_CACHE_HOME": home, "NUMBA_CACHE_DIR": str(tmp_path / "chosen")}
    code = f"{RUN}\nfrom part2gs_robotics.runtime.jit_cache import kept_in; print(kept_in())"
    folder = tmp_path / "chosen/part2gs-robotics"
    assert run(place, code, **chosen)[0].splitlines() == ["7 False", str(folder)]
    assert run(place, code, **chosen)[0].splitlines() == ["7 True", str(folder)]
    assert list(folder.rglob("*.nbi"))
    assert not Path(home).exists()


@pytest.mark.parametrize("variable", ["NUMBA_CACHE_DIR", "XDG_CACHE_HOME"])
def test_kernels_are_kept_where_no_usual_folder_is_writable(place: Path, tmp_path: Path,
                                                            variable: str) -> None:
    # /proc refuses new files even to root, unlike a folder without write permission.
    (tmp_path / "temporary").mkdir()
    variables = {variable: "/proc/none", "TMPDIR": str(tmp_path / "temporary")}
    assert run(place, **variables)[0] == "7 False"
    assert run(place, **variables)[0] == "7 True"
    (folder,) = (tmp_path / "temporary").iterdir()
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert list(folder.rglob("*.nbi"))


@pytest.mark.usefixtures("decide_again")
def test_the_last_resort_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/none")
    note = jit_cache.prepare_jit_cache()
    assert note is not None
    assert all(word in note for word in ("/proc/none", str(tmp_path), "NUMBA_CACHE_DIR"))
    jit_cache.kept_in.cache_clear()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    assert jit_cache.prepare_jit_cache() is None
    assert jit_cache.kept_in() == tmp_path / "home/part2gs-robotics"


def test_an_unwritable_choice_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "/proc/none")
    with pytest.raises(ConfigError, match=r"NUMBA_CACHE_DIR is '/proc/none'.*Expected.*correct"):
        jit_cache.prepare_jit_cache()


@pytest.mark.usefixtures("decide_again")
def test_a_folder_others_can_write_is_not_trusted(tmp_path: Path,
                                                  monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    first = jit_cache._private_temporary_folder()
    assert jit_cache._private_temporary_folder() == first
    first.chmod(0o777)
    assert jit_cache._private_temporary_folder() != first
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    (tmp_path / "part2gs-robotics").mkdir()
    (tmp_path / "part2gs-robotics").chmod(0o777)
    assert jit_cache.kept_in() != tmp_path / "part2gs-robotics"


def test_a_link_in_place_of_the_folder_is_not_followed(tmp_path: Path,
                                                       monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    target = tmp_path / "elsewhere"
    target.mkdir(mode=0o700)
    (tmp_path / f"part2gs-robotics-numba-{os.getuid()}").symlink_to(target)
    assert jit_cache._private_temporary_folder().resolve() != target


def test_kernels_of_older_code_go_when_nothing_asks_for_them(tmp_path: Path) -> None:
    names = ["fit.hull-0123456789abcdef", "fit.hull-fedcba9876543210", "a folder of the user"]
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name / "kernel.nbc").write_text("")
    for name in (names[0], names[2]):
        os.utime(tmp_path / name, (0, 0))
    jit_cache.remove_unused(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == set(names[1:])


def test_a_kernel_that_is_used_stays(place: Path, home: str) -> None:
    run(place, XDG_CACHE_HOME=home)
    (folder,) = Path(home).glob("part2gs-robotics/*")
    os.utime(folder, (0, 0))
    assert run(place, XDG_CACHE_HOME=home) == ("7 True", "")
    jit_cache.remove_unused(folder.parent)
    assert folder.is_dir()
