"""`colony explain`: why the robot did what it did, at a moment of a recorded run."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from decimal import Decimal, InvalidOperation
from typing import TYPE_CHECKING, NoReturn

import click

from colony.cli.exit_codes import EXIT_ERRORS
from colony.cli.outputs import BEHAVIOR
from colony.cli.params_choice import params_option
from colony.cli.progress import ReadingProgress
from colony.cli.recorded import program_for
from colony.cli.reporting import refuse, report, say
from colony.cli.robot_choice import description_option
from colony.text.wording import TIME_RESOLUTION_NS, counted, did_you_mean, seconds_of, time_text

if TYPE_CHECKING:
    from colony.analysis.finding import Found, RecordingIndex
    from colony.analysis.recording import OpenRecording
    from colony.analysis.tracks import Condition, FrameSpan
    from colony.ir.program import Program
    from colony.verify.explain.answer import Explanation, Why, WhyNot

MAX_SPANS = 10
"""Maximum number of spans that text lists for a condition."""

MAX_SECONDS = 9_000_000_000
"""Maximum distance of a time from zero, in seconds: its nanoseconds fit into 64 bits."""


class Seconds(click.ParamType):  # type: ignore[type-arg]
    """A time in seconds, exactly, as nanoseconds."""

    name = "seconds"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the nanoseconds of a text such as `12.3` or `12.3 s`."""
        text = str(value).strip().removesuffix("s").rstrip()
        try:
            seconds = Decimal(text)
        except InvalidOperation:
            seconds = Decimal("nan")
        if seconds.is_nan() or not -MAX_SECONDS <= seconds <= MAX_SECONDS:
            self.fail(f"found `{value}`; expected a time in seconds, such as 12.3", param, ctx)
        return round(seconds * 1_000_000_000)


@click.command("explain", short_help="explain why the robot did what it did, or did not")
@click.argument("recording", metavar="RECORDING")
@click.argument("file", metavar="[FILE]", required=False, type=BEHAVIOR)
@click.option(
    "--at",
    "at_ns",
    type=Seconds(),
    metavar="SECONDS",
    help="The time to explain, from the first frame on: that of the last frame at or before it. "
    "With --when, the search begins there.",
)
@click.option(
    "--when",
    "when",
    metavar="CONDITION",
    help='Explain the moment when this begins: "drive by back_off", "drive is idle", "avoid is active", '
    '"sonar is missing", "avoid is late"; also with "is not".',
)
@click.option(
    "--nth",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="With --when, the number of the moment to explain.",
)
@click.option(
    "--why", "why", multiple=True, metavar="NAME", help="Explain why NAME is as it is. May be repeated."
)
@click.option(
    "--why-not",
    "why_not",
    multiple=True,
    metavar="NAME",
    help="Explain why NAME does not act. May be repeated.",
)
@description_option()
@params_option()
@click.option("--format", "format_", type=click.Choice(["text", "json"]), default="text", show_default=True)
def command(
    recording: str,
    file: str | None,
    at_ns: int | None,
    when: str | None,
    nth: int,
    why: tuple[str, ...],
    why_not: tuple[str, ...],
    format_: str,
) -> None:
    """Explain a moment of a recording: which condition decided, with which values, and what had to change.

    NAME is an actuator, a module, a wire or a sensor. Without --why and --why-not, every actuator is
    explained or, with --when, what the condition is about. The answers come from the reference interpreter,
    which follows the program of the recording. A recording as JSON lines does not contain its program: give
    it as FILE.

    The first time, the whole recording is followed once, and an index is kept in the user's cache
    ($XDG_CACHE_HOME/colony/moments); after that, any moment is found quickly.

    Exit code: 0 if there is an answer, 1 if what the program remembered at that moment is not known, 2 for
    misuse, such as a time outside the recording.

    \b
    Example:
      colony run wander --map loop --record run.mcap
      colony explain run.mcap --at 12.3
      colony explain run.mcap --at 12.3 --why-not avoid
      colony explain run.mcap --when "drive by avoid" --why drive
    """
    if at_ns is None and when is None:
        raise click.UsageError(
            "no moment: give --at SECONDS or --when CONDITION", click.get_current_context()
        )
    from colony.analysis.recording import OpenRecording
    from colony.text.diagnostics import DiagnosticError

    try:
        with OpenRecording.at(recording) as opened:
            asked = _Asked(opened, file)
            chosen = None if when is None else asked.chosen(when, nth, at_ns)
            found = asked.found(at_ns or 0) if chosen is None else asked.at(chosen.span.start.t_ns)
            questions = _questions(asked.program, why, why_not, chosen)
            answers = asked.answers(found, questions)
    except DiagnosticError as failure:
        if failure.diagnostics[0].code[0] in "AF":
            refuse(failure.diagnostics)
        report(failure.diagnostics)
        raise click.exceptions.Exit(EXIT_ERRORS) from None
    if format_ == "json":
        _print_json(asked, chosen, answers, found)
    else:
        _print_text(asked, chosen, answers)
        for line in _heard_lines(asked.program, found):
            click.echo(line)


