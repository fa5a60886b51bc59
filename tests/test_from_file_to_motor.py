"""One text, followed from its file to its commands at the motor: nothing on the way is done twice."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from colony.cli.programs import compile_file
from colony.compile import pipeline
from colony.execute import colonyc, intake, machine
from colony.execute.compiled import Compiled
from colony.execute.intake import Records
from colony.ir.frame import Reading
from colony.ir.program import Sensor
from colony.ir.types import Value
from colony.runtime.assembly.virtual import VirtualSession
from colony.runtime.protocol.bindings import SensorBinding
from colony.runtime.protocol.messages import Sample
from tests.cli.machine import MAP, Machine
from tests.paths import ROOT
from tests.runtime.scripted import FAR, Log, Script
from tests.sampling import long
from tests.verify.testing.bugs_in_passes import replace_pass

TEXT = """
robot rome {
  sensor   sonar[24] : m   from PServer.sonar   within 200 ms
  sensor   limit     : m/s from DServer.Limit
  actuator drive { velocity : m/s range 0 .. 1, turn : deg/s }
           to RServer.drive  idle drive(velocity = 0, turn = 0)
}
module stop   { when sonar[12] < 1 m  do drive(velocity = 0, turn = 30 deg/s) }
module cruise { when true             do drive(velocity = limit, turn = 0) }
network { drive = stop suppresses cruise }
"""
FRAMES = 4
FRAME_NS = 50_000_000
LIMIT = 0.3
NEAR = (*FAR[:12], 999.9, *FAR[13:])
PASSES = ("elaborate", "eliminate_inhibition", "forward_traversal", "simplify")


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count how often each pass is run, and each sensor's readings are converted or taken by an executor."""
    calls: Counter[str] = Counter()

    def count(where: Any, name: str, what: Callable[..., str]) -> None:
        original = getattr(where, name)

        def counting(*arguments: Any) -> Any:
            calls[what(*arguments)] += 1
            return original(*arguments)

        monkeypatch.setattr(where, name, counting)

    def converted(way: str) -> Callable[[SensorBinding, Value], str]:
        return lambda binding, _: f"{binding.sensor} {way}"

    def taken(sensor: Sensor, _reading: Reading, _records: Records) -> str:
        return f"{sensor.name} taken, factor {sensor.factor:g}"

    def once_more(original: Callable[[Any], Any], given: object) -> Any:
        calls[original.__name__] += 1
        return original(given)

    for name in PASSES:
        replace_pass(monkeypatch, name, once_more)
    count(pipeline, "lower", lambda *_: "lower")
    for way in ("in_base_units", "in_declared_units"):
        count(SensorBinding, way, converted(way))
    assert machine.validate_reading is intake.validate_reading
    count(machine, "validate_reading", taken)
    return calls


def test_from_file_to_motor(counted: Counter[str], tmp_path: Path) -> None:
    path = tmp_path / "roam.colony"
    path.write_text(TEXT)
    data = colonyc.encode(compile_file(str(path)).compiled)
    path.unlink()  # all that is needed is in the compiled program
    compiled: Compiled = colonyc.decode(data, "roam.colonyc")
    log = Log()
    script = Script(sonar_at=lambda t: Sample(FAR if t < 2 * FRAME_NS else NEAR, t))
    session = VirtualSession(
        compiled, script.drivers, clock=script.clock, seed=1, variables={"Limit": LIMIT}, sinks=(log,)
    )
    session.run(FRAMES * FRAME_NS)

    # base units from the servers' frames to the motor
    assert [command[1:] for command in script.told[-FRAMES:]] == [(300.0, 0.0)] * 2 + [(0.0, 30.0)] * 2
    # declared units for people
    assert log.frames[0].frame.readings == {"sonar": tuple(x / 1000.0 for x in FAR), "limit": LIMIT}
    assert [frame.verdicts["drive"].values for frame in log.frames] == [(LIMIT, 0.0)] * 2 + [(0.0, 30.0)] * 2
    assert log.winners() == ["cruise", "cruise", "stop", "stop"]
    assert not any(frame.disagreements for frame in log.frames)
    assert counted == {
        # each pass is run once
        **dict.fromkeys((*PASSES, "lower"), 1),
        # each client has each of its readings converted once, where its frame is made, and computes with
        # that; the guard of `cruise` reads the sonar, too
        "sonar in_base_units": 2 * FRAMES,
        "sonar taken, factor 1": 2 * FRAMES,
        "limit in_base_units": FRAMES,
        "limit taken, factor 1": FRAMES,
        # the observer has the declared units that people read, and its monitor converts them once
        "sonar in_declared_units": FRAMES,
        "sonar taken, factor 1000": FRAMES,
        "limit in_declared_units": FRAMES,
        "limit taken, factor 1000": FRAMES,
    }


