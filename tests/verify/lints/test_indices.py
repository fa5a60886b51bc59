"""Lint of computed indices: what is proved to be inside, and what a run shows to be outside."""

from __future__ import annotations

import math

import pytest

from colony.dsl.load import load_text
from colony.text.diagnostics import Diagnostic
from colony.verify.lints import lint
from colony.verify.lints.indices import accesses
from colony.verify.lints.proof import Finding, replay, run_lines
from colony.verify.reference.interpreter import Interpreter

ROBOT = """robot r {
  sensor five[5] : mm from D.five
  sensor flags[5] : bool from D.flags
  sensor arc[8] : mm bearing -70 deg step 20 deg from D.arc
  sensor ring[8] : mm bearing -180 deg from D.ring
  sensor i : number range 0 .. 4 from D.i
  sensor free : number from D.free
  sensor ahead : deg range -60 .. 60 from D.ahead
  sensor wide : deg range -180 .. 180 from D.wide
  sensor heading : deg from D.heading
  actuator out { v : mm } to D.out idle hold
}
module m { when true do out(v = 0) }
network { out = m }
"""


def found(text: str) -> list[Finding]:
    program = load_text(ROBOT + text)
    return [finding for finding in lint(program) if finding.diagnostic.code == "V036"]


def diagnostics(text: str) -> list[Diagnostic]:
    return [finding.diagnostic for finding in found(text)]


@pytest.mark.parametrize(
    "expression",
    [
        "five[i]",  # by the range of a sensor
        "five[min(4, i + 1)]",
        "five[clamp(i * 7, 0, 4)]",
        "five[mod(i + 1, 4)]",
        "five[index_of_min(five)]",
        "five[index_of_max(five[1..3])]",
        "five[previous(i, 0)]",
        "five[1 + 2]",
        "value_or(five[free], 0)",
        "value_or(arc[heading], 0)",
        "min(window(five, clamp(i, 1, 3), 1))",
        "min(window(ring, i, 2))",
        "ring[i * 100]",
        "ring[wide]",
        "arc[ahead]",
        "min(five[k] for k in 0 .. 4)",
        "min(five[k - 1] for k in 1 .. 5 if flags[4])",
        "min(arc[a] for r, a in arc)",
        "min(five[clamp(r / 1 mm, 0, 4)] for r in value_or(five, 0) if r < 1 mm)",
        "min(if x < 0 mm then 1 mm else x for x in five)",
    ],
)
def test_proved_to_be_inside(expression: str) -> None:
    finite = expression.replace("r / 1 mm", "i")
    assert diagnostics(f"let x = {finite}") == []


@pytest.mark.parametrize(
    ("expression", "says"),
    [
        ("five[free]", "the index is"),
        ("five[i + 1]", "the index is"),
        ("five[previous(i, 5)]", "the index is outside at 0 s of a run of 1 frame, the last index 4"),
        ("if free >= 0 and free <= 4 then five[free] else 0", "can be outside the array"),
        ("five[if flags[0] then 0 else 7]", "the index is 7 at 0 s"),
        ("value_or(five[free] + 0, 0)", "can be outside the array"),
        ("value_or(five[0], five[free])", "can be outside the array"),
        ("min(window(five, i, 1))", "the center is"),
        ("ring[free]", "an index that is not finite: the index is"),
        ("min(window(ring, free, 1))", "an index that is not finite: the center is"),
        ("ring[heading]", "can look where there is no element: the angle is"),
        ("arc[wide]", "can look where there is no element: the angle is"),
        ("min(five[k] for k in 0 .. 5)", "the index is outside"),
        ("min(r for r in five if five[free] < r)", "can be outside the array"),
        ("min(arc[a + 10 deg] for r, a in arc)", "the angle is outside"),
        ("if flags[free] then 1 mm else 0", "can be outside the array"),
    ],
)
def test_outside_in_a_run(expression: str, says: str) -> None:
    text = f"let x = {expression}"
    [finding] = found(text)
    assert says in finding.diagnostic.message
    assert finding.diagnostic.severity == "warning"
    program, trace = load_text(ROBOT + text), finding.run.trace
    assert replay(program, trace.snapshots) == trace.outcomes
    instrumented, [*claims] = accesses(program)
    interpreter = Interpreter(instrumented)
    breaches = [
        interpreter.step_in_base_units(s.t_ns, s.readings, restarted=s.restarted).breaches
        for s in trace.snapshots
    ]
    assert breaches[-1] == tuple(claim.claim.name for claim in claims)
    assert run_lines(program, finding)[0].startswith("V036 ")


@pytest.mark.parametrize(
    "expression",
    ["arc[heading]", "arc[heading * 2]", "arc[-heading]", "five[free]", "arc[previous(heading, 0)]"],
)
def test_runs_outside_prefer_finite_values(expression: str) -> None:
    [finding] = found(f"let x = {expression}")
    readings = [x for s in finding.run.trace.snapshots for x in s.readings.values()]
    assert all(math.isfinite(x) for x in readings if isinstance(x, float))
    assert "inf" not in finding.diagnostic.message


def test_the_hint_names_sensors_that_could_have_a_range() -> None:
    hints = [d.hint or "" for d in diagnostics("let x = arc[heading + wide]\nlet y = arc[wide]")]
    assert hints[0].endswith("`value_or(arc[heading + wide], ...)`; or give `heading` a range")
    assert hints[1].endswith("`value_or(arc[wide], ...)`")


def test_an_element_that_decides_is_an_error() -> None:
    text = """
module a { let x = five[free + 1]  when five[free] < 1 mm  do out(v = five[free + 2]) }
machine phase { start one  one -> two when flags[free]  two -> one when flags[i] }
limit out.v <= five[free + 3] when flags[free + 4]
contract k: five[free + 5] < 1 mm
"""
    program = load_text((ROBOT + text).replace("out = m", "out = a suppresses m"))
    said = {
        f.diagnostic.span.text: f.diagnostic.severity for f in lint(program) if f.diagnostic.code == "V036"
    }
    assert said == {
        "five[free]": "error",
        "five[free + 1]": "warning",
        "five[free + 2]": "warning",
        "flags[free]": "error",
        "five[free + 3]": "error",
        "flags[free + 4]": "error",
        "five[free + 5]": "warning",
    }


def test_only_frames_in_which_the_owner_has_what_it_reads() -> None:
    """Without `free` the module is silent, and nothing is computed."""
    text = "module a { when five[if fresh(free) then i else 9] < free * 1 mm do out(v = 0) }\n"
    program = load_text((ROBOT + text).replace("out = m", "out = a suppresses m"))
    assert [f for f in lint(program) if f.diagnostic.code == "V036"] == []
    text = "let x = five[if fresh(free) then i else 9] + free * 1 mm"
    assert diagnostics(text) == []
    [at_nine] = diagnostics("let x = five[if fresh(free) then i else 9]")
    assert "the index is 9" in at_nine.message


def test_what_value_or_reads_is_present_where_an_index_is_computed() -> None:
    assert diagnostics("let x = value_or(five[if fresh(free) then i else 9] + free * 1 mm, 0)") == []


def test_by_the_invariant_of_a_state() -> None:
    bounded = "state n : number = 0\nnext n = min(n + i, 4)\nlet x = five[n]"
    assert diagnostics(bounded) == []
    assert diagnostics("state n : number = 0\nnext n = if n < 4 then n + 1 else 0\nlet x = five[n]") == []
    mean = "state n : number = 0\nnext n = n + (clamp(i, 0, 5) - n) / 4\nlet x = five[floor(n)]"
    [note] = diagnostics(mean)
    assert note.severity == "note"
    assert "proved to be inside the array only over real numbers" in note.message
    [finding] = found("state n : number = 0\nnext n = if n < 5 then n + 1 else 0\nlet x = five[n]")
    assert len(finding.run.trace.snapshots) == 6
    assert "the index is 5 at" in finding.diagnostic.message


def test_neither_proved_nor_refuted() -> None:
    [finding] = found("state n : number = 0\nnext n = if n < 3000 then n + 1 else 0\nlet x = five[n / 620]")
    assert finding.run is None
    assert finding.diagnostic.severity == "warning"
    assert "is not proved to be inside the array: " in finding.diagnostic.message


def test_a_module_and_those_derived_from_it_have_one_finding() -> None:
    text = "module a { when five[free] < 1 mm do out(v = 0) }\nmodule b = a\n"
    program = load_text((ROBOT + text).replace("out = m", "out = a suppresses b suppresses m"))
    assert [f.diagnostic.code for f in lint(program)].count("V036") == 1


def test_an_index_in_a_function_has_a_finding_for_each_call_with_its_arguments() -> None:
    function = "let along(x[] : mm, a : deg) = 2 * x[a - 5 deg]\nlet wider(x[] : mm) = along(x, 2 * wide)\n"
    calls = "let p = along(ring, heading) + along(arc, wide) + along(arc, ahead)\nlet q = wider(arc)"
    found = diagnostics(function + calls)
    assert {f.span.text for f in found} == {"x[a - 5 deg]"}
    arguments = [tuple(label.span.text for label in f.labels) for f in found]
    assert arguments == [("ring", "heading"), ("arc", "wide"), ("arc", "2 * wide")]


def test_programs_without_computed_indices_are_not_encoded_again() -> None:
    program = load_text(ROBOT + "let x = five[3] + min(ring[k] for k in 0 .. 7) + arc[0 deg]")
    instrumented, claims = accesses(program)
    assert claims == ()
    assert instrumented.derived == program.derived
