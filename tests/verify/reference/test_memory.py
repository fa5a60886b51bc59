"""Functions with memory, frame by frame, by hand."""

from __future__ import annotations

import pytest

from tests.verify.stepping import every, run, values, winners

T, F = True, False


@pytest.mark.parametrize(
    ("expression", "rows", "expected"),
    [
        ("previous(a, true)", {"a": "0110"}, [T, F, T, T]),
        ("previous(a, b)", {"a": "00", "b": "11"}, [T, F]),  # the initial value of the first frame only
        ("changed(a)", {"a": "1101"}, [F, F, T, T]),
        ("rising(a)", {"a": "1101"}, [T, F, F, T]),
        ("falling(a)", {"a": "0100"}, [F, F, T, F]),
        ("latch(a, b)", {"a": "010011", "b": "000110"}, [F, T, T, F, F, T]),  # reset wins
        ("held(a, 100 ms)", {"a": "010000"}, [F, T, T, F, F, F]),  # until, and not including
        ("held(a, 0 ms)", {"a": "0100"}, [F, T, F, F]),
        ("elapsed(a)", {"a": "1110110"}, [0.0, 0.05, 0.1, 0.0, 0.0, 0.05, 0.0]),
        ("every(100 ms)", {"a": "00000"}, [T, F, T, F, T]),
        ("every(120 ms)", {"a": "0000000"}, [T, F, F, T, F, F, T]),
        ("captured(now(), a)", {"a": "00110"}, [0.0, 0.0, 0.1, 0.1, 0.2]),
    ],
)
def test_a_frame_every_50_ms(expression: str, rows: dict[str, str], expected: list[object]) -> None:
    assert values(expression, *every(50, **rows)) == expected


def test_durations_are_whole_nanoseconds() -> None:
    one_ns = 1e-6
    shots = [(0, {"a": T}), (100 - one_ns, {"a": F}), (100, {"a": F})]
    assert values("held(a, 0.1 s)", *shots) == [T, T, F]
    assert values("every(0.1 s)", *shots) == [T, F, T]


def test_every_counts_from_when_it_was_last_true() -> None:
    shots = [(t, {}) for t in (0, 130, 200, 230, 240)]
    assert values("every(100 ms)", *shots) == [T, T, F, T, F]


def test_captured_anew_at_each_change_of_the_key_only() -> None:
    shots = [(i, {"x": float(i), "y": y}) for i, y in enumerate((1.0, 1.0, 2.0, 1.0, 1.0))]
    assert values("captured(x, y)", *shots) == [0.0, 0.0, 2.0, 3.0, 3.0]


def test_a_key_that_is_nan_differs_from_itself() -> None:
    shots = [(i, {"x": float(i), "y": 0.0}) for i in range(3)]
    assert values("captured(x, y / y)", *shots) == [0.0, 1.0, 2.0]


def test_changed_of_nan_is_true_after_the_first_frame() -> None:
    assert values("changed(x / x)", *[(i, {"x": 0.0}) for i in range(2)]) == [F, T]


def test_missing_frames_leave_memory_as_it_was() -> None:
    assert values("previous(a, false)", *every(50, a="10.1")) == [F, T, None, F]
    assert values("rising(a)", *every(50, a="1.1")) == [T, None, F]
    assert values("latch(a, b)", *every(50, a="1.0", b="0.0")) == [T, None, T]


def test_time_goes_on_while_missing() -> None:
    assert values("elapsed(a)", *every(50, a="1..1")) == [0.0, None, None, pytest.approx(0.15)]
    assert values("held(a, 100 ms)", *every(50, a="1..0")) == [T, None, None, F]
    assert values("every(100 ms)", *every(50, a="0..00")) == [T, F, T, F, T]  # reads nothing
    assert values("every(100 ms) and (a or true)", *every(50, a="0..00")) == [T, None, None, T, F]


