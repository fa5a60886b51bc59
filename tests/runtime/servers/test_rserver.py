"""RServer: fields of the base, one command a frame, runs, a watchdog and a reflex."""

from __future__ import annotations

import msgspec
import pytest

from colony.ir.program import Role
from colony.ir.servers import RSERVER
from colony.runtime.library import actuator, emergency, robot
from colony.runtime.protocol import topics
from colony.runtime.protocol.deployment import LIMITS_RUN, Deployment
from colony.runtime.protocol.messages import Request, Tick
from colony.runtime.servers.commanding import NotSentError
from tests.kit.base import RollingBase, Stage, bid, deployed, silent, stage_in_run
from tests.kit.node_stage import FRAME_NS, MS


class RefusingBase(RollingBase):
    """A base whose driver fails at each command."""

    def drive(self, velocity: float, turn: float) -> None:
        super().drive(velocity, turn)
        raise NotSentError("no power")


class SharedBase(RollingBase):
    """A base that others drive, too; `rests` counts the frames in which it is left to them."""

    rests = 0

    def rest(self) -> None:
        self.rests += 1


@pytest.fixture
def stage() -> Stage:
    return stage_in_run()


def test_it_has_exactly_the_documented_fields() -> None:
    stage = Stage()
    stage.tick()
    assert set(stage.frames[-1].fields) == {f.name for f in RSERVER.fields}


def test_a_base_that_gave_nothing_yet_has_no_values() -> None:
    stage = Stage()
    stage.base.mute = True
    stage.tick()
    assert set(stage.frames[-1].fields) == {"speed_setting", "turn_setting"}
    stage.open("ann/1")
    assert stage.problem("ann/1", robot.position()).code == "no value"


def test_the_settings_are_the_command_sent_last(stage: Stage) -> None:
    stage.frame(bid("cruise", 300.0, -10.0), *silent("cruise"))
    assert stage.base.told == [(0, 300.0, -10.0)]
    stage.tick()
    fields = stage.frames[-1].fields
    assert [fields[n].value for n in ("speed_setting", "turn_setting")] == [300.0, -10.0]  # type: ignore[union-attr]


def test_a_frame_has_what_was_given_in_the_frame_before() -> None:
    stage = Stage(run="r1", deployment=deployed(reported=(0, 1)))

    def given() -> list[object]:
        fields = stage.frames[-1].fields
        found = [fields.get(f"last.drive.{name}") for name in ("velocity", "turn")]
        return [None if sample is None else sample.value for sample in found]  # type: ignore[misc]

    stage.tick()
    assert given() == [0.0, 0.0]  # it was stopped when the server started
    stage.frame(bid("cruise", 300.0, -10.0), *silent("cruise"))
    stage.tick()  # nobody bids: the frame is idle at its end
    assert given() == [300.0, -10.0]
    stage.tick()
    assert given() == [0.0, 0.0]
    stage.frame(bid("cruise", 300.0, -10.0), *silent("cruise"))
    stage.open("ann/1")
    stage.do("ann/1", emergency.stop())
    stage.tick()
    assert given() == [0.0, 0.0]


def test_a_frame_whose_tick_comes_late_does_not_have_what_was_given_after_it() -> None:
    stage = Stage(run="r1", deployment=deployed(reported=(0, 1)))
    stage.tick()
    stage.handle(Tick(k=2, t_ns=2 * FRAME_NS, run="r1"))
    for request in (*silent("cruise"), bid("cruise", 300.0, -10.0)):
        stage.handle(msgspec.structs.replace(request, k=2))
    assert stage.base.told[-1][1:] == (300.0, -10.0)
    stage.handle(Tick(k=1, t_ns=FRAME_NS, run="r1"))
    assert stage.frames[-1].k == 1
    assert not [name for name in stage.frames[-1].fields if name.startswith("last.")]
    stage.handle(Tick(k=3, t_ns=3 * FRAME_NS, run="r1"))
    assert stage.frames[-1].fields["last.drive.velocity"].value == 300.0  # type: ignore[union-attr]


ROLES = tuple(Role(kind=kind, module="cruise") for kind in ("by", "active"))


