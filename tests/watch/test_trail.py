"""Any frame of a run can be explained, also in a segment that was packed, and after a gap."""

from __future__ import annotations

from dataclasses import replace

import pytest

from colony.analysis.moments import MomentFollower
from colony.verify.explain.answer import WhyNot, explain
from colony.verify.explain.text import lines
from colony.watch import trail as trail_module
from colony.watch.sources import RunFollower
from colony.watch.store import SnapshotStore
from colony.watch.trail import RunTrail
from tests.watch.runs import PROGRAM, page, recorded, run, scene, served


def followed(frames: object = None, **options: int) -> RunTrail:
    store, trail = SnapshotStore(scene().modules), RunTrail(PROGRAM, **options)
    follower = RunFollower(PROGRAM, store, trail)
    for log in frames or run():  # type: ignore[attr-defined]
        follower.take(log)
    store.close()
    return trail


def test_every_frame_has_the_answers_of_the_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trail_module, "SEGMENT_FRAMES", 6)
    trail, follower = followed(), MomentFollower(PROGRAM)
    for log in run():
        moment = follower.take(log)
        assert moment is not None
        for module in scene().modules:
            assert trail.explain(log.tick.k, module) == lines(explain(moment, WhyNot(module)))


def test_after_a_gap_it_answers_from_the_next_keyframe_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trail_module, "SEGMENT_FRAMES", 7)
    frames = run()
    keys = [k for k, log in enumerate(frames) if k > 6 and log.keyframe is not None]
    frames = [*frames[:5], replace(frames[6], keyframe=None), *frames[7:]]
    frames[5] = replace(frames[5], damaged=True)
    trail = followed(frames)
    assert "not known" in trail.explain(6, "avoid")[0]
    assert "not known" not in trail.explain(keys[0], "avoid")[0]


def test_what_is_too_old_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trail_module, "SEGMENT_FRAMES", 4)
    trail = followed(max_bytes=0)
    assert "too old" in trail.explain(2, "avoid")[0]
    assert "too old" not in trail.explain(19, "avoid")[0]
    assert "has not come" in trail.explain(99, "avoid")[0]


def test_a_page_asks_and_is_answered() -> None:
    with recorded() as watched, served(watched) as server, page(server.host) as opened:
        opened.ask(do="ask", module="cruise", k=3)
        answer = opened.until(lambda m: "answer" in m)["answer"]
        assert (answer["module"], answer["k"]) == ("cruise", 3)
        assert "avoid" in "\n".join(answer["lines"])
