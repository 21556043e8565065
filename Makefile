# palpate: `make demo` shows it, `make check` runs the fast tests, `make test` all tests. `make help` lists all targets.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
DEPLOY := .venv-deploy
RELEASE_KEY ?= $(HOME)/.ssh/palpate-release
ROS    := .venv-ros
DCFGEN := .cache/dcfgen
LEROBOT := .venv-lerobot
LEROBOT_PYTHON ?= $(firstword $(wildcard $(HOME)/.pyenv/versions/3.12.*/bin/python3.12) python3.12)
VM     := vm
SUITES := bookworm trixie
KERNELS := $(wildcard edge/palpate_edge/kernels/*.[ch])
TIERS  := namespace hand killed foreign booted cuts
PIP    := $(BIN)/python -m pip --disable-pip-version-check --quiet

# pytest, with a file of the tests' durations for `make slowest`. Each worker has a core: further threads of the matrix
# library would cost a third more processor time. Compiled modules are kept also where the surroundings forbid it: without
# them each process that a test starts has to compile them again.
PYTEST  = OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= $(BIN)/pytest --junitxml=.cache/tests/$@.xml
# Many tests of `unit` wait for processes, so it has one worker more than the two cores of the published times.
WORKERS = -n 2 --dist loadfile --no-loadscope-reorder
UNIT_WORKERS = -n 3 --dist loadfile --no-loadscope-reorder

# $(call timed,COMMAND): run it and print how long it took.
timed = @begin=$$(date +%s); $(1); status=$$?; echo "make $@: $$(($$(date +%s) - begin)) s"; exit $$status

.DEFAULT_GOAL := help
.PHONY: help demo check check-tests test lint lint-format lint-ruff lint-types lint-rooms unit slow-test slowest demo-test kernel-test uml-test vm-test ros-test dcfgen-test kicad-test lerobot-test vm-disks board-image deploy-test wheelhouse release-key coverage mutation firmware-mutation accuracy coverage-slow quiet-test console-pictures schematic bench lock format system-deps clean nightly weekly canopennode-test deploy-bookworm deploy-trixie

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 14

demo: $(VENV)/host.stamp  ## set up, then run the real processes with a simulated hand that turns an object for 20 s
	$(BIN)/palpate-host demo
	@echo 'palpate-edge and palpate-host are in $(BIN); to type them without the folder: export PATH="$(CURDIR)/$(BIN):$$PATH"'

# $(call beside_lint,TARGETS): make the targets while the linters run; the linters' output is printed at the end.
beside_lint = $(MAKE) --no-print-directory --output-sync=recurse lint & lint=$$!; \
  $(MAKE) --no-print-directory $(1); tests=$$?; wait $$lint && test $$tests = 0

check: $(VENV)/dev.stamp  ## set up, then check format, lint, types and rooms, and run the tests that need no process, FEM or kernel
	$(call timed,$(call beside_lint,check-tests))

check-tests: $(VENV)/dev.stamp
	$(call timed,$(PYTEST) -q $(WORKERS) -m check $(PYTEST_ARGS))

test: $(VENV)/dev.stamp $(VENV)/firmware.stamp $(DEPLOY)/stamp  ## set up, then run every check and test except slow-test and vm-test (a test whose tool is missing skips)
	$(call timed,$(call beside_lint,unit demo-test))

lint: lint-format lint-ruff lint-types lint-rooms  ## run ruff, mypy and import-linter

lint-format: $(VENV)/dev.stamp
	$(call timed,$(BIN)/ruff format --check --quiet . || { echo 'error: unformatted files: run make format'; false; })

lint-ruff: $(VENV)/dev.stamp
	$(call timed,$(BIN)/ruff check .)

lint-types: $(VENV)/dev.stamp
	$(call timed,$(BIN)/mypy)

lint-rooms: $(VENV)/dev.stamp
	$(call timed,$(BIN)/lint-imports)

unit: $(VENV)/firmware.stamp $(DEPLOY)/stamp  ## run the tests except the real-time demo's; PYTEST_ARGS adds options
	$(call timed,$(PYTEST) $(UNIT_WORKERS) -m "not demo" $(PYTEST_ARGS))

slow-test: $(VENV)/firmware.stamp $(DEPLOY)/stamp  ## run at full length the tests that make test shortens, and boards in namespaces (root)
	$(call timed,$(PYTEST) $(WORKERS) --effort=full -m "slow or reduced or deploy_namespace" $(PYTEST_ARGS))

slowest:  ## list the 30 slowest tests of the last runs
	@$(BIN)/python -m tests.slowest

demo-test: $(VENV)/dev.stamp  ## run the real-time demo's tests
	$(call timed,$(PYTEST) -m demo $$(grep -rl --include='test_*.py' 'pytest.mark.demo' tests) $(PYTEST_ARGS))

kernel-test: uml-test vm-test  ## run the tests that need a kernel of their own

uml-test: $(VENV)/dev.stamp  ## run the tests in user-mode Linux: SocketCAN (also part of make test)
	$(call timed,$(PYTEST) -m uml $(PYTEST_ARGS))

vm-test: $(VENV)/dev.stamp vm-disks  ## run the tests in a virtual machine: SocketCAN, CAN cards, V4L2
	$(call timed,$(PYTEST) -m "$(VM)" $(PYTEST_ARGS))

ros-test: $(ROS)/stamp  ## run the tests of palpate-host ros with rclpy, in an environment of their own (network namespaces: root)
	$(call timed,OPENBLAS_NUM_THREADS=1 $(ROS)/bin/python -m pytest tests/host/ros -m ros $(PYTEST_ARGS))

quiet-test: $(VENV)/dev.stamp  ## measure what needs a computer without other work: CAN FD in real time, two browsers (it prints the figures)
	$(call timed,$(PYTEST) --effort=full -m quiet -rP $(PYTEST_ARGS))

dcfgen-test: $(VENV)/dev.stamp $(DCFGEN)/stamp  ## run dcfgen of ros2_canopen on docs/ros2_canopen/bus.yml and configure a fingertip with the result
	$(call timed,$(PYTEST) tests/edge/node/test_ros2_canopen.py -m dcfgen $(PYTEST_ARGS))

kicad-test: $(VENV)/dev.stamp  ## check the schematic of the light and its netlist with kicad-cli (KiCad 8 or newer)
	$(call timed,$(PYTEST) tests/firmware/test_schematic.py -m kicad $(PYTEST_ARGS))

schematic:  ## write netlist and picture of the light's schematic (kicad-cli, chromium)
	kicad-cli sch export netlist --format pads -o firmware/board/light-netlist.asc firmware/board/light.kicad_sch
	kicad-cli sch export svg -o build firmware/board/light.kicad_sch
	chromium --headless --no-sandbox --screenshot=docs/board-light.png --window-size=1123,795 build/light.svg

canopennode-test: $(VENV)/dev.stamp  ## run CANopenNode's programs as master and slave (PALPATE_CANOPENNODE: a checkout of CANopenDemo to build them from)
	$(call timed,$(PYTEST) tests/kernel -m canopennode $(PYTEST_ARGS))

lerobot-test: $(VENV)/dev.stamp $(LEROBOT)/stamp  ## run LeRobot's recorder, loader and replay with the twin; LEROBOT_PYTHON is 3.12 or newer
	$(call timed,$(PYTEST) tests/integrations -m lerobot $(PYTEST_ARGS))

vm-disks: $(VENV)/pyvenv.cfg  ## build the virtual machine's disks if they are missing (5 minutes, once)
	PYTHONPATH=tests/kernel $(BIN)/python -m kernel_guest.disks

board-image: $(VENV)/pyvenv.cfg  ## build the bare boards that tests provision, if they are missing (4 minutes, once)
	PYTHONPATH=tests/kernel:tests/deploy $(BIN)/python -m deploy_rig.image

wheelhouse: $(VENV)/host.stamp  ## write build/wheelhouse, from which boards install, for aarch64 and x86-64, Python 3.11 and 3.13
	$(BIN)/python ansible/wheelhouse.py build/wheelhouse $(if $(wildcard $(RELEASE_KEY)),--key $(RELEASE_KEY))
	@test -e $(RELEASE_KEY) || echo 'not signed, so no board installs it: make release-key, or RELEASE_KEY=FILE; docs/deploying.md'

release-key:  ## make the key that signs releases, ~/.ssh/palpate-release, with a password
	ssh-keygen -t ed25519 -C palpate-release -f $(RELEASE_KEY)

deploy-test:  ## provision, update, roll back and break boards of Debian 12 and 13 (root; docs/testing.md)

nightly: TIERS = hand namespace foreign booted
nightly:  ## the tiers of deploy-test that are the same each day (root)

weekly: export PALPATE_KILLS = all
weekly: export PALPATE_CUTS = 200
weekly: TIERS = killed cuts
weekly:  ## site.yml killed after each task that changes a board, and 200 power cuts in an update (root; hours; SUITES=bookworm: one suite)

# A hand stops when its processes are late, so that tier has the computer to itself; in the others the suites share it.
deploy-test nightly weekly: $(VENV)/dev.stamp $(DEPLOY)/stamp
	$(call timed,$(MAKE) --no-print-directory --keep-going --jobs=1 $(SUITES:%=deploy-%) TIERS="$(filter hand,$(TIERS))"; \
	  hand=$$?; $(MAKE) --no-print-directory --keep-going --jobs=2 $(SUITES:%=deploy-%) TIERS="$(filter-out hand,$(TIERS))" \
	  && test $$hand = 0)

deploy-bookworm deploy-trixie: deploy-%: $(VENV)/dev.stamp $(DEPLOY)/stamp  ## the same of one suite, a log for each tier in build/deploy
	@mkdir -p build/deploy; failed=; for tier in $(TIERS); do begin=$$(date +%s); log=build/deploy/$*-$$tier.log; \
	  result=passed; PALPATE_SUITE=$* $(BIN)/pytest tests/deploy -m "deploy_$$tier" -s --durations=0 $(PYTEST_ARGS) >$$log 2>&1 \
	    || { result=failed; failed=1; }; \
	  echo "deploy-$*: $$tier $$result, $$(($$(date +%s) - begin)) s ($$log)"; done; test -z "$$failed"

# Coverage slows the tests down: the run takes a quarter of an hour on two idle cores.
coverage: $(VENV)/firmware.stamp $(DEPLOY)/stamp  ## measure line coverage of make test (without the demo) by room, into build/coverage
	@mkdir -p build/coverage
	$(call timed,COVERAGE_CORE=ctrace COVERAGE_FILE=build/coverage/data $(PYTEST) $(WORKERS) -m "not demo" \
	  -vv --durations=0 --durations-min=0 --cov=palpate_edge --cov=palpate_bus --cov=palpate_host --cov=palpate_twin \
	  --cov-context=test --cov-report= $(PYTEST_ARGS) >build/coverage/tests.log; \
	  tests=$$?; tail -n 1 build/coverage/tests.log; test $$tests = 0)
	@$(BIN)/python -m tests.coverage_by_room build/coverage/data | tee build/coverage/rooms.md

coverage-slow: build/coverage/data  ## add the slow tests that PYTEST_ARGS names to that coverage, into build/coverage/rooms-slow.md
	$(call timed,COVERAGE_CORE=ctrace COVERAGE_FILE=build/coverage/slow $(PYTEST) $(WORKERS) -q --effort=full \
	  -m "slow or reduced" --cov=palpate_edge --cov=palpate_bus --cov=palpate_host --cov=palpate_twin --cov-report= $(PYTEST_ARGS))
	@COVERAGE_FILE=build/coverage/both $(BIN)/coverage combine --quiet --keep build/coverage/data build/coverage/slow
	@$(BIN)/python -m tests.coverage_by_room build/coverage/both | tee build/coverage/rooms-slow.md

mutation: build/coverage/data  ## change 320 lines of estimation, control, safety and node one by one, count the changes that tests detect (hours)
	$(BIN)/python -m tests.mutation.run --workers 2 $(MUTATION_ARGS)

build/coverage/data:
	$(MAKE) coverage

firmware-mutation: $(VENV)/dev.stamp  ## change the firmware line by line, count the changes that its tests detect (half an hour)
	$(BIN)/python tests/firmware/mutate.py

accuracy: $(VENV)/dev.stamp  ## write docs/accuracy.md and its picture from the recorded data (2 minutes)
	$(BIN)/python -m bench.accuracy

console-pictures: $(VENV)/dev.stamp  ## renew docs/console*.jpg: the pages as their tests see them in Chromium (2 minutes)
	PALPATE_PICTURES=1 $(PYTEST) --effort=full tests/edge/console/test_page.py tests/edge/console/test_guide_page.py tests/host/console/test_hand_page.py tests/twin/press_rig/test_rig_page.py

bench: $(VENV)/dev.stamp  ## print tables of timings and their ratios to alternatives; TABLES="camera hand" selects tables
	$(BIN)/python -m bench $(TABLES)

simulate: $(VENV)/dev.stamp  ## write the paper's figures to paper/ and the whole chain in lock step to loop/ (10 minutes)
	$(BIN)/palpate-host simulate paper
	$(BIN)/palpate-host simulate loop

format: $(VENV)/dev.stamp  ## format the sources
	$(BIN)/ruff check --fix-only --quiet .
	$(BIN)/ruff format .

lock: $(VENV)/dev.stamp  ## renew requirements/*.lock (hashes for x86-64 and aarch64)
	sh requirements/lock.sh $(BIN)/uv

system-deps:  ## install the apt packages that some tests use: tshark, user-mode Linux, qemu, gcc-avr, chromium, openscad (needs root or sudo)
	sh requirements/system-deps.sh
	@rm -f $(VENV)/firmware.stamp

clean:  ## remove the virtual environment, caches and the demo's output
	rm -rf $(VENV) $(DEPLOY) $(ROS) $(LEROBOT) .cache .import_linter_cache .mypy_cache .ruff_cache .pytest_cache .hypothesis build dist demo/run demo/run.lock demo/sensors demo/report.html

$(VENV)/pyvenv.cfg:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "error: $(PYTHON) is older than 3.11: give another one, for example make PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -m venv $(VENV) \
	  || { rm -rf $(VENV); echo "error: no venv module: apt install python3-venv, or give another PYTHON"; exit 1; }

$(VENV)/host.stamp: $(VENV)/pyvenv.cfg requirements/host.lock requirements/kernels.lock pyproject.toml hatch_build.py $(KERNELS)
	@echo "installing the packages of host and fingertip into $(VENV)"
	@$(PIP) install --require-hashes -r requirements/host.lock -r requirements/kernels.lock
	@$(PIP) install --no-deps --no-build-isolation --editable .
	@touch $@

$(VENV)/dev.stamp: $(VENV)/host.stamp requirements/dev.lock
	@echo "installing the test tools into $(VENV)"
	@$(PIP) install --require-hashes -r requirements/dev.lock
	@touch $@

# ansible is a separate program with an environment of its own.
$(DEPLOY)/stamp: requirements/deploy.lock
	@echo "installing ansible into $(DEPLOY)"
	@$(PYTHON) -m venv $(DEPLOY)
	@$(DEPLOY)/bin/python -m pip --disable-pip-version-check --quiet install --require-hashes -r requirements/deploy.lock
	@touch $@

$(DCFGEN)/stamp: requirements/dcfgen.lock
	@echo "installing dcfgen into $(DCFGEN)"
	@$(PYTHON) -m venv $(DCFGEN)
	@$(DCFGEN)/bin/python -m pip --disable-pip-version-check --quiet install --require-hashes -r requirements/dcfgen.lock
	@touch $@

# ROS 2 beside the packages and tools of $(VENV), which it does not change.
$(ROS)/stamp: $(VENV)/dev.stamp requirements/ros.lock ros/build_interfaces.py $(wildcard ros/palpate_msgs/action/*.action)
	@echo "installing ROS 2 into $(ROS)"
	@$(VENV)/bin/python -m venv $(ROS)
	@$(ROS)/bin/python -m pip --disable-pip-version-check --quiet install --require-hashes -r requirements/ros.lock
	@$(BIN)/python -c 'import sysconfig; print("import site; site.addsitedir(%r)" % sysconfig.get_path("purelib"))' \
	  >"$$($(ROS)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/development.pth"
	@if command -v g++ >/dev/null; then $(ROS)/bin/python ros/build_interfaces.py; fi
	@touch $@

# LeRobot needs a newer Python and other versions of NumPy and OpenCV than $(VENV), so nothing is shared.
$(LEROBOT)/stamp: requirements/lerobot.lock integrations/lerobot_robot_palpate/pyproject.toml
	@echo "installing LeRobot into $(LEROBOT)"
	@$(LEROBOT_PYTHON) -m venv $(LEROBOT)
	@$(LEROBOT)/bin/python -m pip --disable-pip-version-check --quiet install --require-hashes -r requirements/lerobot.lock
	@$(LEROBOT)/bin/python -m pip --disable-pip-version-check --quiet install --no-deps --no-build-isolation \
	  --editable integrations/lerobot_robot_palpate
	@touch $@

# The simulator is compiled from source in a minute or two, so only if the firmware can be built.
$(VENV)/firmware.stamp: $(VENV)/dev.stamp requirements/firmware.lock
	@if command -v avr-gcc >/dev/null && command -v g++ >/dev/null && test -e /usr/include/libelf.h; then \
	  echo "installing the microcontroller's simulator into $(VENV)"; \
	  $(PIP) install --require-hashes -r requirements/firmware.lock; fi
	@touch $@
