"""Behaviors in the place of a twist_mux: what is written is proved, and decides as twist_mux does."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import colony
from colony.cli.main import main
from colony.cli.twist_mux import MuxInput, TwistMux, behavior_text, interface_text, read_twist_mux
from colony.text.diagnostics import DiagnosticError
from colony.text.source import NOWHERE, Source

EXAMPLE = """\
twist_mux:
  ros__parameters:
    use_stamped: true
    topics:
      navigation: {topic: nav_vel, timeout: 0.5, priority: 10}
      joystick: {topic: joy_vel, timeout: 0.5, priority: 100}
      tablet: {topic: tab_vel, timeout: 0.5, priority: 50}
    locks:
      pause: {topic: pause_navigation, timeout: 0.0, priority: 60}
      closed: {topic: stop_closing_loop, timeout: 1.0, priority: 200}
      never: {topic: never, timeout: 1.0, priority: 3}
"""


def read(text: str) -> TwistMux:
    return read_twist_mux(Source("mux.yaml", text))


def test_sources_and_locks_are_in_order_of_priority() -> None:
    mux = read(EXAMPLE)
    assert [each.name for each in mux.sources] == ["joystick", "tablet", "navigation"]
    assert [each.name for each in mux.locks] == ["closed", "pause"]
    assert mux.stamped
    assert [d.message for d in mux.notes] == [
        "the lock `pause` stays as it was when its publisher dies",
        "the lock `never` masks no source, and is left out",
    ]


def test_each_lock_inhibits_the_sources_up_to_its_priority() -> None:
    text = behavior_text(read(EXAMPLE), "mux")
    wiring = "closed inhibits (joystick suppresses (pause inhibits (tablet suppresses navigation)))"
    assert f"drive = {wiring}\n" in text


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("locks: {}", "X001", "no sources"),
        ("topics: [a]", "X001", "expected a mapping from names to sources"),
        ("topics: {a: {topic: t", "X001", "not YAML"),
        ("[" * 5000, "X001", "nested too deeply"),
        ("topics: {a: {topic: t, priority: 1}}", "X002", "the source `a` has no `timeout`"),
        ("topics: {a: {topic: t, timeout: x, priority: 1}}", "X002", "expected a number from 0 to 3600"),
        ("topics: {a: {topic: t, timeout: 1, priority: 256}}", "X002", "expected a number from 0 to 255"),
        ("topics: {a: {topic: t, timeout: 1, priority: 0}}", "X002", "`a` never drives"),
        ('topics: {a: {topic: "a b", timeout: 1, priority: 1}}', "X002", "is not the name of a topic"),
        ("topics: {1a: {topic: t, timeout: 1, priority: 1}}", "X002", "cannot be a name"),
        (
            "topics: {a: {topic: t, timeout: 1, priority: 1}, b: {topic: t, timeout: 1, priority: 1}}",
            "X002",
            "`b` has the priority of `a`",
        ),
        (
            "topics: {a: {topic: t, timeout: 1, priority: 1}, a_turn: {topic: t, timeout: 1, priority: 2}}",
            "X002",
            "a behavior would have `a_turn` twice",
        ),
    ],
)
def test_what_cannot_be_converted_is_refused_at_its_place(text: str, code: str, message: str) -> None:
    with pytest.raises(DiagnosticError) as refused:
        read(text)
    found = refused.value.diagnostics[0]
    assert found.code == code
    assert message in found.message


def drives(mux: TwistMux, fresh: dict[str, bool], locked: dict[str, bool]) -> str | None:
    """What twist_mux does: the highest fresh source above all locks that are on."""
    masked = max((lock.priority for lock in mux.locks if locked[lock.name]), default=-1)
    return next((s.name for s in mux.sources if fresh[s.name] and s.priority > masked), None)


PRIORITIES = st.lists(st.integers(1, 6), min_size=1, max_size=4, unique=True)


@given(sources=PRIORITIES, locks=st.lists(st.integers(1, 6), max_size=3), data=st.data())
@settings(max_examples=40)
def test_the_behavior_decides_as_twist_mux(sources: list[int], locks: list[int], data: st.DataObject) -> None:
    def made(kind: str, number: int, priority: int) -> MuxInput:
        return MuxInput(name=f"{kind}{number}", topic="t", timeout_s=1.0, priority=priority, span=NOWHERE)

    mux = TwistMux(
        sources=tuple(
            sorted((made("s", i, p) for i, p in enumerate(sources)), key=lambda each: -each.priority)
        ),
        locks=tuple(
            sorted(
                (made("l", i, p) for i, p in enumerate(locks) if p >= min(sources)),
                key=lambda each: -each.priority,
            )
        ),
        stamped=False,
    )
    interface = interface_text(mux, "mux").split("language 1\n")[1]
    program = colony.loads(behavior_text(mux, "mux").replace("import robot\n", interface))
    executor = colony.build(program, proof=False).executor()
    for k in range(8):
        fresh = {each.name: data.draw(st.booleans()) for each in mux.sources}
        locked = {each.name: data.draw(st.booleans()) for each in mux.locks}
        readings: dict[str, float | bool] = {}
        for name, is_fresh in fresh.items():
            if is_fresh:
                readings |= {f"{name}_velocity": 0.5, f"{name}_turn": 0.0}
        for name, is_on in locked.items():  # one that is missing has timed out, and is on
            if not is_on:
                readings[f"{name}_locked"] = False
        [decision] = executor.step(colony.Frame(k * 50_000_000, readings)).decisions
        assert decision.by == drives(mux, fresh, locked)


def test_the_command_writes_a_project_whose_contracts_are_proved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mux.yaml").write_text(EXAMPLE)
    for arguments in (
        ("new", "mux", "--from-twist-mux", "mux.yaml"),
        ("verify", "mux/mux.colony"),
        ("robot", "check", "mux"),
    ):
        monkeypatch.setattr("sys.argv", ["colony", *arguments])
        if arguments[0] == "robot":
            monkeypatch.chdir(tmp_path / "mux")
        with pytest.raises(SystemExit) as ended:
            main()
        assert not ended.value.code, capsys.readouterr().err
    assert "5 proved, 0 refuted, 0 unknown\nmux: ok\n" in capsys.readouterr().out
