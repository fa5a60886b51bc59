"""What frames cover, held against a second calculation that shares no code with the first."""

from __future__ import annotations

import re
from collections import Counter

import pytest

from colony.ir.program import Machine, PythonModule
from colony.text.wording import one_line
from colony.verify.coverage.measure import covered_by
from colony.verify.coverage.obligations import CoveragePlan, Obligation, plan_of, transition_text
from colony.verify.coverage.recorder import seen_in
from colony.verify.snapshot import snapshot_of
from tests.drawn.strategies import run_of_seed
from tests.sampling import sampled
from tests.verify.coverage.naive import Key, covered

_BLOCK = 50


def _keys(plan: CoveragePlan) -> dict[Key, Obligation]:
    """Return the obligations that both calculations know, by their keys in the naive one."""
    machines = [d for d in plan.program.derived if isinstance(d, Machine)]
    owners = {
        (f"{m.name}: {transition_text(m, t)}", start): f"{m.name} {i}"
        for m in machines
        for i, t in enumerate(m.transitions)
        for start in range(t.condition.span.start, t.condition.span.end)
    }
    for i, limit in enumerate(plan.program.limits):
        span = limit.span
        owners |= {
            (one_line(span.text).removeprefix("limit "), at): f"limit {i}"
            for at in range(span.start, span.end)
        }
    sequences = {m.name for m in machines if m.tasks}  # their parts do not stand in the order of the text
    python = {m.name for m in plan.program.modules if isinstance(m, PythonModule)}
    keys: dict[Key, Obligation] = {}
    numbers = Counter[str]()
    for o in plan.obligations:
        match o.kind:
            case "node":
                keys["node", " ".join(o.ways[0][0].name.split()[1:3]), o.text] = o
            case "condition":
                owner = owners.get((o.subject, o.span.start), o.subject)
                if re.split(r"[.: ]", owner)[0] in sequences:
                    continue
                keys["condition", owner, str(numbers[owner])] = o
                numbers[owner] += 1
            case "module" | "sensor" if o.text != "blind" or o.subject not in python:
                keys[o.kind, o.subject, o.text] = o
            case "contract":
                keys["contract", o.subject, ""] = o
            case "machine":
                if " -> " not in o.text:
                    keys[o.kind, o.subject, o.text] = o
            case _:
                pass
    return keys


@pytest.mark.parametrize("block", sampled(range(40), every=20, thorough=True))
def test_drawn_runs_cover_what_a_naive_calculation_finds(block: int) -> None:
    wrong, agreed, conditions = [], 0, 0
    for seed in range(block * _BLOCK, (block + 1) * _BLOCK):
        program, frames = run_of_seed(seed, network=seed % 5 == 0)
        plan = plan_of(program, everywhere=True)
        seen = seen_in(plan, [snapshot_of(program, f) for f in frames])
        with pytest.MonkeyPatch.context() as patch:
            expected = covered(program, frames, patch)
        for key, obligation in _keys(plan).items():
            if covered_by(obligation, seen) != (key in expected):
                wrong.append((seed, key))
            agreed += 1
            conditions += key[0] == "condition" and key in expected
    assert not wrong
    assert agreed > 10 * _BLOCK
    assert conditions > _BLOCK // 5
