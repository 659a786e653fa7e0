# Everything a checkout needs, on any Debian or Ubuntu with Python 3.11+ and make.

VENV ?= .venv
PYTHON ?= python3
DATASET ?= 1.0-mini
PAGE ?= page
SITE ?= site
# Where the project is published, https://HOST/OWNER/NAME: the site then links to code there.
export REPOSITORY ?=

STAMP := $(VENV)/.installed
# One process per core and one thread each: threads of two processes would wait for each other.
PYTEST := OMP_NUM_THREADS=1 $(VENV)/bin/python -m pytest -n auto --dist loadfile

.DEFAULT_GOAL := help
.PHONY: help quickstart test test-all lint types docs bench tables page sbom bundle ci clean

help: ## list the targets
	@echo "Usage: make TARGET [VENV=$(VENV)] [PYTHON=$(PYTHON)] [DATASET=$(DATASET)]"
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-12s %s\n", $$1, $$2 }' Makefile

# The stamp is written last, so an interrupted installation is resumed.
$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) scripts/make_venv.py $(VENV)
	$(VENV)/bin/python -m pip install -c constraints.txt -e '.[all,dev]'
	@touch $@

quickstart: $(STAMP) ## install everything, build DATASET, show it and load a first batch
	$(VENV)/bin/synthnet build $(DATASET)
	$(VENV)/bin/synthnet info $(DATASET)
	$(VENV)/bin/python examples/first_batch.py $(DATASET)
	@echo "Now: . $(VENV)/bin/activate"

test: $(STAMP) ## run the quick tests, one process per core
	$(PYTEST) -m "not slow"

test-all: test ## run the quick tests, then the slow ones
	$(PYTEST) -m slow

lint: $(STAMP) ## check style and formatting
	$(VENV)/bin/python -m ruff check
	$(VENV)/bin/python -m ruff format --check

types: $(STAMP) ## check the types
	$(VENV)/bin/python -m mypy

docs: $(STAMP) bundle ## build documentation and leaderboard into SITE (site/); a broken link fails
	$(VENV)/bin/python -m sphinx --quiet --fail-on-warning --keep-going -j auto -c docs . $(SITE)
	$(VENV)/bin/eigbench site --out $(SITE)/board --docs "../docs/{}.html" $(if $(REPOSITORY),--code "$(REPOSITORY)/blob/main/{}")

bench: $(STAMP) ## measure solver, building, harness and network, each against a peer
	$(VENV)/bin/python -m evidence measure solver --out -
	$(VENV)/bin/python -m evidence measure peers --out -
	$(VENV)/bin/python -m evidence measure build-cost --out -
	$(VENV)/bin/synthnet build 1.0-mini
	$(VENV)/bin/python -m evidence measure harness-overhead --out -
	$(VENV)/bin/python -m evidence measure gcn --version 1.0-mini --out -
	@echo "after a build of 1.0: $(VENV)/bin/python -m evidence measure loading --out -"

tables: $(STAMP) ## write docs/reproduction.md: the paper's tables beside ours
	$(VENV)/bin/python -m evidence fill reproduction

page: $(STAMP) bundle ## write the leaderboard alone, as a page, into PAGE
	$(VENV)/bin/eigbench site --out $(PAGE)

sbom: $(STAMP) ## list all packages with versions and licences, in CycloneDX, into sbom.json and sbom-page.json
	$(PYTHON) -m venv $(VENV)-sbom  # apart, since its packages delay every start of eigbench by a second
	$(VENV)-sbom/bin/python -m pip install -q -c constraints.txt cyclonedx-bom
	$(VENV)-sbom/bin/cyclonedx-py environment --pyproject pyproject.toml --output-reproducible --output-file sbom.json $(VENV)/bin/python
	cd benchmark/page && PATH="$(abspath $(VENV))/bin:$$PATH" npm sbom --package-lock-only --sbom-format cyclonedx > ../../sbom-page.json

bundle: $(STAMP) # the page's scripts, from benchmark/page/src
	cd benchmark/page && PATH="$(abspath $(VENV))/bin:$$PATH" npm ci
	cd benchmark/page && PATH="$(abspath $(VENV))/bin:$$PATH" npm run build

ci: lint types docs test-all ## run all checks: lint, types, docs and every test

clean: ## remove the virtual environment and all caches
	rm -rf $(VENV) $(VENV)-sbom .mypy_cache .pytest_cache .ruff_cache build dist site page sbom*.json *.egg-info
	rm -rf benchmark/page/node_modules benchmark/page/dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
