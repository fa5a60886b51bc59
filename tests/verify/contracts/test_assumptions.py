"""What holds where the world does as it is assumed to, and what a verdict says that it rests on."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl.load import load_text
from colony.ir.program import Program, assumptions
from colony.verify.contracts.assumptions import doubtful_assumptions, under
from colony.verify.contracts.kept import ProofCache, kept_proofs
from colony.verify.contracts.prove import prove_contracts, results
from colony.verify.contracts.report import lines, row
from colony.verify.contracts.results import (
    ProofOptions,
    Proved,
    ProvedInTime,
    Refuted,
    Result,
    Unknown,
    with_reaches,
)
from colony.verify.contracts.solver import Deadline
from colony.verify.reference.interpreter import Interpreter
from tests.verify.contracts.behaviors import program

TWO = """
robot r {
  sensor a : number range 0 .. 100 from PServer.a
  sensor b : bool default false from PServer.b
  actuator base { speed : number range -10 .. 10 } to RServer.base idle base(speed = 0)
  actuator arm { out : bool } to DServer.arm idle arm(out = false)
}
module go { when a > 10 do base(speed = 5) }
module reach_out { when a > 50 do arm(out = true) }
network { base = go  arm = reach_out }
"""

ROUTES = {
    "one frame": "assume near: far < 5 m\ncontract c: value_or(far < 6 m, true)",
    "its memory": "assume slow: value_or(previous(far, far) - far < 1 m, true)\n"
    "contract c: value_or(previous(far, far) - far < 2 m, true)",
    "induction": "assume quiet: not value_or(bump, false)\n"
    "state a = 0  next a = if value_or(bump, false) then 1 else 0\n"
    "state b = 0  next b = a  state d = 0  next d = b\ncontract c: d == 0",
    "an invariant": "assume few: n <= 3\nstate n = 0\nnext n = if value_or(bump, false) then n + 1 else n\n"
    "state m = 0  next m = clamp(n, m, 1000)\ncontract c: m <= 3",
    "an invariant while it holds": "assume low: value_or(x >= 0 and x <= 5, true)\nstate m = 0\n"
    "next m = m + (clamp(value_or(x, 0), -100, 100) - m) / 4\ncontract c: m <= 6",
    "the past": "assume once: not value_or(bump, false)\n"
    "contract c: now > 3 min implies not recently(value_or(bump, false), 1 min)",
    "floats": "assume bounded: value_or(x * 0.1 < 1, true) and value_or(x > 0, true)\n"
    "contract c: value_or(x * 0.1 + small < 2.1, true)",
    "in time": "assume slow: value_or(far < 1 m, true)\n"
    "contract c in time: drive.velocity <= 0 m/s or not fresh(far)",
    "what is decided": "assume slow: value_or(far < 1 m, true)\ncontract c: not (drive by cruise)",
    "what was sent": "assume obeyed: last.drive.velocity <= 0.1 m/s\ncontract c: last.drive.velocity < 1 m/s",
}


def verdict(text: str) -> Result:
    return prove_contracts(program(text))[-1]


@pytest.mark.parametrize("route", ROUTES)
def test_a_proof_rests_on_the_assumption_that_it_needs(route: str) -> None:
    found = verdict(ROUTES[route])
    assert isinstance(found, Proved), found
    assert len(found.contract.assuming) == 1
    without = "\n".join(line for line in ROUTES[route].splitlines() if not line.startswith("assume"))
    assert not isinstance(verdict(without), Proved)


def test_a_proof_names_no_assumption_that_it_can_do_without() -> None:
    text = """
assume near: far < 5 m
assume nearer: far < 4 m
assume other: small < 0.5
assume unknown: want != goal.light
contract c: value_or(far < 4.5 m, true)
contract d: value_or(far < 5.5 m, true)
contract both: value_or(far < 4.5 m and small < 0.75, true)
contract always: value_or(far <= 10 m, true)
"""
    found = {r.contract.name: r.contract.assuming for r in prove_contracts(program(text))}
    assert found["c"] == ("nearer",)
    assert found["d"] in (("near",), ("nearer",))
    assert found["both"] == ("nearer", "other")
    assert found["always"] == ()


LIMITED = {
    "always": ("limit drive.velocity <= 0.3 m/s", "last.drive.velocity < 0.31 m/s", True),
    "wider": ("limit drive.velocity <= 0.3 m/s", "last.drive.velocity < 0.29 m/s", False),
    "from below": ("limit drive.velocity >= -0.3 m/s", "last.drive.velocity > -0.31 m/s", True),
    "what was read": ("limit drive.velocity <= far / 10 s", "last.drive.velocity <= 0.01 m/s or known", True),
    "missing": (
        "limit drive.velocity <= far / 10 s",
        "previous(fresh(far), true) or last.drive.velocity <= 0",
        True,
    ),
    "under a condition": (
        "limit drive.velocity <= 0.3 m/s when bump",
        "previous(value_or(bump, true), false) implies last.drive.velocity < 0.31 m/s",
        True,
    ),
    "outside of the condition": (
        "limit drive.velocity <= 0.3 m/s when bump",
        "last.drive.velocity < 0.31 m/s",
        False,
    ),
    "an infinite bound": ("limit drive.velocity <= x * 1 m/s", "last.drive.velocity < 0.31 m/s", False),
    "a bound with memory": (
        "limit drive.velocity <= previous(0.3 m/s, 0.3 m/s)",
        "last.drive.velocity < 0.31 m/s",
        False,
    ),
}


@pytest.mark.parametrize("case", LIMITED)
def test_what_was_sent_kept_the_limits_of_the_frame_before(case: str) -> None:
    limit, claim, holds = LIMITED[case]
    known = "let known = previous(value_or(far > 0.05 m, false), true)"
    result = verdict(f"{limit}\n{known}\ncontract c: previous(true, false) implies ({claim})")
    assert isinstance(result, Proved if holds else Refuted), result
    assert not holds or (result.contract.assuming == () and result.operators)


def test_late_clients_and_operators_are_assumed_nothing_of() -> None:
    text = (
        TWO
        + """
