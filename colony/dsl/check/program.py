"""Checking of all files of a program, in stages, to the typed program.

Names are declared first, so that the order of declarations matters only where the language says so; then
constants, the robot, derived values, modules, wires, limits, contracts and tests are checked. In every stage,
imported files come before their importers.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple, TypeVar

from colony.dsl import ast
from colony.dsl.check.checker import Checker
from colony.dsl.check.contracts import check_contract, check_limit, check_test, frames_are_regular
from colony.dsl.check.declare import MODULE_DECLARATIONS, declare_names, modules_declared
from colony.dsl.check.expressions import ExpressionChecker
from colony.dsl.check.functions import declare_function
from colony.dsl.check.inputs import (
    check_assumption,
    check_let,
    check_machine,
    check_nexts,
    check_param,
    check_state,
    let_symbol,
    machine_type,
    note_sensor_name,
)
from colony.dsl.check.modules import PendingModule, check_modules
from colony.dsl.check.phases import phase_findings
from colony.dsl.check.references import role_sensor
from colony.dsl.check.robot import check_enum, check_input, check_robot, literal_frame_period
from colony.dsl.check.scope import (
    AssumptionSymbol,
    BrokenSymbol,
    CheckReport,
    EnumSymbol,
    FileScope,
    MachineSymbol,
    RobotScope,
    SensorSymbol,
    StateSymbol,
    WireSymbol,
)
from colony.dsl.check.sequence_text import written_out
from colony.dsl.check.sequences import (
    bases_of_tasks,
    waiting_findings,
    with_modules_of_tasks,
    write_out_sequences,
)
from colony.dsl.check.site_values import bind_params
from colony.dsl.check.wiring import PendingWire, check_outputs, check_wires, names_reaching_actuators
from colony.dsl.files import SourceTree
from colony.dsl.printer import print_declarations, print_file
from colony.dsl.site import SiteParams
from colony.ir import program as ir
from colony.ir.types import ScalarValue
from colony.text.diagnostics import Diagnostic, Label, error, has_errors, in_order, warning

_Node = TypeVar("_Node", bound=ast.SyntaxNode)


def check_program(
    tree: SourceTree, *, params: SiteParams | None = None
) -> tuple[ir.Program | None, tuple[Diagnostic, ...]]:
    """Return the program (None if there are errors), and all errors and warnings in order.

    The values of `params` stand in for those in the text.
    """
    examined = examine(tree, params=params)
    return examined.program, examined.diagnostics


class Examined(NamedTuple):
    """The program if there are no errors, all findings, and the names of each file with their symbols."""

    program: ir.Program | None
    diagnostics: tuple[Diagnostic, ...]
    scopes: tuple[FileScope, ...]


def examine(tree: SourceTree, *, params: SiteParams | None = None) -> Examined:
    """Check a program as `check_program` does; errors leave the symbols of all else."""
    report = CheckReport(diagnostics=[*tree.diagnostics, *([] if params is None else params.diagnostics)])
    is_readable = bool(tree.files) and not any(d.code == "E008" for d in tree.diagnostics)
    check = _Check(tree, report, params) if is_readable else None
    program = None if check is None else check.run()
    diagnostics = in_order(report.diagnostics)
    scopes = () if check is None else tuple(check.scopes)
    return Examined(None if has_errors(diagnostics) else program, diagnostics, scopes)


def write_out(tree: SourceTree, *, params: SiteParams | None = None) -> str:
    """Return what the sequences of the main file stand for, as text; nothing without any, or with errors."""
    check = _Check(tree, CheckReport(diagnostics=[*tree.diagnostics]), params)
    if check.run() is None or has_errors(check.report.diagnostics):
        return ""
    return print_declarations(written_out(check.scopes)[1])


def without_sequences(tree: SourceTree, *, params: SiteParams | None = None) -> str:
    """Return the text of the main file of a program without errors with its sequences written out."""
    check = _Check(tree, CheckReport(), params)
    check.run()
    return print_file(written_out(check.scopes)[0])


class _Check:
    """A check of one program in progress."""

    def __init__(self, tree: SourceTree, report: CheckReport, params: SiteParams | None) -> None:
        self.report = report
        self.robot = RobotScope()
        self.scopes = [FileScope(file=with_modules_of_tasks(f), robot=self.robot) for f in tree.files]
        self.root = self.scopes[-1]
        declare_names(report, self.scopes)
        self.site = None if params is None else bind_params(report, self.scopes, params)

    def run(self) -> ir.Program | None:
        self._constants()
        robot = self._robot()
        inputs = self._inputs()
        write_out_sequences(self.report, self.scopes, modules_declared(self.scopes))
        derived = self._derived()
        checked = check_modules(self.report, self._pending_modules())
        modules = list(checked.modules)
        wires = self._wires(modules)
        limits = [check_limit(c, n) for c, n in self._each(ast.LimitDecl)]
        contracts = self._contracts(robot)
        root_checker = ExpressionChecker(scope=self.root, report=self.report)
        tests = [check_test(root_checker, n) for c, n in self._each(ast.TestDecl) if c.scope is self.root]
        self._roles()
        if robot is None:
            return None
        assert has_errors(self.report.diagnostics) or not (
            None in limits
            or None in tests
            or len(contracts) < self._count(ast.ContractDecl)
            or len(modules) + len(checked.templates) < self._count(*MODULE_DECLARATIONS)
            or len(derived) < self._count(ast.LetDecl, ast.AssumeDecl, ast.StateDecl, ast.MachineDecl)
        ), "a declaration was left out without an error"
        derived = self._with_inputs(derived, checked.input_lets)
        self._warn_unused(robot, modules, wires)
        self._look_at_phases(derived, {s.name: s for s in (*robot.sensors, *inputs)})
        sent = sorted(self.robot.sent.values(), key=lambda sensor: _place(robot, sensor))
        return ir.Program(
            robot=replace(
                robot, sensors=(*robot.sensors, *inputs, *sent, *self._tunables(checked.templates))
            ),
            derived=tuple(derived),
            modules=tuple(modules),
            wires=tuple(wires),
            limits=tuple(x for x in limits if x is not None),
            contracts=tuple(c for c in contracts if not c.reach),
            reaches=tuple(c for c in contracts if c.reach),
            tests=tuple(x for x in tests if x is not None),
            site=self.site,
        )

    def _each(self, kind: type[_Node]) -> Iterator[tuple[Checker, _Node]]:
        """Yield every declaration of a kind in all files, with a checker in the scope of its file."""
        for scope in self.scopes:
            checker = ExpressionChecker(scope=scope, report=self.report)
            for node in scope.file.tree.declarations:
                if isinstance(node, kind):
                    yield checker, node

    def _count(self, *kinds: type[ast.SyntaxNode]) -> int:
        """Return the number of declarations of these kinds in all files."""
        return sum(isinstance(d, kinds) for scope in self.scopes for d in scope.file.tree.declarations)

    def _constants(self) -> None:
        """Check enums and params; each may use those above it."""
        robots = list(self._each(ast.RobotDecl))
        self.robot.frame_ns = literal_frame_period(*robots[0]) if robots else ir.DEFAULT_FRAME_NS
        for scope in self.scopes:
            checker = ExpressionChecker(scope=scope, report=self.report)
            for node in scope.file.tree.declarations:
                if isinstance(node, ast.EnumDecl):
                    type_ = check_enum(checker, node)
                    symbol = EnumSymbol(type=type_) if type_ else BrokenSymbol()
                    scope.values.setdefault(node.name.text, symbol)
                elif isinstance(node, ast.ParamDecl):
                    full_name = scope.full_name(node.name.text)
                    scope.values.setdefault(node.name.text, check_param(checker, node, full_name))

    def _robot(self) -> ir.Robot | None:
        """Check the one robot of the program."""
        found = list(self._each(ast.RobotDecl))
        if not found:
            self.robot.absent = True
            if not any(d.code in _UNREADABLE_CODES for d in self.report.diagnostics):
                start = ast.NameNode(text="", start=0, end=0)
                hint = 'write `import robot`, or import a file that declares one: `import "rome"`'
                self.report.error(self.root, "E301", start, "the program has no robot", hint)
            return None
        first_checker, node = found[0]
        for checker, other in found[1:]:
            message = f"the program has a robot already: `{node.name.text}`"
            checker.error(
                "E302", other.name, message, "a program has one robot", first_checker.label(node.name)
            )
        self.robot.title = f"the robot `{node.name.text}` ({first_checker.scope.file.source.name})"
        return check_robot(first_checker, node)

    def _inputs(self) -> list[ir.Sensor]:
        """Check the inputs of files: variables of DServer beside the sensors of the robot."""
        inputs: list[ir.Sensor] = []
        for checker, node in self._each(ast.SensorDecl):
            sensor = check_input(checker, node)
            symbol = BrokenSymbol() if sensor is None else SensorSymbol(sensor=sensor)
            if checker.scope.values.setdefault(node.name.text, symbol) is symbol and sensor is not None:
                inputs.append(sensor)
        return inputs

    def _derived(self) -> list[ir.Derived]:
        """Check derived values: states and machines can be read anywhere, lets only below themselves."""
        initial: dict[str, ScalarValue] = {}
        for checker, machine in self._each(ast.MachineDecl):
            checker.scope.values.setdefault(machine.name.text, machine_type(checker, machine))
        for checker, state in self._each(ast.StateDecl):
            found = check_state(checker, state)
            full_name = checker.scope.full_name(state.name.text)
            if found is not None:
                initial[full_name] = found[1]
            symbol = BrokenSymbol() if found is None else StateSymbol(name=full_name, type=found[0])
            checker.scope.values.setdefault(state.name.text, symbol)
        derived: list[ir.Derived] = []
        for scope in self.scopes:
            derived += self._lets(scope)
        return derived + self._states(initial) + self._machines()

    def _lets(self, scope: FileScope) -> Iterator[ir.Let]:
        """Check the lets and functions of a file, each of which may use those above it."""
        checker = ExpressionChecker(scope=scope, report=self.report)
        for node in scope.file.tree.declarations:
            if isinstance(node, ast.FunctionDecl):
                scope.values.setdefault(node.name.text, declare_function(checker, node, {}))
            elif isinstance(node, ast.AssumeDecl):
                assumption = check_assumption(checker, node)
                symbol = AssumptionSymbol(name=assumption.name) if assumption else BrokenSymbol()
                scope.values.setdefault(node.name.text, symbol)
                if assumption is not None:
                    yield assumption
            elif isinstance(node, ast.LetDecl):
                let = check_let(checker, node, scope.full_name(node.name.text))
                scope.values.setdefault(node.name.text, let_symbol(let) if let else BrokenSymbol())
                if let is not None:
                    note_sensor_name(self.robot, let)
                    yield let

    def _with_inputs(self, derived: list[ir.Derived], inputs: tuple[ir.Let, ...]) -> list[ir.Derived]:
        """Return derived values with the inputs of modules, which other lets do not read, after the lets."""
        first = {d.name: d for d in derived}
        for let in inputs:
            if let.name in first:
                message = f"the program has a value `{let.name}` already"
                labels = Label(first[let.name].span, "declared here")
                self.report.diagnostics.append(error("E102", let.span, message, "rename the module", labels))
        count = sum(isinstance(d, ir.Let) for d in derived)
        return [*derived[:count], *inputs, *derived[count:]]

    def _states(self, initial: dict[str, ScalarValue]) -> list[ir.Derived]:
        states: list[ir.Derived] = []
        for scope in self.scopes:
            checker = ExpressionChecker(scope=scope, report=self.report)
            own = {n: s for n, s in scope.values.items() if isinstance(s, StateSymbol)}
            nodes = [d for d in scope.file.tree.declarations if isinstance(d, ast.NextDecl)]
            names = {d.name.text for d in scope.file.tree.declarations if isinstance(d, ast.StateDecl)}
            nexts = check_nexts(checker, nodes, {n: scope.values[n] for n in names})
            for node in scope.file.tree.declarations:
                if isinstance(node, ast.StateDecl) and node.name.text in own:
                    symbol = own.pop(node.name.text)
                    states.append(
                        ir.State(
                            name=symbol.name,
                            span=checker.span(node.name),
                            type=symbol.type,
                            initial=initial[symbol.name],
                            next=nexts.get(node.name.text),
                        )
                    )
        return states

    def _machines(self) -> list[ir.Derived]:
        machines: list[ir.Derived] = []
        checked: set[str] = set()
        for checker, node in self._each(ast.MachineDecl):
            symbol = checker.scope.values[node.name.text]
            if (
                isinstance(symbol, MachineSymbol) and symbol.name not in checked
            ):  # another of the same name was reported
                checked.add(symbol.name)
                machine = check_machine(checker, node, symbol.type)
                machines += [machine] if machine else []
        return machines

    def _pending_modules(self) -> list[PendingModule]:
        seen: set[str] = set()
        pending: list[PendingModule] = []
        for scope in self.scopes:
            for node in scope.file.tree.declarations:
                if isinstance(node, MODULE_DECLARATIONS):
                    module = PendingModule(node=node, scope=scope)
                    if module.full_name not in seen:  # another of the same name was reported
                        seen.add(module.full_name)
                        pending.append(module)
        return pending

    def _wires(self, modules: list[ir.AnyModule]) -> list[ir.Wire]:
        pending: dict[str, PendingWire] = {}
        for scope in self.scopes:
            for network in scope.file.tree.declarations:
                if not isinstance(network, ast.NetworkDecl):
                    continue
                for node in network.wires:
                    name = node.name.text
                    if name not in scope.actuator_wires and not isinstance(
                        scope.network_symbols.get(name), WireSymbol
                    ):
                        continue  # the name of a module, which was reported
                    actuator = name if name in scope.actuator_wires and scope is self.root else None
                    symbol = scope.actuator_wires.get(name) or WireSymbol(name=scope.full_name(name))
                    wire = PendingWire(node=node, scope=scope, name=symbol.name, actuator=actuator)
                    pending.setdefault(symbol.name, wire)
        wires = check_wires(self.report, list(pending.values()))
        scopes = {name: wire.scope for name, wire in pending.items()}
        check_outputs(self.report, wires, {m.name: m for m in modules}, scopes)
        return wires

    def _contracts(self, robot: ir.Robot | None) -> list[ir.Contract]:
        contracts: dict[str, ir.Contract] = {}
        names: dict[str, Label] = {}
        assumed = set[str]()
        if robot is not None and robot.jitter_ns is not None:
            regular = frames_are_regular(robot, self.report.new_cell)
            contracts[regular.name] = regular
        for checker, node in self._each(ast.ContractDecl):
            full_name = checker.scope.full_name(node.name.text)
            if full_name in names:
                if isinstance(node, ast.AssumeDecl) and full_name in assumed:
                    continue  # which was reported as a value
                message = f"{node.keyword} `{full_name}` is declared twice"
                checker.error("E102", node.name, message, None, names[full_name])
                continue
            names[full_name] = checker.label(node.name)
            assumed |= {full_name} if isinstance(node, ast.AssumeDecl) else set()
            found = check_contract(checker, node)
            if found is not None:
                contracts[full_name] = found
        return list(contracts.values())

    def _roles(self) -> None:
        """Add the sensors of what modules did in the frame before."""
        for scope, node in self.robot.roles.values():
            sensor = role_sensor(ExpressionChecker(scope=scope, report=self.report), node)
            if sensor is not None:
                self.robot.sent.setdefault(sensor.name, sensor)

    def _tunables(self, templates: frozenset[str]) -> tuple[ir.Sensor, ...]:
        """Return the tunable params that the program reads, without those of templates."""
        found = self.robot.tunables
        return tuple(found[name] for name in sorted(found) if name.rpartition(".")[0] not in templates)

    # --- warnings

    def _warn_unused(self, robot: ir.Robot, modules: list[ir.AnyModule], wires: list[ir.Wire]) -> None:
        """Warn about modules and wires of the main file without effect, and about undriven actuators."""
        if has_errors(self.report.diagnostics):
            return
        used = names_reaching_actuators(wires) | bases_of_tasks(self.root)
        main_source = self.root.file.source
        for kind, parts in (("module", modules), ("wire", wires)):
            for part in parts:
                if part.name not in used and part.span.source is main_source:
                    message = f"{kind} `{part.name}` reaches no actuator"
                    actuators = [a.name for a in robot.actuators]
                    suggestion = self.report.suggest(part.name, actuators) if kind == "wire" else None
                    hint = suggestion or "wire it in a `network { ... }` block, or remove it"
                    self.report.diagnostics.append(warning("W001", part.span, message, hint))
        driven = {w.actuator for w in wires}
        for actuator in robot.actuators:
            # With `idle hold`, an actuator of an imported robot may stay unused: nothing is sent to it.
            is_optional = actuator.idle is None and actuator.span.source is not main_source
            if actuator.name in driven or is_optional:
                continue
            is_wired = self._is_wired_by_imports(actuator.name)
            if self._declares(*MODULE_DECLARATIONS, ast.NetworkDecl) or (
                is_wired and self._declares(ast.ContractDecl)
            ):
                message = f"nothing drives actuator `{actuator.name}`"
                hint = f"assign to it: `network {{ {actuator.name} = ... }}`"
                if is_wired:
                    hint = (
                        "the network of an imported file drives nothing here: import the file `as NAME`, and "
                        f"write `network {{ {actuator.name} = NAME.{actuator.name} }}`"
                    )
                self.report.diagnostics.append(warning("W002", actuator.span, message, hint))

    def _look_at_phases(self, derived: list[ir.Derived], sensors: dict[str, ir.Sensor]) -> None:
        """Report the phases of the main file's machines that nothing leads to, or that nothing leaves.

        Of its sequences, tasks that may wait for ever for one of `sensors` are reported, too.
        """
        if has_errors(self.report.diagnostics):
            return
        machines = {d.name: d for d in derived if isinstance(d, ir.Machine)}
        for checker, node in self._each(ast.MachineDecl):
            if checker.scope is self.root:
                machine = machines[checker.scope.full_name(node.name.text)]
                self.report.diagnostics += phase_findings(checker, node, machine)
        for checker, sequence in self._each(ast.SequenceDecl):
            if checker.scope is self.root:
                self.report.diagnostics += waiting_findings(checker, sequence, derived, sensors)

    def _declares(self, *kinds: type[ast.SyntaxNode]) -> bool:
        """Return True if the main file has a declaration of these kinds."""
        return any(isinstance(d, kinds) for d in self.root.file.tree.declarations)

    def _is_wired_by_imports(self, actuator: str) -> bool:
        """Return True if the network of an imported file assigns to an actuator."""
        return any(
            checker.scope is not self.root and any(wire.name.text == actuator for wire in network.wires)
            for checker, network in self._each(ast.NetworkDecl)
        )


def _place(robot: ir.Robot, sensor: ir.Sensor) -> tuple[int, int, str]:
    """Return the place of a sensor `last...` among all: by actuator its fields, then the roles of modules."""
    assert sensor.sent is not None
    actuator, of = [a.name for a in robot.actuators].index(sensor.sent.actuator), sensor.sent.of
    return (
        (actuator, of, "")
        if isinstance(of, int)
        else (actuator, len(robot.actuators[actuator].fields), sensor.name)
    )


_UNREADABLE_CODES = frozenset(
    {"E002", "E003", "E004", "E005", "E006", "E007", "E103", "E320", "E321", "E323"}
)