def test_each_element_has_its_own() -> None:
    shots = [(0, {"bits": (T, F, F, F)}), (50, {"bits": (F, T, F, F)}), (100, {"bits": (F, F, F, F)})]
    expected = [(T, F, F, F), (T, T, F, F), (F, T, F, F)]
    assert values("held(bits, 100 ms)", *shots) == expected
    assert values("previous(four, x)", (0, {"four": (1.0,) * 4, "x": 7.0})) == [(7.0,) * 4]


def test_each_loop_index_has_its_own_also_where_the_condition_is_false() -> None:
    shots = [
        (0, {"bits": (T, F, F, F), "a": F}),
        (50, {"bits": (F, T, F, F), "a": F}),
        (99, {"bits": (F, F, F, F), "a": T}),
    ]
    assert values("count(held(bits[k], 100 ms) for k in 0 .. 3 if a)", *shots) == [0.0, 0.0, 2.0]
    assert (
        values("count(rising(bits[k]) or rising(bits[j]) for k in 0 .. 1)", *shots, before="let j = 3")[0]
        == 1.0
    )


def test_nested_loops_have_memory_for_each_pair() -> None:
    shots = [(0, {"x": 1.0}), (50, {"x": 2.0})]
    nested = "sum(sum(previous(x * k * j, 0) for j in 1 .. 2) for k in 1 .. 2)"
    assert values(nested, *shots) == [0.0, 9.0]


def test_memory_moves_on_in_a_branch_not_taken() -> None:
    rows = every(50, a="0110", b="0001")
    assert values("if b then previous(a, false) else false", *rows) == [F, F, F, T]
    assert values("b and previous(a, false)", *rows) == [F, F, F, T]
    assert values("not b or previous(a, false)", *rows) == [T, T, T, T]
    assert values("b implies previous(a, false)", *rows) == [T, T, T, T]


def test_value_or_moves_memory_where_all_is_there() -> None:
    # rising(a) misses the frames without b; the other side moves on always.
    shots = every(50, a="0110", b="1.11")
    assert values("value_or(rising(a) and (b or true), false)", *shots) == [F, F, T, F]
    shots = every(50, a="1001", b="1.1.")
    assert values("value_or(b, previous(a, false))", *shots) == [T, T, T, F]


def test_value_or_gives_the_other_only_where_something_is_missing() -> None:
    assert values("value_or(x, 5)", (0, {"x": 1.0}), (1, {})) == [1.0, 5.0]
    assert values("value_or(x, y)", (0, {"x": 1.0}), (1, {"y": 2.0}), (2, {"x": 3.0, "y": 2.0})) == [
        None,
        2.0,
        3.0,
    ]
    assert values("value_or(value_or(x, y), 9)", (0, {"x": 1.0}), (1, {"y": 2.0})) == [9.0, 2.0]
    assert values("value_or(four, 1)", (0, {})) == [(1.0,) * 4]
    assert values("value_or(x / 0, 1)", (0, {"x": 1.0})) == [float("inf")]


def test_fresh_needs_nothing() -> None:
    assert values("fresh(x) and not fresh(y)", (0, {"x": 1.0}), (1, {"y": 1.0}), (2, {})) == [T, F, F]


def test_now_starts_at_the_first_frame() -> None:
    assert values("now()", (5000, {}), (5050, {}), (5200, {})) == [0.0, 0.05, 0.2]


# --- derived values ------------------------------------------------------------------------------


def test_a_let_is_missing_exactly_when_something_it_reads_is() -> None:
    before = "let first = x + 1\nlet second = value_or(first, 0)"
    assert values("first + second", (0, {"x": 1.0}), (1, {}), before=before) == [4.0, None]
    assert values("second", (0, {"x": 1.0}), (1, {}), before=before) == [2.0, 0.0]
    assert values("fresh(first)", (0, {"x": 1.0}), (1, {}), before=before) == [T, F]


def test_a_let_is_evaluated_once_whoever_reads_it() -> None:
    before = "let tick = rising(a)"
    assert values("count(tick, tick, previous(tick, false))", *every(50, a="11"), before=before) == [2.0, 1.0]


def test_states_show_their_old_values() -> None:
    before = "state n = 1\nstate m = 2\nnext n = m\nnext m = n"
    assert values("10 * n + m", *every(50, a="000"), before=before) == [12.0, 21.0, 12.0]


