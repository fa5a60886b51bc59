"""A recording and a summary of a program in the shadow of a robot say that it commanded nothing."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace

import pytest
from mcap.reader import NonSeekingReader

from colony.analysis.audit import audit_recording
from colony.cli.audit import render as audit_text
from colony.compile.pipeline import compile_program
from colony.runs.recording import LiveRun
from colony.runtime.observe.summary import Tally, render
from colony.runtime.recordings.lines import Recording
from colony.runtime.recordings.mcap_writer import McapRecording
from colony.runtime.recordings.opening import read_recording
from tests.analysis.recorded_runs import Kept, run_info, written
from tests.runtime.assembly.shadow_stage import RAMP, Stage, program
from tests.runtime.scripted import Log


def _lines(log: Log, file: io.BytesIO) -> None:
    written(Recording(compile_program(program(RAMP)).compiled, file, shadow=True), log.frames)


def _mcap(log: Log, file: io.BytesIO) -> None:
    info = replace(run_info(program(RAMP)), shadow=True)
    written(McapRecording(compile_program(program(RAMP)).compiled, info, file), log.frames)


@pytest.mark.parametrize("write", [_lines, _mcap])
def test_its_recording_says_that_nothing_was_sent(write: Callable[[Log, io.BytesIO], None]) -> None:
    stage, file = Stage(), Kept()
    stage.frames(range(4))
    stage.frames(range(6, 20))
    write(stage.log, file)
    reader = read_recording(io.BytesIO(file.content), "run")
    report = audit_recording(program(RAMP), reader)
    assert report.agrees
    assert (report.frames, report.compared, report.restarts) == (18, 18, 1)
    assert reader.shadow
    text = audit_text("run", reader, program(RAMP), report, file=None)
    assert "SHADOW: this is what it would have sent; it commanded nothing" in text


def test_other_tools_find_its_verdicts_under_another_topic() -> None:
    stage, file = Stage(), Kept()
    stage.frames(range(3))
    _mcap(stage.log, file)
    topics_ = {channel.topic for _, channel, _ in NonSeekingReader(io.BytesIO(file.content)).iter_messages()}
    assert topics_ == {"/frames", "/keyframes", "/shadow/verdicts/drive", "/shadow/requests/drive"}


def test_its_summary_says_that_nothing_was_sent() -> None:
    stage = Stage()
    stage.frames(range(3))
    tally = Tally(compile_program(program(RAMP)).compiled)
    for log in stage.log.frames:
        tally.take(log)
    summary = replace(tally.summary(seed=0, duration_s=0.15, interrupted=False, travel=None), shadow=True)
    text = render(summary)
    assert "SHADOW: this is what it would have sent; it commanded nothing" in text
    assert "drive would have been commanded by" in text
    assert summary.as_json()["shadow"] is True


def test_a_live_run_has_a_name_and_a_time() -> None:
    live = LiveRun("20260101-120000-7", shadow=True)
    assert (live.name, live.shadow) == ("20260101-120000-7", True)
    assert live.started[:2] == "20"
