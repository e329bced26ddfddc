# Sets up everything in .venv from wheels, ROS 2 Jazzy included, and runs the demo, the tests and the linters there.
# On a sourced ROS 2 installation use colcon instead: colcon build --paths . msg_defs

PYTHON ?= python3
SEED ?= 1
ROBOT ?= ur5

VENV := .venv
BIN := $(VENV)/bin
STAMPS := $(VENV)/stamps
LOGS := $(VENV)/log

SHELL := /bin/sh
.DEFAULT_GOAL := setup
.DELETE_ON_ERROR:

# What a sourced ROS installation, or a Python of another environment that started this make, would smuggle in.
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE
ifdef AMENT_PREFIX_PATH
unexport LD_LIBRARY_PATH
endif

# $(call logged,NAME,COMMAND): runs COMMAND with its output in a log; shows the end of it if it fails.
logged = mkdir -p $(LOGS) && { $(2) ; } > $(LOGS)/$(1).log 2>&1 || { tail -n 30 $(LOGS)/$(1).log >&2; \
	echo "make: $(1) failed; the whole log is $(LOGS)/$(1).log" >&2; exit 1; }

.PHONY: setup demo test lint docs clean help FORCE

setup: $(STAMPS)/package $(STAMPS)/messages $(STAMPS)/kernels ## install everything into .venv (the default)

demo: setup ## plan for a robot in a cluttered scene; SEED=1 ROBOT=ur5
	@$(BIN)/bsp-planner demo --seed $(SEED) --robot $(ROBOT)

test: setup ## run the tests
	@$(BIN)/python -m pytest

lint: setup ## ruff and mypy
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check
	@$(BIN)/mypy

docs: $(STAMPS)/docs-tools ## build the site of docs/ into build/site, and check its links
	@$(BIN)/zensical build --strict --clean
	@echo "docs: build/site/index.html"

clean: ## remove .venv and all build results and caches
	rm -rf $(VENV) build install log dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis .cache
	find . -name __pycache__ -type d -not -path './.git/*' -prune -exec rm -rf {} +

help: ## this list
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1\t\2/p' $(firstword $(MAKEFILE_LIST)) | expand -t 16
	@echo 'PYTHON=... chooses the Python that .venv is made of; to change it later: make clean first.'

# --- setup ------------------------------------------------------------------------------------------------------------
# One stamp a step, so that a change repeats only the steps that it touches, and an interrupted setup goes on where it
# stopped. The stamps live in .venv: they go when it goes.

# An environment cannot be moved: its scripts name its path. One that came with a moved or copied checkout is made anew.
ifeq ($(shell test -f $(BIN)/pip && ! grep -qF "$(CURDIR)/$(VENV)/bin/python" $(BIN)/pip && echo moved),moved)
$(STAMPS)/venv: FORCE
endif

$(STAMPS)/venv:
	@sh tools/check_prerequisites.sh "$(PYTHON)"
	@if grep -qsF "$(CURDIR)/$(VENV)/bin/python" $(BIN)/pip && $(BIN)/python -m pip --version > /dev/null 2>&1; then \
		echo "setup: $(VENV) is there"; \
	else \
		echo "setup: making $(VENV)"; rm -rf $(VENV) && "$(PYTHON)" -m venv $(VENV); \
	fi
	@mkdir -p $(STAMPS) && touch $@

# Touched only if the requirements differ: most changes of setup.py do not concern them.
$(STAMPS)/requirements.txt: setup.py tools/requirements.py $(STAMPS)/venv
	@{ $(BIN)/python tools/requirements.py ros learning baselines view test lint && echo 'setuptools>=64'; } > $@.new
	@cmp -s $@.new $@ || cp $@.new $@

# pip writes RECORD last: a package without one was being installed when an earlier setup was interrupted.
$(STAMPS)/dependencies: $(STAMPS)/requirements.txt constraints.txt
	@echo "setup: installing the dependencies (a few minutes the first time)"
	@for info in $(VENV)/lib/python3*/site-packages/*.dist-info; do \
		test ! -d "$$info" || test -f "$$info/RECORD" || rm -rf "$$info"; done
	@$(call logged,dependencies,$(BIN)/python -m pip install --no-input --disable-pip-version-check \
		-r $(STAMPS)/requirements.txt -c constraints.txt)
	@ls $(VENV)/lib/python3*/site-packages | grep -E '^(ros_|numpy-)' > $(STAMPS)/ros-versions.new
	@cmp -s $(STAMPS)/ros-versions.new $(STAMPS)/ros-versions || cp $(STAMPS)/ros-versions.new $(STAMPS)/ros-versions
	@touch $@

# What the messages are built against; older than the dependencies if those changed elsewhere only.
$(STAMPS)/ros-versions: $(STAMPS)/dependencies
	@:

# The folders are named too, since a removed file shows only in them.
$(STAMPS)/messages: $(STAMPS)/ros-versions tools/build_messages.py cmake/drop_foreign_python_includes.cmake \
		$(wildcard msg_defs/* msg_defs/*/*)
	@echo "setup: building the messages (half a minute)"
	@$(call logged,messages,$(BIN)/python tools/build_messages.py --build-dir $(VENV)/build/msg_defs)
	@touch $@

$(STAMPS)/package: setup.py setup.cfg package.xml $(STAMPS)/dependencies
	@echo "setup: installing the package"
	@$(call logged,package,$(BIN)/python -m pip install --no-input --disable-pip-version-check \
		--no-deps --no-build-isolation -e .)
	@touch $@

# The kernels' compiler caches on disk what it compiled, so that no user waits for it.
$(STAMPS)/kernels: $(STAMPS)/package bsp_informed_planner/compiled.py \
		$(shell find bsp_informed_planner -name '*kernels*.py' -o -name 'warm_up.py')
	@echo "setup: compiling the kernels (one to three minutes)"
	@$(call logged,kernels,$(BIN)/python -m bsp_informed_planner.compile_kernels)
	@touch $@

# What builds the site. It reads the sources and imports nothing of them: neither package nor dependencies are needed.
$(STAMPS)/docs-tools: setup.py tools/requirements.py constraints.txt $(STAMPS)/venv
	@$(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 11) and "make docs: needs Python 3.11 or newer")'
	@$(BIN)/python tools/requirements.py --extras-only docs > $(STAMPS)/docs-requirements.txt
	@echo "docs: installing the generator"
	@$(call logged,docs-tools,$(BIN)/python -m pip install --no-input --disable-pip-version-check \
		-r $(STAMPS)/docs-requirements.txt -c constraints.txt)
	@touch $@

FORCE:
