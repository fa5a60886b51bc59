"""The sentences about each kind of cause, of runs of small programs."""

from __future__ import annotations

import pytest

from colony.analysis.moments import MomentFollower
from colony.dsl.load import load_text
from colony.ir.frame import Answer, Frame
from colony.ir.program import Program
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol.messages import Tick, Verdict
from colony.verify.explain.answer import Why, WhyNot, explain
from colony.verify.explain.text import lines
from tests.verify.small_robot import go, robot

MS = 1_000_000

Readings = dict[str, object]


def program(text: str, more: str = "") -> Program:
    return load_text(f"language 1\n{robot(more)}{text}")


def answer(
    loaded: Program,
    frames: list[Readings],
    question: Why | WhyNot,
    *,
    down: tuple[str, ...] = (),
    answers: dict[str, Answer] | None = None,
) -> str:
    """Return an answer about the last of some frames, 100 ms apart; a reading stays until it changes."""
    follower, readings = MomentFollower(loaded), dict[str, object]()
    for k, changed in enumerate(frames):
        readings |= changed
        frame = Frame(100 * MS * k, dict(readings))  # type: ignore[arg-type]
        tick = Tick(k=k, t_ns=frame.t_ns, down=down if k == len(frames) - 1 else ())
        follower.take(RunFrame(tick=tick, frame=frame, verdicts={}, answers=answers or {}))
    assert follower.moment is not None
    return "\n".join(lines(explain(follower.moment, question)))


FAR: Readings = {"sonar": 5000.0, "bumper": False, "level": 0.0}

CASES = [
    (
        go("m", "sustained(bumper, 300 ms)") + "network { drive = m }",
        [FAR, {"bumper": True}, {}],
        WhyNot("m"),
        "`bumper` is true since 0.1 s: 100 ms of 300 ms",
    ),
    (
        go("m", "sustained(bumper, 300 ms)") + "network { drive = m }",
        [FAR, {}],
        WhyNot("m"),
        "it would change only if `bumper` held and `bumper` had been true for 300 ms",
    ),
    (
        go("m", "latch(bumper, sonar < 1 m)") + "network { drive = m }",
        [FAR, {"bumper": True}, {"bumper": False}, {}],
        Why("m"),
        "`latched` remembers true, set at 0.1 s, 200 ms before",
    ),
    (
        "state n : number = 0  next n = if bumper then n + 1 else n\n"
        + go("m", "n > 1")
        + "network { drive = m }",
        [FAR, {"bumper": True}, {"bumper": False}, {}],
        WhyNot("m"),
        "`n > 1` fails: 1 against 1 (n was set 200 ms before)",
    ),
    (
        "machine p { start rest  rest -> run when bumper }\n"
        + go("m", "p == p.run")
        + "network { drive = m }",
        [FAR],
        WhyNot("m"),
        "`p == p.run` fails: p.rest against p.run",
    ),
    (
        go("a", "bumper") + go("b", "true") + "network { drive = a suppresses[500 ms] b }",
        [FAR, {"bumper": True}, {"bumper": False}, {}],
        WhyNot("b"),
        "a was last active at 0.1 s, 200 ms before; its time constant of 500 ms still counts",
    ),
    (
        go("m", "bumper", "1 mm/s / 0") + "network { drive = m }",
        [FAR, {"bumper": True}],
        WhyNot("drive"),
        "the command of m could not be sent to drive: a field was not a finite number",
    ),
    (
        go("a", "true") + "module other { when bumper }\nnetwork { drive = a }",
        [FAR],
        Why("other"),
        "`bumper` is false",
    ),
    (
        go("a", "true") + go("b", "true") + "network { drive = a inhibits b }",
        [FAR],
        WhyNot("a"),
        "no wire leads from a to drive",
    ),
    (
        go("m", "sonar < 1 m") + "network { drive = m }",
        [FAR, {"sonar": 1000.5}],
        WhyNot("m"),
        "`sonar < 1 m` fails by 0.5 mm: 1000.5 mm against 1000 mm",
    ),
    (
        go("m", "sonar < 1 m") + "network { drive = m }",
        [FAR, {"sonar": "broken"}],
        WhyNot("m"),
        "sonar is missing: its reading was not of its type; missing since 0.1 s",
    ),
    (
        go("m", "sonar < 1 m") + "network { drive = m }",
        [{"bumper": False}],
        WhyNot("m"),
        "sonar is missing: PServer gave no value; it has had none so far",
    ),
    (
        go("m", "sonar in 1 m .. 2 m") + "network { drive = m }",
        [FAR, {"sonar": 2100.0}],
        WhyNot("m"),
        "`sonar in 1 m .. 2 m` fails by 100 mm: 2100 mm against 2000 mm",
    ),
    (
        go("m", "true", "900 mm/s") + "network { drive = m }",
        [FAR],
        Why("drive"),
        "velocity: 900 mm/s was cut to 600 mm/s by the range of the actuator",
    ),
    (
        "limit drive.velocity <= sonar / 1 s\n" + go("m", "true") + "network { drive = m }",
        [{"bumper": False}],
        Why("drive"),
        "the bound is missing, so the idle command's value stands in",
    ),
]


