"""Changing what an answer names changes the outcome."""

from __future__ import annotations

from collections import Counter

import pytest

from tests.sampling import sampled
from tests.verify.explain.flipping import asked, drawn_run, findings


@pytest.mark.parametrize("network", [False, True])
@pytest.mark.parametrize("seed", sampled(range(60), every=20, thorough=True))
def test_what_an_answer_says_had_to_change_changes_the_outcome(seed: int, network: bool) -> None:
    program, trace = drawn_run(seed, network=network)
    counts = Counter[str]()
    assert not [found for answer in asked(program, trace) for found in findings(answer, counts)]
    assert counts["answers"]


def test_most_answers_name_what_had_to_change() -> None:
    counts = Counter[str]()
    for seed in range(2):
        for network in (False, True):
            program, trace = drawn_run(seed, network=network)
            for answer in asked(program, trace):
                assert not [*findings(answer, counts)]
    assert counts["single"] > counts["answers"] / 3
    assert counts["several"] > 5
    assert counts["uncertain"] < counts["answers"] / 3
