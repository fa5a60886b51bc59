"""`make attack`: every attack of the suite on a robot of real processes, and a table of what came of them.

It listens and sends on loopback only, takes some minutes, and exits with 1 if any attack got something.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from colony.runtime.kit.connection import Session
from colony.runtime.kit.emergency import StopButton
from colony.runtime.library.clock import release
from colony.runtime.transport.live.network import local_user
from colony.runtime.transport.live.run_directory import UnreachableError
from tools.attack.after import after
from tools.attack.damage import cost, costs, flips, record
from tools.attack.flood import KINDS, Flood, Kind, flood
from tools.attack.handshakes import HalfOpen
from tools.attack.intruder import CERTIFICATES, MODES, Intruder, scouted
from tools.attack.lab import Lab, Witness, descriptors, lab, memory_mb
from tools.attack.stops import Stop, stop_times
from tools.attack.trial import attempt, impersonators
from tools.attack.weights import bear, weights

WATCH_S = 2.0
FLOOD_S, STOPS = 30.0, 50
CROWD = 15
"""Sessions of one user in a flood of many."""
BEGUN_S = 0.5
"""After so long a flood has begun."""

HALF_OPEN, NEW_A_SECOND = 300, 20.0
DURING_S = 45.0
PATIENCE_S = 120.0
TRIALS, RECORDED_S = 250, 8.0
BOMB_S, BOMB_MB = 2.0, 300.0


def main() -> int:
    folder = Path(tempfile.mkdtemp(prefix="colony-", dir="/tmp"))
    try:
        with lab(folder) as robot:
            failures = scouting(robot) + intruders(robot, folder)
            failures += floods(robot) + heavy(robot) + handshakes(robot)
        failures += flipped(folder) + bombed(folder)
    finally:
        shutil.rmtree(folder)
    print(f"\n{failures} attacks got something" if failures else "\nno attack got anything")
    return 1 if failures else 0


def scouting(robot: Lab) -> int:
    """A call to everybody on loopback; gives how many processes of the robot answered."""
    witness = Witness(robot.machine)
    try:
        found = len(scouted(WATCH_S) & witness.processes())
    finally:
        witness.close()
    print(f"{found} processes of the robot answer a scout\n")
    return found


def intruders(robot: Lab, folder: Path) -> int:
    """Every mode with every certificate; gives how many got beyond their right."""
    head = ("attack", "linked", "within", "delivered", "heard", "connections", "moved")
    print("Beyond the right of whom (`within` it: messages that got through)\n")
    print("{:<30} {:>7} {:>7} {:>10} {:>7} {:>12} {:>6}".format(*head))
    failures = 0
    tried = [Intruder(mode=m, certificate=c) for c in CERTIFICATES for m in MODES]
    for intruder in (*tried, *(i for mode in MODES for i in impersonators(robot, mode))):
        came = attempt(intruder, robot, folder, watch_s=0.5 if intruder.process else WATCH_S)
        cells = (len(came.delivered), len(came.heard), len(came.connections))
        linked, moved = ("yes" if found else "no" for found in (came.linked, came.moved))
        print(
            f"{came.attack:<30} {linked:>7} {came.within:>7} {cells[0]:>10} {cells[1]:>7} "
            f"{cells[2]:>12} {moved:>6}",
            flush=True,
        )
        for what in (*came.delivered[:3], *came.heard[:3], *came.connections[:3]):
            print(f"    {what}")
        failures += not came.failed
    return failures


def flipped(folder: Path) -> int:
    """Recordings, whole and of killed runs, with a bit that flipped; gives how many audits were wrong."""
    print(f"\nAudits of recordings in which one bit flipped, {TRIALS} each\n")
    head = ("recording", "bytes", "damage told", "refused", "not read", "wrong")
    print("{:<14} {:>9} {:>12} {:>8} {:>9} {:>6}".format(*head))
    failures = 0
    for name, killed in (
        ("whole.mcap", False),
        ("killed.mcap", True),
        ("whole.jsonl", False),
        ("killed.jsonl", True),
    ):
        data = record(folder / name, seconds=RECORDED_S, killed=killed)
        came = flips(data, name, trials=TRIALS, seed=1)
        print(
            f"{name:<14} {len(data):>9} {came.told:>12} {came.refused:>8} {came.untouched:>9} "
            f"{len(came.wrong):>6}",
            *came.wrong[:3],
            sep="\n    ",
            flush=True,
        )
        failures += len(came.wrong)
    return failures


def bombed(folder: Path) -> int:
    """Recordings that unpack to much; gives how many commands took too long or too much, or were content."""
    print("\nRecordings that unpack to much: beyond what `--help` takes\n")
    print(
        "{:<30} {:>10} {:<6} {:>6} {:>5} {:>5}  {}".format(
            "recording", "bytes", "", "s", "MB", "code", "said"
        )
    )
    recording = record(folder / "run.mcap", seconds=RECORDED_S, killed=False)
    failures, least = 0, cost("audit", "--help")
    for what, command, size, took in costs(folder, recording):
        seconds, megabytes = took.seconds - least.seconds, took.megabytes - least.megabytes
        said = took.said.removeprefix(str(folder))[:80]
        print(
            f"{what:<30} {size:>10} {command:<6} {seconds:>6.1f} {megabytes:>5.0f} {took.code:>5}  {said}",
            flush=True,
        )
        failures += seconds > BOMB_S or megabytes > BOMB_MB or took.code not in (1, 2)
    return failures


def floods(robot: Lab) -> int:
    """Every kind of flood while a user stops the robot; gives in how many a stop was not acknowledged, or the
    robot was not itself again soon."""
    print(
        f"\nEmergency stops of another user during a flood of {FLOOD_S:g} s, in ms; and the robot after it\n"
    )
    crowds: list[tuple[Kind, int]] = [
        (kind, niceness) for kind in ("command calls", "read calls", "fetches") for niceness in (0, 19)
    ]
    head = (
        "flood",
        "sent/s",
        "stops",
        "p50",
        "p99",
        "max",
        "frames",
        "login ms",
        "well s",
        "answer ms",
        "MB",
    )
    print("{:<22} {:>7} {:>6} {:>7} {:>7} {:>7} {:>7} {:>9} {:>7} {:>10} {:>4}".format(*head))
    failures = 0
    with robot.session("guard") as guard, robot.machine.session() as home:
        list(stop_times(guard, home, 3))
        failures += not _told(
            "none", 0.0, list(stop_times(guard, home, STOPS)), _login_and_stop(robot), robot
        )
        for kind, sessions, niceness in (*((k, 1, 0) for k in KINDS), *((k, CROWD, n) for k, n in crowds)):
            name = kind if sessions == 1 else f"{kind} x{sessions}{' nice' if niceness else ''}"
            running = flood(
                robot, kind, seconds=FLOOD_S, sessions=sessions, batched=sessions > 1, niceness=niceness
            )
            try:
                failures += not _flooded(robot, name, running, home if kind == "local calls" else guard, home)
            except Exception as problem:
                failures += 1
                print(f"{name:<22} {type(problem).__name__}: {problem}", flush=True)
    return failures


def _flooded(
    robot: Lab, name: str, flooding: AbstractContextManager[Flood], guard: Session, home: Session
) -> bool:
    """Whether the robot is itself again after a flood."""
    with flooding as running:
        time.sleep(BEGUN_S)
        begin = time.monotonic() - BEGUN_S
        took = list(stop_times(guard, home, STOPS))
        login_s = _login_and_stop(robot)
        sent, seconds = running.end(), time.monotonic() - begin
    return _told(name, sent / seconds, took, login_s, robot)


def _told(name: str, rate: float, took: list[Stop], login_s: float, robot: Lab) -> bool:
    ordered = [1000 * seconds for seconds in sorted(stop.seconds for stop in took)]
    p50, p99 = ordered[len(ordered) // 2], ordered[int(0.99 * (len(ordered) - 1))]
    frames, came = max(stop.frames for stop in took), after(robot)
    print(
        f"{name:<22} {rate:>7.0f} {len(took):>6} {p50:>7.1f} {p99:>7.1f} {ordered[-1]:>7.1f} {frames:>7} "
        f"{1000 * login_s:>9.0f} {came.seconds:>7.1f} {1000 * came.slowest_s:>10.1f} {came.megabytes:>4.0f}",
        flush=True,
    )
    return came.well


def _login_and_stop(robot: Lab) -> float:
    """Seconds that an emergency stop takes for a user who has to log in first."""
    begin = time.monotonic()
    with robot.session("guard") as session, StopButton(session, timeout_s=PATIENCE_S) as button:
        assert button.press().kept
        took = time.monotonic() - begin
    with robot.machine.session() as home, home.connect("Clock", timeout_s=PATIENCE_S) as at_clock:
        at_clock.do(release())
    return took


def heavy(robot: Lab) -> int:
    """The largest messages of all kinds; gives whether the robot is not itself after them."""
    print("\nThe largest messages of every kind, and an emergency stop right behind each, in ms\n")
    print(f"{'server':<10} {'messages':>9} {'answer':>8} {'slowest':<26} {'stop':>8}")
    with robot.machine.session() as home, StopButton(home, timeout_s=PATIENCE_S) as button:
        button.press()
        borne = [bear(home, weight, button) for weight in weights(local_user())]
    for server in dict.fromkeys(one.weight.server for one in borne):
        own = [one for one in borne if one.weight.server == server]
        worst, stop_s = max(own, key=lambda one: one.answer_s), max(one.stop_s for one in own)
        cells = f"{len(own):>9} {1000 * worst.answer_s:>8.1f} {worst.weight.name:<26} {1000 * stop_s:>8.1f}"
        print(f"{server:<10} {cells}")
    came = after(robot)
    answers = f"everything answers within {1000 * came.slowest_s:.1f} ms"
    print(f"\nafter it {answers}, and no process has more than {came.megabytes:.0f} MB")
    return not came.well


def handshakes(robot: Lab) -> int:
    """Half-open connections: stops on a session that stands, and how long a login takes meanwhile; gives how
    often one was never closed."""
    print(f"\n{HALF_OPEN} half-open connections, and then {NEW_A_SECOND:g} new ones a second\n")
    head = (
        "connections",
        "new/s",
        "stops",
        "p50 ms",
        "max ms",
        "files",
        "MB",
        "login s",
        "closed s",
        "login again s",
    )
    print("{:<12} {:>6} {:>6} {:>7} {:>7} {:>6} {:>5} {:>8} {:>9} {:>14}".format(*head))
    failures = 0
    with robot.session("guard") as guard, robot.machine.session() as home:
        for hello in (True, False):
            for rate in (0.0, NEW_A_SECOND):
                with HalfOpen(robot.port, count=HALF_OPEN, rate=rate, hello=hello) as half:
                    took = sorted(1000 * stop.seconds for stop in stop_times(guard, home, STOPS))
                    process = robot.pid("Gateway")
                    use = descriptors(process), memory_mb(process)
                    login = _login(robot, DURING_S)
                    half.rest()
                    closed = _until(lambda: not half.standing())
                    again = _login(robot, PATIENCE_S)
                failures += "never" in (closed, again)
                name = "stalled" if hello else "silent"
                stops = f"{len(took):>6} {took[len(took) // 2]:>7.1f} {took[-1]:>7.1f}"
                logins = f"{login:>8} {closed:>9} {again:>14}"
                print(f"{name:<12} {rate:>6g} {stops} {use[0]:>6} {use[1]:>5.0f} {logins}", flush=True)
    return failures


def _login(robot: Lab, patience_s: float) -> str:
    def attempted() -> bool:
        try:
            robot.session("guard").close()
        except UnreachableError:
            return False
        return True

    return _until(attempted, patience_s)


def _until(condition: Callable[[], bool], patience_s: float = PATIENCE_S) -> str:
    """Seconds until it holds."""
    begin = time.monotonic()
    while not condition():
        if time.monotonic() - begin > patience_s:
            return "never"
        time.sleep(0.05)
    return f"{time.monotonic() - begin:.2f}"


if __name__ == "__main__":
    sys.exit(main())
