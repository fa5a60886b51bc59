from __future__ import annotations

from colony.verify.equivalence.results import (
    Activation,
    EquivalenceProved,
    EquivalenceUndecided,
    Recent,
    WrongActivity,
    WrongForm,
    WrongWinner,
    counterexample_text,
    merge_results,
    proved_text,
    undecided_text,
)

FRAME = Activation(
    active=("a", "b", "c"),
    recent=(
        Recent(name="d", min_age_ns=0, max_age_ns=1_500_000_000),
        Recent(name="e", min_age_ns=100_000_000, max_age_ns=100_000_001),
    ),
)


def test_a_wrong_winner_in_words() -> None:
    wrong = WrongWinner(
        form="JSON", actuator="drive", frame=FRAME, network="a", by_priority=None, by_exclusive=("b", "c")
    )
    assert counterexample_text(wrong) == (
        "JSON: drive: with a, b and c active, and d less than 1.5 s ago and e 100 ms ago or more, but less "
        "than 100.000001 ms ago, the network lets a through; by priority no module commands, by exclusive "
        "guard b and c"
    )


def test_a_form_without_exclusive_guards_says_nothing_of_them() -> None:
    wrong = WrongWinner(
        form="generated Python",
        actuator="drive",
        frame=Activation(active=()),
        network=None,
        by_priority="a",
        by_exclusive=None,
    )
    assert counterexample_text(wrong) == (
        "generated Python: drive: with no module active, the network lets no module through; "
        "by priority a commands"
    )


def test_the_others_in_words() -> None:
    frame = Activation(active=("a",))
    activity = WrongActivity(form="JSON", name="w", frame=frame, network=False, found=True)
    expected = "JSON: with a active, `w` is not active in the network, and active in what was compiled"
    assert counterexample_text(activity) == expected
    malformed = WrongForm(form="JSON", subject="drive", found="this", expected="that")
    assert counterexample_text(malformed) == "JSON: drive: found this, expected that"
    undecided = EquivalenceUndecided(subjects=(("JSON", "drive"),), seconds=1.5)
    expected = "JSON: drive: z3 found neither a proof nor a counterexample within 1.5 s of steps"
    assert undecided_text(undecided) == expected


def test_what_was_proved_in_words() -> None:
    one = EquivalenceProved(forms=("clients",), by_structure=3, by_solver=1, questions=2)
    other = EquivalenceProved(forms=("JSON",), by_structure=2, by_solver=0, questions=0)
    expected = "proved: clients, JSON and network are the same (6 obligations: 5 by structure, 1 by z3)"
    assert proved_text(merge_results([one, other])) == expected
