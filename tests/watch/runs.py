"""A recorded run, and pages of it, for the tests of `colony watch`."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import msgspec
from websockets.sync.client import ClientConnection, connect

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute.compiled import SourceFile
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.recordings.mcap_reader import McapReader
from colony.watch.scene import PageScene, scene_of
from colony.watch.serving import PROTOCOL, Greeting, PageProof, PageServer, new_nonce, proof
from colony.watch.snapshot import PageFrame
from colony.watch.sources import RecordingSource, RunFollower
from colony.watch.store import SnapshotStore
from colony.watch.trail import RunTrail
from colony.watch.watched import StopAnswer, Watched
from tests.analysis.recorded_runs import MS, as_mcap, logs
from tests.waiting import until

TOKEN = "the-token-of-the-tests-the-token-of-the-tests"

TEXT = """
robot tiny {
  frame 100 ms
  sensor ranges[4] : m bearing -90 deg step 90 deg range 0 .. 4 from PServer.ranges
  sensor bump : bool from RServer.bumper
  sensor x : mm from RServer.x
  sensor y : mm from RServer.y
  sensor heading : deg from RServer.heading
  sensor charge : number range 0 .. 1 from DServer.charge
  actuator drive { velocity : mm/s range -400 .. 400, turn : deg/s range -90 .. 90 }
           to RServer.drive idle drive(velocity = 0, turn = 0)
}
state bumps : number = 0
next bumps = if rising(bump) then bumps + 1 else bumps
module back_off { when bump do drive(velocity = -100 mm/s, turn = 0) }
module avoid { when ranges[0 deg] < 1 m do drive(velocity = 0, turn = 60 deg/s) }
module tired { when charge < 0.2 do drive(velocity = 50 mm/s, turn = 0) }
module cruise { when true do drive(velocity = 600 mm/s, turn = 0) }
limit drive.velocity <= 300 mm/s when ranges[0 deg] < 2 m
network {
  careful = avoid suppresses[500 ms] tired suppresses cruise
  drive = back_off suppresses careful
}
contract slow_when_near: ranges[0 deg] < 1 m implies drive.velocity <= 100 mm/s
contract never_backward: drive.velocity >= 0 mm/s
"""

PROGRAM = load_text(TEXT)

SOURCES = (SourceFile(kind="behavior", path="b.colony", data=TEXT.encode()),)

FRAMES = 20


def frame(k: int) -> Frame:
    """Return a frame: something is near from 0.3 s to before 0.5 s, and the bumper touches from 1.5 s."""
    near = 0.5 if k in (3, 4) else 1.5 if k == 12 else 3.0
    readings: dict[str, Any] = {
        "ranges": (4.0, near, 4.0, 1.0),
        "bump": k >= 15,
        "x": 100.0 * k,
        "y": 0.0,
        "heading": 270.0,
    }
    return Frame(k * 100 * MS, readings | ({"charge": 0.9} if k < 18 else {}))


def run() -> list[RunFrame]:
    """Return the run; in frame 8 the winner was late, so that the robot idled."""
    out = logs(PROGRAM, [frame(k) for k in range(FRAMES)])
    verdict = out[8].verdicts["drive"]
    fates = tuple((c, "late" if c == "cruise" else fate) for c, fate in verdict.fates)
    late = replace_verdict(verdict, by=None, values=(0.0, 0.0), fates=fates)
    out[8] = replace(out[8], verdicts={"drive": late})
    return out


def replace_verdict(verdict: Any, **changes: Any) -> Any:
    """Return a verdict with other members."""
    return msgspec.structs.replace(verdict, **changes)


def snapshots(frames: list[RunFrame] | None = None) -> list[PageFrame]:
    """Return the snapshots of the run."""
    store = SnapshotStore(scene().modules)
    follower = RunFollower(PROGRAM, store, RunTrail(PROGRAM))
    made = [follower.take(log) for log in (run() if frames is None else frames)]
    store.close()
    return made


def scene(title: str = "run.mcap", program: Program = PROGRAM) -> PageScene:
    """Return the scene of a program."""
    return scene_of(program, title, compile_program(program).compiled.clients)


def recording() -> bytes:
    """Return the run as MCAP."""
    return as_mcap(PROGRAM, run(), *SOURCES).content


@contextmanager
def recorded(stop: Callable[[], StopAnswer] | None = None) -> Iterator[Watched]:
    """Read the recording into a store, to the end."""
    with recorded_run(PROGRAM, recording(), stop) as watched:
        yield watched


@contextmanager
def recorded_run(
    program: Program, content: bytes, stop: Callable[[], StopAnswer] | None = None
) -> Iterator[Watched]:
    """Read a recording of a program into a store, to the end."""
    store = SnapshotStore(scene(program=program).modules)
    reader = McapReader(io.BytesIO(content), "run.mcap")
    trail = RunTrail(program)
    with RecordingSource(reader, program, store, trail):
        until(lambda: store.is_complete, "the recording is read")
        shown = scene(program=program)
        yield Watched(scene=shown, store=store, is_live=False, explain=trail.explain, stop=stop)
    store.close()


@contextmanager
def served(watched: Watched) -> Iterator[PageServer]:
    """Serve the page of a run on a free port."""
    with PageServer(watched, port=0, token=TOKEN) as server:
        yield server


class Page:
    """A page without a browser: its WebSocket. Mutable."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket

    def ask(self, **members: Any) -> None:
        """Send a request."""
        self.send(json.dumps(members))

    def send(self, message: str | bytes) -> None:
        """Send a message, a request or not: a text, or bytes as a binary one."""
        self._socket.send(message)

    def until(self, wanted: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
        """Return the next message that is wanted."""
        while True:
            message: dict[str, Any] = json.loads(self._socket.recv(timeout=60))
            if wanted(message):
                return message

    def shown(self, k: int) -> dict[str, Any]:
        """Return the snapshot of frame `k`, once it comes."""
        return self.until(lambda m: m.get("snapshot", {}).get("k") == k)["snapshot"]


@contextmanager
def greeted(
    host: str, *, origin: str | None = None, **headers: str
) -> Iterator[tuple[ClientConnection, str, Greeting]]:
    """Open a WebSocket as a page would, of the page's own origin unless another is given, with more headers.

    The context's value has the nonce that was offered, and the greeting of the server.
    """
    nonce = new_nonce()
    with connect(
        f"ws://{host}/run",
        origin=f"http://{host}" if origin is None else origin,  # type: ignore[arg-type]
        subprotocols=[PROTOCOL, nonce],  # type: ignore[list-item]
        additional_headers=headers,
        compression=None,
        proxy=None,
    ) as socket:
        yield socket, nonce, msgspec.json.decode(socket.recv(timeout=60), type=Greeting)


@contextmanager
def page(host: str, *, origin: str | None = None, token: str = TOKEN) -> Iterator[Page]:
    """Open the WebSocket of a page, and prove that it knows the token."""
    with greeted(host, origin=origin) as (socket, _, greeting):
        reply = PageProof(proof=proof(token, "page", greeting.nonce, host))
        socket.send(msgspec.json.encode(reply).decode())
        yield Page(socket)
