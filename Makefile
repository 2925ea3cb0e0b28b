# `make demo` needs Python 3.11 or later. `make test` needs Node 20 and npm too, and from Python 3.12 on a C++ compiler,
# since PyBullet has no wheels there. With Chromium (Debian's package, or what the variable CHROMIUM names) `make test` runs
# the browser tests too.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
CLIENTS := tests/clients/node
BROWSER := tests/browser/node

.PHONY: demo test lint types unit bench paper load soak fuzz mutants conformance client-grades clean

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade 'pip>=25.1'

# Everything a user needs to run the server.
$(STAMP): pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

# What the checks and the tests need on top of it.
$(STAMP)-dev: pyproject.toml $(STAMP)
	$(BIN)/python -m pip install --quiet --group dev
	touch $@

# The npm releases of the client libraries that the tests drive, exactly as the lock file names them.
$(CLIENTS)/node_modules/.installed $(BROWSER)/node_modules/.installed: \
%/node_modules/.installed: %/package-lock.json
	npm ci --prefix $* --no-audit --no-fund --loglevel=error
	touch $@

demo: $(STAMP)
	$(BIN)/rwt serve --demo

lint: $(STAMP)-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

types: $(STAMP)-dev
	$(BIN)/mypy

unit: $(STAMP)-dev $(CLIENTS)/node_modules/.installed $(BROWSER)/node_modules/.installed
	$(BIN)/pytest

test: lint types unit

# Whole-process figures beside a yardstick, as ratios; needs Linux. `make bench ARGS=--quick` is the short run.
bench: $(STAMP)
	$(BIN)/python -m bench $(ARGS)

# The paper's figures beside ours, and plots in build/paper; `make paper ARGS=fig3` is one of them.
paper: $(STAMP)-dev
	$(BIN)/python -m pip install --quiet --group paper
	$(BIN)/python -m bench.paper $(ARGS)

# A thousand clients, ten of them stopped dead; about a minute, needs Linux.
load: $(STAMP)
	$(BIN)/python -m bench.load_1000 $(ARGS)

# Ten minutes of clients that come and go; `make soak ARGS='--seconds 60'` is a shorter run. Needs Linux.
soak: $(STAMP)
	$(BIN)/python -m bench.soak $(ARGS)

# Fuzzing guided by coverage, two minutes; `make fuzz ARGS='--seconds 600 session bridge'` for more of some.
fuzz: $(STAMP)-dev
	$(BIN)/python -m pip install --quiet --group fuzz
	$(BIN)/python -m tests.fuzz $(ARGS)

# Small faults put into our server one by one; the conformance suite has to find every one.
mutants: $(STAMP)-dev
	$(BIN)/python -m tests.conformance.mutants $(ARGS)

# Grades the client libraries and writes docs/reference/client-grades.md.
GRADE := $(BIN)/python -m conformance client --jobs 6
GRADES := .grades
client-grades: $(STAMP)-dev $(CLIENTS)/node_modules/.installed
	mkdir -p $(GRADES)
	$(GRADE) --target roslib-2 --json $(GRADES)/1 -- node conformance/adapters/roslib.mjs $(CLIENTS)
	$(GRADE) --target roslib-1 --json $(GRADES)/2 -- node conformance/adapters/roslib.mjs $(CLIENTS) roslib1
	$(GRADE) --target roslibpy --json $(GRADES)/3 -- $(BIN)/python conformance/adapters/roslibpy_adapter.py
	$(GRADE) --target tests/conformance/rwt-client.toml --json $(GRADES)/4 -- \
		$(BIN)/python -m tests.conformance.rwt_client_adapter
	$(BIN)/python tools/generate_client_grades.py $(GRADES)/[1-4]
	rm -r $(GRADES)

# Every case of the suite against our server over every transport; six minutes, most of them for the pipes.
conformance: $(STAMP)-dev
	$(BIN)/python -m tests.conformance.transports

clean:
	rm -rf $(VENV) $(CLIENTS)/node_modules $(BROWSER)/node_modules tests/browser/screenshots
