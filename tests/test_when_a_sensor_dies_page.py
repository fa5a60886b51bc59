"""docs/when-a-sensor-dies.md: it shows parts of its example, all of whose tests, and what the commands print.

`python -m tests.test_when_a_sensor_dies_page` writes the output of the commands anew.
"""

from __future__ import annotations

import re

import pytest

from tests.pages import COMMANDS, typed
from tests.paths import ROOT

FILE = ROOT / "docs" / "when-a-sensor-dies.md"
PAGE = FILE.read_text(encoding="utf-8")
FENCES = re.findall(r"^```colony\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
EXAMPLES = [path.read_text(encoding="utf-8") for path in sorted((ROOT / "examples/sensor_loss").iterdir())]


def page(monkeypatch: pytest.MonkeyPatch) -> str:
    """The page with what the commands print; of what the page cuts off with `...`, the lines above."""
    monkeypatch.chdir(ROOT)

    def run(block: re.Match[str]) -> str:
        [printed] = [typed(line, monkeypatch, errors=True) for line in block[1].splitlines()]
        if block[2].endswith("\n...\n"):
            printed = "".join(printed.splitlines(keepends=True)[: block[2].count("\n") - 1]) + "...\n"
        return f"```sh\n{block[1]}```\n\n```text\n{printed}```"

    return COMMANDS.sub(run, PAGE)


def test_commands_print_what_the_page_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    assert page(monkeypatch) == PAGE, "`python -m tests.test_when_a_sensor_dies_page` writes it anew"


@pytest.mark.parametrize("fence", FENCES, ids=[fence.splitlines()[0][:40] for fence in FENCES])
def test_the_page_shows_parts_of_its_example(fence: str) -> None:
    assert any(fence in text for text in EXAMPLES)


def test_every_loss_is_on_the_page() -> None:
    tests = {
        test
        for text in EXAMPLES
        for test in re.findall(r'^(test ".*dies.*|test ".*dead.*|test ".*sticks.*)$', text, re.MULTILINE)
    }
    assert len(tests) == 11
    assert {test for test in tests if test not in PAGE} == set()


if __name__ == "__main__":
    with pytest.MonkeyPatch.context() as patch:
        text = page(patch)
    FILE.write_text(text, encoding="utf-8")
