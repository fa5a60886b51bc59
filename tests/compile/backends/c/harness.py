"""Runs of generated C outside of this process: frames as constants in C, outcomes as lines of numbers."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from colony.compile.backends.c.expressions import identifier, literal
from colony.compile.backends.c.generate import CText, generate_c
from colony.compile.backends.c.native import CExecutor, built
from colony.ir.frame import Frame
from colony.ir.types import Array, Bool
from colony.verify.testing.agreement import disagreement
from tests.drawn.strategies import run_of_seed

WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror")
STRICT = ("-std=c99", "-ffp-contract=off")


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A computer that runs C: its compiler with options, and the command that runs the binary."""

    name: str
    compiler: Sequence[str]
    options: Sequence[str] = ("-O2",)
    runner: Sequence[str] = ()
    startup: str = ""
    libraries: Sequence[str] = ("-lm",)

    @property
    def is_there(self) -> bool:
        """Whether compiler and emulator are installed."""
        return all(shutil.which(command[0]) for command in (self.compiler, self.runner) if command)


HERE = Target(name="here", compiler=("gcc",))
CLANG = Target(name="clang", compiler=("clang",))
SANITIZED = Target(
    name="sanitizers",
    compiler=("clang",),
    options=("-O1", "-g", "-fsanitize=undefined,address,float-cast-overflow", "-fno-sanitize-recover=all"),
)
AARCH64 = Target(
    name="aarch64",
    compiler=("aarch64-linux-gnu-gcc", "-static"),
    runner=("qemu-aarch64",),
)

_STARTUP = r"""
#include <stdint.h>
extern int main(void);
extern uint32_t _stack_top, _data_load, _data_begin, _data_end, _bss_begin, _bss_end;
static int semihosting(int operation, const void *argument)
{
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}
void emit(const char *text) { semihosting(4, text); }
void reset(void)
{
    *(volatile uint32_t *)0xE000ED88u |= 0xFu << 20; /* the FPU */
    __asm__ volatile("dsb\n isb");
    for (uint32_t *to = &_data_begin, *from = &_data_load; to < &_data_end;) { *to++ = *from++; }
    for (uint32_t *to = &_bss_begin; to < &_bss_end;) { *to++ = 0; }
    const uint32_t exit[2] = {0x20026, (uint32_t)main()};
    semihosting(0x20, exit);
    for (;;) { }
}
void fault(void)
{
    emit("fault\n");
    const uint32_t exit[2] = {0x20026, 1};
    semihosting(0x20, exit);
    for (;;) { }
}
__attribute__((section(".vectors"), used)) static const void *const vectors[16] = {
    &_stack_top, (const void *)reset, (const void *)fault, (const void *)fault, (const void *)fault,
    (const void *)fault, (const void *)fault,
};
"""

_LINKED = """
MEMORY { code (rx) : ORIGIN = 0, LENGTH = 4M  ram (rwx) : ORIGIN = 0x20000000, LENGTH = 4M }
SECTIONS {
  .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) } > code
  .ARM.exidx : { *(.ARM.exidx*) } > code
  .data : { _data_begin = .; *(.data*) . = ALIGN(4); _data_end = .; } > ram AT > code
  _data_load = LOADADDR(.data);
  .bss : { _bss_begin = .; *(.bss*) *(COMMON) . = ALIGN(4); _bss_end = .; } > ram
  end = .;
  _stack_top = ORIGIN(ram) + LENGTH(ram);
}
"""


def _cortex(name: str, machine: str, *options: str) -> Target:
    return Target(
        name=name,
        compiler=("arm-none-eabi-gcc", "-mthumb", *options),
        runner=(
            *("qemu-system-arm", "-M", machine, "-display", "none", "-monitor", "none", "-serial", "none"),
            *("-chardev", "stdio,id=out", "-semihosting-config", "enable=on,target=native,chardev=out"),
            "-kernel",
        ),
        startup=_STARTUP,
        libraries=("-nostartfiles", "--specs=nosys.specs", "-T", "link.ld", "-lm", "-lc"),
    )


CORTEX_M7 = _cortex("Cortex-M7", "mps2-an500", "-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard")
CORTEX_M4 = _cortex("Cortex-M4", "mps2-an386", "-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")

_EMIT = """
#include <stdio.h>
static void emit(const char *text) { fputs(text, stdout); }
"""