class _Chosen:
    """The moments in which a condition begins to hold, and the one that is explained. Immutable."""

    def __init__(self, text: str, condition: Condition, spans: Sequence[FrameSpan], nth: int) -> None:
        self.text, self.condition, self.spans, self.nth = text, condition, spans, nth

    @property
    def span(self) -> FrameSpan:
        """The moment that is explained."""
        return self.spans[self.nth - 1]


class _Asked:
    """A recording that is asked about: its program and its index. Mutable.

    Attributes:
        shadow: once `found` was called, whether the program ran in the shadow of a robot.
    """

    def __init__(self, opened: OpenRecording, file: str | None) -> None:
        from colony.analysis.finding import cached_index, index_path

        self._opened, self.recording, self.file, self.run = opened, opened.name, file, opened.run
        self.program: Program = program_for(opened, file)
        self.shadow = False  # until a frame was read
        self._path = index_path(opened.stream, self.program, os.environ)
        self.index: RecordingIndex = cached_index(self._path) or self._built()
        if not self.index.frames:
            damage = f": damaged {self.index.damaged[0]}" if self.index.damaged else ""
            _misuse(f"{self.recording}: error: the recording contains no frame{damage}")

    def _built(self) -> RecordingIndex:
        from colony.analysis.finding import build_index, keep_index

        progress = ReadingProgress(self._opened.stream, "reading, once: ")
        index = build_index(self.program, self._opened.again(), progress)
        problem = keep_index(self._path, index)
        if problem is not None:
            say(f"the index cannot be kept, so the next question will take as long: {problem}")
        return index

    def chosen(self, when: str, nth: int, from_ns: int | None) -> _Chosen:
        """Return the moments in which a condition begins to hold; exit with 2 if there is none."""
        from colony.analysis.tracks import ConditionError, condition, spans_of

        try:
            wanted = condition(self.program, when)
        except ConditionError as problem:
            _misuse(f"{self.recording}: error: --when: {problem}")
        begin_ns = None if from_ns is None else self.index.first_ns + from_ns - TIME_RESOLUTION_NS // 2
        found = list(spans_of(self.index.tracks, wanted, begin_ns))
        if len(found) < nth:
            since = "" if from_ns is None else f" from {time_text(from_ns)} on"
            begins = f"begins {counted(len(found), 'time')}" if found else "never begins"
            _misuse(f"{self.recording}: error: --when: `{when}` {begins}{since}{self._extent()}")
        return _Chosen(when, wanted, found, nth)

    def _extent(self) -> str:
        end = time_text(self.index.last_ns - self.index.first_ns)
        return f"; the recording has {self.index.frames} frames from 0 s to {end}"

    def found(self, at_ns: int) -> Found:
        """Return the frame at a time of the run; exit with 2 if the recording does not have it.

        A frame is at the time that texts show of it.
        """
        index, frame_ns = self.index, self.program.robot.frame_ns
        if not 0 <= at_ns < index.last_ns - index.first_ns + frame_ns:
            where = "before" if at_ns < 0 else "after"
            message = f"{time_text(at_ns)} is {where} the recording{self._extent()}"
            breaks_off = f"; {index.truncation}" if index.truncation and where == "after" else ""
            _misuse(f"{self.recording}: error: --at: {message}{breaks_off}")
        return self.at(index.first_ns + at_ns + TIME_RESOLUTION_NS // 2)

    def at(self, t_ns: int) -> Found:
        """Return the last frame at or before a time of the robot, which the recording has."""
        from colony.analysis.finding import moment_at

        found = moment_at(self.program, self._opened.again(), self.index, t_ns)
        self.shadow = self._opened.reader.shadow
        return found

    def answers(self, found: Found, questions: Sequence[Why | WhyNot]) -> list[Explanation]:
        """Return the answers about a frame; exit with 1 if its memory is not known."""
        from colony.verify.explain.answer import explain

        if found.moment is None:
            damage = "".join(f"; damaged {text}" for text in self.index.damaged)
            damage += "".join(f"; {text}" for text in self.index.remarks)
            when = f"{time_text(found.t_ns - self.index.first_ns)} (frame {found.k})"
            say(f"{self.recording}: error: what the program remembered at {when} is not known{damage}")
            raise click.exceptions.Exit(EXIT_ERRORS)
        return [explain(found.moment, question) for question in questions]


def _misuse(text: str) -> NoReturn:
    from colony.cli.exit_codes import EXIT_MISUSE

    say(text)
    raise click.exceptions.Exit(EXIT_MISUSE)


def _questions(
    program: Program, why: tuple[str, ...], why_not: tuple[str, ...], chosen: _Chosen | None
) -> list[Why | WhyNot]:
    """Return the questions of the command line; by default, about what is chosen or every actuator."""
    from colony.verify.explain.answer import Why, WhyNot, subjects

    names = subjects(program)
    for option, given in (("--why", why), ("--why-not", why_not)):
        for name in given:
            if name not in names:
                hint = did_you_mean(name, names) or f"the program has {', '.join(names)}"
                _misuse(
                    f"colony explain: error: {option}: no actuator, module, wire or sensor `{name}`; {hint}"
                )
    asked: list[Why | WhyNot] = [*map(Why, why), *map(WhyNot, why_not)]
    if asked:
        return asked
    if chosen is not None:
        return [Why(chosen.condition.subject)]
    wired = {w.actuator for w in program.wires}
    return [Why(a.name) for a in program.robot.actuators if a.name in wired]


def _print_text(asked: _Asked, chosen: _Chosen | None, answers: Sequence[Explanation]) -> None:
    from colony.runtime.observe.summary import SHADOW_TEXT
    from colony.verify.explain.text import lines

    begin_ns = asked.index.first_ns
    if asked.shadow:
        click.echo(SHADOW_TEXT)
    if chosen is not None:
        click.echo(f"`{chosen.text}` begins {counted(len(chosen.spans), 'time')}:")
        for i, span in enumerate(chosen.spans[:MAX_SPANS], 1):
            end = "to the end" if span.end is None else f"to {time_text(span.end.t_ns - begin_ns)}"
            mark = "  <- explained below" if i == chosen.nth else ""
            click.echo(f"  {i}. from {time_text(span.start.t_ns - begin_ns)} {end}{mark}")
        if len(chosen.spans) > MAX_SPANS:
            click.echo(f"  and {len(chosen.spans) - MAX_SPANS} more; choose one with --nth")
        click.echo()
    for i, answer in enumerate(answers):
        if i:
            click.echo()
        for line in lines(answer, begin_ns):
            click.echo(line)
    for text in (*asked.index.remarks, *(f"damaged {text}" for text in asked.index.damaged)):
        say(f"{asked.recording}: warning: {text}")


def _heard_lines(program: Program, found: Found) -> Iterator[str]:
    """Yield what another controller commanded in a frame, and the contracts that it broke."""
    from colony.runtime.observe.comparison import heard_text

    for actuator in program.robot.actuators:
        if actuator.name in found.frame.heard:
            yield heard_text(actuator, found.frame.heard[actuator.name])
    for contract in found.frame.heard_breaches:
        yield f"  which broke the contract {contract}"


def _print_json(asked: _Asked, chosen: _Chosen | None, answers: Sequence[Explanation], found: Found) -> None:
    import json

    from colony.verify.explain.json_rows import row

    index, run, begin_ns = asked.index, asked.run, asked.index.first_ns
    when = None
    if chosen is not None:
        spans = [
            {
                "from": seconds_of(s.start.t_ns - begin_ns),
                "to": None if s.end is None else seconds_of(s.end.t_ns - begin_ns),
            }
            for s in chosen.spans
        ]
        when = {"condition": chosen.text, "spans": spans, "explained": chosen.nth - 1}
    out = {
        "recording": asked.recording,
        "file": asked.file,
        "program": run.program if run else None,
        "robot": asked.program.robot.name,
        "shadow": asked.shadow,
        "frames": index.frames,
        "from": 0.0,
        "to": seconds_of(index.last_ns - begin_ns),
        "truncated": index.truncation,
        "remarks": list(index.remarks),
        "damaged": list(index.damaged),
        "when": when,
        "answers": [row(answer, begin_ns) for answer in answers],
    }
    if heard := found.frame.heard:
        commands = {name: None if command is None else command._asdict() for name, command in heard.items()}
        out["controller"] = {"commands": commands, "broken": list(found.frame.heard_breaches)}
    click.echo(json.dumps(out, indent=2))
