"""C on this computer: the compiler, the cache, and an executor that checks its frames."""

from __future__ import annotations

from pathlib import Path

import pytest

import colony
from colony.compile.backends.c import native
from colony.compile.backends.c.generate import generate_c
from colony.compile.backends.c.native import CExecutor, NoCompilerError, built, is_available
from colony.ir.frame import Frame
from colony.verify.testing.agreement import generated_c
from tests.compile.backends.c.harness import HERE, main_text, run
from tests.executors import outcomes
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


def test_a_damaged_file_of_the_cache_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    text = generate_c(compilation(PROGRAM).compiled)
    built(text)
    [kept] = (tmp_path / "colony/native").iterdir()
    whole = kept.read_bytes()
    kept.write_bytes(whole[: len(whole) // 2])
    assert CExecutor(text, built(text)).step(Frame(0, {"x": 2.0})).commands["out"].by == "m"
    assert kept.read_bytes() != whole[: len(whole) // 2]


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


def test_names_of_c_are_names_of_the_language_too(tmp_path: Path) -> None:
    text = """
robot colony {
  sensor int : number from DServer.int
  sensor nearbyint : number from DServer.n
  sensor m[2] : number from DServer.m
  sensor COLONY_H : bool from DServer.h
  actuator found { for : number, double : bool } to DServer.out idle hold
}
let t = round(int) + m[0]
module h { when COLONY_H and t > 0 do found(for = t, double = true) }
module H { when nearbyint > t do found(for = nearbyint, double = false) }
network { found = h suppresses H }
contract has_int: t > 5
"""
    readings = {"int": 1.4, "nearbyint": 9.0, "m": [1.0, 2.0], "COLONY_H": True}
    trace = [Frame(0, readings), Frame(1, {**readings, "COLONY_H": False}), Frame(2, {})]
    outcomes(text, trace, {"generated C": generated_c})
    c = generate_c(compilation(text).compiled)
    run(HERE, c, main_text(c, trace), tmp_path)


def test_a_restart_begins_anew_and_says_so_for_one_frame() -> None:
    counting = (
        "state n = 0\nnext n = n + 1\nmodule m { when true do out(v = if restarted then -n - 1 else n) }\n"
    )
    c = generate_c(compilation(robot() + counting + "network { out = m }\n").compiled)
    module = built(c)
    memory, frame, out = (module.ffi.new(f"struct tester_{x} *") for x in ("memory", "frame", "outcome"))
    sent = []
    module.lib.tester_init(memory)
    for k in range(6):
        if k == 3:
            module.lib.tester_restart(memory)
        frame.t_ns = 1_000 * k
        module.lib.tester_step(memory, frame, out)
        sent.append(out.out.command.v)
    assert sent == [0.0, 1.0, 2.0, -1.0, 1.0, 2.0]
