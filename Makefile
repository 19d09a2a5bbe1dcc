# make help lists what there is. Everything runs in .venv, which the first target that needs it makes.
SHELL := /bin/bash

# The virtual environment brings its own ROS 2: one that is sourced in this shell must not mix with it.
unexport PYTHONPATH PYTHONHOME LD_LIBRARY_PATH AMENT_PREFIX_PATH COLCON_PREFIX_PATH CMAKE_PREFIX_PATH
unexport ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION RMW_IMPLEMENTATION
# Compiled once: tests are parsed and their assertions rewritten anew by each process else, a third of a minute in all.
unexport PYTHONDONTWRITEBYTECODE
# Nothing that is started here talks to other machines.
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST

# Options of the demo, e.g. `make demo BAG=drive.mcap RATE=1`.
BAG ?=
RATE ?=
FRAMES ?=
SEED ?=
MODEL ?=
OUT ?= out/demo
# Share of the cases of `make adversary`.
SHARE ?= 0.1
# Pages of `make docs`; all of them if none is named.
PAGES ?=

# Two compute, and a third fills the time in which live nodes wait; whole files each, the slow ones first (test/conftest.py).
IN_PARALLEL := -n 3 --dist loadfile --no-loadscope-reorder
ALONE = $(shell grep -rl --include='*.py' 'pytest.mark.alone' test)
EXHAUSTIVE = $(shell grep -rl --include='*.py' 'pytest.mark.exhaustive' test)
ENDURANCE = $(shell grep -rl --include='*.py' 'pytest.mark.endurance' test)

# Version of `make release`.
VERSION ?=

.PHONY: help demo test test-exhaustive test-devkit test-fleet adversary check check-all docs site generate lint lint-files format wheel release clean

help: ## this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1\t/' | expand -t 11

demo: .venv/installed ## a drive through the live node, with a report [BAG=path] [RATE=1] [FRAMES=n] [SEED=n] [MODEL=file] [OUT=folder]
	@.venv/bin/python -m demo --out "$(OUT)" $(if $(BAG),--bag "$(BAG)") $(if $(RATE),--rate "$(RATE)") \
	    $(if $(FRAMES),--frames "$(FRAMES)") $(if $(SEED),--seed "$(SEED)") $(if $(MODEL),--model "$(MODEL)")

test test-exhaustive check check-all: export ROS_PYTHON_CHECK_FIELDS := 1
test: .venv/installed .venv/messages.installed ## all tests, three at a time [PYTEST_ARGS="test/node -k life"]
ifdef PYTEST_ARGS
	@.venv/bin/python -m pytest $(PYTEST_ARGS)
else
	@.venv/bin/python -m pytest $(IN_PARALLEL) -m "not alone and not exhaustive and not endurance"
	@.venv/bin/python -m pytest -m alone $(ALONE)
endif

test-exhaustive: .venv/installed .venv/docs.installed ## what `make test` tries in part, pages in a browser, the notebook
	@.venv/bin/python -m pytest -n 2 -m exhaustive $(EXHAUSTIVE)

# nuScenes' devkit wants numpy < 2, so it has an environment of its own.
.venv/nuscenes-devkit/installed: .venv/installed
	@python3 -m venv .venv/nuscenes-devkit
	@.venv/nuscenes-devkit/bin/python -m pip install --quiet 'numpy<2' nuscenes-devkit==1.2.0
	@touch $@

test-devkit: .venv/nuscenes-devkit/installed ## nuScenes' own devkit judges what is exported and imported in its schema
	@NUSCENES_DEVKIT_PYTHON=.venv/nuscenes-devkit/bin/python .venv/bin/python -m pytest test/datasets/test_against_the_devkit.py

# Ray, and a server of S3 for tests, are no part of what a developer needs.
.venv/fleet.installed: .venv/installed
	@.venv/bin/python -m pip install --quiet -c constraints.txt --no-build-isolation -e '.[fleet]' 'moto[server]>=5'
	@touch $@

test-fleet: .venv/fleet.installed ## drives on a cluster of Ray, and in storage
	@.venv/bin/python -m pytest test/fleet