def test_a_state_stays_where_its_next_reads_something_missing() -> None:
    before = "state n = 0\nnext n = n + x"
    shots = [(0, {"x": 1.0}), (1, {}), (2, {"x": 1.0}), (3, {})]
    assert values("n", *shots, before=before) == [0.0, 1.0, 1.0, 2.0]


def test_a_state_without_next_never_changes() -> None:
    assert values("n", *every(50, a="00"), before="state n : number = 7") == [7.0, 7.0]


MACHINE = """
machine phase {
  start idle_now
  idle_now -> going when a
  going -> ended when b
  any -> idle_now when c
}
"""


def test_a_transition_is_seen_in_the_next_frame() -> None:
    rows = every(50, a="10100", b="01000", c="00010")
    assert values("phase == phase.going", *rows, before=MACHINE) == [F, T, F, F, F]
    assert values("phase == phase.ended", *rows, before=MACHINE) == [F, F, T, T, F]


def test_the_first_transition_that_applies_is_taken() -> None:
    rows = every(50, a="110", b="010", c="010")  # from `going` both `b` and `c` apply
    assert values("phase == phase.ended", *rows, before=MACHINE) == [F, F, T]


def test_any_is_every_phase_but_the_target() -> None:
    before = "machine m {\n start one\n any -> two when a\n any -> one when a\n}"
    assert values("m == m.one", *every(50, a="111"), before=before) == [T, F, T]


def test_a_transition_that_reads_something_missing_is_not_taken() -> None:
    assert values("phase == phase.going", *every(50, a=".100", c=".00."), before=MACHINE) == [F, F, T, T]


def test_memory_in_a_condition_moves_on_whatever_the_phase() -> None:
    before = "machine m {\n start one\n one -> two when a\n two -> three when falling(b)\n}"
    # b is true only while the machine is in `one`, and falls when it has just come to `two`.
    assert values("m == m.three", *every(50, a="0100", b="1100"), before=before) == [F, F, F, T]


def test_the_timer_of_a_phase() -> None:
    rows = every(50, a="1000", b="0001")
    timer = "elapsed(phase == phase.going)"
    assert values(timer, *rows, before=MACHINE.replace("when c", "when false")) == [0.0, 0.0, 0.05, 0.1]


# --- memory of modules ---------------------------------------------------------------------------

DRIVER = "network { out = it }\n"


def test_memory_moves_on_where_the_predicate_is_false() -> None:
    text = DRIVER + "module it { let was = previous(a, false) when b and was do out(v = 1) }"
    assert winners(text, *every(50, a="010", b="001")) == [None, None, "it"]


def test_memory_in_the_command_moves_on_where_the_predicate_is_false() -> None:
    text = DRIVER + "module it { when b do out(v = if previous(a, false) then 1 else 0) }"
    assert run(text, *every(50, a="10", b="01"))[1].decisions[0].values == (1.0,)


def test_memory_stays_where_the_module_is_silent() -> None:
    text = DRIVER + "module it { state n = 0 next n = n + 1 when a do out(v = n) }"
    outcomes = run(text, *every(50, a="1.01"))
    assert [o.decisions[0].values for o in outcomes] == [(0.0,), None, None, (2.0,)]


def test_memory_moves_on_where_the_output_does_not_get_through() -> None:
    text = """
      module top { when a do out(v = 0) }
      module it { state n = 0 next n = n + 1 when true do out(v = n) }
      network { out = top suppresses it }
    """
    assert [o.decisions[0].values for o in run(text, *every(50, a="110"))] == [(0.0,), (0.0,), (2.0,)]


def test_variations_have_memory_of_their_own() -> None:
    text = """
      module it { param from_what = 1 let was = previous(x, 0) when was >= from_what do out(v = was) }
      module gentle = it(from_what = 3)
      network { out = gentle suppresses it }
    """
    shots = [(i, {"x": x}) for i, x in enumerate((2.0, 3.0, 0.0))]
    assert winners(text, *shots) == [None, "it", "gentle"]
