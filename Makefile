# Every target builds its own .venv when it is missing or when pyproject.toml or constraints.txt changed.
# Needed beforehand: make, and Python 3.11 or later with its venv module (Debian: apt install make python3-venv).

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
# One more than there are processors: a test often waits for a kernel that another one is compiling.
WORKERS := $(shell n=$$(nproc 2>/dev/null || echo 1); echo $$((n < 4 ? n + 1 : 4)))
PIP    := $(BIN)/pip install --quiet --disable-pip-version-check -c constraints.txt

# Matplotlib keeps its font list here instead of in the home directory.
export MPLCONFIGDIR := $(CURDIR)/$(VENV)/matplotlib

# Some containers forbid Python to keep what it compiled: the tests start some two hundred processes that would all do it again.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo test quick thorough machines lint kernels rewritten unit virtual realtime shared alone bench docs clean

help: ## list the targets
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1	\2/p' Makefile | expand -t 18

demo: $(VENV)/dev.stamp ## move the emulated PUMA 560 through the paper's experiment
	$(BIN)/qrobot demo

test: $(VENV)/dev.stamp ## the checks of every change: lint, then the test suite
	@$(MAKE) --no-print-directory -j 2 lint kernels rewritten
	@$(MAKE) --no-print-directory unit
	@echo "make test: every check has passed"

# Without a browser, an arm that runs and most programs in C: nine in ten of all tests on virtual time.
quick: $(VENV)/dev.stamp ## lint, and the tests of units and contracts on virtual time (three minutes, warm)
	@$(MAKE) --no-print-directory -j 2 lint kernels rewritten
	@$(MAKE) --no-print-directory virtual FILES="tests/unit tests/contract tests/golden"

# Tests marked `thorough` are wide and long forms of what others show: every change is tested without them.
thorough: $(VENV)/dev.stamp ## make test, with the wide and long forms of its tests too (a quarter of an hour, warm)
	@$(MAKE) --no-print-directory test LEFT_OUT=

LEFT_OUT := and not thorough

# A test on the wall clock may be run again so often: `make test RERUNS=0` for not at all.
RERUNS ?= 2
unit realtime shared alone: export QROBOT_RERUNS := $(RERUNS)

FILES := # of tests on virtual time; all, if none are named

kernels rewritten unit virtual realtime shared alone machines: export QROBOT_CACHE := $(CURDIR)/.pytest_cache/qrobot

kernels: $(VENV)/dev.stamp
	@echo "compiling ..."
	@$(BIN)/python -m tests.support.kernels

# Pytest rewrites the assertions of each test file once: five processes that start together would each do it.
rewritten: .pytest_cache/rewritten.stamp

.pytest_cache/rewritten.stamp: $(VENV)/dev.stamp $(shell find tests -name '*.py')
	@mkdir -p $(@D)
	@$(BIN)/python -m pytest --collect-only -qq > $(VENV)/rewritten.txt 2>&1 || { cat $(VENV)/rewritten.txt; exit 1; }
	@touch $@

# Tests on virtual time share out the processors, file by file and in order: the longest files are not the last. Those on
# the wall clock wait more than they compute: they run beside the others, in two rows, of which one is all on one arm, and
# the others get what they leave of the processors. What they print comes when they are done.
IDLE := $(shell command -v chrt >/dev/null && echo chrt --idle 0 || echo nice -n 19)

unit: $(VENV)/dev.stamp
	@$(MAKE) --no-print-directory -j 3 shared alone virtual

virtual: $(VENV)/dev.stamp
	$(IDLE) $(BIN)/python -m pytest -m "not realtime $(LEFT_OUT)" --numprocesses $(WORKERS) --dist loadfile --no-loadscope-reorder --max-worker-restart 0 $(FILES)

shared: SHARES := and shared_arm
alone: SHARES := and not shared_arm
shared alone: $(VENV)/dev.stamp
	@$(BIN)/python -m pytest -m "realtime $(SHARES) $(LEFT_OUT)" > $(VENV)/$@.txt 2>&1; status=$$?; cat $(VENV)/$@.txt; exit $$status

realtime: $(VENV)/dev.stamp
	@$(MAKE) --no-print-directory -j 2 shared alone

machines: $(VENV)/dev.stamp ## the tests on slow, busy and fast machines made out of this one (two hours)
	$(BIN)/python -m tests.machines

lint: $(VENV)/dev.stamp ## style, import contracts, types, spelling
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports --no-logo
	$(BIN)/mypy
	$(BIN)/codespell

bench: $(VENV)/bench.stamp ## measure this machine (half an hour; wants a quiet one)
	$(BIN)/python -m benchmarks

docs: $(VENV)/docs.stamp ## build docs/_build/html; a warning is an error
	@rm -rf docs/api docs/_build  # left by a build that was killed, or by one whose warnings would not be told again
	$(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

clean: ## remove everything the targets made, .venv included
	rm -rf $(VENV) out dist build docs/_build docs/api .pytest_cache .mypy_cache .ruff_cache .hypothesis \
	    .import_linter_cache .coverage
	find . -name __pycache__ -prune -exec rm -rf {} +

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null \
	    || { echo "$(PYTHON) is missing or older than 3.11: apt install python3 (or make PYTHON=python3.12 ...)" >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV) >/dev/null 2>&1 \
	    || { rm -rf $(VENV); echo "$(PYTHON) cannot create .venv: apt install python3-venv" >&2; exit 1; }

$(VENV)/dev.stamp: pyproject.toml constraints.txt | $(BIN)/python
	@echo "installing into $(VENV) ..."
	@$(PIP) -e '.[dev]'
	@touch $@

$(VENV)/bench.stamp: $(VENV)/dev.stamp
	@$(PIP) -e '.[dev,bench]'
	@touch $@

$(VENV)/docs.stamp: $(VENV)/dev.stamp
	@$(PIP) -e '.[dev,docs]'
	@touch $@
