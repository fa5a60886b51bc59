from __future__ import annotations

from colony.compile.guards import Always, And, GuardTable, ModuleActive, Never, Not, Or, Recently, operands


def test_equal_nodes_have_one_reference() -> None:
    table = GuardTable()
    a, b = table.add(ModuleActive("a")), table.add(ModuleActive("b"))
    assert table.add(And((a, b))) == table.add(And((a, b)))
    assert table.freeze() == (ModuleActive("a"), ModuleActive("b"), And((0, 1)))


def test_a_table_goes_on_from_another() -> None:
    table = GuardTable((ModuleActive("a"), Always()))
    assert table.add(ModuleActive("a")) == 0
    assert table.conjunction((0, 1)) == 0


def test_builders() -> None:
    table = GuardTable((ModuleActive("a"), ModuleActive("b")))
    assert table.nodes[table.conjunction(())] == Always()
    assert table.nodes[table.disjunction(())] == Never()
    assert table.disjunction((0,)) == 0
    assert table.nodes[table.disjunction((0, 1))] == Or((0, 1))
    assert table.nodes[table.negation(0)] == Not(0)
    assert table.recently(0, 0) == 0
    assert table.nodes[table.recently(0, 5)] == Recently(0, 5)


def test_operands() -> None:
    assert operands(And((1, 2))) == (1, 2)
    assert operands(Recently(3, 5)) == operands(Not(3)) == (3,)
    assert operands(Always()) == operands(ModuleActive("a")) == ()
