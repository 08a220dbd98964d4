# The two commands of the README are `make demo` and `make test`; both work from a bare clone.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
DEMO_VENV ?= .venv-demo
# Twice: errors are shown, but no warning for every place that a user's pip configuration names in vain.
QUIETLY := --quiet --quiet
# Half of the time tests wait for processes that they start: twice as many are run at once as there are processors.
WORKERS ?= $(shell echo $$((2 * $$(nproc))))
PYTEST := $(BIN)/pytest --dist loadfile --no-loadscope-reorder

# Tests start processes by the hundred. Each would compile every module anew where nothing compiled may be kept.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test quick lint types imports compiled interpreted unit interfaces browser scxml-tests benchmarks overhead mutants soak clean

# The lab tour on Zenoh: models -> nodes -> a running, tapped system. No ROS, no questions. TAP=1: all that is heard.
demo: $(DEMO_VENV)/.installed
	@$(DEMO_VENV)/bin/python examples/lab_tour/demo.py $(if $(filter-out 0,$(TAP)),--tap)

$(DEMO_VENV)/.installed: pyproject.toml
	@echo "Installing m2c and moon into $(DEMO_VENV) (about a minute, once) ..."
	@$(PYTHON) -m venv $(DEMO_VENV)
	@$(DEMO_VENV)/bin/python -m pip install $(QUIETLY) --disable-pip-version-check -e .
	@touch $@

$(VENV)/.installed: pyproject.toml
	@echo "Installing everything, the ROS 2 wheels included, into $(VENV) ..."
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install $(QUIETLY) --disable-pip-version-check -e '.[dev,ros2]'
	@touch $@

# Beside the compiler, which uses one processor, the checks and the tests that need nothing compiled.
test: $(VENV)/.installed
	@$(MAKE) --no-print-directory --output-sync=line -j 2 compiled types lint imports browser interfaces scxml-tests unit-interpreted
	@$(MAKE) --no-print-directory unit

# After an edit, within two minutes, with what is installed; nothing has to be compiled. Left out: what is marked so
# (pyproject.toml says what each means), and import rules.
QUICK_WITHOUT ?= zenoh or ros2 or slow
quick:
	@test -x $(BIN)/pytest || { echo "Nothing is installed in $(VENV): make test does that first."; exit 2; }
	@$(MAKE) --no-print-directory --assume-old=$(VENV)/.installed lint types
	@$(PYTEST) -x -q -r fE -n $(shell nproc) -p tests.interpreted -m "not ($(QUICK_WITHOUT) or soak)"
	@echo "Left out: $(QUICK_WITHOUT); make test has them."

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.installed
	$(BIN)/mypy

imports: $(VENV)/.installed
	$(BIN)/lint-imports

# What compiles needs a compiler and Python's headers. Where they are missing it is left out, and so is what tests it.
HEADERS = "import os, sys, sysconfig; sys.exit(not os.path.isfile(sysconfig.get_path('include') + '/Python.h'))"
CAN_COMPILE = command -v c++ > /dev/null && command -v cc > /dev/null && $(BIN)/python -c $(HEADERS)
NO_COMPILER = no C and C++ compiler with Python's headers (apt-get install g++ python3-dev)

# The examples' interface packages, built by colcon for ROS 2.
interfaces: $(VENV)/.installed
	@if $(CAN_COMPILE); then $(MAKE) --no-print-directory --assume-old=$(VENV)/.installed packages; \
	 else echo "The tests on ROS 2 are left out: there is $(NO_COMPILER)."; fi

# The last two are used beside the ticks of the tests' own (have_ticks of tests/transports/ros2_network.py).
TICKS := . build/test-interfaces/setup.sh
packages: $(VENV)/.installed
	$(BIN)/m2c interfaces build examples/lab_tour/interfaces -o build/interfaces
	$(BIN)/m2c interfaces build tests/transports/ros2_interfaces -o build/test-interfaces
	$(TICKS) && $(BIN)/m2c interfaces build examples/charging_station/interfaces -o build/charging_station_interfaces
	$(TICKS) && $(BIN)/m2c interfaces build examples/navigation/interfaces -o build/navigation_interfaces

