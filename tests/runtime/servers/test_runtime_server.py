"""Chance comes from the seed of what is deployed, by a call or from the Clock beside it."""

from __future__ import annotations

import msgspec

from colony.runtime.frames.clock import Clock
from colony.runtime.library.clock import deploy
from colony.runtime.protocol.messages import Tick
from colony.runtime.servers.runtime_server import RuntimeServer, random_of_frame
from tests.kit.clock import deployed
from tests.kit.node_stage import NodeStage


def chance(server: RuntimeServer, k: int) -> object:
    (sent,) = server.handle(Tick(k=k, t_ns=k), k)
    return sent.message.fields["random"].value


def test_the_seed_comes_with_the_deployment() -> None:
    server = RuntimeServer(frames_kept=10)
    assert chance(server, 0) == random_of_frame(0, 0)
    stage = NodeStage(server)
    stage.connect("leader/1").do(deploy(msgspec.structs.replace(deployed("a"), seed=7)))
    assert chance(server, 1) == random_of_frame(7, 1)


def test_the_clock_tells_it_before_the_first_frame() -> None:
    server = RuntimeServer(frames_kept=10)
    clock = NodeStage(Clock(servers=("Runtime",), frames_kept=10, on_deploy=server.on_deploy))
    clock.connect("leader/1").do(deploy(msgspec.structs.replace(deployed("a"), seed=9)))
    assert chance(server, 5) == random_of_frame(9, 5)
