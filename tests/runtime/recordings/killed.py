"""How much of a recording is lost when its writer is killed: `python -m tests.runtime.recordings.killed`.

A robot of real processes is served; again and again a run of it is recorded and its leader killed at a moment
of chance. Everything up to half a second before must be there, and the audit must agree.
"""

from __future__ import annotations

import argparse
import random
import signal
import sys
import tempfile
import time
from pathlib import Path

from colony.dsl.load import load_file
from tests.attack.damage import audited
from tests.cli.machine import MAP, ROBOT, WANDER, Machine, children_of, lives
from tests.waiting import until

MOST_S = 0.5
A_WHILE_S = 1.5
"""The longest time from the first frames of a recording to the kill."""


def killed(machine: Machine, name: str, chance: random.Random) -> float:
    """Record a run, kill its leader, and give the seconds before that of which nothing is recorded."""
    run = machine.start("run", WANDER, "--connect", "--robot", ROBOT, "--duration", "1000", "--record", name)
    path = run.folder / name
    until(lambda: run.ended() or (path.exists() and path.stat().st_size > 0), "the recording begins")
    head = path.stat().st_size
    until(lambda: run.ended() or path.stat().st_size > head, "frames are recorded")
    time.sleep(chance.uniform(0.0, A_WHILE_S))
    assert not run.ended(), run.err
    clients = children_of(run.pid)
    run.tell(signal.SIGKILL)
    t_ns = time.monotonic_ns() - machine.directory.origin_ns()
    run.process.wait()
    until(lambda: not any(map(lives, clients)), "the clients end with their leader")
    program = load_file(WANDER)
    found = audited(path.read_bytes(), name, program)
    assert found.frames > 0
    assert (found.differs, found.damaged, found.refused) == (False, 0, None), found
    return (t_ns - found.last_ns) / 1e9


def measure(folder: Path, trials: int, seed: int) -> list[float]:
    """The seconds that are lost, of each trial; both formats take turns."""
    machine, chance = Machine(folder), random.Random(seed)
    try:
        machine.start("serve", "all", "--robot", ROBOT, "--map", MAP)
        until(lambda: machine.truth() is not None, "the robot is served", patience_s=120.0)
        return [killed(machine, ("run.mcap", "run.jsonl")[k % 2], chance) for k in range(trials)]
    finally:
        machine.close()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="colony-", dir="/tmp") as folder:
        lost = measure(Path(folder), options.trials, options.seed)
    for name, of in (("MCAP", lost[::2]), ("JSON lines", lost[1::2])):
        late = sum(seconds > MOST_S for seconds in of)
        print(f"{name}: {len(of)} kills, at most {max(of):.3f} s lost, {late} beyond {MOST_S:g} s")
    return 1 if max(lost) > MOST_S else 0


if __name__ == "__main__":
    sys.exit(main())
