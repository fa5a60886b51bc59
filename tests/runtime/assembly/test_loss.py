"""The policies for losses over some seeds (`make loss` is for many); bugs put in on purpose are found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any, NamedTuple

import pytest

from colony.execute.executor import ClientKey, ClientMemory, ClientsExecutor
from colony.runtime.arbitration.ballot import BoundedCommand, FrameBounds, Interventions
from colony.runtime.clients import client
from colony.runtime.frames import registry
from colony.runtime.frames.assembler import AssembledFrame, FrameAssembler
from colony.runtime.frames.publishing import Publisher
from colony.runtime.protocol.messages import Effect, Tick
from colony.runtime.servers.actuating import CommandedActuators
from colony.runtime.servers.commanding import CommandDispatcher
from colony.runtime.servers.outside_control import OutsideCommands
from tests.found_seeds import find_seed
from tests.sampling import long, sampled, thorough
from tools.loss import actuators, actuators_stage, outside, outside_stage, policy
from tools.loss.seeds import fails

Run = Callable[[int], Counter[str]]
Bug = Callable[[pytest.MonkeyPatch], None]


class Seeds(NamedTuple):
    """Runs of a policy, and what must happen in them: more than so often."""

    name: str
    run: Run
    seeds: range
    happens: Mapping[str, int]


def groups(name: str, run: Run, seeds: int, groups: int, every: int, **happens: int) -> list[Any]:
    """Parameters: seeds in groups, of which `make test` runs some."""
    size = seeds // groups
    named = {what.replace("_", " "): count for what, count in happens.items()}
    every_group = [Seeds(name, run, range(g * size, (g + 1) * size), named) for g in range(groups)]
    return sampled(every_group, every=every, thorough=True)


COMMANDED = {f"commands_from_outside_at_{actuator}": 5 for actuator in ("drive", "lift", "lamp")}
GROUPS = (
    *groups("stop", policy.run, 120, 8, 4, commands=100),
    *groups("degrade", partial(policy.run, degrade=True), 30, 3, 3, commands=100),
    *groups("clock", partial(policy.run, often="Clock"), 20, 1, 1, gaps=10),
    *groups("degrade, clock", partial(policy.run, degrade=True, often="Clock"), 20, 1, 1, gaps=10),
    *groups("outside", outside.run, 120, 40, 40, commands_from_outside=5),
    *groups("actuators", actuators.run, 120, 40, 40, **COMMANDED),
)


@pytest.mark.parametrize("seeds", GROUPS, ids=lambda seeds: f"{seeds.name} from {seeds.seeds.start}")
def test_seeds_hold_the_policy(seeds: Seeds) -> None:
    totals = sum(map(seeds.run, seeds.seeds), Counter[str]())
    assert all(totals[what] > count for what, count in seeds.happens.items()), totals


@pytest.mark.parametrize("number", sampled(range(outside.VARIANTS), every=4))
def test_what_must_hold_outside_is_proved_with_operators(number: int) -> None:
    program = outside_stage.variant(number, 100)
    safe = {c.name for c in program.contracts if c.name.startswith("safe")}
    assert len(safe) == 5
    assert safe <= outside.proved(program)


@pytest.mark.parametrize("number", sampled(range(actuators.VARIANTS), every=8, thorough=True))
def test_what_must_hold_at_actuators_is_proved_with_operators(number: int) -> None:
    proved = outside.proved(actuators_stage.variant(number, 100))
    assert {"safe_slow", "safe_bump", "safe_lift", "safe_lamp"} <= proved


# --- would it notice? --------------------------------------------------------------------------------


def restored_without_catching_up(patch: pytest.MonkeyPatch) -> None:
    """A client that loads a checkpoint goes on with the present frame."""
    resume = FrameAssembler.resume

    def wrong(self: FrameAssembler, k: int) -> tuple[Effect, ...]:
        return resume(self, self.latest - 1)

    patch.setattr(FrameAssembler, "resume", wrong)


def frames_skipped(patch: pytest.MonkeyPatch) -> None:
    """A reader that is behind leaves frames out."""
    take = FrameAssembler.take

    def wrong(self: FrameAssembler, message: Tick) -> tuple[Effect, ...]:
        effects = take(self, message)
        if isinstance(message, Tick) and self.latest - self.next >= 3:
            self.skip()
            self._next = self.latest
        return effects

    patch.setattr(FrameAssembler, "take", wrong)


def epochs_ignored(patch: pytest.MonkeyPatch) -> None:
    """Memory goes on where it should begin anew."""
    patch.setattr(AssembledFrame, "restart", property(lambda self: False))


def frames_given_up_by_guess(patch: pytest.MonkeyPatch) -> None:
    """Each reader decides for itself that the frame of a server that is down now will not come."""
    gone = FrameAssembler._absent

    def wrong(self: FrameAssembler, tick: Tick) -> frozenset[str]:
        newest = self._ticks.get(self._latest, tick)
        return gone(self, tick) | (
            frozenset(newest.down) & frozenset(self._servers) - frozenset(self._modules)
        )

    patch.setattr(FrameAssembler, "_absent", wrong)


def frames_invented(patch: pytest.MonkeyPatch) -> None:
    """A server that was started anew says "no value" for frames that the dead one may have published."""
    handle = Publisher.handle

    def wrong(self: Publisher, message: Tick) -> object:
        if self._since is not None:
            self._last_dropped = -1
        return handle(self, message)

    patch.setattr(Publisher, "handle", wrong)


def never_asked_for_again(patch: pytest.MonkeyPatch) -> None:
    """What got lost on its way is not asked for again."""

    def none(self: FrameAssembler) -> Iterator[Effect]:
        yield from ()

    patch.setattr(FrameAssembler, "_fetches", none)
    patch.setattr(client, "RECALL_NS", -1)
    patch.setattr(FrameAssembler, "lost", property(lambda self: False))


def memory_of_the_first_client_alone(patch: pytest.MonkeyPatch) -> None:
    """Of several clients in one process, only the first gets its memory back."""
    recall = ClientsExecutor.recall

    def wrong(self: ClientsExecutor, memories: dict[ClientKey, ClientMemory]) -> None:
        kept = {c: memories[c]._replace(cells=self.memory(c).cells) for c in self.clients[1:]}
        recall(self, memories | kept)

    patch.setattr(ClientsExecutor, "recall", wrong)


def liveness_forgotten(patch: pytest.MonkeyPatch) -> None:
    """Whoever was missing once is missing for good."""

    def renew(self: registry.Liveness, name: str, now_ns: int) -> None:
        if name in self._heard and name not in self.missing(now_ns):
            self._heard[name] = now_ns

    patch.setattr(registry.Liveness, "renew", renew)


def limits_ignored(patch: pytest.MonkeyPatch) -> None:
    """Commands from outside are not held to the limits."""
    patch.setattr(FrameBounds, "apply", lambda self, command: BoundedCommand(command.values))


def bounds_of_another_frame(patch: pytest.MonkeyPatch) -> None:
    """A command is held to the bounds of the last frame whose bounds came."""
    begin = FrameBounds.begin

    def wrong(self: FrameBounds, k: int, *, lost: bool) -> None:
        before = self._bounds
        begin(self, k, lost=lost)
        self._bounds = self._bounds or before

    patch.setattr(FrameBounds, "begin", wrong)


def sent_after_the_frame(patch: pytest.MonkeyPatch) -> None:
    """A tick that comes late is answered with what was sent after its frame."""
    fields = CommandDispatcher.fields

    def wrong(self: CommandDispatcher, tick: object) -> object:
        self._k = -1
        return fields(self, tick)  # type: ignore[arg-type]

    patch.setattr(CommandDispatcher, "fields", wrong)


def halts_unnoticed(patch: pytest.MonkeyPatch) -> None:
    """What was given before a stop counts as what was given last."""
    patch.setattr(CommandDispatcher, "note_halted", lambda self: None)


def stops_ignored(patch: pytest.MonkeyPatch) -> None:
    """An emergency stop does not keep connections from commanding."""
    patch.setattr(OutsideCommands, "stop", lambda self: None)
    interventions = OutsideCommands.interventions

    def wrong(self: OutsideCommands, *arguments: Any) -> Interventions:
        with pytest.MonkeyPatch.context() as unnoticed:
            unnoticed.setattr(self.state.emergency, "stopped", None)
            return interventions(self, *arguments)

    patch.setattr(OutsideCommands, "interventions", wrong)


def never_made_safe(patch: pytest.MonkeyPatch) -> None:
    """A command of a connection just ends where there is no idle command."""
    patch.setattr(CommandedActuators, "_release", lambda self, commands: self._driven.clear())


def leases_without_end(patch: pytest.MonkeyPatch) -> None:
    """A command of a connection stays in force."""
    patch.setattr("colony.runtime.arbitration.outside.OutsideCommanders.expire", lambda self, now_ns: None)
    patch.setattr(OutsideCommands, "on_lost", lambda self, caller: None)


POLICY, OUTSIDE, ACTUATORS = ("policy", policy.run), ("outside", outside.run), ("actuators", actuators.run)


@pytest.mark.parametrize(
    ("oracle", "bug", "seeds"),
    [
        (POLICY, restored_without_catching_up, 3000),
        (POLICY, frames_skipped, 3000),
        (POLICY, epochs_ignored, 3000),
        (POLICY, frames_given_up_by_guess, 3000),
        (POLICY, frames_invented, 3000),
        (POLICY, never_asked_for_again, 3000),
        thorough(POLICY, memory_of_the_first_client_alone, 3000),
        (POLICY, liveness_forgotten, 3000),
        (OUTSIDE, limits_ignored, 200),
        (OUTSIDE, bounds_of_another_frame, 200),
        thorough(OUTSIDE, sent_after_the_frame, 200),
        thorough(OUTSIDE, halts_unnoticed, 200),
        (ACTUATORS, limits_ignored, 200),
        (ACTUATORS, never_made_safe, 200),
        long(ACTUATORS, stops_ignored, 200),
        long(ACTUATORS, leases_without_end, 200),
    ],
)
def test_known_bugs_are_found(
    oracle: tuple[str, Run], bug: Bug, seeds: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, run = oracle
    bug(monkeypatch)
    assert find_seed(f"loss {name}: {bug.__name__}", range(seeds), partial(fails, run)) is not None
