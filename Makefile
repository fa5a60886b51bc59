# Each target stands alone: it makes the environment where there is none, installs, and does its job.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV   ?= .venv
BIN    := $(VENV)/bin
SIM    := $(VENV)/.sim
DEV    := $(VENV)/.dev

SECONDS ?= 60
SEED    ?= 1
SEEDS   ?= 10000
TRIALS  ?= 100
ROUNDS  ?= 50
MODULE  ?=
SAMPLE  ?=
WORKERS ?= 2
RELEASE ?= jazzy
ROS2_SAMPLE := many_types or topics_alone

# Tests start many processes; without bytecode each of them would compile all that it imports.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: run test test-long test-thorough ros2 ros2-sample browser vscode check format bench soak stops loss agreement angles attack wheel mutants clean

run: $(SIM)
	$(BIN)/colony run wander --map loop --duration 60 --seed 1 --picture run.png

test: $(DEV)
	$(BIN)/python -m pytest -n auto --dist worksteal tests

test-long: $(DEV)
	$(BIN)/python -m pytest -n auto --dist worksteal -m 'long and not thorough and not ros2' tests

test-thorough: $(DEV)
	$(BIN)/python -m pytest -n auto --dist worksteal -m thorough tests

ros2: $(DEV)
	-ROS2_RELEASE=$(RELEASE) $(BIN)/python -m tests.ros2.environment
	-ROS2_RELEASE=$(RELEASE) $(BIN)/python -m tests.ros2.nav2
	ROS2_RELEASE=$(RELEASE) $(BIN)/python -m pytest -n 0 -rs -m ros2 tests/ros2

# Beside the suite the machine is busy, and nodes may not find each other in time: what fails is tried once more.
ros2-sample: $(DEV)
	-ROS2_RELEASE=$(RELEASE) timeout 300 $(BIN)/python -m tests.ros2.environment
	for options in '' '--last-failed'; do ROS2_RELEASE=$(RELEASE) $(BIN)/python -m pytest -n 0 -rs -m ros2 \
	-o cache_dir=.pytest_cache/ros2 -k '$(ROS2_SAMPLE)' $$options tests/ros2 && break; test -z "$$options"; done

browser: $(DEV)
	npm install --silent --no-audit --no-fund --no-save --prefix build/axe axe-core@4.14.1
	WATCH_PICTURE=docs/watch.png $(BIN)/python -m pytest -n 0 -m '' tests/watch/browser

vscode: $(DEV)
	$(BIN)/python -m tools.editor_grammar
	cp LICENSE editors/vscode/LICENSE
	cd editors/vscode && npm install --silent --no-audit --no-fund && npm run --silent package

check: $(DEV)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

format: $(DEV)
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(DEV)
	$(BIN)/python -m benchmarks

soak: $(DEV)
	$(BIN)/colony robot test rome --duration $(SECONDS) --seed $(SEED)
	$(BIN)/python -m tools.freezes --rounds $(ROUNDS) --seed $(SEED)

stops: $(DEV)
	$(BIN)/python -m tools.stops_kept --trials $(TRIALS) --seed $(SEED)

loss: $(DEV)
	$(BIN)/python -m tools.loss --seeds $(SEEDS)

agreement: $(DEV)
	$(BIN)/python -m tools.drawn_programs --workers $(WORKERS)
	$(BIN)/python -m tools.layouts --workers $(WORKERS)

angles: $(DEV)
	$(BIN)/python -m tools.angles_trial --seed $(SEED) --workers $(WORKERS)

attack: $(DEV)
	$(BIN)/python -m tools.attack

wheel: $(DEV)
	$(BIN)/python -m tools.wheel --platforms

mutants: $(DEV)
	$(BIN)/python -m tools.mutants $(MODULE) $(if $(SAMPLE),--sample $(SAMPLE)) --workers $(WORKERS)

$(VENV)/.%: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[$*]'
	$(BIN)/python -m compileall -q colony
	touch $@

clean:
	rm -rf $(VENV) build *.egg-info run.png
