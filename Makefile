# palpate: the two commands are `make demo` and `make test`. `make help` lists the others.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
DEPLOY := .venv-deploy
VM     := vm
PIP    := $(BIN)/python -m pip --disable-pip-version-check --quiet

.DEFAULT_GOAL := help
.PHONY: help demo test lint unit demo-test kernel-test uml-test vm-test vm-disks board-image deploy-test wheelhouse firmware-mutation accuracy bench lock format system-deps clean

help:  ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 14

demo: $(VENV)/host.stamp  ## set up, then a simulated hand turns an object for 20 s, all processes real
	$(BIN)/palpate-host demo

test: lint unit demo-test  ## set up, then every check and test (tests whose tool is missing say so and skip)

lint: $(VENV)/dev.stamp  ## ruff, mypy, import-linter
	$(BIN)/ruff check .
	$(BIN)/ruff format --check --quiet . || { echo 'error: unformatted files: run make format'; exit 1; }
	$(BIN)/mypy
	$(BIN)/lint-imports

# Each worker has a core: threads of the matrix library beside it cost a third more processor time.
unit: export OPENBLAS_NUM_THREADS := 1
unit: $(VENV)/firmware.stamp $(DEPLOY)/stamp  ## pytest, but for the real-time demo; PYTEST_ARGS adds options
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -m "not demo" $(PYTEST_ARGS)

demo-test: $(VENV)/dev.stamp  ## the real-time demo's tests
	$(BIN)/pytest -m demo $(PYTEST_ARGS)

kernel-test: uml-test vm-test  ## the tests that need a kernel of their own

uml-test: $(VENV)/dev.stamp  ## those in user-mode Linux: SocketCAN (also part of make test)
	$(BIN)/pytest -m uml $(PYTEST_ARGS)

vm-test: $(VENV)/dev.stamp vm-disks  ## those in a virtual machine: SocketCAN, CAN cards, V4L2
	$(BIN)/pytest -m "$(VM)" $(PYTEST_ARGS)

vm-disks: $(VENV)/pyvenv.cfg  ## the virtual machine's disks, where they are missing (5 minutes, once)
	PYTHONPATH=tests/kernel $(BIN)/python -m kernel_guest.disks

board-image: $(VENV)/pyvenv.cfg  ## the bare board that is provisioned in tests, where it is missing (2 minutes, once)
	PYTHONPATH=tests/kernel:tests/deploy $(BIN)/python -m deploy_rig.image

wheelhouse: $(VENV)/host.stamp  ## build/wheelhouse: what boards install from, for aarch64 and x86-64 (docs/deploying.md)
	$(BIN)/python ansible/wheelhouse.py build/wheelhouse

deploy-test: $(VENV)/dev.stamp $(DEPLOY)/stamp  ## provision, update, roll back and break boards (root; docs/testing.md)
	@for tier in lint namespace hand foreign booted; do \
	  begin=$$(date +%s); $(BIN)/pytest tests/deploy -m "deploy_$$tier" -s --durations=0 $(PYTEST_ARGS) || exit 1; \
	  echo "deploy-test: $$tier took $$(($$(date +%s) - begin)) s"; done

firmware-mutation: $(VENV)/dev.stamp  ## break the firmware line by line, count what its tests notice (half an hour)
	$(BIN)/python tests/firmware/mutate.py

accuracy: $(VENV)/dev.stamp  ## write docs/accuracy.md and its picture from the recorded data (2 minutes)
	$(BIN)/python -m bench.accuracy

bench: $(VENV)/dev.stamp  ## a table of timings with ratios against the alternatives; TABLES="camera hand" for these only
	$(BIN)/python -m bench $(TABLES)

simulate: $(VENV)/dev.stamp  ## the paper's figures into paper/, the whole chain in lock step into loop/ (10 minutes)
	$(BIN)/palpate-host simulate paper
	$(BIN)/palpate-host simulate loop

format: $(VENV)/dev.stamp  ## format the sources
	$(BIN)/ruff check --fix-only --quiet .
	$(BIN)/ruff format .

lock: $(VENV)/dev.stamp  ## renew requirements/*.lock (hashes for x86-64 and aarch64)
	sh requirements/lock.sh $(BIN)/uv

system-deps:  ## what apt has and some tests use: tshark, user-mode Linux, qemu, gcc-avr (needs root or sudo)
	sh requirements/system-deps.sh
	@rm -f $(VENV)/firmware.stamp

clean:  ## remove the virtual environment, caches and the demo's output
	rm -rf $(VENV) $(DEPLOY) .cache .mypy_cache .ruff_cache .pytest_cache .hypothesis build dist demo/run demo/sensors demo/report.html

$(VENV)/pyvenv.cfg:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "error: $(PYTHON) is older than 3.11: give another one, as in make PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -m venv $(VENV) \
	  || { rm -rf $(VENV); echo "error: no venv module: apt install python3-venv, or give another PYTHON"; exit 1; }

$(VENV)/host.stamp: $(VENV)/pyvenv.cfg requirements/host.lock pyproject.toml
	@echo "installing what the host and the fingertip need into $(VENV)"
	@$(PIP) install --require-hashes -r requirements/host.lock
	@$(PIP) install --no-deps --no-build-isolation --editable .
	@touch $@

$(VENV)/dev.stamp: $(VENV)/host.stamp requirements/dev.lock
	@echo "installing the test tools into $(VENV)"
	@$(PIP) install --require-hashes -r requirements/dev.lock
	@touch $@

# What provisions boards is a program of its own, apart from palpate's environment.
$(DEPLOY)/stamp: requirements/deploy.lock
	@echo "installing ansible into $(DEPLOY)"
	@$(PYTHON) -m venv $(DEPLOY)
	@$(DEPLOY)/bin/python -m pip --disable-pip-version-check --quiet install --require-hashes -r requirements/deploy.lock
	@touch $@

# Compiles from source for a minute or two, so only where the firmware can be built.
$(VENV)/firmware.stamp: $(VENV)/dev.stamp requirements/firmware.lock
	@if command -v avr-gcc >/dev/null && command -v g++ >/dev/null && test -e /usr/include/libelf.h; then \
	  echo "installing the microcontroller's simulator into $(VENV)"; \
	  $(PIP) install --require-hashes -r requirements/firmware.lock; fi
	@touch $@
