"""Runs the blocks of the pages; `python -m tests.pages PAGE...` writes what its commands print again."""

from __future__ import annotations

import ast
import difflib
import doctest
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from colony.cli.main import main
from colony.dsl.load import check_file
from colony.text.diagnostics import headline
from colony.verify.testing.examples import failures_as_diagnostics, run_examples
from tests.paths import ROOT

PAGES = {
    f"{prefix}{path.name}": path
    for folder, prefix in ((".", ""), ("docs", ""), ("studies", "studies/"))
    for path in sorted((ROOT / folder).glob("*.md"))
}
TESTED_APART = {
    "errors.md": "tests/test_other_codes.py and tests/dsl/test_error_page.py: an example is several blocks",
    "runtime.md": "tests/test_runtime_page.py, on one machine with its servers",
    "security.md": "tests/runtime/transport/live/test_security_page.py, with the keys that it makes",
}
"""Pages whose blocks another test runs."""
NOT_RUN = {
    "^colony serve ": "a server; tests/cli/test_serve*.py",
    "^colony watch ": "a server; tests/cli/test_watch*.py",
    r"^python -m colony\.drivers\.\w+\.emulator ": "a server; tests/drivers",
    "^colony robot test ": "a minute of real time; tests/cli/test_robot_acceptance.py",
    " --connect": "needs a robot behind a gateway; tests/cli/test_serve.py",
    "^ *colony drive ": "needs a robot that is served; tests/cli/run and tests/cli/test_your_robot.py",
    "^ *colony shadow (?!.*--bag)": "needs a robot that is served; tests/cli/test_shadow.py",
    "^colony robot import ": "needs a robot of ROS 2; tests/ros2/test_imported.py",
    "^colony robot check rover": "needs a robot of ROS 2; tests/ros2/test_imported.py",
    "^(source /opt/|ros2 )": "needs ROS 2",
    "^colony data ": "needs a robot that is served; tests/cli/test_data.py",
    "^colony params (list$|set|reset|save)": "needs a robot that runs; tests/cli/test_params.py",
    "^colony teleop": "needs a robot that is served, and a hand; tests/cli/teleop",
    "^colony sim hold ": "needs a robot that is served; tests/cli/sim",
    r"connect\(.*, priority=50\)": "needs a robot that is served; tests/test_runtime_page.py",
    "^(touch|rm) go|^cat hitch": "are for a robot that is served; tests/cli/test_your_robot.py",
    " --from .* --to ": "minutes of simulation; tests/cli/run",
    r"^colony verify \w+$|^colony (verify|run) .*--params": "minutes of proofs; tests/verify/contracts",
    r"^ *colony experiment .*--runs \d\d": "minutes of simulation; tests/cli/experiment",
    r"^python -m studies ": "hours of simulation; tests/studies",
    r"^python -m tools\.": "hours, or another renderer",
    "^ros2 |^from launch ": "needs ROS 2; tests/ros2",
    "^make ": "the whole suite, or hours",
}
"""Patterns of the lines of shell, and of the programs, that are only parsed, each with the reason."""
SHORT = " --duration 0.2 --no-picture"
"""Ends a run whose output is not shown."""


class Block(NamedTuple):
    """A fenced block, or indented commands: page, line, the words after the backquotes, the text.

    `shown` is the block of output directly below commands.
    """

    page: str
    line: int
    info: str
    text: str
    shown: str | None = None

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"

    @property
    def file(self) -> str:
        """The name of the file that the block is; empty if it has none."""
        names = [word.removeprefix("file=") for word in self.info.split()[1:]]
        return next((name for name in names if "." in name and "=" not in name), "")

    @property
    def commands(self) -> list[str]:
        """Its lines of shell."""
        return self.text.replace("\\\n", " ").splitlines()


def page_text(name: str) -> str:
    """Return the text of a page."""
    return PAGES[name].read_text(encoding="utf-8")


def page_words(name: str) -> str:
    """Return the text of a page in one line."""
    return " ".join(page_text(name).split())


