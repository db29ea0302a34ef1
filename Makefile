# Everything a newcomer needs: `make demo`, `make test`. Each sets up what it needs in .venv; nothing is installed system-wide.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# A sourced ROS would put its own rclpy before the wheels of the venv; inside these targets it is left out.
CLEAN := env -u PYTHONPATH -u AMENT_PREFIX_PATH -u LD_LIBRARY_PATH -u ROS_DISTRO -u COLCON_PREFIX_PATH \
	-u _ROS_WHEELS_BOOTSTRAP_COMPLETE -u RMW_IMPLEMENTATION

.PHONY: help install demo test test-long lint bench convergence gallery measured court soak clean

help:
	@echo "make demo   install into .venv, run the demo, write demo/report.html"
	@echo "make test   install into .venv, run linters and all tests but the longest"
	@echo "make test-long  run the longest tests"
	@echo "make lint   ruff, mypy, import-linter"
	@echo "make bench  measure, and write docs/performance.md and the README's performance table"
	@echo "make convergence  how many domains a polycrystal needs: docs/convergence.md"
	@echo "make gallery  do what the pages of docs/gallery say, and put what comes out on them (five minutes)"
	@echo "make measured  judge the measured runs in ../shared/data, where they are: docs/measured.md"
	@echo "make court  the diagnosis judged on hidden effects: docs/court.md (hours; goes on where it stopped; SEED=, ROUNDS=)"
	@echo "make soak   perform every fault many times: docs/faults.md (an hour; goes on where it stopped; REPEAT=)"
	@echo "make clean  remove what these made"

install: $(VENV)/.installed

$(VENV)/.packages: pyproject.toml
	@[ -z "$$ROS_DISTRO" ] || echo "note: ROS '$$ROS_DISTRO' is sourced in this shell; these targets use the wheels in $(VENV) instead"
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(not (3, 10) <= v < (3, 14) and f"Python 3.10 to 3.13 is needed, this is {v[0]}.{v[1]}; try make PYTHON=python3.12")'
	@$(PYTHON) -m venv $(VENV) || { echo "python3-venv is missing: apt install python3-venv"; exit 1; }
	$(CLEAN) $(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

$(VENV)/.installed: $(VENV)/.packages
	$(CLEAN) $(BIN)/python -m pzt_ros.first_run
	@touch $@

demo: install
	$(CLEAN) $(BIN)/pzt demo --out demo --overwrite

# Where no result depends on time, three run at once (half of a graph's time is waiting). Of graphs that keep time, two do:
# they compute for less than half of it. The browser, and commands that come late, have the machine to themselves.
test: $(VENV)/.packages
	$(MAKE) --jobs 2 install lint
	$(CLEAN) $(BIN)/pytest --numprocesses 3 --dist loadscope --no-loadscope-reorder --durations 40 --ignore tests/graph --ignore tests/browser
	$(CLEAN) $(BIN)/pytest --numprocesses 2 --dist loadscope --durations 15 tests/graph --ignore tests/graph/test_pace.py
	$(CLEAN) $(BIN)/pytest --durations 5 tests/graph/test_pace.py tests/browser

test-long: install
	$(CLEAN) $(BIN)/pytest --numprocesses 2 -m long

lint: $(VENV)/.packages
	$(BIN)/ruff check --quiet .
	$(BIN)/ruff format --check --quiet .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: install
	$(CLEAN) $(BIN)/pzt bench --out docs/performance.json
	$(BIN)/python docs/make_performance.py

convergence: install
	$(CLEAN) $(BIN)/python -m pzt_benchmarks.convergence --out docs

gallery: install
	$(CLEAN) $(BIN)/python -m pzt_benchmarks.gallery

measured: install
	$(CLEAN) $(BIN)/python -m pzt_benchmarks.measured --out docs

SEED ?= 1
court: install
	$(CLEAN) $(BIN)/python -m pzt_benchmarks.residual_court --seed $(SEED) $(if $(ROUNDS),--rounds $(ROUNDS)) \
		--results runs/court-$(SEED).jsonl --out docs/court.md

soak: install
	$(CLEAN) $(BIN)/python -m pzt_benchmarks.soak $(if $(REPEAT),--repeat $(REPEAT)) --results runs/soak.json --out docs/faults.md

clean:
	rm -rf $(VENV) demo runs build *.egg-info
