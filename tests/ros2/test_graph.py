"""What the graph shows, and what is wrong with it."""

from __future__ import annotations

from typing import Any

import pytest

from colony.ros2.graph import heard_problems, sent_problems

NOTHING = "nothing arrives"
RELIABLE, BEST = ["mux", "/", "T", True, False], ["scanner", "/lab", "T", False, False]
LATCHED, OTHER = ["keeper", "/", "T", True, True], ["other", "/", "U", True, False]


@pytest.mark.parametrize(
    ("publishers", "quality", "expected"),
    [
        ([RELIABLE], "best_effort", []),
        ([BEST], "best_effort", []),
        ([LATCHED], "latched", []),
        ([], "best_effort", ["no node publishes /a"]),
        ([OTHER], "best_effort", ["`/other` publishes /a as U; expected T"]),
        (
            [BEST],
            "reliable",
            [f'`/lab/scanner` publishes /a as best effort, and `qos` is "reliable": {NOTHING}'],
        ),
        (
            [RELIABLE],
            "latched",
            [f'`/mux` does not keep its messages of /a, and `qos` is "latched": {NOTHING}'],
        ),
    ],
)
def test_what_keeps_messages_from_arriving_is_named(
    publishers: list[Any], quality: str, expected: list[str]
) -> None:
    found = {"name": "/a", "publishers": publishers, "error": ""}
    assert list(heard_problems(found, "T", quality)) == expected


def test_an_error_of_the_subscription_is_named() -> None:
    assert list(heard_problems({"name": "/a", "publishers": [], "error": "E"}, "T", "reliable")) == ["/a: E"]


@pytest.mark.parametrize(
    ("publishers", "subscribers", "quality", "expected"),
    [
        ([], [RELIABLE, BEST], "reliable", []),
        ([], [], "reliable", ["no node subscribes to /a"]),
        ([OTHER], [RELIABLE], "reliable", ["`/other` publishes /a as well (U)"]),
        ([], [OTHER], "reliable", ["`/other` subscribes to /a as U, and T is sent"]),
        (
            [],
            [RELIABLE],
            "best_effort",
            [f'`/mux` subscribes to /a as reliable, and `qos` is "best_effort": {NOTHING}'],
        ),
        (
            [],
            [LATCHED],
            "reliable",
            [f'`/keeper` expects /a as latched, and `qos` is "reliable": {NOTHING}'],
        ),
    ],
)
def test_what_keeps_commands_from_arriving_alone_is_named(
    publishers: list[Any], subscribers: list[Any], quality: str, expected: list[str]
) -> None:
    found = {"name": "/a", "type": "T", "publishers": publishers, "subscribers": subscribers, "error": ""}
    assert list(sent_problems(found, quality)) == expected


def test_an_error_of_the_publisher_is_all_that_is_named() -> None:
    found = {"name": "/a", "type": "", "publishers": [OTHER], "subscribers": [], "error": "E"}
    assert list(sent_problems(found, "reliable")) == ["E"]
