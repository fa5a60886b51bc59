"""C on this computer: the compiler, the cache, and an executor that checks its frames."""

from __future__ import annotations

from pathlib import Path

import pytest

import colony
from colony.compile.backends.c import native
from colony.compile.backends.c.generate import generate_c
from colony.compile.backends.c.native import CExecutor, NoCompilerError, built, is_available
from colony.ir.frame import Frame
from tests.programs import compilation, robot

pytestmark = pytest.mark.skipif(not is_available(), reason="no C compiler, or no cffi")

PROGRAM = robot() + "module m { when x > 1 do out(v = x) }\nnetwork { out = m }\n"


def test_what_was_compiled_is_loaded_from_the_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    text = generate_c(compilation(PROGRAM).compiled)
    built(text)
    [kept] = (tmp_path / "colony/native").iterdir()
    monkeypatch.setattr(native, "_run", pytest.fail)
    frame = Frame(0, {"x": 2.0})
    assert CExecutor(text, built(text)).step(frame).commands["out"].by == "m"
    monkeypatch.undo()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    built(text, options=(*native.STRICT, "-O1"))
    assert len([*kept.parent.iterdir()]) == 2


def test_without_a_cache_it_is_compiled_each_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("HOME", raising=False)
    text = generate_c(compilation(PROGRAM).compiled)
    assert CExecutor(text, built(text)).step(Frame(0, {"x": 2.0})).commands["out"].by == "m"


def test_a_compiler_that_fails_is_one_line(tmp_path: Path) -> None:
    text = generate_c(compilation(PROGRAM).compiled)
    with pytest.raises(NoCompilerError, match=r"^\S*gcc: .*error: .*no-such-option") as raised:
        built(text, ["gcc"], ["--no-such-option"])
    assert "\n" not in str(raised.value)
    with pytest.raises(NoCompilerError):
        built(text, [str(tmp_path / "none")])


def test_the_executor_of_the_library_checks_frames() -> None:
    program = colony.load("figure_4_14")
    executor = colony.build(program).to_c().executor()
    executor.step(Frame(0, {}))
    with pytest.raises(ValueError, match="expected a later time"):
        executor.step(Frame(0, {}))
    with pytest.raises(ValueError, match="nothing"):
        executor.step(Frame(1, {"nothing": 1.0}))
    executor.restart()
    assert executor.step(Frame(0, {})) == colony.build(program).executor().step(Frame(0, {}))