_MAIN = """
#include <string.h>
static void show(uint64_t value)
{
    char text[18];
    for (int i = 15; i >= 0; i--) {
        text[i] = "0123456789abcdef"[value & 15u];
        value >>= 4;
    }
    text[16] = ' ';
    text[17] = '\\0';
    emit(text);
}
static void number(double value)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    show(bits);
}
"""


def main_text(text: CText, frames: Sequence[Frame]) -> str:
    """Return a program that steps over frames and prints every outcome."""
    p, code = text.name, text.compiled.code
    executor = CExecutor(text, built(text))
    lines = []
    for frame in frames:
        executor.write(frame)
        lines.append(f"    {{{', '.join(_fields(text, executor.frame))}}},")
    shown = []
    for a, member in zip(code.actuators, text.actuators, strict=True):
        out = f"out.{member}"
        shown += [f"show((uint64_t){out}.{x});" for x in ("by", "reason", "reason_field", "sent")]
        for i, field in enumerate(a.actuator.fields):
            value, is_bool = f"{out}.command.{identifier(field.name)}", isinstance(field.type, Bool)
            shown += [
                f"show({out}.changed[{i}]);",
                f"show({value} ? 1 : 0);" if is_bool else f"number({value});",
            ]
    shown += [f"show(out.found[{i}]);" for i in range(len(code.sensors))]
    shown += [f"show(out.broken[{i}] ? 1 : 0);" for i in range(len(code.contracts))]
    return "\n".join(
        [
            _MAIN,
            f"static const struct {p}_frame frames[] = {{",
            *lines,
            "};",
            "int main(void)",
            "{",
            f"    static struct {p}_memory m;",
            f"    static struct {p}_outcome out;",
            f"    {p}_init(&m);",
            f"    for (int i = 0; i < {len(frames)}; i++) {{",
            f"        {p}_step(&m, &frames[i], &out);",
            *[f"        {line}" for line in shown],
            '        emit("\\n");',
            "    }",
            "    return 0;",
            "}",
            "",
        ]
    )


def _fields(text: CText, frame: object) -> list[str]:
    fields = [f".t_ns = INT64_C({frame.t_ns})", f".restarted = {int(frame.restarted)}"]  # type: ignore[attr-defined]
    for sensor, member in zip(text.compiled.code.sensors, text.sensors, strict=True):
        given = getattr(frame, member)
        values = list(given.value) if isinstance(sensor.type, Array) else [given.value]
        value = ", ".join(literal(x).text for x in values)
        fields.append(f".{member}.value = {f'{{{value}}}' if isinstance(sensor.type, Array) else value}")
        fields.append(f".{member}.given = {given.given}")
        if sensor.within_ns is not None:
            fields.append(f".{member}.taken_ns = INT64_C({given.taken_ns})")
    return fields


def run(target: Target, text: CText, main: str, folder: Path) -> str:
    """Compile a program for a target without a warning, run it, and return what it prints."""
    emit = "void emit(const char *text);\n" if target.startup else _EMIT
    (folder / f"{text.name}.h").write_text(text.header)
    (folder / f"{text.name}.c").write_text(text.source)
    (folder / "main.c").write_text(f'#include "{text.name}.h"\n#include <math.h>\n{emit}{main}')
    (folder / "link.ld").write_text(_LINKED)
    sources, binary = [f"{text.name}.c", "main.c"], f"{target.name}.elf"
    if target.startup:
        (folder / "startup.c").write_text(target.startup)
        sources.append("startup.c")
    options = [*STRICT, *target.options]
    for source in sources:
        warnings = WARNINGS if source == sources[0] else ()
        _done([*target.compiler, *options, *warnings, "-c", source, "-o", f"{source}.o"], folder)
    objects = [f"{source}.o" for source in sources]
    _done([*target.compiler, *options, *objects, *target.libraries, "-o", binary], folder)
    return _done([*target.runner, str(folder / binary)], folder)


def _done(command: Sequence[str], folder: Path) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, f"{' '.join(command)}:\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    return done.stdout


def drawn(seed: int, *, network: bool = False) -> tuple[CText, tuple[Frame, ...]]:
    """Return a drawn program in C and a trace, over which the host agrees with the interpreter."""
    program, trace = run_of_seed(seed, network=network)
    texts: list[CText] = []

    def make(compilation: object) -> CExecutor:
        texts.append(generate_c(compilation.compiled))  # type: ignore[attr-defined]
        return CExecutor(texts[0], built(texts[0]))

    found = disagreement(program, trace, {"generated C": make})
    assert found is None, str(found)
    return texts[0], trace
