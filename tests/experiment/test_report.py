"""The report of an experiment: its figures, the bins of a param, and paired differences."""

from __future__ import annotations

from dataclasses import replace

from colony.experiment.report import comparison_of, summary_of, text_of
from colony.experiment.results import Results, RunKey
from colony.experiment.trial import TRIALS, TrialResult
from tests.experiment.test_design import PLAIN

GOOD = TrialResult(
    key=RunKey("e", 1, 5, "one"),
    movers=0,
    params={"clearance": 0.7},
    frames=100,
    duration_s=60.0,
    contacts=0,
    distance_mm=2000.0,
    stay_s=1.0,
    off_map_s=0.0,
    arrived=-1,
    blind=0,
    shares={"drive/avoid": 0.25, "drive/(nobody)": 0.75, "lift/(nobody)": 1.0},
    limits={},
    breaches={},
    assumptions={},
    unmet=0,
    unexplained=-1,
    remark="",
    difference="",
    audited=0,
    path=((0, 0), (10, 20)),
    places=(),
)


def result(number: int, program: str = "one", **changes: object) -> TrialResult:
    key = RunKey("e", number, 4 + number, program)
    return replace(GOOD, key=key, **changes)  # type: ignore[arg-type]


RESULTS = [
    result(1),
    result(2, contacts=3, places=((5, 5),) * 3, params={"clearance": 1.39}, limits={"drive.velocity": 10}),
    result(3, stay_s=30.0, blind=50),
    result(4, breaches={"slow": 2.0}, distance_mm=4000.0, params={"clearance": 1.4}),
]


def test_summary_counts_runs_and_frames() -> None:
    found = summary_of("one", RESULTS)
    assert (found.contacts.cases, found.stuck.cases, found.broken["slow"].cases) == (1, 1, 1)
    assert found.contacts_per_run.mean == 0.75
    assert found.distance_m.mean == 2.5
    assert (found.blind, found.limits) == (0.125, {"drive.velocity": 0.025})
    assert found.shares["drive/avoid"] == 0.25
    assert found.arrived is None
    assert found.worst == (4, 2, 3)
    assert found.failed


def test_summary_of_runs_with_a_goal_counts_arrivals() -> None:
    found = summary_of("one", [result(1, arrived=1, stay_s=60.0), result(2, arrived=0)])
    assert (found.arrived.cases, found.stuck.cases, found.worst) == (1, 0, (2,))


def test_broken_assumptions_are_counted_and_fail_nothing() -> None:
    results = [result(1, assumptions={"apart": 2}, unmet=2, unexplained=0), result(2)]
    found = summary_of("one", results)
    assert (found.assumptions["apart"].cases, found.broken, found.failed) == (1, {}, False)
    text = text_of(replace(PLAIN, programs=PLAIN.programs[:1]), results)
    assert "assumption apart" in text
    assert "broken in 1 of 2 runs" in text


def test_summary_of_short_runs_does_not_say_how_often_robots_are_stuck() -> None:
    assert summary_of("one", [result(1, duration_s=30.0)]).stuck is None


def test_text_has_the_bins_of_a_param_and_no_idle_actuator() -> None:
    text = text_of(replace(PLAIN, programs=PLAIN.programs[:1]), RESULTS)
    assert "with a contact" in text
    assert "contract slow" in text
    assert "BROKEN in 1 of 4 runs" in text
    assert "0.6 to 0.8 m: with a contact 0 of 2 runs" in text
    assert "1.2 to 1.4 m: with a contact 1 of 2 runs" in text
    assert (
        "1.2 to 1.4 m: with a contact 1 of 2 runs (9.5 to 90.5 %), stuck 0 of 2 runs (0.0 to 65.8 %), "
        in text
    )
    assert "slow broken 1 of 2 runs" in text
    assert "lift" not in text


def test_comparison_pairs_runs_of_the_same_number() -> None:
    other = [
        result(1, "other"),
        result(2, "other", contacts=1),
        result(3, "other", stay_s=1.0, distance_mm=1000.0),
    ]
    found = comparison_of(PLAIN, [*RESULTS, *other])
    assert found.pairs == 3
    by_measure = {d.measure: d for d in found.differences}
    assert by_measure.keys() == {"contacts", "stuck", "distance in m"}
    contacts = by_measure["contacts"]
    assert (contacts.more, contacts.less, contacts.same) == (0, 1, 2)
    assert contacts.difference.mean == -2 / 3
    assert by_measure["distance in m"].difference.mean == -1 / 3


def test_comparison_without_pairs_is_none() -> None:
    assert comparison_of(PLAIN, RESULTS) is None
    assert comparison_of(replace(PLAIN, programs=PLAIN.programs[:1]), RESULTS) is None


def test_results_come_back_from_their_file() -> None:
    with Results(None, TRIALS) as results:
        for one in RESULTS:
            results.put(one)
        assert list(results.select("e", "one")) == RESULTS


def test_report_counts_frames_that_break_assumptions_and_contacts_without_one() -> None:
    results = [result(1, assumptions={"apart": 3}, unmet=4, unexplained=1), result(2, unexplained=0)]
    found = summary_of("one", results)
    assert (found.assumption_frames, found.unmet, found.unexplained) == ({"apart": 0.015}, 0.02, 1)
    text = text_of(replace(PLAIN, programs=PLAIN.programs[:1]), results)
    assert "broken in 1 of 2 runs (9.5 to 90.5 %), 1.50 % of the frames" in text
    assert "contacts without a broken assumption  1" in text
    assert "without a broken" not in text_of(replace(PLAIN, programs=PLAIN.programs[:1]), RESULTS)
