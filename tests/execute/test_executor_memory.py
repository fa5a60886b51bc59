"""Every memory function against small tables over frames, in every executor."""

from __future__ import annotations

from typing import Any

from colony.compile.backends.python.generate import generate, load
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.executor import ClientListExecutor
from colony.ir.frame import Frame
from colony.verify.reference.interpreter import Interpreter

ROBOT = """
robot r {
  sensor x : number from DServer.x
  sensor k : number from DServer.k
  sensor b : bool from DServer.b
  sensor c : bool from DServer.c
  sensor f[2] : bool from DServer.f
  sensor a[2] : number from DServer.a
  actuator out { v : number } to DServer.Out idle hold
}
network { out = m }
"""

SILENT = None
"""What is sent in a frame in which the module is silent."""


def _executors(text: str) -> dict[str, Any]:
    program = load_text(ROBOT + text)
    clients = compile_program(program).clients
    return {
        "priority": ClientListExecutor(program, clients),
        "exclusive": ClientListExecutor(program, clients, exclusive=True),
        "generated": load(generate(program, clients)),
        "interpreter": Interpreter(program),
    }


def _run(text: str, frames: list[tuple[float, dict[str, Any], float | None]]) -> None:
    """Steps every executor; each frame is its time in seconds, its readings, and the value to be sent."""
    for name, executor in _executors(text).items():
        for seconds, readings, expected in frames:
            (decision,) = executor.step(Frame(7_000_000_000 + round(seconds * 1e9), readings)).decisions
            found = decision.values[0] if decision.values is not None else None
            assert found == expected, f"{name} at {seconds} s"


def _module(expression: str) -> str:
    return f"module m {{ when true  do out(v = {expression}) }}"


def _truth(expression: str) -> str:
    return _module(f"if {expression} then 1 else 0")


def _over(
    name: str, *rows: tuple[float, Any, float | None]
) -> list[tuple[float, dict[str, Any], float | None]]:
    """Frames in which one sensor has a value, or (None) is missing."""
    return [(seconds, {name: value}, expected) for seconds, value, expected in rows]


def test_previous_with_a_constant() -> None:
    _run(_module("previous(x, 9)"), _over("x", (0, 1.0, 9), (1, 2.0, 1), (2, None, SILENT), (3, 3.0, 2)))


def test_previous_with_what_it_is_at_first() -> None:
    frames = [(0, {"x": None, "k": 1.0}, SILENT), (1, {"x": 5.0, "k": 2.0}, 4), (2, {"x": 6.0, "k": 3.0}, 5)]
    _run(_module("previous(x, k * 2)"), frames)


def test_changed() -> None:
    rows = [(0, 1.0, 0), (1, 1.0, 0), (2, 2.0, 1), (3, None, SILENT), (4, 2.0, 0), (5, 1.0, 1)]
    _run(_truth("changed(x)"), _over("x", *rows))


def test_what_is_not_a_number_always_changes() -> None:
    _run(_truth("changed(sqrt(x))"), _over("x", (0, -1.0, 0), (1, -1.0, 1), (2, 4.0, 1), (3, 4.0, 0)))


def test_rising() -> None:
    rows = [(0, True, 1), (1, True, 0), (2, False, 0), (3, True, 1), (4, None, SILENT), (5, True, 0)]
    _run(_truth("rising(b)"), _over("b", *rows))


def test_falling() -> None:
    rows = [(0, False, 0), (1, True, 0), (2, None, SILENT), (3, False, 1), (4, False, 0)]
    _run(_truth("falling(b)"), _over("b", *rows))


def test_held_until_and_not_including_the_moment() -> None:
    rows = [(0, False, 0), (1, True, 1), (2, True, 1), (3.999999999, False, 1), (4, False, 0), (5, True, 1)]
    _run(_truth("held(b, 2 s)"), _over("b", *rows))


def test_held_counts_the_time_of_silent_frames() -> None:
    _run(_truth("held(b, 2 s)"), _over("b", (0, True, 1), (1, None, SILENT), (1.9, False, 1), (2, False, 0)))


def test_held_for_no_time() -> None:
    _run(_truth("held(b, 0 s)"), _over("b", (0, True, 1), (1e-9, False, 0)))


