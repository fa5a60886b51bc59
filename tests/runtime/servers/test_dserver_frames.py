"""What DServer's frames show: the variables that the program reads, and those that connections ask for."""

from __future__ import annotations

import math

import pytest

from colony.runtime.library import data
from colony.runtime.library.clock import deploy
from colony.runtime.servers.frame_content import (
    MAX_LIST_LENGTH,
    MAX_NAMES_PER_CONNECTION,
    MAX_NAMES_REQUESTED,
)
from tests.kit.data import DataStage, program
from tests.kit.node_stage import Caller, S


def test_a_program_reads_what_it_is_bound_to_in_the_frames_of_its_run(stage: DataStage, ada: Caller) -> None:
    ada.do(data.set_many({"X": 1, "Y": 2, "Z": 3}))
    ada.do(deploy(program("first", reads=("X", "Later"))))
    assert stage.fields(1) == {}
    assert stage.fields(2, "first") == {"X": 1.0}
    ada.do(data.set("Later", True))
    assert stage.fields(3, "first") == {"X": 1.0, "Later": True}
    ada.do(deploy(program("second", reads=("Y",))))
    assert stage.fields(4, "second") == {"Y": 2.0}
    assert stage.fields(5) == {}


@pytest.mark.parametrize("value", ["200", [], {"a": 1}, [1, "a"], [[1]]])
def test_a_value_that_frames_cannot_show_is_a_fault_where_the_program_reads_it(
    stage: DataStage, ada: Caller, value: object
) -> None:
    ada.do(deploy(program("run", reads=("X",))))
    ada.do(data.set_many({"X": value, "Y": value}))
    ada.do(data.publish(["X", "Y"]))
    fields = stage.fields(1, "run")
    assert fields.keys() == {"X"}
    assert math.isnan(fields["X"])
    stage.kill_and_restart()
    assert math.isnan(stage.fields(2, "run")["X"])
    ada.open()
    for k, shown in ((3, None), (4, 3.0)):
        ada.do(data.set("X", shown))
        assert stage.fields(k, "run") == ({} if shown is None else {"X": shown})


def test_what_the_program_reads_survives_a_death(stage: DataStage, ada: Caller) -> None:
    ada.do(data.set("X", 1))
    ada.do(deploy(program("run", reads=("X",))))
    stage.kill_and_restart()
    assert stage.fields(1, "run") == {"X": 1.0}


def test_a_program_that_is_there_from_the_beginning_reads_too() -> None:
    stage = DataStage(deployment=program("run", reads=("X",)))
    stage.connect().do(data.set_many({"X": 1, "Y": 2}))
    assert stage.fields(1, "run") == {"X": 1.0}


def test_a_deleted_variable_is_missing_from_the_next_frame_on(stage: DataStage, ada: Caller) -> None:
    ada.do(data.set_history("X", 3))
    ada.do(data.set_many({"X": 1}))
    ada.do(deploy(program("run", reads=("X",))))
    ada.do(data.watch("X"))
    assert stage.fields(1, "run") == {"X": 1.0}
    effects = ada.begin(data.delete("X"))
    assert ada.changes(effects) == [("X", ...)]
    assert stage.fields(2, "run") == {}
    for _ in range(2):
        assert ada.refusal(data.history("X")) == "unknown"
        assert ada.do(data.names()) == ()
        stage.kill_and_restart()
        ada.open()
    ada.do(data.set("X", 2))
    assert stage.fields(3, "run") == {"X": 2.0}
    assert ada.refusal(data.get("X", -1)) == "range", "its history is gone, too"


def test_publish_lasts_as_long_as_the_connection(stage: DataStage, ada: Caller) -> None:
    bob = stage.connect("bob/1")
    ada.do(data.set_many({"X": 1, "Y": 2, "Z": 3}))
    ada.do(data.set_history("Never", 3))
    ada.do(data.publish(["X", "X", "Never"]))
    ada.do(data.publish(["Y"]))
    bob.do(data.publish(["Y", "Z"]))
    assert stage.fields(1) == {"X": 1.0, "Y": 2.0, "Z": 3.0}
    ada.close()
    assert stage.fields(2) == {"Y": 2.0, "Z": 3.0}
    stage.pass_time(S)
    assert stage.fields(3) == {}