adversary: .venv/installed ## attacks the package with a part of the hostile inputs of `make check-all` [SHARE=0.1]
	@.venv/bin/python -m benchmarks.adversary --share "$(SHARE)" --seed 1

check: .venv/installed lint ## lint, types and the fast tests, between two edits
	@.venv/bin/python -m pytest -n 2 --dist loadfile -m "not alone and not exhaustive and not endurance and not slow" --durations 5 --durations-min 2 -q

check-all: .venv/installed .venv/messages.installed lint ## all tests in both number formats, hostile inputs, hooks, workflows, wheels, docs
	@for format in float32 bfloat16; do \
	    printf '\n== %s\n' "$$format"; RADCAM_DEPTH_PRECISION=$$format $(MAKE) --no-print-directory test || exit 1; done
	@$(MAKE) --no-print-directory test-exhaustive
	@$(MAKE) --no-print-directory test-devkit
	@$(MAKE) --no-print-directory test-fleet
	@.venv/bin/python -m pytest -n 2 -m endurance $(ENDURANCE)
	@.venv/bin/python -m benchmarks.fuzz --messages 20000 --seed 1
	@.venv/bin/python -m benchmarks.adversary --seed 1
	@$(MAKE) --no-print-directory lint-files
	@$(MAKE) --no-print-directory wheel
	@$(MAKE) --no-print-directory docs
	@$(MAKE) --no-print-directory site

docs: .venv/docs.installed ## executes the commands of README, docs and --help, in copies [PAGES="README.md --help"]
	@.venv/bin/python scripts/documented_commands.py $(PAGES)

site: .venv/docs.installed ## writes the docs as a site to out/site; fails on a broken link
	@NO_MKDOCS_2_WARNING=1 .venv/bin/python -m mkdocs build --strict --site-dir out/site

generate: .venv/installed ## writes the pages that follow from the package's tables: parameters, outputs
	@.venv/bin/python scripts/generate_pages.py

lint: .venv/installed ## ruff, mypy, bandit and known vulnerabilities of dependencies, as CI runs them
	@.venv/bin/python -m ruff check .
	@.venv/bin/python -m ruff format --check .
	@.venv/bin/python -m mypy
	@.venv/bin/python -m bandit --quiet --configfile pyproject.toml --recursive radcam_depth_ros
	@.venv/bin/python scripts/audit_dependencies.py

lint-files: .venv/release.installed ## pre-commit's hooks, and the workflows with actionlint and zizmor
	@.venv/bin/python -m pre_commit run --all-files
	@scripts/lint_workflows

format: .venv/installed ## format and sort imports in place
	@.venv/bin/python -m ruff check --fix .
	@.venv/bin/python -m ruff format .

wheel: .venv/release.installed ## builds the wheels into dist/, and tries them in a fresh environment outside of the checkout
	@.venv/bin/python scripts/release.py

release: .venv/release.installed ## the same for a new version, and writes it and the changelog VERSION=1.2.3
	@test -n "$(VERSION)" || { echo "make release: say which version, for example VERSION=1.2.3" >&2; exit 1; }
	@.venv/bin/python scripts/release.py "$(VERSION)"

clean: ## remove what was built, made and measured here, .venv included
	@rm -rf .venv build dist install log out *.egg-info

.venv/installed: setup.py setup.cfg constraints.txt scripts/make_venv
	@scripts/make_venv

# Apart, since tests need none of these.
.venv/release.installed: .venv/installed
	@.venv/bin/python -m pip install --quiet -c constraints.txt --no-build-isolation -e '.[release]'
	@touch $@

# What shows: Rerun, the docs' site, the notebook, and what drives a browser in tests.
.venv/docs.installed: .venv/installed
	@.venv/bin/python -m pip install --quiet -c constraints.txt --no-build-isolation -e '.[view,docs]'
	@touch $@

.venv/messages.installed: .venv/installed scripts/make_messages $(wildcard scripts/message_packages/* scripts/message_packages/*/* scripts/message_packages/*/msg/*)
	@scripts/make_messages
