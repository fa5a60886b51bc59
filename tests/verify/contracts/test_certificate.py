"""Solvers that know nothing of colony accept certificates, and none that is altered."""

from __future__ import annotations

import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest
import z3

from colony.dsl.load import load_text
from colony.ir.program import Program
from colony.verify.contracts import attempt
from colony.verify.contracts.certificate import certificate
from colony.verify.contracts.prove import ContractProver, results
from colony.verify.contracts.results import ProofOptions, Proved, ProvedInTime, Result
from tests.verify.contracts.behaviors import MEAN, program

CYCLE = "state e = 0  next e = if e == 0 then 1 else if e == 7 then 8 else 0\ncontract c: e != 8\n"
"""Without invariants, two frames must be known: only 7 leads to 8, and nothing to 7."""

IN_STEP = """
state a = 0  next a = if bump and a < 100 then a + 1 else a
state b = 0  next b = if bump and a < 100 and b < 300 then b + 2 else b
contract c: b == 10 implies a == 5
"""
"""Spacer finds the relation of the two, once they are known to be whole numbers."""

REGULAR = """
robot r { frame 50 ms jitter 10 ms }
state n = 0  next n = n + 1
state m = 0  next m = n
contract c: m + 1 == n or n == 0
"""

PROGRAMS = {  # with texts that the certificate has
    "a single frame": ("contract c: not fresh(stop) implies not stop", ["contract c: in any frame"]),
    "an invariant by Houdini": (
        "machine m { start rest  rest -> go when bump  go -> rest when falling(bump) }\n"
        "contract c: m == m.rest or m == m.go",
        [": before the first frame", ": before the next frame"],
    ),
    "an invariant by Spacer": (IN_STEP, ["a > 0 or b < 2: before the next frame"]),
    "any rounding": ("contract c: fresh(x) and fresh(bump) and x + 0.1 > 3 and bump implies bump", []),
    "close rounding": (MEAN + "contract c: mean <= 10.000001", ["|rounded#0@0|", ": before the next frame"]),
    "decisions": (
        "contract c: drive.velocity in -1 m/s .. 1 m/s",
        [
            "; Covered: runs with clients late or lost, and commands from outside",
            "contract c operators: in any",
        ],
    ),
    "late clients": (
        "contract c: drive by back implies fresh(bump)\ncontract d: drive by cruise implies fresh(far)",
        ["contract d operators: in any frame"],
    ),
    "only in time": (
        "contract c: back is active and not (cruise is active) implies drive by back",
        ["; Covered: runs with every client in time.\n(set-info"],
    ),
    "meant in time": (
        "contract c in time: back is active and not (cruise is active) implies drive by back",
        ["; Covered: runs with every client in time.\n(set-info"],
    ),
}


def certificates(made: Program) -> list[str]:
    """Return the certificates of all contracts."""
    options, found = ProofOptions(), list[str]()

    def certify(prover: ContractProver, proved: Result) -> None:
        assert isinstance(proved, Proved | ProvedInTime)
        text = certificate(prover, proved, options)
        assert text is not None
        found.append(text)

    list(results(made, [c.name for c in made.contracts], options, on_result=certify))
    return found


@cache
def certified(text: str) -> str:
    """Return the certificate of the last contract of a text."""
    return certificates(program(text))[-1]


def is_accepted(text: str) -> bool:
    """Return True if z3 answers all queries of a text as they say, and knows nothing else of the program."""
    context = z3.Context()
    try:
        found = z3.Z3_eval_smtlib2_string(context.ref(), text)
    except z3.Z3Exception as problem:
        found = str(problem)
    assert found.count("sat") >= text.count("(check-sat)") > 0, found
    return set(found.split()) == {"unsat"}


def unproved(text: str) -> set[str]:
    """Return the contracts and invariants that a certificate uses without a query about them."""
    item = r"(contract [^|]*|invariant \d+) (?:in|before) frame \d+"
    return set(re.findall(rf"\(assert \|{item}\|", text)) - set(re.findall(rf"\(not \|{item}\|", text))


@pytest.fixture
def no_invariants(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing guesses invariants, so that only k-induction is left."""
    monkeypatch.setattr(attempt, "candidates", lambda *_: ())
    monkeypatch.setattr(attempt, "solve", lambda *_, **__: None)


@pytest.mark.parametrize(("text", "has"), PROGRAMS.values(), ids=PROGRAMS)
def test_a_certificate_is_accepted_as_it_is(text: str, has: list[str]) -> None:
    found = certified(text)
    assert is_accepted(found)
    assert not unproved(found)
    assert all(part in found for part in has)


@pytest.mark.parametrize("text", [text for text, _ in PROGRAMS.values()], ids=PROGRAMS)
def test_a_certificate_in_which_the_contract_is_altered_is_not_accepted(text: str) -> None:
    found = certified(text)
    altered = re.sub(r"(\(define-fun \|contract [^|]* frame 0\| \(\) Bool \(and) true", r"\1 false", found)
    assert altered != found
    assert not is_accepted(altered)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (r"\(= 0 b@0\)", "(= 4 b@0)"),
        (r"\(\+ b@0 2\)", "(+ b@0 3)"),
        (r"(invariant \d+ before frame 0\| \(\) Bool) \(and true", r"\1 (or true"),
        (r"(invariant \d+ before frame 1\| \(\) Bool) \(and true", r"\1 (and false"),
    ],
    ids=["the first memory", "the next memory", "what is assumed", "what is shown"],
)
def test_a_certificate_in_which_memory_or_invariants_are_altered_is_not_accepted(old: str, new: str) -> None:
    found = certified(IN_STEP)
    altered = re.sub(old, new, found)
    assert altered != found
    assert not is_accepted(altered)


@pytest.mark.usefixtures("no_invariants")
def test_induction_over_several_frames_has_its_base() -> None:
    found = certified(CYCLE)
    comments = re.findall(r"; contract c: (.*)", found)
    assert comments == ["in frame 0 of a run", "in frame 1 of a run", "after 2 frames"]
    assert is_accepted(found)
    assert not is_accepted(found.replace("last@0)\n  (= 0 e@0)", "last@0)\n  (= 7 e@0)"))
    assert not is_accepted(found.replace("(assert |frame 0 leads to frame 1|)", ""))


@pytest.mark.usefixtures("no_invariants")
def test_a_contract_that_helps_is_proved_as_well() -> None:
    found = certified(f"{CYCLE}contract d: e != 8 or bump\n")
    assert "(assert |contract c in frame 0|)\n(assert (not |contract d in frame 0|))" in found
    assert "; contract c: after 2 frames" in found
    assert is_accepted(found)
    assert not unproved(found)


@pytest.mark.thorough
def test_a_range_that_follows_from_the_longest_run_is_named_as_an_assumption() -> None:
    made = load_text(REGULAR)
    found = certificates(made)[-1]
    assert re.search(r"; Assumed: invariant \d+, \(0 <= n\) and .*, which is a part of the encoding", found)
    assert is_accepted(found)


@pytest.mark.skipif(shutil.which("cvc5") is None, reason="no cvc5")
@pytest.mark.parametrize("text", [text for text, _ in PROGRAMS.values()], ids=PROGRAMS)
def test_another_solver_accepts_it(text: str, tmp_path: Path) -> None:
    file = tmp_path / "c.smt2"
    file.write_text(certified(text))
    ran = subprocess.run(["cvc5", "--incremental", file], capture_output=True, text=True, timeout=60)
    assert set(ran.stdout.split()) == {"unsat"}
