"""Answers about large networks are short, and found without recursion."""

from __future__ import annotations

import pytest

from colony.verify.explain.answer import Why, WhyNot
from tests.verify.explain.test_causes import answer, program
from tests.verify.small_robot import go

MODULES = 150


@pytest.mark.parametrize("relation", ["suppresses", "suppresses[100 ms]"])
@pytest.mark.parametrize("nested", [False, True])
@pytest.mark.parametrize("sonar", [-1.0, 5000.0, MODULES / 2])
def test_answers_about_a_long_chain(relation: str, nested: bool, sonar: float) -> None:
    modules = "".join(go(f"m{i}", f"sonar > {i} mm") for i in range(MODULES))
    wires = [f"w{i} = m{i} {relation} {f'w{i - 1}' if i > 1 else 'm0'}" for i in range(1, MODULES)]
    chain = f" {relation} ".join(f"m{i}" for i in range(MODULES))
    network = "\n".join((*wires, f"drive = w{MODULES - 1}")) if nested else f"drive = {chain}"
    loaded = program(f"{modules}network {{ {network} }}")
    for question in (Why("drive"), WhyNot("drive"), WhyNot("m3"), WhyNot(f"m{MODULES - 2}")):
        told = answer(loaded, [{"sonar": sonar, "bumper": False}], question)
        assert 1 < len(told.splitlines()) < 250
