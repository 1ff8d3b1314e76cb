# make                 set up .venv and run the default study
# make test            set up .venv and run the tests
# make STUDY=davinci_tool results    run another study of config/studies, or one of yours: STUDY=my_lab.yaml
# make help            all targets

PYTHON ?= python3
CORES ?= 2
STUDY ?= thesis
VENV := .venv
PIP := $(VENV)/bin/python -m pip --disable-pip-version-check
STUDY_FILE := $(if $(filter-out thesis,$(STUDY)),$(if $(filter %.yaml,$(STUDY)),$(STUDY),config/studies/$(STUDY).yaml))
CONFIGFILE := $(if $(STUDY_FILE),--configfile $(STUDY_FILE))
SHIPPED := $(basename $(notdir $(wildcard config/studies/*.yaml)))
ifneq ($(STUDY_FILE),$(wildcard $(STUDY_FILE)))
$(error STUDY=$(STUDY): no file $(STUDY_FILE); give the path of a study, or one of: thesis $(SHIPPED))
endif
export PATH := $(CURDIR)/$(VENV)/bin:$(PATH)

.PHONY: results test test-statistical acceptance report provenance check-results update-reference benchmark lint format lock audit docs docs-site clean help environment cluster

results: environment ## every table, figure and FMU of the study (default target)
	@python -m lumbar.base.yaml_file $(STUDY_FILE) # Snakemake would name no file and no line
	snakemake --cores $(CORES) $(CONFIGFILE) --logger lumbar # workflow/snakemake_logger_plugin_lumbar

environment: $(VENV)/installed ## .venv from the lock

$(VENV)/installed: envs/build-lock.txt envs/lock.txt pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13) and "lumbar needs Python 3.11, 3.12 or 3.13, found " + sys.version.split()[0] + "; set PYTHON=python3.12 or so")'
	@echo "Setting up $(VENV), once: 400 MB of packages in their locked versions, two or three minutes; nothing is compiled"
	$(PYTHON) -m venv $(VENV)
	$(PIP) install --quiet --require-hashes -r envs/build-lock.txt
	$(PIP) install --quiet --require-hashes --no-build-isolation -r envs/lock.txt
	$(PIP) install --quiet --no-deps --no-build-isolation --editable .
	touch $@

$(VENV)/cluster: $(VENV)/installed envs/cluster-lock.txt
	$(PIP) install --quiet --require-hashes --no-deps --no-build-isolation -r envs/cluster-lock.txt
	touch $@

cluster: $(VENV)/cluster ## .venv with what SLURM and object storage need: docs/cluster.md

# A file stays with one worker, as its fixtures do; the longest come first, in order. A worker more than there are cores, for while
# one waits for a browser or a socket.
TEST := python -m pytest -n $$(($(CORES) + 1)) --dist loadfile --no-loadscope-reorder
test: environment ## the tests, but for those of the next target
	$(TEST)

test-statistical: environment ## rates over many draws, the default study whole, on one core and on two, ways through the whole program
	$(TEST) -m "statistical or nightly"

# Both suites run to their end; the status tells whether an answer is another one than recorded.
acceptance: environment ## records whose truth is known, public and hard ones: a judgement each, and docs/tissue/acceptance.md: minutes
	python tests/real_records/ask_records.py --markdown docs/tissue/acceptance.md; real=$$?; \
	python tests/hard_effects/ask_cases.py --markdown docs/tissue/acceptance.md && exit $$real

report: results ## results/<study>/report.html: every table and figure with the thesis's, one page, works offline
	snakemake --cores 1 $(CONFIGFILE) report

provenance: results ## results/<study>/provenance.html: Snakemake's own report: which job made what, when, from what
	snakemake --cores 1 $(CONFIGFILE) --report results/$(basename $(notdir $(STUDY)))/provenance.html

check-results: environment ## regenerate the default study and compare it with tests/reference
	snakemake --cores $(CORES) --forceall
	python tests/reference/check_results.py

update-reference: results ## take the default study's numbers as the new reference
	python tests/reference/check_results.py --update
	PYTHONPATH=docs python -m generate.thesis_items

# Sizes are small: without options the scripts take hours, and --markdown renews the table of a page.
benchmark: environment ## accuracy of the diagnosis, timings and memory, printed: half an hour
	snakemake --cores $(CORES) lifting
	python benchmarks/timings.py
	python benchmarks/growth.py
	python benchmarks/stability.py --starts 1000
	python benchmarks/alternation.py --knots 100
	python benchmarks/marker_faults.py
	python benchmarks/runtime.py
	python benchmarks/sensor_faults.py --records 100 --repeats 1
	python benchmarks/pendulum.py --seeds 1
	python benchmarks/calibration.py --count 1
	python benchmarks/hidden_effects/run.py --quick --processes $(CORES)

lint: environment ## what the continuous integration checks before the tests
	ruff check .
	ruff format --check .
	mypy
	snakefmt --check Snakefile workflow/rules
	snakemake --lint

format: environment ## put the sources into the house's format
	ruff check --fix .
	ruff format .
	snakefmt Snakefile workflow/rules

docs: environment ## renew the references of configuration keys, effects, the thesis's items and figures
	python docs/generate/configuration_reference.py
	python docs/generate/effects_reference.py
	python docs/generate/laboratory_tests.py
	PYTHONPATH=docs python -m generate.thesis_items
	python docs/generate/gallery.py
	python docs/generate/import_diagram.py
	python docs/generate/marker_sets.py

SITE := build/docs-venv
# An environment of its own, from the newest versions that pyproject.toml allows: .venv stays the lock's.
docs-site: ## build/docs-site: the pages and the API reference as a site (downloads MkDocs)
	$(PYTHON) -m venv $(SITE)
	$(SITE)/bin/pip install --quiet $$($(PYTHON) -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["dependency-groups"]["docs"])')
	NO_MKDOCS_2_WARNING=1 $(SITE)/bin/mkdocs build --strict --quiet

SOLVE := --universal --fork-strategy fewest --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --no-annotate --quiet
COMPILE := uv pip compile pyproject.toml $(SOLVE)
# The other packages are solved with the lock's versions at hand; derive.py keeps what the cluster's add.
lock: ## renew envs/ from pyproject.toml (needs uv)
	$(COMPILE) --group dev --upgrade -o envs/lock.txt
	cp envs/lock.txt envs/runtime-lock.txt
	$(COMPILE) -o envs/runtime-lock.txt
	cp envs/lock.txt envs/cluster-lock.txt
	$(COMPILE) --group dev --extra cluster -o envs/cluster-lock.txt
	echo pip-audit | uv pip compile - $(SOLVE) --upgrade -o envs/audit-lock.txt
	$(PYTHON) envs/derive.py

AUDIT := build/audit-venv
audit: ## known vulnerabilities of the locked versions (downloads pip-audit, which asks PyPI)
	$(PYTHON) -m venv $(AUDIT)
	$(AUDIT)/bin/pip install --quiet --require-hashes -r envs/audit-lock.txt
	$(AUDIT)/bin/python envs/audit.py

clean: ## remove results and caches, keep .venv
	rm -rf results .snakemake

help: ## this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 20
