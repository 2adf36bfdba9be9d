# Copyright the vislam_ros contributors
# SPDX-License-Identifier: Apache-2.0

# The Python to make the virtual environment with; 3.10 or later.
PYTHON ?= python3
# More arguments for pytest or the benchmark: make test ARGS='-k stereo'
ARGS ?=

SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help demo docs report bench test coverage lint hooks constraints colcon clean

VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

# A ROS 2 installation is used where there is one, with the packages that it was built against;
# elsewhere its wheels come with pip, and all versions are those of constraints.txt.
ROS_SETUP := $(wildcard /opt/ros/jazzy/setup.bash)
TOOLS := test,lint,colcon,dask,peers,report,view,docs
ifdef ROS_SETUP
ENTER := source $(ROS_SETUP) &&
VENV_OPTIONS := --system-site-packages
PACKAGES := -e '.[$(TOOLS)]'
else
ENTER :=
VENV_OPTIONS :=
PACKAGES := -e '.[ros,$(TOOLS)]' -c constraints.txt
endif

# Of `make constraints`: one interpreter of each Python that is supported.
PYTHONS ?= python3.10 python3.11 python3.12 python3.13

# Least share of the lines that the tests must reach, per cent.
CORE_FLOOR := 98
DATA_FLOOR := 97

IMAGES := results/demo_images
TRUTH := $(IMAGES)/truth.tum
DEMO := results/demo

# Of `make report` and `make bench`: a dataset or bag, and the truth about it. Empty simulates a
# drive.
SHARED_DATA ?= $(or $(VISLAM_SHARED_DATA),../shared/data)
DATA ?= $(wildcard $(SHARED_DATA)/10_synthetic.npz)
REFERENCE ?= $(wildcard $(dir $(DATA))ground_truth/$(basename $(notdir $(DATA))).tum)

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "make %-11s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

demo: $(READY) ## draw stereo images of a drive, run them live through the nodes, judge it: results/demo
	@mkdir -p results
	@$(ENTER) $(BIN)/vislam simulate $(IMAGES) --images --seed 1 --force
	@$(ENTER) $(BIN)/vislam run $(IMAGES) --rate 0 --out $(DEMO) --force
	@$(ENTER) $(BIN)/vislam track $(IMAGES) results/demo_tracks.npz --picture $(DEMO)/tracks.png --force
	@$(ENTER) $(BIN)/vislam plot $(DEMO) --reference $(TRUTH) --force
	@$(ENTER) $(BIN)/vislam evaluate $(DEMO) --reference $(TRUTH)
	@echo 'See $(DEMO)/trajectory.png and $(DEMO)/tracks.png'

report: $(READY) ## draw the report's figures 2 to 6: results/report; DATA=... REFERENCE=...
	@$(ENTER) $(BIN)/python tools/reproduce_report.py $(DATA) --force \
	  $(if $(REFERENCE),--reference $(REFERENCE))

docs: $(READY) ## build the documentation as a site that needs no network: results/site/index.html
	@$(BIN)/python -m sphinx -E -W --keep-going -q -c tools/docs_site . results/site
	@echo 'See results/site/index.html'

bench: $(READY) ## measure speed, peers and consistency, half an hour: results/bench.json
	@$(ENTER) OPENBLAS_NUM_THREADS=1 $(BIN)/python tools/bench.py $(if $(DATA),--data $(DATA)) \
	  $(if $(REFERENCE),--reference $(REFERENCE)) --force $(ARGS)

test: $(READY) ## run all tests on two cores
	@$(ENTER) $(BIN)/python -m pytest -q -n 2 --dist worksteal -m 'not alone' $(ARGS) || [ $$? = 5 ]
	@$(ENTER) $(BIN)/python -m pytest -q -m alone $(ARGS) || [ $$? = 5 ]

# Tests that count the lines they reach; the others start whole graphs, and reach no more.
COUNTED := test/core test/data test/cli test/nodes

coverage: $(READY) ## run all tests, and see that they reach nearly all lines of core and data
	@$(ENTER) $(BIN)/python -m pytest -q -n 2 --dist worksteal -m 'not alone' --cov --cov-report= $(COUNTED) $(ARGS)
	@$(BIN)/coverage report --skip-covered --include 'vislam_ros/core/*' --fail-under $(CORE_FLOOR)
	@$(BIN)/coverage report --skip-covered --include 'vislam_ros/data/*' --fail-under $(DATA_FLOOR)
	@$(ENTER) $(BIN)/python -m pytest -q -n 2 --dist worksteal -m 'not alone' $(addprefix --ignore ,$(COUNTED))
	@$(ENTER) $(BIN)/python -m pytest -q -m alone

lint: $(READY) ## mend the format, check style and types: .pre-commit-config.yaml
	@$(ENTER) $(BIN)/pre-commit run --all-files

hooks: $(READY) ## have git do the same before each commit
	@$(BIN)/pre-commit install

constraints: $(READY) ## choose the newest versions of all packages: constraints.txt; PYTHONS=...
	@$(BIN)/python tools/constraints.py '.[ros,$(TOOLS)]' $(PYTHONS) >$(VENV)/constraints.txt
	@mv $(VENV)/constraints.txt constraints.txt

colcon: $(READY) ## build the package with colcon into install/
	@$(ENTER) $(BIN)/colcon build --paths .

clean: ## remove everything that was made, the virtual environment too
	rm -rf $(VENV) build install log results *.egg-info
	rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage .coverage.*
	find vislam_ros test tools -name __pycache__ -exec rm -rf {} +

$(READY): setup.py constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
	  { echo 'error: Python 3.10 or later is needed: make PYTHON=/path/to/python3'; exit 1; }
	@echo 'Setting up $(VENV) (once; about 2.2 GB)'
	@$(PYTHON) -m venv $(VENV_OPTIONS) $(VENV)
	@$(ENTER) $(BIN)/pip install --disable-pip-version-check --use-pep517 $(PACKAGES) \
	  >$(VENV)/pip.log 2>&1 || { cat $(VENV)/pip.log; exit 1; }
	@# Compiles the filter's loops, so that the first node need not.
	@$(ENTER) $(BIN)/python -c 'import vislam_ros.core.filters.robocentric'
	@touch $@