def test_elapsed() -> None:
    rows = [(0, False, 0), (1, True, 0), (1.5, True, 0.5), (2, None, SILENT), (3, True, 2), (4, False, 0)]
    _run(_module("elapsed(b) / 1 s"), _over("b", *rows, (5, True, 0), (6, True, 1)))


def test_latch() -> None:
    frames = [
        (t, {"b": b, "c": c}, v)
        for t, b, c, v in [
            (0, False, False, 0),
            (1, True, False, 1),
            (2, False, False, 1),
            (3, None, True, SILENT),
            (4, False, False, 1),
            (5, True, True, 0),
            (6, False, False, 0),
            (7, True, False, 1),
        ]
    ]
    _run(_truth("latch(b, c)"), frames)


def test_captured() -> None:
    frames = [
        (t, {"x": x, "k": k}, v)
        for t, x, k, v in [
            (0, 1.0, 0.0, 1),
            (1, 2.0, 0.0, 1),
            (2, 3.0, 5.0, 3),
            (3, 4.0, None, SILENT),
            (4, 4.0, 5.0, 3),
            (5, 6.0, 0.0, 6),
        ]
    ]
    _run(_module("captured(x, k)"), frames)


def test_captured_with_a_key_that_is_no_number() -> None:
    frames = [(t, {"x": x, "k": -1.0}, x) for t, x in [(0, 1.0), (1, 2.0)]]
    _run(_module("captured(x, sqrt(k))"), frames)


def test_every() -> None:
    rows = [
        (0, None, SILENT),
        (0.5, 0.0, 1),
        (1, 0.0, 0),
        (2.4, 0.0, 0),
        (2.5, 0.0, 1),
        (5, 0.0, 1),
        (6, 0.0, 0),
    ]
    _run(_truth("every(2 s) and x == 0"), _over("x", *rows))


def test_now_and_times_are_exact() -> None:
    _run(_module("now() / 1 s + x"), _over("x", (0, 0.0, 0), (0.3, 0.0, 0.3), (1e-9 * 3, 0.0, 3e-9)))


def test_each_element_has_memory_of_its_own() -> None:
    rows = [
        (0, [True, False], 1),
        (1, [False, False], 1),
        (1.5, [False, True], 2),
        (2, [False, False], 1),
        (4, [False, False], 0),
    ]
    _run(_module("count(held(f, 2 s))"), _over("f", *rows))


def test_each_loop_index_has_memory_of_its_own() -> None:
    text = _module("sum(previous(a[i], i * 10) for i in 0 .. 1 if i < x)")
    frames = [
        (0, {"a": [1.0, 2.0], "x": 2.0}, 10),
        (1, {"a": [3.0, 4.0], "x": 1.0}, 1),
        (2, {"a": [5.0, 6.0], "x": 2.0}, 7),
    ]
    _run(text, frames)


def test_memory_moves_on_in_a_branch_not_taken() -> None:
    text = _module("if b then previous(x, 0) else -1")
    frames = [
        (t, {"b": b, "x": x}, v) for t, b, x, v in [(0, True, 1.0, 0), (1, False, 2.0, -1), (2, True, 3.0, 2)]
    ]
    _run(text, frames)


def test_memory_moves_on_where_the_predicate_is_false() -> None:
    text = "module m { when b  do out(v = previous(x, 0)) }"
    frames = [
        (t, {"b": b, "x": x}, v)
        for t, b, x, v in [(0, True, 1.0, 0), (1, False, 2.0, None), (2, True, 3.0, 2)]
    ]
    _run(text, frames)


def test_memory_inside_value_or_moves_only_where_it_is_there() -> None:
    text = _module("value_or(previous(x, 0), -1) + previous(k, 0) * 10")
    frames = [
        (0, {"x": 1.0, "k": 1.0}, 0),
        (1, {"x": None, "k": 2.0}, 9),
        (2, {"x": 3.0, "k": None}, SILENT),
        (3, {"x": 4.0, "k": 3.0}, 21),
        (4, {"x": 5.0, "k": 4.0}, 34),
    ]
    _run(text, frames)


def test_first_frame_inside_value_or_is_its_own() -> None:
    text = _truth("value_or(changed(x), true)")
    _run(text, _over("x", (0, None, 1), (1, 1.0, 0), (2, None, 1), (3, 2.0, 1), (4, 2.0, 0)))


