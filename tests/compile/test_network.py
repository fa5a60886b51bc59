"""Nodes of a network, and what is equal among them."""

from __future__ import annotations

import pytest

from colony.compile.network import Inhibitor, Suppressor


@pytest.mark.parametrize("joint", [Suppressor, Inhibitor])
def test_what_memory_calls_a_time_constant_makes_no_other_node(joint: type[Suppressor | Inhibitor]) -> None:
    unnamed = joint(dominant=0, inferior=1, window_ns=5)
    assert unnamed.memory_name == ""
    assert unnamed == joint(dominant=0, inferior=1, window_ns=5, memory_name="window w.0")
    assert unnamed != joint(dominant=0, inferior=1, window_ns=6)
