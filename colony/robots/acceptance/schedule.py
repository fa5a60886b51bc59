"""The schedule of an acceptance test from a seed: emergency stops, deaths and freezes of processes, in turn.

Each step waits until the robot has recovered from the step before, so that what was measured belongs to one
step. The order does not depend on the speed of the machine: a seed gives one schedule, of any length.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from random import Random

from colony.runtime.transport.live.configuration import LINK_LEASE_MS

FREEZE_S = (0.01, 0.6)
"""Shortest and longest freeze: from a fifth of a frame to more than twice the liveness lease."""

LEASE_FREEZES, LEASE_FREEZE_S = 0.2, (0.9 * LINK_LEASE_MS / 1000, 1.5 * LINK_LEASE_MS / 1000)
"""Part of the freezes that last about as long as the lease of a link, and their range."""

SPARED_FREEZE_S = (0.01, 0.2)
"""The range of all freezes with a process that may not die. The lease of a leader at the Clock is 525 ms."""

PAUSE_S = (0.0, 0.3)
"""Range of the pause before a step, so that it comes at any moment of a frame."""

HOLD_S = (0.2, 1.0)
"""Range of the time for which an emergency stop is held."""

DOUBLE_KILLS = 0.25
"""Part of the deaths at which a second process dies together with the first."""

DISTURBED_STOPS = 0.5
"""Part of the stops under which a process is killed or frozen."""

MOST_FROZEN = 3
"""Maximum number of processes that are frozen together."""


@dataclass(frozen=True, slots=True)
class ProcessFault:
    """SIGKILL to processes, or SIGSTOP for `freeze_s` seconds unless it is None."""

    processes: tuple[str, ...]
    freeze_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultStep:
    """An emergency stop for `hold_s` seconds, under which a fault may come, or a fault alone."""

    pause_s: float
    hold_s: float | None = None
    fault: ProcessFault | None = None


def steps(seed: int, mortal: Sequence[str], spared: Sequence[str] = ()) -> Iterator[FaultStep]:
    """Yield a stop, a death and a freeze, again and again; each process dies once in a round.

    Args:
        seed: seed of all that is drawn.
        mortal: names of the processes that are killed and frozen.
        spared: names of the processes that are only frozen.
    """
    random = Random(f"acceptance {seed}")
    while True:
        for name in random.sample(sorted(mortal), len(mortal)):
            under = None
            if random.random() < DISTURBED_STOPS:
                under = random.choice((_death(random, mortal, None), _freeze(random, mortal, spared)))
            yield FaultStep(pause_s=random.uniform(*PAUSE_S), hold_s=random.uniform(*HOLD_S), fault=under)
            for fault in (_death(random, mortal, name), _freeze(random, mortal, spared)):
                yield FaultStep(pause_s=random.uniform(*PAUSE_S), fault=fault)


def _death(random: Random, mortal: Sequence[str], name: str | None) -> ProcessFault:
    first = name or random.choice(sorted(mortal))
    others = [other for other in sorted(mortal) if other != first]
    second = (random.choice(others),) if others and random.random() < DOUBLE_KILLS else ()
    return ProcessFault((first, *second))


def _freeze(random: Random, mortal: Sequence[str], spared: Sequence[str]) -> ProcessFault:
    names = sorted((*mortal, *spared))
    frozen = tuple(random.sample(names, random.randint(1, min(MOST_FROZEN, len(names)))))
    shortest, longest = LEASE_FREEZE_S if random.random() < LEASE_FREEZES else FREEZE_S
    if not set(spared).isdisjoint(frozen):
        shortest, longest = SPARED_FREEZE_S
    return ProcessFault(frozen, math.exp(random.uniform(math.log(shortest), math.log(longest))))
