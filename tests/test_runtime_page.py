"""docs/runtime.md: every command and program is run, on real processes, and its tables and numbers are the
code's."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Iterator

import msgspec
import pytest

from colony.runtime.arbitration.arbiter import timing
from colony.runtime.clients import client
from colony.runtime.frames import assembler, clock, publishing, registry
from colony.runtime.kit import connection, conversation
from colony.runtime.kit.connection import Session
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.library import leader, robot
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol import calls, codec, deployment
from colony.runtime.protocol.messages import MAX_BATCH_LENGTH, Batch, Request, ServerFrame
from colony.runtime.servers import (
    actuating,
    base,
    data_calls,
    data_methods,
    dserver,
    frame_content,
    rserver,
    semaphores,
    variables,
)
from colony.runtime.store import store
from colony.runtime.transport.live import inbox, limits, network, run_directory
from colony.runtime.transport.live.robot_address import local
from tests.cli.machine import contracts_held
from tests.examples.stage import ROOT, Machine, machine
from tests.runtime.transport.live.certificates import Authority, free_port
from tests.runtime_page_tables import PAGE, commands, page
from tests.waiting import until

TEXT = PAGE.read_text(encoding="utf-8")
FENCES = re.findall(r"^```([^\n]*)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
SHELL = {info.split()[1]: text.splitlines() for info, text in FENCES if info.startswith("sh ")}
FILES = {info.split()[1]: text for info, text in FENCES if not info.startswith("sh ")}
README = re.findall(r"^```python\n(.*?)^```$", (ROOT / "README.md").read_text(encoding="utf-8"), re.M | re.S)


# --- what needs no process -------------------------------------------------------------------------


def test_there_is_no_block_that_is_not_run() -> None:
    assert {info.split()[0] for info, _ in FENCES} == {"sh", "python", "colony"}
    assert set(SHELL) == {
        "processes", "servers", "programs", "gateway", "remote", "own", "lift", "turtle", "faults",
        "fleet", "data", "limits",
    }  # fmt: skip
    assert set(FILES) == {
        "client.py", "halves.py", "awaited.py", "shared.py", "drive.py",
        "battery.py", "charge.py", "tired.colony", "lift.py", "raise.colony", "by_hand.py",
        "turtle.py", "ride.py",
    }  # fmt: skip


def test_the_tables_are_those_of_the_code() -> None:
    assert page() == TEXT, "`python -m tests.runtime_page_tables` writes them anew"


def test_programs_are_as_long_as_is_said() -> None:
    for name, least, most in (("client.py", 5, 20), ("battery.py", 12, 20)):
        assert least <= len([line for line in FILES[name].splitlines() if line]) <= most


def test_the_fields_of_the_command() -> None:
    [said] = re.findall(r"An actuator commands `RServer.drive`, with the fields (.*?), or", TEXT, re.DOTALL)
    assert {n: u.split(",")[0] for n, u in re.findall(r"`(\w+)` \(([^)]*)\)", said)} == commands()


@pytest.mark.parametrize(
    ("said", "is_so"),
    [
        ("every 50 ms", clock.IDLE_FRAME_NS == 50_000_000),
        ("or after 5 s", clock.READY_TIMEOUT_NS == 5_000_000_000),
        ("after four fifths of the frame", timing(100).deadline_ns == 80),
        ("which servers can give for 2 s", assembler.FRAME_RETENTION_NS == 2_000_000_000),
        ("After 250 ms without a word it is lost", registry.lease(50_000_000) == 250_000_000),
        ("at most 500 ms old", client.CHECKPOINT_NS == 500_000_000),
        ("ends with its lease, 500 ms unless told", robot.LEASE_S == 0.5),
        ("750 ms after its last sign of life", calls.LEASE_NS == 750_000_000 > 3 * conversation.KEEPALIVE_NS),
        ("two frames after the last command", rserver.WATCHDOG_FRAMES == 2),
        ("no tick comes for three deadlines (2.4 frames)", actuating.WATCHDOG_DEADLINES == 3),
        ("has 2 s to come back to it", data_calls.RECONNECT_GRACE_NS == 2_000_000_000),
        ("no answer came in 5 s", connection.TIMEOUT_S == 5.0),
        ("A history has 1 value unless told", variables.MAX_HISTORY_LENGTH == 10_000),
        ("| a message | 4 MiB |", codec.MAX_MESSAGE_BYTES == 4 << 20),
        ("| a frame of a server | 256 KiB |", codec.max_bytes(ServerFrame) == 256 << 10),
        ("| a request of a client | 64 KiB |", codec.max_bytes(Request) == 64 << 10),
        (
            "in one message | 64 KiB, 1000 of them;",
            (codec.max_bytes(Batch), MAX_BATCH_LENGTH) == (64 << 10, 1000),
        ),
        ("| connections to a server | 1000 |", calls.MAX_CONNECTIONS == 1000),
        ("| connections to a server of one user | 500 |", calls.MAX_CONNECTIONS_PER_USER == 500),
        ("| answers that a server keeps | 8 MiB |", calls.MAX_ANSWER_BYTES == 8 << 20),
        ("| clients of a program | 2000 |", deployment.MAX_CLIENTS == 2000),
        (
            "| a position that is set at the base | 10 km from the origin, and a heading of 36000 deg |",
            (base.MAX_COORDINATE_MM, base.MAX_HEADING_DEG) == (1e7, 36_000.0),
        ),
        ("| calls of one connection that wait | 256 |", inbox.MAX_CALLS_PER_CONNECTION == 256),
        ("| the value of a variable, in msgpack | 1 MiB |", variables.MAX_VALUE_BYTES == 1 << 20),
        ("| values in a history | 10000 |", variables.MAX_HISTORY_LENGTH == 10_000),
        ("| all variables with their histories | 64 MiB |", variables.MAX_TOTAL_BYTES == 64 << 20),
        ("| variables | 20000 |", variables.MAX_VARIABLES == 20_000),
        (
            "| variables that one call sets, gets, watches or publishes | 1000 |",
            data_methods.MAX_NAMES_PER_CALL == 1000,
        ),
        ("| the values that one call sets | 1 MiB |", data_methods.MAX_SET_BYTES == (1 << 20) + 1024),
        ("| values of a history in one reply | 2000 |", data_methods.MAX_VALUES_PER_REPLY == 2000),
        (
            "| the values in one of DServer's frames that the program reads | 64 KiB |",
            frame_content.FRAME_SPACE == 64 << 10,
        ),
        (
            "| the other values in it, which connections published | 32 KiB |",
            frame_content.PUBLISHED_SPACE == 32 << 10,
        ),
        ("| prefixes of them | 50 |", data_calls.MAX_PREFIXES_PER_CONNECTION == 50),
        ("| variables that a connection publishes | 1000 |", frame_content.MAX_NAMES_PER_CONNECTION == 1000),
        ("| variables that all connections publish | 10000 |", frame_content.MAX_NAMES_REQUESTED == 10_000),
        ("| names in the arguments of one call | 256 KiB |", data_methods.MAX_NAMES_BYTES == 256 << 10),
        ("| names in one reply | 5000 |", data_methods.MAX_NAMES_PER_REPLY == 5000),
        (
            "| names and prefixes that a connection watches | 2000 |",
            data_calls.MAX_WATCHED_PER_CONNECTION == 2000,
        ),
        (
            "| names, and prefixes, that all connections watch; of one user half | 20000 and 1000 |",
            (data_calls.MAX_WATCHED_NAMES, data_calls.MAX_WATCHED_PREFIXES) == (20_000, 1000),
        ),
        ("| semaphores | 10000 |", semaphores.MAX_SEMAPHORES == 10_000),
        (
            "| holds of semaphores, and calls that wait for one | 2000 and 1000 |",
            (semaphores.MAX_HOLDS, semaphores.MAX_WAITING_CALLS) == (2000, 1000),
        ),
        (
            "| the arguments of a call that has no limit of its own | 64 KiB |",
            calls.MAX_ARGUMENT_BYTES == 64 << 10,
        ),
        ("| a deployment | 256 KiB |", deployment.MAX_DEPLOYMENT_BYTES == 256 << 10),
        ("| checkpoints of all clients | 16 MiB |", dserver.MAX_TOTAL_BYTES == 16 << 20),
        (
            "| frames that a server publishes again between two ticks | 64, or 1 MiB |",
            (publishing.MAX_REPUBLISHED_FRAMES, publishing.MAX_REPUBLISHED_BYTES) == (64, 1 << 20),
        ),
        ("| frames that a server keeps | 16 MiB |", publishing.KEPT_BYTES == 16 << 20),
        ("| the name of a robot, server or user | 64 characters |", run_directory.MAX_NAME_LENGTH == 64),
        ("DServer puts 2 MiB aside", store.RESERVE_BYTES == 2 << 20),
        ("Once a second it looks whether there is room", dserver.SPACE_CHECK_INTERVAL_NS == 1_000_000_000),
        ("needs room for 32 more open files", network.FREE_DESCRIPTORS == 32),
        ("16 KiB of a message count as one more", limits.BYTES_PER_TOKEN == 16 << 10),
        ("| calls and signs of life | 2000 | 1000 |", limits.CALL_RATE == (2000.0, 1000.0)),
        ("| the same under the right `stop` | 500 | 100 |", limits.STOP_RATE == (500.0, 100.0)),
        ("| frames that are asked for again | 500 | 500 |", limits.FETCH_RATE == (500.0, 500.0)),
        (
            "| messages from clients of a program | 20000 | 10000 |",
            limits.PROGRAM_RATE == (20_000.0, 10_000.0),
        ),
    ],
)
def test_numbers_are_those_of_the_code(said: str, is_so: bool) -> None:
    assert said in " ".join(TEXT.split())
    assert is_so


# --- what is run -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def rome(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Machine]:
    """A machine with the servers of the page, in a folder with its files."""
    folder = tmp_path_factory.mktemp("page")
    for name, text in {**FILES, "readme.py": README[1]}.items():
        (folder / name).write_text(text, encoding="utf-8")
    for name in ("behaviors", "maps", "examples"):
        (folder / name).symlink_to(ROOT / name)
    with machine(folder) as on:
        [serve] = SHELL["servers"]
        on.start(serve)
        on.there("rome", "Clock", "RServer", "PServer", "DServer")
        yield on


def session(on: Machine, robot: str = "rome") -> Session:
    """What this process has with the robot."""
    return Session.open(robot, environment=on.environment)


@pytest.fixture(scope="module")
def ada(rome: Machine) -> Machine:
    """The same machine, with a robot besides that has no description."""
    rome.start(SHELL["own"][0])
    rome.there("ada", "Clock", "RServer", "PServer", "DServer")
    return rome


def test_programs_come_and_go(rome: Machine) -> None:
    run, ps, stop, release = SHELL["programs"]
    assert rome.run(run).result() == 0
    listed = rome.run(ps)
    assert listed.result() == 0
    assert re.search(r"RServer +up", listed.printed())
    assert rome.run(stop).printed().startswith("rome: stopped")
    assert rome.run(release).printed().startswith("rome: released")


def test_people_set_and_delete_variables(rome: Machine) -> None:
    printed = []
    for command in SHELL["data"]:
        ran = rome.run(f"{command} --robot rome")
        assert ran.result() == 0
        printed.append(ran.printed())
    assert printed[0] == printed[3] == ""
    assert "GoalDirection" in printed[1].split()
    assert printed[2] == "270.0\n"


@pytest.mark.parametrize(
    ("program", "printed"),
    [
        ("client.py", r"now at 0 mm/s\nturned by \d+ degrees, heading \d+\n"),
        ("halves.py", r"at -?\d+, -?\d+; bumpers 0; \d+ mm ahead\n"),
        ("awaited.py", r"Greeting is hello\n"),
        ("shared.py", r"107 103\n0\n"),
        ("drive.py", r"locked\nTrue\n"),
        ("readme.py", r"Position\(x=.*, y=.*, heading=.*\)\n"),
    ],
)
def test_a_client_prints(rome: Machine, program: str, printed: str) -> None:
    ran = rome.run(f"python {program}")
    assert re.fullmatch(printed, ran.printed()), ran.printed()
    assert ran.result() == 0


@pytest.mark.long
def test_a_server_of_our_own(ada: Machine) -> None:
    _, serve, charge, run = SHELL["own"]
    battery = ada.start(serve)
    ada.there("ada", "Battery")
    with session(ada, "ada") as there:
        assert ada.run(charge).printed() == "95.0\n"
        running = ada.start(run)
        base = there.connect("RServer")
        until(lambda: base.do(robot.speed_setting()) == 150.0, "the robot drives")
        battery.kill()
        until(lambda: base.do(robot.speed_setting()) == 0.0, "it stands without the battery")
        battery = ada.start(serve)
        until(lambda: base.do(robot.speed_setting()) == 150.0, "it drives again")
    running.finish()
    assert battery.finish() == 0


@pytest.mark.long
def test_an_actuator_of_our_own(ada: Machine) -> None:
    serve, run, audit, by_hand = SHELL["lift"]
    lift = ada.start(serve)
    ada.there("ada", "Lift")
    ran = ada.run(run)
    assert ran.result() == 0, ran.printed()
    audited = ada.run(audit)
    assert audited.result() == 0, audited.printed()
    assert re.search(r"reach +1\.\d+ s", ran.printed()), ran.printed()
    commanded = ada.run(by_hand)
    assert re.fullmatch(r"move \S+/\S+\n", commanded.printed()), commanded.printed()
    assert commanded.result() == 0
    assert lift.finish() == 0


@pytest.mark.long
def test_the_example_with_more_around_it(ada: Machine) -> None:
    shown = (ROOT / "examples" / "battery.colony").read_text(encoding="utf-8")
    serve, run = re.findall(r"^#   (.*)$", shown, re.MULTILINE)

    class Charge(msgspec.Struct):
        rate: float

    def charge(rate: float) -> CallRequest[float]:
        return CallRequest("charge", Charge(rate), float, "command")

    server = ada.start(serve)
    ada.there("ada", "Battery")
    running = ada.start(run)
    with session(ada, "ada") as there:
        base, battery = there.connect("RServer"), there.connect("Battery")
        until(lambda: base.do(robot.speed_setting()) == 150.0, "the robot drives")
        with pytest.raises(CallRefusedError, match="would harm the battery"):
            battery.do(charge(5000.0))
        assert 70.0 < battery.do(charge(-3000.0)) <= 80.0
        until(lambda: battery.do(charge(-3000.0)) < 25.0, "the battery is low")
        until(lambda: base.do(robot.speed_setting()) == 0.0, "the robot rests")
        assert battery.do(charge(3000.0)) < 25.0
        until(lambda: base.do(robot.speed_setting()) == 150.0, "the robot drives again")
    running.finish()
    assert contracts_held(running.printed()), running.printed()
    assert server.finish() == 0


@pytest.mark.long
def test_a_driver_of_our_own(rome: Machine) -> None:
    serve, ride = SHELL["turtle"]
    turtle = rome.start(serve)
    rome.there("turtle", "RServer")
    assert re.fullmatch(r"(199|20\d) mm\n", (ran := rome.run(ride)).printed()), ran.printed()
    assert turtle.finish() == 0


@pytest.mark.long
def test_another_machine(rome: Machine) -> None:
    authority, port = Authority(rome.folder), free_port()
    authority.table({"ada": ("run",)})
    ada = authority.user("ada")
    (rome.folder / "login.toml").write_text(
        f'user = "ada"\ncertificate = "{ada.certificate}"\nkey = "{ada.key}"\nauthority = "{ada.authority}"\n'
    )

    def here(command: str) -> str:
        """The command, with this machine in the place of the page's."""
        return command.replace("rome.lab:7447", f"localhost:{port}").replace(
            "0.0.0.0:7447", f"127.0.0.1:{port}"
        )

    [serve] = SHELL["gateway"]
    gateway = rome.start(here(serve))
    gateway.says("listens")
    ps, run = SHELL["remote"]
    listed = rome.run(here(ps))
    assert re.search(r"RServer +up", listed.printed()), listed.printed()
    ran = rome.run(here(run))
    assert ran.result() == 0, ran.printed()
    assert contracts_held(ran.printed()), ran.printed()
    gateway.finish()


@pytest.mark.long
def test_whoever_is_killed_comes_back(rome: Machine) -> None:
    [command] = SHELL["faults"]
    run = rome.start(command)
    rome.there("rome", leader.LEADER)
    with session(rome) as there:
        leading = there.connect(leader.LEADER)

        def goes_on(since: int) -> bool:
            status = leading.do(leader.run_status())
            alive = all(c.standing == "alive" for c in status.clients)
            return alive and status.k > since and status.commanded_by["drive"] is not None

        until(lambda: goes_on(0), "it drives")
        for victim in ("RServer", "DServer", "Clock"):
            pid = _process(rome, victim)
            assert pid is not None
            os.kill(pid, signal.SIGKILL)
            until(lambda v=victim, p=pid: _process(rome, v) not in (None, p), f"{victim} is back")
            k = leading.do(leader.run_status()).k
            until(lambda k=k: goes_on(k), f"the run goes on with the new {victim}")
    run.finish()
    assert contracts_held(run.printed()), run.printed()


def _process(on: Machine, server: str) -> int | None:
    """Who serves this now."""
    return local("rome", on.environment).directory.running().get(server)


@pytest.mark.long
def test_a_data_server_of_a_fleet(rome: Machine) -> None:
    [command] = SHELL["fleet"]
    rome.start(command).says("listens")


@pytest.mark.long
def test_a_robot_that_is_served_with_its_description(rome: Machine) -> None:
    [command] = SHELL["limits"]
    rome.start(command)
    rome.there("lab", "Clock", "RServer")
    until(lambda: "the limits of rome hold" in rome.run("colony ps --robot lab").printed(), "the limits hold")


@pytest.mark.long
def test_everything_as_processes() -> None:
    [command] = SHELL["processes"]
    with machine() as on:
        run = on.run(command)
        assert run.ended == 0, run.printed()
        assert contracts_held(run.printed()), run.printed()