# Chromium, in which the report's page is tested. Where it cannot be installed, its tests say so.
browser:
	@command -v chromedriver > /dev/null && { command -v chromium || command -v chromium-browser; } > /dev/null \
	  || { [ "$$(id -u)" = 0 ] && command -v apt-get > /dev/null \
	       && echo "Installing chromium for the report's tests ..." \
	       && apt-get update -q > /dev/null && apt-get install -y -q chromium chromium-driver > /dev/null; } \
	  || echo "No browser: the report's tests are left out, until chromium and chromedriver are installed."

# W3C's tests of SCXML and SCION's, one package without what it depends on. Where npm cannot bring it, they say so.
SCXML_TESTS := @scion-scxml/test-framework@2.0.16
scxml-tests: build/scxml-tests
build/scxml-tests:
	@mkdir -p build
	@PATH="$$PATH:$(abspath $(BIN))"; cd build && command -v npm > /dev/null && tests=$$(npm pack --silent $(SCXML_TESTS)) && tar -xzf "$$tests" && rm "$$tests" && mv package scxml-tests \
	  || echo "W3C's tests of SCXML are left out: npm cannot bring them."

# What runs for every observation, and for every message of a simulated world, compiled by mypyc (needs a C compiler).
compiled: $(VENV)/.installed
	@if $(CAN_COMPILE); then $(MAKE) --no-print-directory --assume-old=$(VENV)/.installed build/compiled.stamp; \
	 else echo "The monitors run as they are written: there is $(NO_COMPILER)."; fi

build/compiled.stamp: $(VENV)/.installed setup.py mypyc.ini $(wildcard moon/*.py moon/*/*.py transports/*.py transports/simulated/*.py)
	@echo "Compiling the monitors (two minutes) ..."
	@mkdir -p build
	@find moon transports -name '*.so' -delete
	@MOON_COMPILED=1 $(BIN)/python -W ignore setup.py --quiet build_ext --inplace > build/compiled.log 2>&1 \
	  || { tail -n 30 build/compiled.log; exit 1; }
	@touch moon/compiled__mypyc*.so transports/compiled__mypyc*.so $@

# As written again, for work on them.
interpreted:
	find moon transports -name '*.so' -delete
	rm -f build/compiled.stamp

# What loads nothing that is compiled: run beside the compiler, and not again.
MODELS_ONLY := tests/language tests/check tests/draw tests/convert
unit: $(VENV)/.installed compiled
	$(PYTEST) -n $(WORKERS) $(MODELS_ONLY:%=--ignore %)

# What was compiled, not compiled: all that compares it with something else. (That nominal runs raise no alarm
# is known of it where both say the same.) And what concerns models only. It is shown when it is done: it runs
# beside the compiler.
# No process that it starts may meet a half of what is compiled.
unit-interpreted: $(VENV)/.installed
	@mkdir -p build
	@$(PYTEST) -n 2 -p tests.interpreted tests/oracle --ignore tests/oracle/test_no_false_alarm.py --ignore tests/oracle/test_busy.py \
	  tests/monitor_policy/test_oracle.py tests/recordings tests/properties/test_monitor.py \
	  tests/properties/test_ordering.py tests/offline/test_same_verdicts.py \
	  --deselect tests/offline/test_same_verdicts.py::test_another_process_says_the_same \
	  $(MODELS_ONLY) > build/interpreted.log 2>&1 || { cat build/interpreted.log; exit 1; }
	@echo "Beside the compiler: $$(tail -n 1 build/interpreted.log)"

# Every figure of docs/performance.md and docs/performance-monitors.md, which are rewritten.
benchmarks: $(VENV)/.installed compiled
	$(BIN)/python -m benchmarks

# What monitoring costs, beside monitors in the middle; rewrites docs/overhead.md (35 minutes).
overhead: $(VENV)/.installed compiled
	$(BIN)/python -m examples.overhead --full --update-docs -o build/overhead

# Every fault that one change can make in a model of an example, against the oracle: docs/mutants*.md.
mutants: $(VENV)/.installed compiled
	$(BIN)/python -m tests.mutation.run lab_tour
	$(BIN)/python -m tests.mutation.run charging_station
	$(BIN)/python -m tests.mutation.run sorting_cell
	$(BIN)/python -m tests.mutation.run navigation

# Hours, with fresh seeds; what fails prints the command that repeats it (tests/soak.py).
soak: $(VENV)/.installed compiled
	$(BIN)/python -m tests.soak

clean:
	rm -rf build $(VENV) $(DEMO_VENV) .mypy_cache .ruff_cache .pytest_cache
