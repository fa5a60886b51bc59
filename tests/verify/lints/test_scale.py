"""The work of the lints on long chains, in counts."""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from colony.dsl.load import load_text
from colony.ir.program import Program
from colony.verify.contracts.results import RESOURCES_PER_SECOND
from colony.verify.lints import Effort, lint
from colony.verify.lints.case import case_of
from colony.verify.symbolic import encode, system
from colony.verify.symbolic.encode import OpenEncoding
from tests.verify.lints.programs import ROBOT, USES
from tests.verify.small_robot import go


def chain(modules: int) -> Program:
    """A chain of suppressors in which every module but `cruise` reads the same sensor."""
    text = "".join(go(f"m{i}", f"sonar < {i + 1} mm", f"{i} mm/s") for i in range(modules - 1)) + go(
        "cruise", "true"
    )
    names = [*(f"m{i}" for i in range(modules - 1)), "cruise"]
    return load_text(f"{ROBOT}{text}network {{ drive = {' suppresses '.join(names)} }}\n{USES}")


@dataclass(frozen=False, slots=True)
class Counts:
    """Counts of the work of one lint run. Mutable."""

    frames: int = 0
    claims: list[str] = field(default_factory=list)


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> Counts:
    found = Counts()
    encode_frame, contract_claim = encode.encode_frame, encode.contract_claim

    def counted_frame(*args: object) -> encode.FrameParts:
        found.frames += 1
        return encode_frame(*args)  # type: ignore[arg-type]

    def counted_claim(contract: object, *args: object) -> system.ContractFormula:
        claim = contract_claim(contract, *args)  # type: ignore[arg-type]
        found.claims.append(claim.name)
        return claim

    monkeypatch.setattr(encode, "encode_frame", counted_frame)
    monkeypatch.setattr(encode, "contract_claim", counted_claim)
    return found


def test_questions_about_a_chain_grow_with_its_length(counts: Counts) -> None:
    for modules in (20, 40):
        effort = Effort()
        lint(chain(modules), effort)
        assert effort.questions_asked <= 2 * modules
    assert counts.frames == 2  # one encoding for each program


def test_no_claim_is_encoded_twice(counts: Counts) -> None:
    lint(chain(20))
    assert len(set(counts.claims)) == len(counts.claims)


def test_spent_effort_asks_and_encodes_nothing_more(counts: Counts) -> None:
    effort = Effort(RESOURCES_PER_SECOND // 2)
    lint(chain(40), effort)
    assert 0 < effort.questions_asked <= 10
    assert effort.questions_skipped > 0
    assert len(counts.claims) <= 2 * effort.questions_asked + 2


def test_questions_are_reported() -> None:
    numbers: list[int] = []
    effort = Effort(on_question=numbers.append)
    lint(chain(10), effort)
    assert numbers == list(range(1, effort.questions_asked + 1))


def test_what_gets_through_a_chain_is_encoded_in_linear_size() -> None:
    sizes = []
    for modules in (100, 200):
        encoding = OpenEncoding(case_of(chain(modules)).instrumented)
        graph = encoding.system.graph
        graph.add(encoding.system.actuators["drive"].wins.values())
        sizes.append(len(graph._kept))
    assert sizes[1] <= 2.2 * sizes[0]
