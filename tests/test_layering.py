"""Imports never run upwards, and starting a part of the system loads no more than that part."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "colony"

BASE = {"colony", "colony.backoff", "colony.collector", "colony.extras", "colony.files", "colony.record"}
ALLOWED: dict[str, set[str]] = {
    "text": set(),
    "shipped": set(),
    "ir": set(),
    "body": {"ir", "shipped"},
    "dsl": {"ir", "shipped"},
    "execute": {"ir"},
    "compile": {"ir", "execute"},
    "verify": {"ir", "execute", "compile", "dsl"},
    "editing": {"ir", "dsl", "compile", "verify", "shipped"},
    "runtime": {"ir", "execute"},
    "analysis": {"ir", "dsl", "execute", "compile", "verify", "runtime"},
    "drivers": {"ir", "runtime"},
    "ros2": {"ir", "runtime"},
    "nav": {"body", "runtime", "shipped"},
    "vision": {"body", "runtime", "nav"},
    "sim": {"ir", "body", "runtime", "nav"},
    "view": {"ir", "body", "compile", "nav"},
    "runs": {"ir", "body", "dsl", "execute", "compile", "runtime", "ros2", "nav", "vision", "sim"},
    "watch": {
        "ir",
        "body",
        "execute",
        "compile",
        "verify",
        "runtime",
        "analysis",
        "nav",
        "vision",
        "view",
        "runs",
    },
    "experiment": {"ir", "dsl", "execute", "runtime", "analysis", "nav", "runs"},
}
ALLOWED["cli"] = set(ALLOWED)
"""The packages that a package may import, besides itself, `text` and the base."""

THIRD_PARTY: dict[str, set[str]] = {
    "lark": {"dsl", "editing"},
    "hypothesis": {"verify"},
    "z3": {"verify"},
    "numba": {"sim"},
    "mujoco": {"sim"},
    "cv2": {"vision"},
    "PIL": {"vision", "sim", "nav"},
    "yaml": {"nav", "cli"},
    "dask": set(),
    "distributed": set(),
    "matplotlib": {"view"},
    "click": {"cli"},
    "rich": {"cli"},
    "networkx": {"view", "nav"},
    "msgspec": {"editing", "execute", "runtime", "analysis", "sim", "experiment", "cli", "watch"},
    "starlette": {"watch"},
    "uvicorn": {"watch"},
    "zenoh": {"runtime"},
    "mcap": {"runtime", "watch"},
    "foxglove": {"watch"},
    "lz4": {"runtime"},
    "zstandard": {"runtime"},
    "serial": {"drivers"},
    "rclpy": {"ros2"},
    "rosbags": {"ros2"},
}
"""The only packages that may import these; an experiment finds dask by its name, where it is installed."""


def _imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            found.add(node.module or "")
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


RUNTIME = (
    *("protocol", "store", "arbitration", "library", "frames", "clients", "observe", "recordings", "servers"),
    *("transport", "kit", "assembly"),
)
"""The folders of `runtime`: each imports only those before it."""

FRONT = {ROOT / "__init__.py", ROOT / "library.py", ROOT / "testing.py"}
"""The front door, which opens every package but the command line, and which no package imports."""

SOURCES = sorted(ROOT.rglob("*.py"))

BESIDE = ("studies", "tools", "tests", "benchmarks")
"""Folders beside colony that import it, and that it may not import."""


@pytest.mark.parametrize("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_run_downwards(path: Path) -> None:
    parts = path.relative_to(ROOT).parts
    package = parts[0] if len(parts) > 1 else None
    for name in _imports(path):
        top = name.split(".")[0]
        if top in THIRD_PARTY:
            assert package in THIRD_PARTY[top], f"{path} imports {name}"
        assert top not in BESIDE, f"{path} imports {name}: {top} rest on colony, not colony on them"
        if top != "colony" or name == "colony":
            continue
        target = name.split(".")[1]
        if (ROOT / target).is_dir():
            allowed = {package, "text", *ALLOWED[package]} if package else {"text"}
            allowed = set(ALLOWED) - {"cli"} if path in FRONT else allowed
            allowed = {"cli"} if path.name == "__main__.py" and package is None else allowed
            assert target in allowed, f"{path} imports {name}"
        elif package is None and path not in FRONT:
            assert f"colony.{target}" in BASE | {"colony.__version__"}, f"{path} imports {name}"


CLOCKLESS = ("text", "ir", "dsl", "compile", "execute", "verify", "analysis")
"""Packages that read no clock: what they find must not depend on how busy the machine is."""


@pytest.mark.parametrize("package", CLOCKLESS)
def test_a_finding_rests_on_no_clock(package: str) -> None:
    for path in (ROOT / package).rglob("*.py"):
        assert not _imports(path) & {"time", "datetime"}, path
        assert '"timeout"' not in path.read_text(), f"{path}: limit z3 by its resources"


def test_imports_within_the_runtime_run_downwards() -> None:
    runtime = ROOT / "runtime"
    assert {folder.name for folder in runtime.iterdir() if (folder / "__init__.py").exists()} == {*RUNTIME}
    for i, folder in enumerate(RUNTIME):
        above = tuple(f"colony.runtime.{name}." for name in RUNTIME[i + 1 :])
        for path in (runtime / folder).rglob("*.py"):
            assert not [name for name in _imports(path) if name.startswith(above)], path


def test_every_allowance_is_used() -> None:
    imports = {name: set[str]() for name in ALLOWED}
    for path in (p for p in SOURCES if p.parent != ROOT):
        names = {name.removeprefix("colony.").split(".")[0] for name in _imports(path)}
        imports[path.relative_to(ROOT).parts[0]] |= names
    for package, allowed in ALLOWED.items():
        assert allowed <= imports[package], package
    for library, packages in THIRD_PARTY.items():
        assert packages == {package for package, names in imports.items() if library in names}, library


def test_every_package_has_its_place() -> None:
    packages = {p.name for p in ROOT.iterdir() if p.is_dir() and p.name != "__pycache__"}
    assert packages == set(ALLOWED)


def _loaded_by(statement: str) -> set[str]:
    code = f"{statement}; import sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        (
            "import colony.runtime.assembly.virtual",
            {"lark", "colony.dsl", "colony.verify", "z3", "hypothesis", "matplotlib"},
        ),
        ("import colony.dsl.ast", {"lark"}),
        ("import colony.compile.pipeline", {"lark", "numpy", "networkx"}),
        ("import colony.dsl.load", {"lark", "numpy", "networkx", "rich", "hypothesis", "difflib"}),
        ("import colony.cli.main", {"lark", "rich", "numpy", "colony.ir"}),
        ("import colony.cli.check", {"lark", "rich", "numpy"}),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_loads_no_more_than_it_needs(statement: str, absent: set[str]) -> None:
    assert not _loaded_by(statement) & absent


FRONT_END = {"colony.compile", "colony.dsl", "colony.verify", "lark", "z3"}
HEAVY = {"numpy", "numba", "llvmlite", "matplotlib", "mujoco", "cv2", "networkx", "lark", "z3"}
CHILD = "import colony.runtime.assembly.processes.child, " + ", ".join(
    f"colony.{module}"
    for module in (
        *("runtime.assembly.limits", "runtime.assembly.nodes", "runtime.assembly.processes.hardware"),
        *("runtime.assembly.processes.parts", "runtime.frames.clock", "runtime.kit.devices"),
        *("runtime.servers.cserver", "runtime.servers.dserver", "runtime.servers.pserver"),
        *("runtime.servers.rserver", "runtime.servers.runtime_server", "runtime.store.sqlite"),
        "execute.colonyc",
    )
)


def _command(*arguments: str) -> str:
    return (
        f"import sys; from contextlib import suppress; from colony.cli.main import main\n"
        f"sys.argv = ['colony', *{arguments!r}]\n"
        f"with suppress(SystemExit): main()\n"
        f"pass"
    )


MAX_LINES = 600
"""Lines of a file that one sitting can read."""


def test_a_class_name_is_used_once_and_a_file_can_be_read_in_one_sitting() -> None:
    classes: dict[str, list[str]] = {}
    for path in ROOT.rglob("*.py"):
        text = path.read_text()
        assert text.count("\n") <= MAX_LINES, path
        for node in ast.parse(text).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                classes.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    assert not {name: paths for name, paths in classes.items() if len(paths) > 1}


def test_a_docstring_names_files_that_are_there() -> None:
    parts = (ROOT, ROOT.parent / "tests")
    files = {f"/{path.relative_to(ROOT.parent)}" for part in parts for path in part.rglob("*.py")}
    for path in ROOT.rglob("*.py"):
        for name in re.findall(r"`([\w/]+\.py)`", path.read_text()):
            assert any(file.endswith(f"/{name}") for file in files) or "NAME" in name, (path, name)


PROCESSES: tuple[tuple[str, str, set[str]], ...] = (
    ("leader", _command("drive", "wander", "--robot", "pioneer"), HEAVY - {"lark"}),
    ("shadow", _command("shadow", "wander", "--robot", "pioneer"), HEAVY - {"lark"}),
    ("watch", _command("watch", "--robot", "pioneer"), HEAVY | {"colony.sim"}),
    ("teleop", _command("teleop"), HEAVY | FRONT_END | {"serial"}),
    ("ps", _command("ps"), HEAVY | FRONT_END | {"colony.sim", "colony.nav"}),
    (
        "supervisor",
        "import colony.cli.serve.serving, colony.cli.programs, colony.compile.pipeline",
        HEAVY | {"colony.verify", "colony.view"},
    ),
    (
        "Clock, servers, clients",
        CHILD,
        HEAVY | FRONT_END | {"colony.sim", "colony.body", "colony.nav", "colony.ros2"},
    ),
    ("gateway", f"{CHILD}, colony.runtime.transport.live.gateway", HEAVY | FRONT_END | {"colony.sim"}),
    ("simulated servers", "import colony.sim.plant.servers", HEAVY | FRONT_END | {"colony.sim.world"}),
    ("plant", "import colony.sim.plant.process", {"colony.sim.cameras.camera", "colony.sim.cameras.ceiling"}),
    ("driver", "import colony.drivers.serial_base", HEAVY | FRONT_END | {"colony.sim", "colony.body"}),
    ("ROS 2", "import colony.ros2.drivers", HEAVY | FRONT_END | {"colony.sim", "colony.body", "serial"}),
    ("guard", "import colony.drivers.guard", HEAVY | FRONT_END | {"zenoh", "colony.sim", "colony.body"}),
)
"""The processes of a robot, what each imports, and what it may not have loaded then."""


@pytest.mark.parametrize(
    ("statement", "absent"), [row[1:] for row in PROCESSES], ids=[p[0] for p in PROCESSES]
)
def test_a_process_of_a_robot_loads_no_more_than_it_needs(
    statement: str, absent: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Commands run as far as the refusal of a robot that does not run."""
    monkeypatch.setenv("COLONY_RUN_DIR", str(tmp_path))
    loaded = _loaded_by(statement)
    assert not {name for name in loaded if any(f"{name}.".startswith(f"{part}.") for part in absent)}


