# `make` lists what there is. Everything is run from here; each target sets up what is missing first.
.DEFAULT_GOAL := help
.PHONY: help setup build workspace demo test test-long compiled-tests lint audit docs bench bench-insertion bench-learning bench-gateway lock clean

python := .venv/bin/python3

# Compiled files are kept: each node and each process of the tests would otherwise compile all that it imports.
export PYTHONDONTWRITEBYTECODE =

help:  ## show this list
	@sed -nE 's/^([a-z-]+):[^#]*## (.*)/  make \1\t\2/p' Makefile | expand -t 16

setup:  ## set up what is missing: Debian packages, .venv, the build in install/; FOR="run planner sim window" only for these
	@.ci/setup $(FOR)

build:  ## build and install again, also when nothing has changed
	@rm -rf build install
	@.ci/setup

workspace:  ## set up for packages of your own: what the demo needs, and a compiler, which catkin_make looks for
	@.ci/setup run planner sim workspace

# The demos: the package and the program of each.
pick-place := skiros2_demo pick_place_demo
piston := skiros2_piston_demo piston_demo
connector := skiros2_connector_demo connector_demo
factory := skiros2_factory_demo factory_demo
push := skiros2_learning_demo push_demo
insertion-learning := skiros2_learning_demo insertion_learning_demo
demos := pick-place piston connector factory push insertion-learning
override DEMO := $(or $(DEMO),pick-place)
gui := $(filter-out 0 false no,$(GUI))

demo:  ## a robot picks and places; GUI=1 shows it, DEMO_ARGS="--disturb slip" disturbs it; DEMO=piston: two arms insert a piston; DEMO=connector: two arms plug in a connector; DEMO=factory: jobs from a MES; DEMO=push, DEMO=insertion-learning learn parameters
	@$(if $(filter $(demos),$(DEMO)),,echo "there is no demo $(DEMO): make demo DEMO=..., one of $(demos)" >&2; exit 2)
	@.ci/setup run planner sim $(if $(filter push insertion-learning,$(DEMO)),learning) $(if $(filter factory,$(DEMO)),gateway page) $(if $(gui),window)
	@exec .ci/in_ros rosrun $($(DEMO)) $(if $(gui),--gui) $(DEMO_ARGS)

# In the files' order: those with real nodes want the ROS client of their process to themselves, before any unit tests.
# Two processes more than there are cores, for tests of nodes wait a third of their time.
test: setup  ## run every test (pytest's own choice: .venv/bin/python3 -m pytest tests/unit)
	@$(MAKE) --no-print-directory --jobs 2 lint compiled-tests
	@exec .ci/in_ros $(python) -m pytest --numprocesses $$(($$(nproc) + 2)) --maxprocesses 4 \
		--dist loadfile --no-loadscope-reorder $(PYTEST_ARGS)

# One after the other: these measure times and load the machine themselves. Their tests state their own time limits.
test-long: setup  ## run the long tests: kills, soak, schemas, attacks, other runs of the demos (PYTEST_ARGS="-k NAME" selects)
	@.ci/setup optimisers
	@exec .ci/in_ros $(python) -m pytest --numprocesses 0 -o timeout=3600 -m long tests/long tests $(PYTEST_ARGS)

# Each of pytest's processes would otherwise compile all tests at the same time.
compiled-tests: setup
	@exec .ci/in_ros $(python) -m pytest --collect-only -qq >/dev/null

lint: setup  ## check style and types, also of the page's code
	@echo "ruff" && $(python) -m ruff check --quiet --output-format concise . && $(python) -m ruff format --check --quiet .
	@echo "mypy" && MYPYPATH=$$($(python) tests/support/packages.py) $(python) -m mypy --no-error-summary
	@echo "page" && PATH=$(CURDIR)/.venv/bin:$$PATH skiros2_std_lib/skiros2_gateway/web/check .venv/page

# Exit status: 0 none is known, 1 there are some, 2 not checked: no service of advisories answers.
audit: setup  ## look for known vulnerabilities of the pinned packages (pip-audit, npm audit); needs a network, and says if there is none
	@python3 -m venv build/audit && build/audit/bin/pip install --quiet pip-audit==2.10.1 || echo "pip-audit is missing"
	@exec .ci/audit

docs:  ## build the documentation's site with a generated reference in build/docs/site; fails on broken links and missing entries
	@.ci/setup run planner sim learning gateway dev docs window
	@exec .ci/in_ros $(python) docs/site/build.py

bench: setup  ## measure, print a table, write build/bench.json (PARTS="ticks planning" selects; COMPARE=REV: against a commit, in pairs; KEEP=1: docs/bench.md)
	@$(python) -m pip install --quiet --require-hashes --requirement requirements/bench.txt || echo "some planners are missing"
	@exec .ci/in_ros $(python) tests/benchmarks/run.py --json build/bench.json \
		$(if $(COMPARE),--compare $(COMPARE)) $(if $(KEEP),--keep) $(PARTS)

bench-insertion: setup  ## insert the piston on a grid of errors, clearances, bores and arms (hours; BENCH_ARGS="--runs 60" for a sample); write build/insertion.json
	@exec $(python) tests/benchmarks/insertion.py $(BENCH_ARGS)

bench-learning: setup  ## compare optimisers of skill parameters (up to two hours; BENCH_ARGS=--short); write build/learning.json
	@.ci/setup optimisers
	@exec $(python) tests/benchmarks/learning.py $(BENCH_ARGS)

bench-gateway: setup  ## measure the gateway: latency, 100 clients, kills, hostile requests (half an hour; BENCH_ARGS=--short); write build/gateway.json
	@exec .ci/in_ros $(python) tests/benchmarks/gateway.py $(BENCH_ARGS)

# Versions stay as they are; UPGRADE=1 takes the newest that the .in files allow.
lock:  ## compile requirements/*.in to *.txt, with the hashes of all files
	@.ci/setup run
	@cd requirements && for list in uv run core planner sim learning dev gateway page browser export optimisers bench docs; do \
		../.venv/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-annotate \
			--default-index https://pypi.org/simple --custom-compile-command "make lock" $(if $(UPGRADE),--upgrade) \
			$$([ $$list != core ] || echo --constraint run.txt) \
			$$([ $$list != optimisers ] || echo --find-links $${UV_FIND_LINKS:-https://download.pytorch.org/whl/cpu/torch/}) \
			$$list.in --output-file $$list.txt || exit; \
	done

clean:  ## remove what was built and the tools' caches (the environment in .venv stays)
	@rm -rf build install .pytest_cache .mypy_cache .ruff_cache .hypothesis
	@find . -path ./.venv -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +
