"""Where the text of a value belongs."""

from __future__ import annotations

from colony.compile.backends.python.plan import ROOT, FunctionLayout


def test_join() -> None:
    layout = FunctionLayout()
    first = layout.slot(ROOT)
    block = layout.region(first)
    one = layout.slot(block)
    body = layout.region(one, condition=7)
    in_one = layout.slot(body)
    two = layout.slot(block)
    in_two = layout.slot(layout.region(two))
    last = layout.slot(ROOT)
    assert layout.join(one, two) == one
    assert layout.join(in_one, in_one) == in_one
    assert layout.join(in_one, two) == one  # not in the body: that may not be passed
    assert layout.join(in_two, in_one) == one
    assert layout.join(in_two, two) == two
    assert layout.join(last, in_two) == first
    assert layout.true_values_at(in_one) == {7}
    assert layout.true_values_at(in_two) == set()