def blocks(page: str) -> list[Block]:
    """Return every block of a page in order, without the indentation of a list around it."""
    found, end = list[Block](), 0
    fence = r"^ *```(?P<info>[^\n]*)\n(?P<text>.*?)^ *```$"
    for m in re.finditer(
        rf"{fence}|(?:^    (?:colony|python -m) [^\n]*\n(?:     [^\n]*\n)*)+", page_text(page), re.M | re.S
    ):
        line = page_text(page)[: m.start()].count("\n") + 1
        text, info = (
            (m["text"], m["info"]) if m["text"] is not None else (re.sub("(?m)^    ", "", m[0]), "sh")
        )
        if info == "text" and found and found[-1].info == "sh" and line == end + 2:
            found[-1] = found[-1]._replace(shown=text)
        found.append(Block(page, line, info, text))
        end = line + m[0].count("\n")
    return found


def files(page: str) -> dict[str, str]:
    """Return the files that a page shows, by name; blocks of the same file are parts of it."""
    found = dict[str, str]()
    for block in blocks(page):
        if block.file:
            found[block.file] = f"{found[block.file]}\n{block.text}" if block.file in found else block.text
    return found


def write_files(page: str, folder: Path) -> None:
    """Write the files that a page shows into a folder."""
    for name, text in files(page).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")


# --- commands ----------------------------------------------------------------------------------------


class Ran(NamedTuple):
    """A command that ended: its exit code, its standard output, and what a terminal shows of both streams."""

    code: int
    out: str
    terminal: str


class _Tee(io.StringIO):
    def __init__(self, terminal: io.StringIO) -> None:
        super().__init__()
        self.terminal = terminal

    def write(self, text: str) -> int:
        self.terminal.write(text)
        return super().write(text)


def typed(line: str, monkeypatch: pytest.MonkeyPatch) -> Ran:
    """Run a line of shell in the current folder; `colony` alone is run in this process."""
    words = shlex.split(line, comments=True)
    if words[0] != "colony" or set(words) & {"|", ">", "&&", ";"}:
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        environment = {
            **os.environ,
            "PATH": path,
            "PYTHONPATH": str(ROOT),
            "CI": "1",
        }  # hypothesis: no deadlines
        done = subprocess.run(
            ["sh", "-c", line], env=environment, capture_output=True, text=True, check=False
        )
        return Ran(done.returncode, done.stdout, done.stdout + done.stderr)
    terminal, before = io.StringIO(), set(sys.modules)
    monkeypatch.setenv("XDG_CACHE_HOME", str(Path("cache").absolute()))
    monkeypatch.setattr(sys, "argv", words)
    monkeypatch.setattr(sys, "path", list(sys.path))
    with (
        redirect_stdout(_Tee(terminal)) as out,
        redirect_stderr(_Tee(terminal)),
        pytest.raises(SystemExit) as end,
    ):
        main()
    for name in set(sys.modules) - before:
        if Path(f"{name}.py").exists():  # a page's own: another may call its so, too
            del sys.modules[name]
    assert isinstance(end.value.code, int)
    return Ran(end.value.code, out.getvalue(), terminal.getvalue())


def is_same_picture(drawn: Path, kept: Path) -> bool:
    """Whether two SVGs are the same, or of two versions of matplotlib, which may set text differently."""
    texts = [path.read_text(encoding="utf-8") for path in (drawn, kept)]
    versions = [re.findall(r"<dc:title>(Matplotlib [^<]*)</dc:title>", text) for text in texts]
    return texts[0] == texts[1] or versions[0] != versions[1]


# --- the runner --------------------------------------------------------------------------------------