def roles(stage: Stage) -> tuple[object, ...]:
    """Whether `cruise` won and was active, None where it is not known, as the newest frame has it."""
    fields = stage.frames[-1].fields
    samples = [fields.get(name) for name in ("last.drive by cruise", "last.cruise is active")]
    return tuple(None if sample is None else sample.value for sample in samples)


@pytest.mark.parametrize(
    ("requests", "lost", "expected"),
    [
        ((bid("cruise", 300.0, 0.0),), (), (True, True)),
        ((msgspec.structs.replace(bid("cruise", 0.0, 0.0), values=None, fault="missing"),), (), (True, True)),
        ((bid("cruise", bid="suppressed"), bid("avoid", 0.0, 9.0)), (), (False, True)),
        ((bid("cruise", bid="inhibited"),), (), (False, True)),
        ((bid("cruise", 300.0, 0.0), bid("avoid", 0.0, 9.0)), (), (False, True)),  # overruled
        ((bid("cruise", bid="inactive"),), (), (False, False)),
        ((bid("cruise", bid="silent"),), (), (False, False)),
        ((bid("cruise", 900.0, 0.0),), (), (False, False)),  # refused
        ((), (), (False, False)),  # late
        ((bid("cruise", 300.0, 0.0),), (topics.client_address("drive", "cruise"),), (False, False)),
    ],
)
def test_a_frame_has_what_a_module_did_in_the_frame_before(
    requests: tuple[Request, ...], lost: tuple[str, ...], expected: tuple[bool, bool]
) -> None:
    stage = Stage(run="r1", deployment=deployed(reported=ROLES))
    stage.tick()
    assert roles(stage) == (None, None)
    verdict = stage.frame(*requests, *silent("cruise", *(r.client for r in requests)), lost=lost)
    stage.tick()
    assert roles(stage) == expected, verdict and verdict.fates


def test_a_module_does_not_get_through_where_a_connection_a_lock_or_a_stop_commands_instead() -> None:
    stage = Stage(run="r1", deployment=deployed(reported=ROLES))
    wanted = (bid("cruise", 300.0, 0.0), *silent("cruise"))
    stage.open("ann/1", priority=50)
    for ask, end in (
        (robot.drive(100.0, 0.0, 10.0), robot.drive(0.0, 0.0, 0.001)),
        (actuator.lock(), actuator.unlock()),
        (emergency.stop(), None),
    ):
        stage.frame(*wanted)
        stage.do("ann/1", ask)
        stage.frame(*wanted)
        assert roles(stage) == (True, True), "of the frame before"
        stage.tick()
        assert roles(stage) == (False, True), ask
        if end is not None:
            stage.do("ann/1", end)


def test_what_a_module_did_is_known_of_the_frame_before_alone() -> None:
    stage = Stage(run="r1", deployment=deployed(reported=ROLES))
    wanted = (bid("cruise", 300.0, 0.0), *silent("cruise"))
    stage.frame(*wanted)
    stage.k += 1
    stage.tick()  # the server did not hear the tick before
    assert roles(stage) == (None, None)
    stage.frame(*wanted)
    before = stage.k
    stage.handle(Tick(k=before + 5, t_ns=(before + 5) * FRAME_NS, run="r1", gaps=((before, before + 5),)))
    assert roles(stage) == (True, True), "the Clock left out the numbers between"
    stage.k = before + 5
    stage.frame(*wanted)
    stage.tick(run="another")
    stage.tick()
    assert roles(stage) == (None, None)


@pytest.mark.parametrize("reason", ["no power", "late tick"])
def test_a_module_does_not_get_through_where_nothing_of_its_command_is_carried_out(reason: str) -> None:
    base = RefusingBase() if reason == "no power" else RollingBase()
    stage = Stage(base, run="r1", deployment=deployed(reported=ROLES))
    stage.tick()
    if reason == "late tick":
        stage.base.roll(stage.now_ns + 10 * FRAME_NS)
        stage.now_ns += 10 * FRAME_NS
    requests = (bid("cruise", 300.0, 0.0), *silent("cruise"))
    stage.handle(*(msgspec.structs.replace(request, k=stage.k) for request in requests))
    stage.handle(Tick(k=1, t_ns=FRAME_NS, run="r1"))
    assert roles(stage) == (False, True)


