"""docs/physics.md: what it says of the model is what the model is made of."""

from __future__ import annotations

from colony.body.shipped import shipped_body
from colony.sim.mujoco import model
from tests.paths import ROOT

PAGE = (ROOT / "docs" / "physics.md").read_text(encoding="utf-8")


def _row(name: str) -> str:
    [row] = [line for line in PAGE.splitlines() if line.startswith(f"| {name} | ")]
    return row


def test_the_constants_are_those_of_the_model() -> None:
    build = model.build_of(shipped_body("amr"))
    assert f"| {model.DENSITY_KG_M3:g} kg/m³ | {build.mass:.0f} kg for `amr`" in _row("hull")
    assert f"radius {model.MAX_WHEEL_RADIUS_M * 1e3:g} mm" in _row("wheels")
    assert f"friction {model.TIRE_FRICTION:g}, " in _row("tires")
    assert f"friction {model.HULL_FRICTION:g} " in _row("hull on walls")
    assert f"{model.TRACTION * 100:g} % of what the tires hold" in _row("motors")
    assert f"settles in {model.SETTLING_S * 1e3:g} ms" in _row("controller of the motors")
    assert f"{model.ROTOR_KG_M2:g} kg m²" in _row("rotors")
    assert f"{model.LIFT_KG:g} kg and its load" in _row("lift")
    assert f"in steps of {model.TIMESTEP_S * 1e3:g} ms" in PAGE


def test_the_targets_are_those_of_the_benchmark() -> None:
    text = (ROOT / "benchmarks" / "physics.py").read_text(encoding="utf-8")
    for row, name in (
        ("distance, the worst of ten drives", "WAY_PERCENT"),
        ("heading, the most", "HEADING_DEG"),
    ):
        [line] = [line for line in PAGE.splitlines() if line.startswith(f"| {row}")]
        target = float(line.split("|")[3].split()[0])
        assert f"TARGET_{name} = {target}" in text
