"""Generated C against C by hand, and against generated Python: N behaviors in strict priority, as `decide`.

One binary has the generated step and one by hand with the same checks: the reading must be there, none of its
numbers NaN; they are clamped to the sensor's range, and the command to the actuator's, where it is finite.
Both are timed in turns over the same frames. On the host, the C is stepped through cffi from a list of
floats, against the bare call of the step after the same checks and the same conversion of the list.
"""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter, perf_counter_ns
from unittest.mock import patch

from benchmarks.decide import READINGS, SEED, Row, _command, _row, generated, main, workload
from colony.compile.backends.c.expressions import literal
from colony.compile.backends.c.generate import CText, generate_c
from colony.compile.backends.c.native import STRICT, CExecutor, built, compiler
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_file
from colony.ir.frame import Frame
from colony.verify.equivalence.prove import prove
from colony.verify.equivalence.results import EquivalenceProved

SIZES = (10, 100, 1000)
MODULES = 1000
ROUNDS = 41
BATCH_NS = 2_000_000
MOST_TIMES_HAND = 1.2
MOST_TIMES_BARE = 2.0
MOST_SECONDS = 10.0
MOST_TEXT = 24_000
MOST_RAM = 4_000

CORTEX_M7 = ("arm-none-eabi-gcc", "-mthumb", "-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mfloat-abi=hard")


def run() -> list[Row]:
    """One row a figure: name, value, unit, target (None: only told), ok, note."""
    rows: list[Row] = []
    for size in SIZES:
        text = generate_c(compile_program(workload(size)).compiled)
        frames = _frames(size)
        step, by_hand = steps(text, size, frames)
        rows.append(_row(f"N={size}, generated C / C by hand", step / by_hand, MOST_TIMES_HAND))
        rows += [
            _row(f"N={size}, {n}", x, None, "ns") for n, x in (("generated C", step), ("C by hand", by_hand))
        ]
        host, bare, python = on_host(text, size, frames)
        rows.append(_row(f"N={size}, through cffi / the bare call", host / bare, MOST_TIMES_BARE))
        for name, ns in (("C through cffi", host), ("bare call", bare), ("generated Python", python)):
            rows.append(_row(f"N={size}, {name}", ns, None, "ns"))
    rows.append(_row(f"compile, prove and build {MODULES} modules", built_in(MODULES), MOST_SECONDS, "s"))
    if shutil.which(CORTEX_M7[0]):
        code, ram = size_on_cortex()
        rows.append(_row("wander's step on a Cortex-M7, -Os", code, MOST_TEXT, "bytes"))
        rows.append(_row("wander's memory on a Cortex-M7", ram, MOST_RAM, "bytes"))
    return rows


def _frames(size: int) -> list[list[float]]:
    draw = random.Random(SEED)
    return [[draw.uniform(0.0, size / 4) for _ in range(size)] for _ in range(READINGS)]


# --- in one binary -------------------------------------------------------------------------------


def steps(text: CText, size: int, frames: list[list[float]]) -> tuple[float, float]:
    """Median nanoseconds a step of the generated C, and of the C by hand, which decide the same."""
    with tempfile.TemporaryDirectory() as folder:
        for name, content in (("h", text.header), ("c", text.source)):
            Path(folder, f"{text.name}.{name}").write_text(content)
        Path(folder, "hand.c").write_text(_by_hand(size))
        Path(folder, "main.c").write_text(_main(size, frames))
        sources = [f"{text.name}.c", "hand.c", "main.c"]
        _done([*compiler(), *STRICT, "-D_POSIX_C_SOURCE=199309L", *sources, "-o", "run", "-lm"], folder)
        found = json.loads(_done(["./run"], folder))
    return median(found["generated"]), median(found["hand"])


def _by_hand(size: int) -> str:
    chain = []
    for i in range(size):
        velocity, turn = _command(i, size, "s")
        chain += [f"    {'} else ' if i else ''}if (s[{i}] < 0.5) {{", f"        out->by = {i + 1};"]
        chain += [f"        v = {velocity};", f"        w = {turn};"]
    return f"""
#include "bench.h"
#include "hand.h"
void hand_step(const struct bench_frame *f, struct hand_outcome *out)
{{
    double s[{size}];
    double v = 0.0;
    double w = 0.0;
    out->by = 0;
    out->fault = 0;
    bool is_there = f->sensor.given == COLONY_GIVEN;
    bool is_clean = true;
    for (int i = 0; i < {size}; i++) {{
        const double x = f->sensor.value[i];
        is_there = is_there && x == x;
        s[i] = x < 0.0 ? 0.0 : x > {size / 4!r} ? {size / 4!r} : x;
        is_clean = is_clean && s[i] == x;
    }}
    out->sensor = !is_there ? 0 : is_clean ? 1 : 2;
    if (out->sensor == 0) {{
        out->velocity = 0.0;
        out->turn = 0.0;
        return;
    }}
{chr(10).join(chain)}
    }}
    if (v - v != 0.0 || w - w != 0.0) {{
        out->fault = 1;
        v = 0.0;
        w = 0.0;
    }} else if (out->by != 0) {{
        out->changed = 0;
        const double bounded_v = v < -600.0 ? -600.0 : v > 600.0 ? 600.0 : v;
        const double bounded_w = w < -90.0 ? -90.0 : w > 90.0 ? 90.0 : w;
        out->changed = bounded_v != v || bounded_w != w;
        v = bounded_v;
        w = bounded_w;
    }}
    out->velocity = v;
    out->turn = w;
}}
"""


