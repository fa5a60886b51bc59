"""A robot of processes without a robot: `python -m benchmarks.floor NAME FOLDER SECONDS`.

Seven bare processes of zenoh, with as many threads as in processes of a robot, exchange the messages that no
robot could do without: a clock ticks every 50 ms, three servers answer with a frame each, a host answers with
one batch of requests, a leader hears everything, and a simulator is linked and hears nothing. msgpack in and
out, and no other work. A robot has more messages than that: frames of `Runtime`, verdicts, signs of life; and
its Clock hears servers.
"""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path

import msgspec
import zenoh

from colony.runtime.transport.live.network import threads

PERIOD_S = 0.05
LINKING_S = 2.0

HEARS = {
    "Clock": ("floor/leader",),
    "RServer": ("floor/Clock", "floor/host"),
    "PServer": ("floor/Clock",),
    "DServer": ("floor/Clock",),
    "Simulator": ("floor/none",),
    "host": ("floor/RServer", "floor/PServer", "floor/DServer"),
    "leader": ("floor/**",),
}
"""What each process subscribes to."""

SERVERS = ("RServer", "PServer", "DServer")


def session(name: str, folder: Path) -> zenoh.Session:
    """Open a session that is linked with all others over unix sockets."""
    config = zenoh.Config()
    others = [f"unixsock-stream/{folder}/{other}.sock" for other in HEARS if other != name]
    for key, value in {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
        "listen/endpoints": [f"unixsock-stream/{folder}/{name}.sock"],
        "connect/endpoints": others,
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def main() -> None:
    """Be one of them; print milliseconds of processor time a tick."""
    name, folder, seconds = sys.argv[1], Path(sys.argv[2]), float(sys.argv[3])
    os.environ.setdefault("ZENOH_RUNTIME", threads())
    encode, decode = msgspec.msgpack.Encoder().encode, msgspec.msgpack.Decoder().decode
    fields: dict[str, object] = {f"field_{i}": (1.5, 123_456_789) for i in range(8)}
    if name == "PServer":
        fields["sonar"] = ([1234.5] * 24, 123)
    requests = [(f"client_{i}", None) for i in range(6)]
    with session(name, folder) as joined:
        out = joined.declare_publisher(f"floor/{name}")
        heard = 0

        def hear(sample: zenoh.Sample) -> None:
            nonlocal heard
            heard += 1
            k = decode(sample.payload.to_bytes())["k"]
            if name in SERVERS and str(sample.key_expr) == "floor/Clock":
                out.put(encode({"k": k, "fields": fields}))
            elif name == "host" and heard % len(SERVERS) == 0:
                out.put(encode({"k": k, "requests": requests}))

        for key in HEARS[name]:
            joined.declare_subscriber(key, zenoh.handlers.Callback(hear, indirect=False))
        time.sleep(LINKING_S)
        begun, cpu = time.monotonic(), time.process_time()
        ticks = round(seconds / PERIOD_S)
        for k in range(ticks):
            if name == "Clock":
                out.put(encode({"k": k, "t_ns": k * 50_000_000, "down": [], "lost": []}))
            time.sleep(max(0.0, begun + (k + 1) * PERIOD_S - time.monotonic()))
        print(json.dumps({"ms": 1000 * (time.process_time() - cpu) / ticks, "heard": heard}), flush=True)
        time.sleep(1.0)


if __name__ == "__main__":
    main()