CLIENT = """
import json, runpy, sys
from pathlib import Path
from tests.robot_servers import ROME_SERVERS
from colony.runtime.assembly.processes import child
sys.argv = ["child", sys.argv[1]]
from contextlib import ExitStack
from colony.runtime.assembly.processes.parts import nodes_of
from colony.runtime.assembly.processes.spec import address_of, read_spec
spec = read_spec(Path(sys.argv[1]))
with ExitStack() as holds:
    first, *_ = nodes_of(spec.part, address_of(spec.robot_address), None, holds)
print(first.address, *sys.modules)
"""


def test_a_client_process_loads_neither_the_front_end_nor_the_compiler(tmp_path: Path) -> None:
    """As far as its node, which is built from the file that the leader writes."""
    from colony.compile.pipeline import compile_program
    from colony.runtime.assembly.processes.jobs import client_processes
    from colony.runtime.protocol.bindings import bind
    from colony.runtime.protocol.deployment import deployment
    from colony.runtime.transport.live.robot_address import Local
    from colony.runtime.transport.live.run_directory import RobotDirectory
    from tests.robot_servers import ROME_SERVERS
    from tests.runtime.programs import roam

    compiled = compile_program(roam()).compiled
    bindings = bind(compiled.robot, ROME_SERVERS)
    robot_address = Local(RobotDirectory(tmp_path, "rome"))
    (job,) = client_processes(
        robot_address,
        deployment(compiled, bindings, run="r", seed=1),
        compiled,
        bindings,
        tmp_path,
        layout="isolated",
    ).jobs
    done = subprocess.run(
        [sys.executable, "-c", CLIENT, *job.arguments], capture_output=True, text=True, check=True
    )
    address, *loaded = done.stdout.split()
    assert address == job.clients[0]
    assert not {name for name in loaded if any(f"{name}.".startswith(f"{part}.") for part in FRONT_END)}
    assert {"colony.execute.executor", "msgspec"} <= set(loaded)