assume calm: a < 60
contract stays: arm.out implies base.speed > 0
contract low: base.speed <= 5
contract quiet: value_or(a < 70, true) or base.speed > 0
"""
    )
    stays, low, quiet = prove_contracts(load_text(text))
    assert isinstance(stays, ProvedInTime)
    assert stays.trace is not None
    assert isinstance(low, Proved)
    assert not low.operators
    assert isinstance(quiet, Proved)
    assert quiet.operators
    assert quiet.contract.assuming == ("calm",)


def test_a_run_that_refutes_breaks_no_assumption() -> None:
    text = (
        TWO
        + """
assume slow: value_or(a - previous(a, 0) <= 9, true)
assume no_b: not b
contract stands: base.speed <= 0
"""
    )
    made = load_text(text)
    [found] = prove_contracts(made)
    assert isinstance(found, Refuted)
    assert found.contract.assuming == ("slow", "no_b")
    assert len(found.trace.snapshots) == 2
    interpreter = Interpreter(made)
    broken = [
        interpreter.step_in_base_units(s.t_ns, s.readings, restarted=s.restarted).breaches
        for s in found.trace.snapshots
    ]
    assert broken == [(), ("stands",)]
    assert "assum" not in found.trace.cause
    assert "assuming" not in lines(made, found)[0]


def test_what_only_runs_that_break_an_assumption_reach_is_never_reached() -> None:
    text = TWO + "assume calm: a < 5\nreach moves: base by go\nreach reads: fresh(a) and a > 4\n"
    moves, reads = prove_contracts(with_reaches(load_text(text)))
    assert isinstance(moves, Proved)
    assert lines(load_text(text), moves)[0].startswith("NEVER REACHED  moves  (assuming calm)")
    assert isinstance(reads, Refuted)


def test_json_and_text_name_the_assumptions() -> None:
    made = program(ROUTES["one frame"])
    [found] = prove_contracts(made)
    assert lines(made, found) == ("proved   c  (assuming near)  (operators too)",)
    assert row(made, found)["assuming"] == ["near"]


def test_a_change_of_an_assumption_is_another_proof(tmp_path: Path) -> None:
    def proofs(bound: str) -> list[Result]:
        made = program(f"assume near: far < {bound}\ncontract c: value_or(far < 6 m, true)")
        cache = ProofCache(tmp_path, made, ProofOptions(), ["c"])
        return list(results(made, ["c"], ProofOptions(), cache=cache))

    assert isinstance(proofs("5 m")[0], Proved)
    kept = sorted(tmp_path.iterdir())
    assert isinstance(proofs("5 m")[0], Proved)
    assert sorted(tmp_path.iterdir()) == kept
    assert isinstance(proofs("7 m")[0], Refuted)
    assert isinstance(proofs("5 m")[0], Proved)


def test_a_proof_stays_with_the_params_of_a_site_under_assumptions() -> None:
    def made(clearance: str) -> Program:
        return program(
            f"param room = {clearance}\nassume near: far < room\ncontract c: value_or(far < 6 m, true)"
        )

    for clearance, is_kept in (("5 m", True), ("7 m", False)):
        found = kept_proofs(
            made("4 m"), made(clearance), folder=None, options=ProofOptions(), on_progress=lambda *_: None
        )
        assert (found.proved == ("c",)) is is_kept


def doubts(text: str) -> list[str]:
    made = load_text(TWO + text)
    found = doubtful_assumptions(made, ProofOptions(), Deadline())
    return [
        f"{d.code} {d.span.text}: {' '.join(label.span.text for label in d.labels)}".strip() for d in found
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("assume p: a < 3\nassume q: value_or(a > 1, true)", []),
        ("assume p: a < 3\nassume q: a > 5\nassume other: b", ["V016 p: q"]),
        ("assume never: a > 100", ["V016 never:"]),
        ("assume always: a <= 100", ["V017 always:"]),
        ("state n = 0\nnext n = n + 1\nassume brief: n < 10", ["V016 brief:"]),
        ("assume late: now > 1 s", ["V016 late:"]),
        ("assume p: a < 3\nassume q: b\nassume pq: not b or a > 5", ["V016 p: q pq"]),
    ],
)
def test_assumptions_that_no_run_meets(text: str, expected: list[str]) -> None:
    assert doubts(text) == expected


def test_without_assumptions_a_program_is_the_same() -> None:
    made = program("contract c: far > 1 m")
    assert under(made, []) is made
    assert assumptions(made) == ()
    assert doubtful_assumptions(made, ProofOptions(), Deadline()) == []


def test_what_stays_unknown_is_unknown_under_assumptions() -> None:
    text = "assume near: far < 5 m\ncontract c: value_or(sin(slope) * sin(slope) * small < 0.999, true)"
    found = verdict(text)
    assert isinstance(found, Unknown | Refuted)
    assert found.contract.assuming == ("near",)
