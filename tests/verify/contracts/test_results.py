"""How hard the prover tries in a given time."""

from __future__ import annotations

from colony.verify.contracts.results import ProofOptions


def test_ten_seconds_at_the_usual_depth_are_what_is_meant_without_options() -> None:
    assert ProofOptions.within(10.0, depth=4) == ProofOptions()


def test_there_is_always_something_to_try() -> None:
    least = ProofOptions.within(1e-9, depth=0)
    assert (least.max_frames, least.resources) == (2, 1)