def test_let_with_memory_is_one_sensor_for_all() -> None:
    text = "let g = previous(x, 0)\n" + _module("g + g + (if fresh(g) then 100 else 0)")
    _run(text, _over("x", (0, 1.0, 100), (1, None, SILENT), (2, 2.0, 102), (3, 3.0, 104)))


def test_let_that_is_missing_where_it_reads_something_missing() -> None:
    text = "let g = x + previous(k, 0)\n" + _module("value_or(g, -1) + (if fresh(g) then 0 else 100)")
    frames = [
        (0, {"x": 1.0, "k": 5.0}, 1),
        (1, {"k": 7.0}, 99),
        (2, {"x": 2.0, "k": 9.0}, 7),
    ]
    _run(text, frames)


def test_states_see_old_values() -> None:
    text = "state p = 1\nstate q = 2\nnext p = q\nnext q = p + value_or(x, 0) * 0\n" + _module("p * 10 + q")
    _run(text, _over("x", (0, 0.0, 12), (1, 0.0, 21), (2, None, 12)))


def test_state_stays_where_next_reads_something_missing() -> None:
    text = "state n = 0\nnext n = n + x\n" + _module("n + k * 0")
    frames = [(t, {"x": x, "k": 0.0}, v) for t, x, v in [(0, 1.0, 0), (1, None, 1), (2, 5.0, 1), (3, 1.0, 6)]]
    _run(text, frames)


def test_state_of_a_module_moves_with_the_module() -> None:
    text = "module m { state n = 0  next n = n + 1  when b  do out(v = n + x) }"
    frames = [
        (t, {"b": b, "x": x}, v)
        for t, b, x, v in [(0, True, 0.0, 0), (1, False, 0.0, None), (2, True, None, None), (3, True, 0.0, 2)]
    ]
    _run(text, frames)


def test_state_without_next_never_changes() -> None:
    _run("state n = 4\n" + _module("n + x"), _over("x", (0, 0.0, 4), (1, 1.0, 5)))


MACHINE = """
machine door {
  start shut
  shut -> ajar when b
  ajar -> open when elapsed(door == door.ajar) >= 1 s and not b
  any  -> shut when c
}
"""


def test_machine() -> None:
    text = MACHINE + _module(
        "(if door == door.shut then 0 else if door == door.ajar then 1 else 2) + value_or(x, 0)"
    )
    frames = [
        (t, {"b": b, "c": c}, v)
        for t, b, c, v in [
            (0, False, False, 0),
            (1, True, None, 0),
            (2, True, False, 1),
            (3, False, False, 1),
            (4, None, True, 2),
            (5, False, False, 0),
            (6, True, True, 0),
            (7, False, False, 1),
        ]
    ]
    _run(text, frames)


def test_memory_in_a_transition_moves_on_in_any_phase() -> None:
    text = "machine s { start one  one -> two when b  two -> one when rising(c) }\n" + _module(
        "(if s == s.two then 1 else 0) + 0 * x"
    )
    frames = [
        (t, {"b": b, "c": c, "x": 0.0}, v)
        for t, b, c, v in [(0, False, True, 0), (1, True, True, 0), (2, False, True, 1), (3, False, True, 1)]
    ]
    _run(text, frames)


def test_time_constant_of_a_node() -> None:
    text = """
robot r {
  sensor b : bool from DServer.b
  sensor c : bool from DServer.c
  actuator out { v : number } to DServer.Out idle hold
}
module high { when b  do out(v = 1) }
module low { when true  do out(v = 2) }
network { out = high suppresses[1.5 s] low }
"""
    program = load_text(text)
    clients = compile_program(program).clients
    executors = [
        ClientListExecutor(program, clients),
        ClientListExecutor(program, clients, exclusive=True),
        load(generate(program, clients)),
        Interpreter(program),
    ]
    rows = [
        (0, False, "low"),
        (1, True, "high"),
        (2, None, None),
        (2.499999999, False, None),
        (2.5, False, "low"),
    ]
    for executor in executors:
        for seconds, b, winner in rows:
            outcome = executor.step(Frame(round(seconds * 1e9), {"b": b}))
            assert outcome.decisions[0].by == winner