def test_what_a_program_and_a_connection_ask_for_stays_while_one_of_them_does(
    stage: DataStage, ada: Caller
) -> None:
    bob = stage.connect("bob/1")
    ada.do(data.set("X", 1))
    ada.do(deploy(program("run", reads=("X",))))
    bob.do(data.publish(["X"]))
    assert stage.fields(1, "run") == stage.fields(2) == {"X": 1.0}
    bob.close()
    assert stage.fields(3, "run") == {"X": 1.0}


def test_publishing_has_an_end(stage: DataStage, ada: Caller) -> None:
    ada.do(data.publish([f"V{i}" for i in range(MAX_NAMES_PER_CONNECTION)]))
    ada.do(data.publish(["V1"]))
    assert ada.refusal(data.publish(["one more"])) == "full"
    assert ada.refusal(data.publish(["x"] * (MAX_NAMES_PER_CONNECTION + 1))) == "size"
    assert ada.refusal(data.publish([""])) == "arguments"
    others = [stage.connect(f"bob/{i}") for i in range(MAX_NAMES_REQUESTED // MAX_NAMES_PER_CONNECTION)]
    for number, other in enumerate(others[:-1]):
        other.do(data.publish([f"W{number}.{i}" for i in range(MAX_NAMES_PER_CONNECTION)]))
    assert others[-1].refusal(data.publish(["one more"])) == "full"
    assert "names requested in frames: 10000 of 10000 are used, and there was no room for more" in (
        stage.node.limit_messages()
    )
    ada.close()
    others[-1].do(data.publish(["one more"]))
    assert (
        others[-1].refusal(
            deploy(program("run", reads=tuple(f"R{i}" for i in range(MAX_NAMES_REQUESTED + 1))))
        )
        == "arguments"
    )


def test_what_no_program_reads_has_room_of_its_own_and_refuses_no_set(stage: DataStage, ada: Caller) -> None:
    quarter = [0.5] * (MAX_LIST_LENGTH // 4 - 10)
    ada.do(data.set_many({"A": quarter, "B": quarter, "C": quarter}))
    ada.do(data.publish(["A", "B"]))
    assert ada.refusal(data.publish(["C"])) == "full"
    assert set(stage.fields(1)) == {"A", "B"}
    ada.do(data.set("A", [0.5] * MAX_LIST_LENGTH))
    assert set(stage.fields(2)) == {"B"}, "it is left out"
    ada.do(data.publish(["C"]))
    assert set(stage.fields(3)) == {"B", "C"}
    ada.do(deploy(program("run", reads=("P", "B"))))
    ada.do(data.set("P", [0.5] * (3 * MAX_LIST_LENGTH // 4 - 20)))
    assert set(stage.fields(4, "run")) == {"B", "C", "P"}, "nobody takes the program's room"
    assert ada.refusal(data.set("P", [0.5] * MAX_LIST_LENGTH)) == "full"
    assert set(stage.fields(5)) == {"B", "C"}, "of another run"
    said = {sentence.partition(":")[0] for sentence in stage.node.limit_messages()}
    assert said == {"numbers in frames", "numbers in frames that no program reads"}


def test_what_the_program_reads_without_room_is_missing(stage: DataStage, ada: Caller) -> None:
    ada.do(data.set_many({"Long": [0.5] * (MAX_LIST_LENGTH - 20), "Second": [0.5] * 100, "Short": 1}))
    ada.do(deploy(program("run", reads=("Long", "Second", "Short"))))
    assert set(stage.fields(1, "run")) == {"Long", "Short"}
    assert ada.refusal(data.set("Second", [0.5] * 99)) == "full"
    ada.do(data.set("Long", 1))
    ada.do(data.set("Second", [0.5] * 99))
    assert set(stage.fields(2, "run")) == {"Long", "Second", "Short"}


def test_a_full_server_still_answers(stage: DataStage, ada: Caller) -> None:
    for i in range(67):
        ada.do(data.set(f"Big{i:02}", b"a" * 1_000_000))
    assert ada.refusal(data.set("Big", b"a" * 1_000_000)) == "full"
    kept = ada.do(data.names())
    assert len(ada.do(data.get(kept[0], type=bytes))) == 1_000_000
    assert any(
        said.startswith("values of variables: 63.9 MiB of 64.0 MiB") for said in stage.node.limit_messages()
    )
    assert ada.do(data.delete(kept[0]))
    ada.do(data.set("Big", b"a" * 1_000_000))
