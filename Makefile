# `make` lists what there is. Everything is run from here; each target sets up what is missing first.
.DEFAULT_GOAL := help
.PHONY: help setup build demo test lint bench clean

python := .venv/bin/python3

help:  ## show this list
	@sed -nE 's/^([a-z]+):[^#]*## (.*)/  make \1\t\2/p' Makefile | expand -t 16

setup:  ## set up what is missing: Debian packages, .venv, the build in install/
	@.ci/setup

build:  ## build and install anew, also when nothing has changed
	@rm -rf build install
	@.ci/setup

demo: setup  ## a simulated robot picks and places; GUI=1 shows it in a window, DEMO_ARGS="--disturb slip" disturbs it
	@exec .ci/in_ros rosrun skiros2_sim_skills pick_place_demo $(if $(filter-out 0 false no,$(GUI)),--gui) $(DEMO_ARGS)

# In the files' order: those with real nodes want the ROS client of their process to themselves, before any unit tests.
# One process more than there are cores, for tests of nodes wait a third of their time.
test: lint  ## run every test (pytest's own choice: .venv/bin/python3 -m pytest tests/unit)
	@exec .ci/in_ros $(python) -m pytest --numprocesses $$(($$(nproc) + 1)) --maxprocesses 4 \
		--dist loadfile --no-loadscope-reorder $(PYTEST_ARGS)

lint: setup  ## check style and types
	@echo "ruff" && $(python) -m ruff check --quiet --output-format concise .
	@echo "mypy" && $(python) -m mypy --no-error-summary

bench: setup  ## measure, print a table, write build/bench.json
	@$(python) -m pip install --quiet --requirement tests/benchmarks/requirements.txt || echo "goes on without some planners"
	@exec .ci/in_ros $(python) tests/benchmarks/run.py --json build/bench.json

clean:  ## remove what was built and the tools' caches (the environment in .venv stays)
	@rm -rf build install .pytest_cache .mypy_cache .ruff_cache .hypothesis
	@find . -path ./.venv -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +
