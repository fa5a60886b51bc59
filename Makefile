# Each target stands alone: it makes the environment where there is none, installs, and does its job.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV   ?= .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed

SECONDS ?= 60
SEED    ?= 1
SEEDS   ?= 10000
TRIALS  ?= 100
MODULE  ?=
SAMPLE  ?=
WORKERS ?= 2

.PHONY: run test test-long check format bench soak stops loss attack tables mutants clean

run: $(STAMP)
	$(BIN)/colony run behaviors/wander.colony --map maps/loop.stickrep --duration 60 --seed 1 --picture run.png

test: $(STAMP)
	$(BIN)/python -m pytest -n auto --dist worksteal tests

test-long: $(STAMP)
	$(BIN)/python -m pytest -n auto --dist worksteal -m long tests

check: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

format: $(STAMP)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(STAMP)
	$(BIN)/python -m benchmarks

soak: $(STAMP)
	$(BIN)/python -m tests.runtime.assembly.processes.soak --seconds $(SECONDS) --seed $(SEED)

stops: $(STAMP)
	$(BIN)/python -m tests.runtime.arbitration.stops_kept --trials $(TRIALS) --seed $(SEED)

loss: $(STAMP)
	$(BIN)/python -m tests.runtime.assembly.loss_policy --seeds $(SEEDS)

attack: $(STAMP)
	$(BIN)/python -m tests.attack

tables: $(STAMP)
	$(BIN)/python -m colony.dsl.tables

mutants: $(STAMP)
	$(BIN)/python -m tests.mutants $(MODULE) $(if $(SAMPLE),--sample $(SAMPLE)) --workers $(WORKERS)

$(STAMP): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	$(BIN)/python -m compileall -q colony
	touch $(STAMP)

clean:
	rm -rf $(VENV) build *.egg-info run.png