# --- between processes -------------------------------------------------------------------------------

COUNTING = """
import os, sys
from hashlib import sha256
from pathlib import Path
from colony.runtime.protocol import codec

log = open(Path(os.environ["COUNTED"], str(os.getpid())), "a", buffering=1)

def count(name):
    function = getattr(codec, name)
    def counting(given):
        result = function(given)
        said, data = (given, result) if name == "encode" else (result, given)
        spec = next((Path(one).stem for one in sys.argv if one.endswith(".json")), "leader")
        for i, message in enumerate(said if name == "decode_all" else getattr(said, "messages", (said,))):
            sender = getattr(message, "server", getattr(message, "client", getattr(message, "actuator", "")))
            which = type(message).__name__, getattr(message, "k", ""), sender
            print(name, spec, *which, f"{sha256(data).hexdigest()}/{i}", sep="\\t", file=log)
        return result
    setattr(codec, name, counting)

count("encode")
count("decode")
count("decode_all")
"""
"""Has each process of a run write down what messages it encodes and decodes, and goes on with it."""

WAY = {
    "PServer": [("Tick", "")],
    "DServer": [("Tick", "")],
    "clients": [("Tick", ""), ("ServerFrame", "PServer"), ("ServerFrame", "DServer")],
    "RServer": [("Tick", ""), ("Request", "cruise")],
    "leader": [("Tick", ""), ("ServerFrame", "PServer"), ("ServerFrame", "DServer"), ("Verdict", "drive")],
}
"""What each process hears, and from whom, in a frame that `cruise` decides."""


@pytest.mark.parametrize("isolated", [False, long(True)], ids=["one process", "isolated"])
def test_each_message_is_decoded_once_in_each_process_that_hears_it(tmp_path: Path, isolated: bool) -> None:
    """Also where several clients of a process hear it; in one process only calls are encoded."""
    counted, inside = tmp_path / "counted", tmp_path / "inside"
    for folder in (counted, inside):
        folder.mkdir()
    (inside / "sitecustomize.py").write_text(COUNTING)
    (tmp_path / "roam.colony").write_text(TEXT)
    paths = {"PYTHONPATH": f"{inside}:{ROOT}", "COUNTED": str(counted)}
    options: tuple[str, ...] = ("--isolate",) if isolated else ()
    options += ("--map", MAP, "--processes", "--set", f"Limit={LIMIT}", "--no-picture", "--duration", "1")
    with closing(Machine(tmp_path, **paths)) as machine:
        run = machine.run("run", str(tmp_path / "roam.colony"), *options, "--record", "run.jsonl")
    assert run.process.returncode == 0, run.err

    sent: Counter[str] = Counter()
    decoded: Counter[tuple[str, str]] = Counter()
    heard, encoded = set(), set()
    for path in counted.iterdir():
        for line in path.read_text().splitlines():
            way, process, kind, k, sender, digest = line.split("\t")
            if way == "encode":
                sent[digest] += 1
                encoded.add(kind)
            else:
                decoded[process, digest] += 1
                heard.add((process, kind, sender, k))
    assert {who: times for who, times in decoded.items() if times > sent[who[1]]} == {}
    frames = [json.loads(line) for line in (run.folder / "run.jsonl").read_text().splitlines()]
    commanded = [frame for frame in frames if frame.get("drive", {}).get("by") == "cruise"]
    assert {frame["drive"]["velocity"] for frame in commanded} == {LIMIT}
    if not isolated:
        assert {kind for _, kind, _, _ in heard} | encoded <= {"Alive", "Call", "Reply"}
    for frame in commanded if isolated else ():
        for process, messages in WAY.items():
            for kind, sender in messages:
                assert (process, kind, sender, str(frame["@tick"])) in heard