_HAND_H = """
struct hand_outcome { int by; int fault; int sensor; int changed; double velocity; double turn; };
void hand_step(const struct bench_frame *f, struct hand_outcome *out);
"""


def _main(size: int, frames: list[list[float]]) -> str:
    rows = ",\n".join(
        f"{{.sensor = {{.value = {{{', '.join(literal(x).text for x in reading)}}}, .given = 1}}}}"
        for reading in frames
    )
    return f"""
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include "bench.h"
#include "hand.h"
static const struct bench_frame frames[{len(frames)}] = {{{rows}}};
static struct bench_memory m;
static struct bench_outcome out;
static struct hand_outcome by_hand;
static double now(void)
{{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec * 1e9 + (double)t.tv_nsec;
}}
static double timed(int hand, int count)
{{
    const double start = now();
    for (int i = 0; i < count; i++) {{
        if (hand) {{ hand_step(&frames[i % {len(frames)}], &by_hand); }}
        else {{ bench_step(&m, &frames[i % {len(frames)}], &out); }}
    }}
    return (now() - start) / count;
}}
int main(void)
{{
    bench_init(&m);
    for (int i = 0; i < {len(frames)}; i++) {{
        bench_step(&m, &frames[i], &out);
        hand_step(&frames[i], &by_hand);
        if ((int)out.drive.by != by_hand.by || out.drive.command.velocity != by_hand.velocity
            || out.drive.command.turn != by_hand.turn) {{ abort(); }}
    }}
    const int count = 1 + (int)({BATCH_NS}.0 / timed(0, 1000));
    double found[2][{ROUNDS}];
    for (int i = 0; i < {ROUNDS}; i++) {{
        for (int hand = 0; hand < 2; hand++) {{ found[hand][i] = timed(hand, count); }}
    }}
    for (int hand = 0; hand < 2; hand++) {{
        printf("%s\\"%s\\": [", hand ? ", " : "{{", hand ? "hand" : "generated");
        for (int i = 0; i < {ROUNDS}; i++) {{ printf("%s%.3f", i ? ", " : "", found[hand][i]); }}
        printf("]");
    }}
    printf("}}\\n");
    return 0;
}}
"""


def _done(command: list[str], folder: str) -> str:
    Path(folder, "hand.h").write_text(_HAND_H)
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout


# --- on the host ---------------------------------------------------------------------------------


def on_host(text: CText, size: int, readings: list[list[float]]) -> tuple[float, float, float]:
    """Median nanoseconds a frame from a list of floats: the executor, the bare call, generated Python."""
    module = built(text)
    executor = CExecutor(text, module)
    m, out, step = (
        module.ffi.new("struct bench_memory *"),
        module.ffi.new("struct bench_outcome *"),
        module.lib.bench_step,
    )
    module.lib.bench_init(m)

    def bare(reading: list[float]) -> None:
        executor.write(Frame(0, {"sensor": reading}))
        step(m, executor.frame, out)

    tick = generated(size)
    calls: list[Callable[[list[float]], object]] = [
        lambda reading: executor.step(Frame(0, {"sensor": reading})),
        bare,
        lambda reading: tick(0, {"sensor": reading}),
    ]
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(ROUNDS):
        for call, found in zip(calls, times, strict=True):
            start = perf_counter_ns()
            for reading in readings:
                call(reading)
            found.append((perf_counter_ns() - start) / len(readings))
    host, alone, python = map(median, times)
    return host, alone, python


def built_in(size: int) -> float:
    """Seconds to compile a program to C, to prove the C, and to build it for this computer, uncached."""
    program = workload(size)
    start = perf_counter()
    compilation = compile_program(program)
    text = generate_c(compilation.compiled)
    assert isinstance(prove(program, compilation, c=text), EquivalenceProved)
    with tempfile.TemporaryDirectory() as cache, patch.dict(os.environ, XDG_CACHE_HOME=cache):
        built(text)
    return perf_counter() - start


def size_on_cortex() -> tuple[int, int]:
    """Bytes of code and constants of wander's C, and of its memory, on a Cortex-M7."""
    path = Path(__file__).parent.parent / "behaviors/wander.colony"
    text = generate_c(compile_program(load_file(path)).compiled, "wander")
    with tempfile.TemporaryDirectory() as folder:
        for name, content in (("h", text.header), ("c", text.source)):
            Path(folder, f"{text.name}.{name}").write_text(content)
        Path(folder, "ram.c").write_text('#include "wander.h"\nstruct wander_memory m;\n')
        for name in ("wander", "ram"):
            _done([*CORTEX_M7, *STRICT[:-1], "-Os", "-c", f"{name}.c"], folder)
        tool = CORTEX_M7[0].replace("gcc", "size")
        [code] = re.findall(r"^ *(\d+)", _done([tool, "wander.o"], folder), re.MULTILINE)
        [ram] = re.findall(r"^ *\d+\s+\d+\s+(\d+)", _done([tool, "ram.o"], folder), re.MULTILINE)
    return int(code), int(ram)


if __name__ == "__main__":
    main(run())
