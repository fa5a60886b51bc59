"""Hints with the known names that are closest to an unknown one."""

from __future__ import annotations

import pickle

from colony.text.wording import Remedy, did_you_mean


def test_case_makes_no_difference() -> None:
    assert did_you_mean("rserver", ["PServer", "RServer"]) == "did you mean `RServer`?"


def test_names_that_differ_in_case_alone_are_all_known() -> None:
    assert did_you_mean("aa", ["AA", "Aa"], max_names=3) == "did you mean `AA` or `Aa`?"


def test_the_closest_come_first_and_no_more_than_asked_for() -> None:
    known = ["sonar", "sonars", "bumper", "sonar2"]
    assert did_you_mean("sonarx", known) == "did you mean `sonar`?"
    assert did_you_mean("sonarx", known, max_names=2) in (
        "did you mean `sonar` or `sonars`?",
        "did you mean `sonar` or `sonar2`?",
    )


def test_nothing_is_close() -> None:
    assert did_you_mean("camera", ["bumper"]) is None
    assert did_you_mean("sonnar", ["sonar"], cutoff=0.95) is None


def test_a_name_of_any_length_is_compared_quickly() -> None:
    assert did_you_mean("a" * 10**6, ["a" * 64]) == f"did you mean `{'a' * 64}`?"


def test_a_suggestion_carries_what_to_write_also_through_a_cache() -> None:
    hint = did_you_mean("rserver", ["PServer", "RServer"])
    assert isinstance(hint, Remedy)
    kept = pickle.loads(pickle.dumps(hint))
    assert (kept, kept.found, kept.written) == ("did you mean `RServer`?", "rserver", ("RServer",))
