"""Rounds of freezes on a served robot, beside busy loops; after each, every link has to be there again.

    python -m tools.freezes --rounds 50 --seed 1 --busy 4

The robot has devices, a server of a user that came last, and a process that only connects. From the seed,
some of these and their supervisor are stopped together for up to `--longest` seconds, mostly about as long as
the lease of a link. All is well when the process that only connects has a frame of every server, and a tick
by which no server is down, that are newer than the thaw.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from random import Random

import zenoh

from colony.runtime.kit.server import Server, field
from colony.runtime.protocol import codec
from colony.runtime.protocol.messages import ServerFrame, Tick
from colony.runtime.protocol.topics import CLOCK
from colony.runtime.transport.live.configuration import LINK_LEASE_MS
from colony.runtime.transport.live.network import ZenohSession, local_time
from colony.runtime.transport.live.robot_address import local
from tests.cli.machine import MAP, ROBOT, Machine, children_of
from tests.runtime.transport.live.stage import python_process
from tests.waiting import killed_in_the_end, until

MODULE = "tools.freezes"
LATE = "Late"
SERVERS = frozenset(
    {CLOCK, "RServer", "DServer", "Runtime", "Lidar", "Floor", "Battery", "Panel", "Lift", LATE}
)

RECOVERED_S = 2.0
"""Seconds from a thaw until every link has to be there again."""

LOST_S = 20.0
"""Seconds after which a link is taken for lost."""

NEAR_LEASE = 0.7
"""Fraction of the freezes that last about as long as a lease."""

SHORTEST_S = 0.5
STAGGER_S = 0.5
"""Seconds within which all freezes of a round begin."""


def drawn(random: Random, pids: tuple[int, ...], longest_s: float) -> list[tuple[float, int, signal.Signals]]:
    """Draw the signals of one round, each with its time and process."""
    lease_s = LINK_LEASE_MS / 1000
    if random.random() < NEAR_LEASE:
        length_s = random.uniform(0.9, 1.5) * lease_s
    else:
        length_s = SHORTEST_S * (longest_s / SHORTEST_S) ** random.random()
    signals = []
    for pid in random.sample(pids, random.randint(1, random.choice((3, len(pids))))):
        at_s = random.uniform(0.0, STAGGER_S)
        thaw_s = at_s + length_s * random.uniform(0.9, 1.1)
        signals += [(at_s, pid, signal.SIGSTOP), (thaw_s, pid, signal.SIGCONT)]
    return sorted(signals)


class Freezes:
    """A robot to freeze. Mutable.

    Attributes:
        late: A line for each round after which the robot was not well in time.
        times: Seconds that it took after each round.
    """

    def __init__(self, machine: Machine, pids: tuple[int, ...], listener: subprocess.Popen[str]) -> None:
        self._pids, self._listener = pids, listener
        self._now = local_time(local(ROBOT, machine.environment))
        self._names = {pid: name for name, pid in machine.directory.running().items()}
        self.late: list[str] = []
        self.times: list[float] = []

    def round(self, random: Random, longest_s: float) -> frozenset[str]:
        """Freeze some processes together, and take the time until all is well; return what stays missing."""
        signals, begin = drawn(random, self._pids, longest_s), time.monotonic()
        for at_s, pid, number in signals:
            time.sleep(max(0.0, begin + at_s - time.monotonic()))
            os.kill(pid, number)
        frozen_s, thaw_ns, missing = time.monotonic() - begin, self._now(), SERVERS
        while missing and self._now() < thaw_ns + 1e9 * LOST_S:
            missing = self.missing(thaw_ns)
        self.times.append((self._now() - thaw_ns) / 1e9)
        if self.times[-1] > RECOVERED_S:
            frozen = ", ".join(self._names.get(pid, str(pid)) for pid in {pid for _, pid, _ in signals})
            lack = f"; missing: {', '.join(sorted(missing))}" if missing else ""
            self.late.append(f"{self.times[-1]:.2f} s after {frozen_s:.1f} s without {frozen}{lack}")
        return missing

    def missing(self, since_ns: int) -> frozenset[str]:
        """Return the servers of which the process that only connects has no newer frame, or that are down."""
        assert self._listener.stdin is not None
        assert self._listener.stdout is not None
        self._listener.stdin.write(f"{since_ns}\n")
        self._listener.stdin.flush()
        return SERVERS - set(json.loads(self._listener.stdout.readline()))


@contextmanager
def freezes(folder: Path) -> Iterator[Freezes]:
    """A robot that is well."""
    machine = Machine(folder)
    with ExitStack() as resources:
        resources.callback(machine.close)
        served = machine.start("serve", "all", "--robot", f"{ROBOT}=amr", "--map", MAP)
        until(lambda: served.ended() or machine.truth(), "the simulator starts")
        assert not served.ended(), served.err
        listener = subprocess.Popen(
            [sys.executable, "-m", MODULE, "--listen"],
            env=machine.environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        resources.enter_context(killed_in_the_end(listener))
        late = resources.enter_context(
            python_process(machine.environment, "-m", MODULE, "--serve", says="serves")
        )
        pids = (served.pid, *children_of(served.pid), late.pid, listener.pid)
        made = Freezes(machine, tuple(sorted(pids)), listener)
        since_ns = local_time(local(ROBOT, machine.environment))()
        until(lambda: not made.missing(since_ns), "every server is heard")
        yield made


def listen() -> None:
    """Answer each time in nanoseconds on stdin with the servers whose frames are newer, and not down."""
    ticks: dict[int, Tick] = {}
    frames: dict[str, int] = {}

    def hear(sample: zenoh.Sample) -> None:
        message = codec.decode(sample.payload.to_bytes())
        if isinstance(message, Tick):
            ticks[message.k] = message
            ticks.pop(message.k - 100, None)
        elif isinstance(message, ServerFrame):
            frames[message.server] = message.k

    with ZenohSession.open(local(ROBOT, os.environ)) as network:
        for key in ("Clock/ticks", "*/frames"):
            handler = zenoh.handlers.Callback(hear, indirect=False)
            network.session.declare_subscriber(f"colony/{ROBOT}/{key}", handler)
        for line in sys.stdin:
            newer = {k: tick for k, tick in tuple(ticks.items()) if tick.t_ns > int(line)}
            down = newer[max(newer)].down if newer else tuple(SERVERS)
            heard = {name for name, k in tuple(frames.items()) if k in newer} | ({CLOCK} if newer else set())
            print(json.dumps(sorted(heard - set(down))), flush=True)


def serve() -> None:
    """Serve a field, as a server of a user."""
    with Server.open(LATE, robot=ROBOT) as server:
        print("serves", flush=True)
        server.mainloop([], fields=[field("level", lambda: 0.5)])


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--rounds", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--busy", type=int, default=4, help="number of busy loops")
    parser.add_argument("--longest", type=float, default=30.0, help="seconds of the longest freeze")
    parser.add_argument("--listen", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.listen or options.serve:
        listen() if options.listen else serve()
        return 0
    random = Random(options.seed)
    with ExitStack() as resources:
        folder = Path(resources.enter_context(tempfile.TemporaryDirectory(prefix="freezes-", dir="/tmp")))
        robot = resources.enter_context(freezes(folder))
        for _ in range(options.busy):
            spin = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            resources.enter_context(killed_in_the_end(spin))
        for _ in range(options.rounds):
            known = len(robot.late)
            robot.round(random, options.longest)
            for line in robot.late[known:]:
                print(f"round {len(robot.times)}: {line}", flush=True)
    times = sorted(robot.times)
    print(
        f"seed {options.seed}: {len(times)} rounds, well again after {times[len(times) // 2]:.2f} s (p50), "
        f"{times[-1]:.2f} s (max); {len(robot.late)} later than {RECOVERED_S:g} s"
    )
    return 1 if robot.late else 0


if __name__ == "__main__":
    sys.exit(main())
