"""How hard the prover tries in a given time."""

from __future__ import annotations

from colony.verify.contracts.results import Options


def test_ten_seconds_at_the_usual_depth_are_what_is_meant_without_options() -> None:
    assert Options.within(10.0, depth=4) == Options()


def test_there_is_always_something_to_try() -> None:
    least = Options.within(1e-9, depth=0)
    assert (least.max_frames, least.resources) == (2, 1)