@pytest.mark.parametrize(("text", "frames", "question", "sentence"), CASES)
def test_a_cause_is_told(text: str, frames: list[Readings], question: Why | WhyNot, sentence: str) -> None:
    assert sentence in answer(program(text), frames, question)


def test_ways_to_change_an_outcome_that_read_alike_are_given_once() -> None:
    text = go("near", "recently(bumper, 1 s)") + go("far", "recently(bumper, 1 s)")
    given = answer(program(f"{text}network {{ drive = near suppresses far }}"), [FAR, {}], WhyNot("drive"))
    assert given.count("`bumper` had been true in the 1 s before") == 1


def test_a_phase_that_the_condition_names_is_not_repeated() -> None:
    text = "machine p { start rest  rest -> run when bumper }\n" + go("m", "p == p.rest")
    given = answer(program(text + "network { drive = m }"), [FAR, {}], Why("m"))
    assert "`p == p.rest` holds" in given
    assert "p.rest against p.rest" not in given


def test_a_follower_goes_on_from_the_checkpoint_of_another_before_its_first_frame() -> None:
    loaded = program(go("m", "bumper") + "network { drive = m }")
    followers = MomentFollower(loaded), MomentFollower(loaded, MomentFollower(loaded).checkpoint)
    for k in range(2):
        frame = Frame(100 * MS * k, dict(FAR))  # type: ignore[arg-type]
        for follower in followers:
            follower.take(RunFrame(tick=Tick(k=k, t_ns=frame.t_ns), frame=frame, verdicts={}))
    first, second = (f.moment for f in followers)
    assert first is not None
    assert second is not None
    assert lines(explain(first, WhyNot("m"))) == lines(explain(second, WhyNot("m")))


def test_a_server_that_is_down_is_told() -> None:
    text = go("m", "sonar < 1 m") + "network { drive = m }"
    told = answer(program(text), [FAR, {"sonar": None}], WhyNot("m"), down=("PServer",))
    assert "sonar is missing: the server PServer was down; missing since 0.1 s" in told


def test_a_lost_client_lets_others_act_only_where_it_may() -> None:
    text = robot().replace(
        "idle drive(velocity = 0, turn = 0)", "idle drive(velocity = 0, turn = 0) on_loss degrade"
    )
    loaded = load_text(
        f"language 1\n{text}{go('a', 'true')}{go('b', 'true')}network {{ drive = a suppresses b }}"
    )
    follower = MomentFollower(loaded)
    verdict = Verdict(
        k=0,
        t_ns=0,
        actuator="drive",
        by="b",
        values=(300.0, 0.0),
        fates=(("a", "lost"), ("b", "won")),
    )
    follower.take(
        RunFrame(
            tick=Tick(k=0, t_ns=0, lost=("drive/a",)),
            frame=Frame(0, dict(FAR)),  # type: ignore[arg-type]
            verdicts={"drive": verdict},
        )
    )
    assert follower.moment is not None
    assert "the client of a was lost" in "\n".join(lines(explain(follower.moment, WhyNot("a"))))
    assert lines(explain(follower.moment, Why("drive")))[0] == "0 s: drive is by b"


def test_a_verdict_that_is_not_the_interpreters_is_told() -> None:
    loaded = program(go("a", "bumper") + go("b", "true") + "network { drive = a suppresses b }")
    follower = MomentFollower(loaded)
    fates = (("a", "won"), ("b", "suppressed"))
    verdict = Verdict(k=0, t_ns=0, actuator="drive", by="a", values=(300.0, 0.0), fates=fates)
    frame = Frame(0, dict(FAR))  # type: ignore[arg-type]
    follower.take(RunFrame(tick=Tick(k=0, t_ns=0), frame=frame, verdicts={"drive": verdict}))
    assert follower.moment is not None
    told = lines(explain(follower.moment, Why("drive")))
    assert told[0] == "0 s: drive is by a, but in the interpreter it is not"


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (Answer(), "the module in Python m answered with no command"),
        (Answer(error=True, blind=True), "the module in Python m failed in this frame"),
    ],
)
def test_the_answer_of_a_module_in_python_is_told(given: Answer, sentence: str) -> None:
    text = 'module m from python "somewhere:M" { reads sonar  commands drive }\nnetwork { drive = m }'
    assert sentence in answer(program(text), [FAR], WhyNot("m"), answers={"m": given})