def test_a_module_gets_through_where_a_bumper_blocks_the_velocity() -> None:
    stage = Stage(run="r1", deployment=deployed(reported=ROLES))
    stage.base.front = True
    stage.frame(bid("cruise", 300.0, 20.0), *silent("cruise"))
    stage.tick()
    assert roles(stage) == (True, True)


@pytest.mark.parametrize(("field_indices", "sent"), [((1, 0), (7.0, 5.0)), ((None, 1), (0.0, 7.0))])
def test_parameters_are_passed_by_name_and_what_is_not_declared_is_0(
    field_indices: tuple[int | None, ...], sent: tuple[float, float]
) -> None:
    stage = Stage(run="r1", deployment=deployed(field_indices=field_indices))
    stage.frame(bid("cruise", 5.0, 7.0), *silent("cruise"))
    assert stage.base.told == [(0, *sent)]


def test_in_lockstep_a_frame_is_waited_for_from_when_its_tick_came() -> None:
    stage = Stage(run="r1", deployment=msgspec.structs.replace(deployed(), lockstep=True))
    came_ns = 1000 * FRAME_NS  # far later than the time that the tick tells
    stage.until(came_ns)
    stage.handle(Tick(k=0, t_ns=0, run="r1"))
    stage.handle(bid("back_off", bid="silent"))
    stage.until(came_ns + FRAME_NS // 2)
    assert stage.base.told == []
    stage.until(came_ns + FRAME_NS)
    assert stage.base.told == [(came_ns + FRAME_NS * 4 // 5, 0.0, 0.0)]


def test_it_stops_the_base_when_it_starts_and_when_it_ends() -> None:
    stage = Stage()
    assert stage.base.stops == [0]
    stage.node.close()
    assert stage.base.stops == [0, 0]


def test_a_base_without_ticks_is_stopped_within_two_frames(stage: Stage) -> None:
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"), count=3)
    assert stage.base.velocity == 300.0
    stage.pass_time(10 * FRAME_NS)
    assert stage.base.velocity == 0.0
    assert stage.base.stops == [0, 2 * FRAME_NS + 2 * FRAME_NS]
    stage.pass_time(100 * FRAME_NS)
    assert len(stage.base.stops) == 2


def test_an_idle_command_that_holds_lets_the_base_go_on_for_two_frames() -> None:
    stage = Stage(run="r1", deployment=deployed(idle=None))
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    stage.frame(*silent(), count=10)
    assert stage.base.told == [(0, 300.0, 0.0)]
    assert stage.base.stops == [0, 2 * FRAME_NS]


def test_a_tick_that_comes_twice_or_late_changes_nothing(stage: Stage) -> None:
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"), count=2)
    verdicts, told = len(stage.verdicts), len(stage.base.told)
    stage.handle(Tick(k=0, t_ns=0, run="r1"))
    stage.handle(Tick(k=1, t_ns=FRAME_NS, run="other"))
    assert (len(stage.verdicts), len(stage.base.told), stage.base.velocity) == (verdicts, told, 300.0)


def test_in_frames_of_another_run_the_base_stands_and_nobody_is_told_anything(stage: Stage) -> None:
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    stage.run = "r2"
    assert stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"), count=3) is None
    assert stage.base.velocity == 0.0
    assert len(stage.base.stops) == 1 + 3
    stage.run = "r1"
    verdict = stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    assert (verdict.k, verdict.by) == (4, "cruise")


def test_without_a_program_the_built_in_actuator_has_a_verdict_every_frame() -> None:
    stage = Stage()
    stage.frame(count=3)
    assert [(v.k, v.actuator, v.by, v.values) for v in stage.verdicts] == [
        (k, "drive", None, (0.0, 0.0)) for k in range(3)
    ]


def test_a_pressed_bumper_lets_nothing_go_into_it_whoever_commands(stage: Stage) -> None:
    stage.base.front = True
    stage.frame(bid("cruise", 300.0, 20.0), *silent("cruise"))
    assert stage.base.told[-1] == (0, 0.0, 20.0)
    assert stage.verdicts[-1].values == (300.0, 20.0)
    assert "300 mm/s was not sent, as the front bumper is pressed" in stage.verdicts[-1].notes[0]
    stage.frame(bid("back_off", -100.0, 0.0), *silent("back_off"))
    assert stage.base.told[-1][1:] == (-100.0, 0.0)
    stage.base.front, stage.base.rear = False, True
    stage.frame(bid("back_off", -100.0, 0.0), *silent("back_off"))
    assert stage.base.told[-1][1:] == (0.0, 0.0)


def test_what_a_bumper_blocks_was_not_given() -> None:
    """So a ramp begins anew when the bumper is released."""
    stage = Stage(run="r1", deployment=deployed(reported=(0, 1)))
    stage.base.front = True
    stage.frame(bid("cruise", 300.0, 20.0), *silent("cruise"))
    stage.tick()
    fields = stage.frames[-1].fields
    assert [fields[f"last.drive.{n}"].value for n in ("velocity", "turn")] == [0.0, 20.0]  # type: ignore[union-attr]


def test_a_command_that_the_driver_refuses_stops_the_base_and_was_not_given() -> None:
    stage = Stage(RefusingBase(), run="r1", deployment=deployed(reported=(0,)))
    stage.frame(bid("cruise", 300.0, 20.0), *silent("cruise"))
    assert stage.base.velocity == 0.0
    assert (stage.base.told[-1][0], stage.base.stops[-1]) == (0, 0)  # at once, not by its watchdog
    assert stage.verdicts[-1].notes == ("frame 0: no power",)
    stage.tick()
    fields = stage.frames[-1].fields
    assert [fields[n].value for n in ("last.drive.velocity", "speed_setting")] == [0.0, 0.0]  # type: ignore[union-attr]


def test_bumpers_can_be_ignored(stage: Stage) -> None:
    stage.open("ann/1")
    stage.base.front = True
    stage.do("ann/1", robot.set_bumper(0))
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    assert stage.base.velocity == 300.0
    stage.do("ann/1", robot.set_bumper(1))
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    assert stage.base.velocity == 0.0


# --- deploying -------------------------------------------------------------------------------------


def test_a_run_begins_with_deploy_and_ends_with_its_leader() -> None:
    stage = Stage()
    stage.open("lead/1")
    stage.do("lead/1", robot.deploy(deployed("r1")))
    stage.run = "r1"
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    assert stage.verdicts[-1].by == "cruise"
    stage.die("lead/1")
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"), count=20)
    assert stage.base.velocity == 0.0
    stage.run = ""
    stage.frame()
    assert stage.verdicts[-1].fates == ()


def test_a_frame_that_is_open_when_a_run_begins_ends_as_it_stands() -> None:
    stage = Stage(run="r1", deployment=deployed("r1"))
    stage.open("lead/1")
    stage.tick()
    stage.handle(bid("cruise", 300.0, 0.0))
    stage.do("lead/1", robot.deploy(deployed("r2")))
    assert (stage.verdicts[-1].k, stage.verdicts[-1].by) == (0, "cruise")
    assert stage.base.velocity == 300.0
    stage.run = "r2"
    stage.frame(*silent())
    assert stage.base.velocity == 0.0


BAD = [
    ({"run": ""}, "a run without a name"),
    ({"clients": (("a", 1), ("b", 1))}, "two clients have the priority 1"),
    ({"clients": (("a", 2), ("a", 1))}, "two clients have the name a"),
]


@pytest.mark.parametrize(("changes", "text"), BAD)
def test_what_cannot_be_deployed_is_refused_and_changes_nothing(
    stage: Stage, changes: dict[str, object], text: str
) -> None:
    stage.open("lead/1")
    wrong = deployed(**({"run": "r2"} | changes))  # type: ignore[arg-type]
    problem = stage.problem("lead/1", robot.deploy(wrong))
    assert text in problem.message
    found = stage.do("lead/1", robot.arbitration())
    assert (found.run, found.leader) == ("r1", None)
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    assert stage.base.velocity == 300.0


# --- what it knows ---------------------------------------------------------------------------------


def test_arbitration_tells_how_every_client_did(stage: Stage) -> None:
    stage.open("ann/1")
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"), count=3)
    stage.frame(*silent("cruise"))
    stage.frame(*silent("cruise"), lost=("drive/cruise",))
    stage.frame(bid("cruise", 9e9, 0.0), *silent("cruise"))
    found = stage.do("ann/1", robot.arbitration())
    (actuator,) = found.actuators
    assert (actuator.name, actuator.frames) == ("drive", 6)
    by_name = {c.name: (c.priority, c.on_time, c.late, c.lost, c.refused) for c in actuator.clients}
    assert by_name == {
        "back_off": (3, 6, 0, 0, 0),
        "avoid": (2, 6, 0, 0, 0),
        "cruise": (1, 3, 1, 1, 1),
    }
    assert actuator.last_note == "`cruise` gave velocity = 9000000000.0"
    assert (found.acting, found.outside, found.stopped, found.lock_holder) == (None, (), None, None)


def test_the_watchdog_can_be_given_more_time() -> None:
    stage = stage_in_run(watchdog_ns=250 * MS)
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    stage.until(300 * MS)
    assert stage.base.stops == [0, 250 * MS]


def test_a_server_that_stood_still_moves_nothing_by_what_waited_for_it() -> None:
    """Frozen, it has not heard what was said since: a stop, perhaps, that comes behind these ticks."""
    stage = Stage(run="r1", deployment=deployed())
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    assert stage.base.velocity == 300.0
    stage.until(2_000_000_000)
    told = len(stage.base.told)
    for k in range(stage.k + 1, stage.k + 30):
        stage.handle(Tick(k=k, t_ns=k * FRAME_NS, run="r1"))
        for request in (bid("cruise", 300.0, 0.0), *silent("cruise")):
            stage.handle(msgspec.structs.replace(request, k=k))
    assert len(stage.base.told) == told
    assert stage.base.velocity == 0.0
    notes = [note for verdict in stage.verdicts for note in verdict.notes]
    assert any("no command was sent, as the tick came too late" in note for note in notes)
    stage.k = 40
    stage.frame(bid("cruise", 300.0, 0.0), *silent("cruise"))
    assert stage.base.velocity == 300.0


def test_a_stop_that_does_not_reach_the_base_is_refused_after_150_ms_and_holds() -> None:
    stage = Stage()
    stage.base.unreached = "the guard of /dev/ttyUSB0 has not sent it"
    stage.tick()
    number = stage.send("eve/1", emergency.stop())
    stage.pass_time(149 * MS)
    assert ("eve/1", number) not in stage.replies
    stage.pass_time(1 * MS)
    problem = stage.replies["eve/1", number].problem
    assert (problem.code, "/dev/ttyUSB0" in problem.message) == ("not reached", True)
    assert stage.base.stops
    stage.tick()
    assert stage.frames[-1].stopped is not None
    stage.base.unreached = None
    stage.do("eve/1", emergency.stop())


@pytest.mark.parametrize(("run", "limits"), [("", None), (LIMITS_RUN, deployed(run=LIMITS_RUN, clients=()))])
def test_a_shared_base_is_left_to_others_until_a_connection_drives_it(
    run: str, limits: Deployment | None
) -> None:
    base = SharedBase()
    stage = Stage(base, run=run, deployment=limits)
    stage.frame(count=3)
    assert (base.rests, base.told) == (3, [])
    stage.open("joystick")
    stage.do("joystick", robot.drive(0.0, 0.0, lease=0.05))
    stage.frame()
    assert (base.rests, [told[1:] for told in base.told]) == (3, [(0.0, 0.0)])
    stage.frame(count=3)
    assert base.rests == 6


def test_a_program_that_is_idle_keeps_a_shared_base() -> None:
    base = SharedBase()
    stage = stage_in_run(base=base)
    stage.frame(*silent(), count=3)
    assert (base.rests, len(base.told)) == (0, 3)


def test_a_shared_base_is_left_to_others_in_frames_of_another_run() -> None:
    base = SharedBase()
    stage = Stage(base, run="r2", deployment=deployed())
    stage.frame(count=3)
    assert (base.rests, base.told, len(base.stops)) == (3, [], 1)  # at the start
