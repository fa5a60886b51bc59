"""docs/letters.md: what it says of the weights is what their file says, and its numbers are the code's."""

from __future__ import annotations

import re
from pathlib import Path

from colony.vision.letters.network import network
from colony.vision.training.fonts import learned_fonts

PAGE = Path(__file__).parent.parent / "docs" / "letters.md"


def test_the_facts_are_those_of_the_weights() -> None:
    told = re.search(
        r"<!-- facts -->\n```text\n(.*?)\n```\n<!-- end of facts -->", PAGE.read_text(), re.DOTALL
    )
    assert told is not None
    assert told[1] == network().facts


def test_the_numbers_of_fonts_and_weights_are_right() -> None:
    page = PAGE.read_text()
    net = network()
    weights = sum(layer.kernel.size + layer.bias.size for layer in (*net.layers, *net.head))
    told = re.search(r"network of ([\d,]+) weights", page)
    assert told is not None
    assert abs(int(told[1].replace(",", "")) - weights) < 1_000
    assert f"in {len(learned_fonts())} fonts" in page