# --- circles -------------------------------------------------------------------------------------


def _imported_at_the_top(path: Path, modules: set[str]) -> set[str]:
    """The modules of colony that a file imports outside of functions, for type checking alone too."""
    found: set[str] = set()
    work: list[ast.stmt] = list(ast.parse(path.read_text()).body)
    while work:
        match work.pop():
            case ast.If(body=body, orelse=orelse):
                work += [*body, *orelse]
            case ast.Import(names=names):
                found |= {alias.name for alias in names}
            case ast.ImportFrom(module=str() as module, names=names):
                inner = {f"{module}.{alias.name}" for alias in names} & modules
                found |= inner if len(inner) == len(names) else {module, *inner}
            case _:
                pass
    return found & modules


def test_no_modules_import_each_other_in_a_circle() -> None:
    sources = [*SOURCES, *(path for folder in BESIDE for path in (ROOT.parent / folder).rglob("*.py"))]
    names = {".".join(p.relative_to(ROOT.parent).with_suffix("").parts): p for p in sources}
    names = {name.removesuffix(".__init__"): path for name, path in names.items()}
    imports = {name: _imported_at_the_top(path, set(names)) for name, path in names.items()}
    while leaves := {name for name, imported in imports.items() if not imported & imports.keys()}:
        imports = {name: imported for name, imported in imports.items() if name not in leaves}
    assert not imports, f"in circles, or importing what is: {sorted(imports)}"
