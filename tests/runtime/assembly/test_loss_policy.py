"""The policy for losses over some seeds (`make loss` is for many); known bugs put in on purpose are found."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial

import pytest

from colony.execute.executor import ClientKey, ClientMemory, ClientsExecutor
from colony.runtime.clients import client
from colony.runtime.frames import liveness
from colony.runtime.frames.assembler import AssembledFrame, FrameAssembler
from colony.runtime.frames.publishing import Publisher
from colony.runtime.protocol.messages import Effect, Tick
from tests.found_seeds import find_seed
from tests.sampling import sampled, thorough
from tools.loss.policy import run
from tools.loss.seeds import fails

SEEDS = 120
GROUPS = 8


@pytest.mark.parametrize("group", sampled(range(GROUPS), every=4, thorough=True))
def test_stop(group: int) -> None:
    totals = Counter[str]()
    for seed in range(group * SEEDS // GROUPS, (group + 1) * SEEDS // GROUPS):
        totals += run(seed)
    assert totals["commands"] > 100


@pytest.mark.parametrize("group", sampled(range(3), every=3, thorough=True))
def test_degrade(group: int) -> None:
    totals = Counter[str]()
    for seed in range(10 * group, 10 * (group + 1)):
        totals += run(seed, degrade=True)
    assert totals["commands"] > 100


@pytest.mark.long
@pytest.mark.parametrize("degrade", [False, True])
def test_the_clock_fails_most_often(degrade: bool) -> None:
    totals = Counter[str]()
    for seed in range(20):
        totals += run(seed, degrade=degrade, often="Clock")
    assert totals["gaps"] > 10


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

    def renew(self: liveness.Liveness, name: str, now_ns: int) -> None:
        if name in self._heard and name not in self.missing(now_ns):
            self._heard[name] = now_ns

    patch.setattr(liveness.Liveness, "renew", renew)


@pytest.mark.parametrize(
    "bug",
    [
        restored_without_catching_up,
        frames_skipped,
        epochs_ignored,
        frames_given_up_by_guess,
        frames_invented,
        never_asked_for_again,
        thorough(memory_of_the_first_client_alone),
        liveness_forgotten,
    ],
)
def test_known_bugs_are_found(
    bug: Callable[[pytest.MonkeyPatch], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    bug(monkeypatch)
    assert find_seed(f"loss policy: {bug.__name__}", range(3000), partial(fails, run)) is not None
