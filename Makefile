# Everything a checkout needs, on any Debian or Ubuntu with Python 3.11+ and make.

VENV ?= .venv
PYTHON ?= python3
VERSION ?= 1.0-mini
PAGE ?= page

STAMP := $(VENV)/.installed

.DEFAULT_GOAL := help
.PHONY: help quickstart test test-all lint types docs bench tables page bundle ci clean

help: ## list the targets
	@echo "Usage: make TARGET [VENV=$(VENV)] [PYTHON=$(PYTHON)] [VERSION=$(VERSION)]"
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-12s %s\n", $$1, $$2 }' Makefile

# The stamp is written last, so an interrupted installation is resumed.
$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) scripts/make_venv.py $(VENV)
	$(VENV)/bin/python -m pip install -c constraints.txt -e '.[all,dev]'
	@touch $@

quickstart: $(STAMP) ## install everything, build VERSION, show it and load a first batch
	$(VENV)/bin/synthnet build --version $(VERSION)
	$(VENV)/bin/synthnet info --version $(VERSION)
	$(VENV)/bin/python examples/first_batch.py $(VERSION)
	@echo "Now: . $(VENV)/bin/activate"

test: $(STAMP) ## run the quick tests, one process per core
	$(VENV)/bin/python -m pytest -n auto --dist loadfile -m "not slow"

test-all: test ## run the quick tests, then the slow ones
	$(VENV)/bin/python -m pytest -n auto --dist loadfile -m slow

lint: $(STAMP) ## check style and formatting
	$(VENV)/bin/python -m ruff check
	$(VENV)/bin/python -m ruff format --check

types: $(STAMP) ## check the types
	$(VENV)/bin/python -m mypy

docs: $(STAMP) bundle ## build documentation and leaderboard into site/; a broken link fails
	$(VENV)/bin/python -m sphinx --quiet --fail-on-warning --keep-going -j auto -c docs . site
	$(VENV)/bin/eigbench site --out site/board --docs "../docs/{}.html"

bench: $(STAMP) ## measure solver, building, harness and network, each against a peer
	$(VENV)/bin/python -m evidence measure solver --out -
	$(VENV)/bin/python -m evidence measure build-cost --out -
	$(VENV)/bin/synthnet build --version 1.0-mini
	$(VENV)/bin/python -m evidence measure harness-overhead --out -
	$(VENV)/bin/python -m evidence measure gcn --version 1.0-mini --out -
	@echo "after a build of 1.0: $(VENV)/bin/python -m evidence measure loading --out -"

tables: $(STAMP) ## write docs/reproduction.md: the paper's tables beside ours
	$(VENV)/bin/python -m evidence.reproduction

page: $(STAMP) bundle ## write the leaderboard alone, as a page, into PAGE
	$(VENV)/bin/eigbench site --out $(PAGE)

bundle: $(STAMP) # the page's scripts, from benchmark/page/src
	cd benchmark/page && PATH="$(abspath $(VENV))/bin:$$PATH" npm ci
	cd benchmark/page && PATH="$(abspath $(VENV))/bin:$$PATH" npm run build

ci: lint types docs test-all ## run all checks: lint, types, docs and every test

clean: ## remove the virtual environment and all caches
	rm -rf $(VENV) .mypy_cache .pytest_cache .ruff_cache build dist site *.egg-info
	rm -rf benchmark/page/node_modules benchmark/page/dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