class Runner:
    """Runs the blocks of a page in order, in the current folder. Mutable: what they leave behind.

    Attributes:
        printed: what blocks of commands print, in the form of the output that is shown below each.
    """

    def __init__(self, page: str, monkeypatch: pytest.MonkeyPatch) -> None:
        self.page = page
        self.printed = dict[Block, str]()
        self._monkeypatch = monkeypatch
        self._names: dict[str, Any] = {"__name__": "page"}
        self._robot: str | None = None
        for name in ("behaviors", "maps", "robots"):
            shutil.copytree(ROOT / name, name)
        for name in ("examples", "tests"):
            Path(name).symlink_to(ROOT / name)
        write_files(page, Path())
        declared = [block.text for block in blocks(page) if block.info == "colony robot"]
        Path("rome.colony").write_text("".join(declared), encoding="utf-8")
        self._interface = 'import "rome.colony"\n' if declared else ""

    def run(self, block: Block) -> None:
        """Run a block, or note what its commands print; an AssertionError says what is wrong."""
        match block.info.split():
            case ["colony", *words]:
                self._check(block, words[-1] if words[:1] == ["wrong"] else None)
            case ["python"]:
                self._execute(block.text)
            case ["sh", *_]:
                self._type(block)

    def _check(self, block: Block, wrong: str | None) -> None:
        """Check a behavior and run its tests. A part of one is left out, a robot noted for those after it."""
        if block.file.startswith("robots/"):
            self._robot = block.file
            return
        alone = re.search(r"^(robot|language|import) ", block.text, re.MULTILINE)
        if not (alone or self._interface):
            return
        path = Path(block.file or "example.colony")
        path.write_text(block.text if alone else self._interface + block.text, encoding="utf-8")
        checked = check_file(path, robot=(self._robot or "rome") if "import robot" in block.text else None)
        found = [d for d in checked.diagnostics if d.severity == "error"]
        if checked.program is not None and "from python" not in block.text:
            found += failures_as_diagnostics(run_examples(checked.program))
        assert [d.code for d in found] == ([wrong] if wrong else []), [headline(d) for d in found]

    def _execute(self, text: str) -> None:
        """Execute a program, and compare values with the comments beside expressions; call its tests."""
        if text.startswith(">>>"):
            test = doctest.DocTestParser().get_doctest(text, self._names, self.page, None, 0)
            report = io.StringIO()
            runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
            assert runner.run(test, out=report.write, clear_globs=False).failed == 0, report.getvalue()
            self._names = test.globs
            return
        lines = text.splitlines()
        for node in ast.parse(text).body:
            printed = io.StringIO()
            with redirect_stdout(printed):
                if isinstance(node, ast.Expr):
                    value = eval(ast.unparse(node), self._names)
                    given = repr(value) if value is not None else printed.getvalue().rstrip()
                    _, _, said = lines[(node.end_lineno or 0) - 1].partition("  # ")
                    assert not said or re.match(rf"{re.escape(given)}(,|:|$)", said), f"{given}  # {said}"
                else:
                    exec(compile(ast.Module([node], []), self.page, "exec"), self._names)
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                self._names[node.name]()

    def _type(self, block: Block) -> None:
        """Type commands. Without output below them, they must succeed, and their runs are short."""
        ran = []
        for line in block.commands:
            shortened = SHORT if block.shown is None and line.startswith("colony run ") else ""
            ran.append(typed(line + shortened, self._monkeypatch))
            assert block.shown is not None or ran[-1].code == 0, f"{line}\n{ran[-1].terminal}"
        if block.shown is not None:
            forms = [
                "".join(r.terminal for r in ran),
                "".join(r.out for r in ran),
                ran[-1].terminal,
                ran[-1].out,
            ]
            self.printed[block] = max(
                (_cut(form, block.shown) for form in forms), key=partial(_likeness, block.shown)
            )


def _cut(text: str, shown: str) -> str:
    """Return as many lines as the page shows, if it cuts them off with `...`."""
    if not shown.endswith("\n...\n"):
        return text
    return "".join(text.splitlines(keepends=True)[: shown.count("\n") - 1]) + "...\n"


def _likeness(shown: str, text: str) -> float:
    return 2.0 if text == shown else difflib.SequenceMatcher(None, text, shown).ratio()


def not_run(text: str) -> list[str]:
    """Return the patterns of `NOT_RUN` that a line or program has."""
    return [pattern for pattern in NOT_RUN if re.search(pattern, text)]


def runnable(page: str) -> list[Block]:
    """Return the blocks of a page that are run, without the commands that are not."""
    found = list[Block]()
    for block in blocks(page) if page not in TESTED_APART else ():
        if block.info.startswith("sh"):
            lines = [line for line in block.commands if not not_run(line)]
            if lines != block.commands:
                block = block._replace(text="".join(f"{line}\n" for line in lines), shown=None)
        elif block.info == "python" and not_run(block.text):
            continue
        if block.text and block.info.split()[:1] in (["sh"], ["python"], ["colony"]):
            found.append(block)
    return found


if __name__ == "__main__":
    for file in map(Path, sys.argv[1:]):
        with tempfile.TemporaryDirectory() as empty, pytest.MonkeyPatch.context() as patch:
            text = file.read_text(encoding="utf-8")
            patch.chdir(empty)
            runner = Runner(file.name, patch)
            for each in runnable(file.name):
                runner.run(each)
            for commands, output in runner.printed.items():
                text = text.replace(
                    f"{commands.text}```\n\n```text\n{commands.shown}",
                    f"{commands.text}```\n\n```text\n{output}",
                )
        file.write_text(text, encoding="utf-8")
