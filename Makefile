# `make` alone prints what there is.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
DEMO ?= demo
PRESET ?= draft
JOBS ?= 2
BY ?= checkout
MACHINES ?= x86_64 aarch64
BASE ?= HEAD~1
PLANTS ?= $(patsubst %/traits/traits.csv,%,$(wildcard results/study_set/*/traits/traits.csv))
SYSTEM_PACKAGES := python3-venv python3-dev g++ ffmpeg libgl1 libegl1 libx11-6 libgomp1 libusb-1.0-0
# Whole files to a process, as the tests of one share what they made; in their order, as the longest come first.
PYTEST = OMP_NUM_THREADS=1 $(BIN)/python $(MEASURED) -m pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder
SOURCES := $(wildcard native/CMakeLists.txt native/src/* native/vision/*)

.DEFAULT_GOAL := help
.PHONY: help setup system demo test test-slow test-all coverage browser-test yolo-test bare-test wheel docs doc-tables gallery test-lowest test-newest test-processors arm-test batch-test slurm-test kill-test hard-cases results results-page study-set interval-coverage bolls-network same-boll segmentation-sweep error-budget sanitize lint format bench bench-compare clean

help: ## print this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-18s %s\n", $$1, $$2}'

setup: $(VENV)/.installed ## make .venv with everything in it; builds the C++ core again when it changed

system:
	@missing="$$(for name in $(SYSTEM_PACKAGES); do dpkg -s $$name >/dev/null 2>&1 || printf '%s ' $$name; done)"; \
	if ! command -v dpkg >/dev/null; then echo "not Debian or Ubuntu; make sure you have: $(SYSTEM_PACKAGES)"; \
	elif [ -z "$$missing" ]; then :; \
	elif [ "$$(id -u)" = 0 ]; then apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $$missing; \
	elif command -v sudo >/dev/null && sudo -n true 2>/dev/null; then sudo apt-get update -q && sudo DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $$missing; \
	else echo "missing system packages; ask for: sudo apt-get install $$missing"; fi

$(VENV)/.installed: pyproject.toml constraints.txt $(SOURCES)
	@$(MAKE) --no-print-directory system
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed: make PYTHON=python3.11 setup"; exit 1; }
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/pip install -q -c constraints.txt scikit-build-core pybind11 cmake ninja
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/pip install -q -c constraints.txt --no-build-isolation -e '.[dev]'
	@touch $@

demo: setup ## simulate a plant, run it, print its row beside the truth
	$(BIN)/cotton3dg demo $(DEMO) --preset $(PRESET)

test: setup ## the quick tests, in parallel: units, native core, hard cases, 100 random scenes, one whole run; 5 to 15 minutes
	$(PYTEST) -m "not slow"

test-lowest: RESOLUTION = lowest-direct
test-newest: RESOLUTION = highest
test-lowest test-newest: OTHER = $(VENV)$(@:test%=%)
test-lowest: ## the quick tests with the oldest releases that pyproject.toml allows, in an environment of its own
test-newest: ## the same with the newest there are
test-lowest test-newest:
	test -x $(OTHER)/bin/python || $(PYTHON) -m venv $(OTHER)
	$(OTHER)/bin/pip install -q -c constraints.txt uv scikit-build-core pybind11 cmake ninja
	PATH="$(CURDIR)/$(OTHER)/bin:$$PATH" $(OTHER)/bin/uv pip install -q --python $(OTHER)/bin/python --resolution $(RESOLUTION) --upgrade --no-build-isolation-package cotton3dg -e '.[dev]'
	OMP_NUM_THREADS=1 $(OTHER)/bin/python -m pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder -m "not slow"

test-slow: setup ## the tests that make test leaves out
	$(PYTEST) -m slow

test-all: setup ## all tests
	$(PYTEST)

coverage: MEASURED = -m coverage run
coverage: setup ## the lines of cotton3dg that the quick tests run, worst last, and as pages in build/coverage; TESTS=tests/unit/io
	rm -rf build/coverage && mkdir -p build/coverage
	$(PYTEST) -m "not slow" $(TESTS); ended=$$?; $(BIN)/coverage combine -q && $(BIN)/coverage html -q \
	&& $(BIN)/coverage report --skip-covered --sort=-cover; exit $$ended

browser-test: setup ## tests of the pages in Chromium, installed if it may; make test skips them without one
	@command -v chromium >/dev/null || test -n "$$COTTON3DG_CHROMIUM" || { apt-get update -q && apt-get install -y -q --no-install-recommends chromium; }
	$(BIN)/python -m pytest tests/end_to_end/test_report_browser.py tests/end_to_end/test_layout_browser.py tests/end_to_end/test_corrections_browser.py tests/end_to_end/test_view_browser.py

yolo-test: ## masks by YOLO .pt models; in an environment of its own, as ultralytics brings an OpenCV with a screen
	$(MAKE) --no-print-directory setup VENV=$(VENV)-yolo
	PATH="$(CURDIR)/$(BIN)-yolo:$$PATH"; $(VENV)-yolo/bin/pip install -q -c constraints.txt --no-build-isolation -e '.[dev,yolo]'
	$(VENV)-yolo/bin/python -m pytest tests/unit/masks/test_yolo.py tests/end_to_end/test_mask_backends.py tests/end_to_end/test_docs_run.py -k yolo

bare-test: ## install.md and the demo in a Debian with nothing in it (debootstrap, as root); BY=checkout|wheel|sdist, AS=--user
	$(PYTHON) tests/stress/bare_machine.py results/bare --by $(BY) $(AS) $(if $(LEND),--lend $(LEND))

wheel: setup ## wheels for Linux on x86-64 and ARM, and the source archive, in dist/
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/pip install -q -c constraints.txt --no-build-isolation -e '.[wheels]'
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python tools/build_wheels.py dist $(MACHINES)

test-processors: setup ## the quick tests as on processors of other kinds, one after the other; half an hour; ONLY='of-2008 seed-6' chooses
	$(BIN)/python tests/stress/other_processors.py results/processors --jobs $(JOBS) $(if $(ONLY),--only $(ONLY))

arm-test: setup ## the core of the ARM wheel in dist/, in an emulator (Debian, as root)
	@command -v qemu-aarch64-static >/dev/null || { apt-get update -q && apt-get install -y -q --no-install-recommends qemu-user-static; }
	$(BIN)/python tests/stress/arm_core.py results/arm dist/cotton3dg-*_aarch64.whl

docs: setup ## the documentation as a site in build/site; a warning is an error
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/pip install -q -c constraints.txt --no-build-isolation -e '.[docs]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --strict --site-dir build/site

doc-tables: setup ## the tables of columns and flags in docs/, from their definitions
	$(BIN)/python tools/doc_tables.py

gallery: build/gallery/a_natural_plant/report.html build/gallery/bolls_that_touch/report.html ## two simulated plants whose reports the site shows; minutes

build/gallery/a_natural_plant/report.html: FILM = --architecture natural --barren 0.2
build/gallery/bolls_that_touch/report.html: FILM = --clustered 0.85 --contact 0.72
build/gallery/%/report.html: | setup
	rm -rf $(@D) && $(BIN)/cotton3dg simulate $(@D) $(FILM) && $(BIN)/cotton3dg run $(@D) --preset $(PRESET)

batch-test: setup ## fifty small plants, five of them broken, in a batch that is killed five times; 25 CPU-minutes
	rm -rf results/fifty && mkdir -p results
	$(BIN)/python tests/stress/fifty_plants.py results/fifty

kill-test: setup ## a hundred runs killed at random over one plant; 20 CPU-minutes
	rm -rf results/killed && mkdir -p results
	$(BIN)/python tests/hard_cases/killed_runs.py kill results/killed --kills 100

slurm-test: setup ## four plants through a real Slurm of one node, installed if it may (Debian, as root)
	@command -v slurmctld >/dev/null && command -v munged >/dev/null || { apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends slurm-wlm munge; }
	rm -rf results/slurm && mkdir -p results
	$(BIN)/python tests/stress/slurm_cluster.py results/slurm

mistakes: setup ## forty mistakes and more on finished plants: no traceback, no changed byte, the remedy in a line; ONLY='--only NAME'
	rm -rf results/mistakes && mkdir -p results
	$(BIN)/python tests/stress/forty_mistakes.py results/mistakes $(ONLY)

hard-cases: setup ## table of what must stay numerically stable, with its tests
	$(BIN)/python tests/hard_cases/report.py

results: setup ## docs/results.md by this code: measure what has no row, PLANTS=folder of path-traced ones; hours; goes on where it ended
	$(BIN)/python tests/accuracy/results.py results/accuracy $(if $(filter-out file,$(origin PLANTS)),--plants $(PLANTS)) $(RESULTS)

results-page: setup ## docs/results.md and README's table from the rows that are saved
	$(BIN)/python tests/accuracy/results_page.py

study-set: setup ## twelve simulated plants, run with PRESET and compared with their truth; goes on where it ended
	$(BIN)/python tests/accuracy/study_set.py results/study_set --preset $(PRESET) $(STUDY)

interval-coverage: setup ## 24 simulated plants, each filmed five times: whether stated errors are true; hours; goes on where it ended
	$(BIN)/python tests/accuracy/interval_coverage.py results/coverage --preset $(PRESET) $(COVERAGE)

bolls-network: setup ## render the scenes and train the bolls' network; hours; goes on where it ended
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/pip install -q -c constraints.txt --no-build-isolation -e '.[dev,training]'
	$(BIN)/cotton3dg masks-train results/bolls_network --scenes 200 --steps 16000

same-boll: setup ## film simulated plants and fit the score that separates bolls; again after a new network; goes on where it ended
	$(BIN)/python tests/accuracy/same_boll.py results/same_boll --jobs $(JOBS) $(SAME_BOLL)

segmentation-sweep: setup ## methods x views x quality of masks on the plants of study-set; goes on where it ended
	OMP_NUM_THREADS=1 $(BIN)/python tests/accuracy/segmentation_sweep.py results/segmentation $(PLANTS) $(SWEEP)

error-budget: setup ## what cameras, masks and scale each add to the errors of the plants of study-set
	$(BIN)/python tests/accuracy/error_budget.py results/error_budget $(PLANTS)

sanitize: setup ## tests of the C++ core under the address, undefined-behaviour and thread sanitizers
	$(BIN)/python tests/native/sanitize.py

lint: setup ## ruff, mypy, import-linter, clang-format
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/clang-format --dry-run --Werror native/src/* native/vision/*

format: setup ## bring Python and C++ into shape
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i native/src/* native/vision/*

bench: setup ## speed of the core as JSON in results/; BENCH='--plants DIR ...' adds trained plants
	mkdir -p results
	$(BIN)/python tests/benchmarks/bench_kernels.py --json results/kernels.json $(BENCH)

bench-compare: setup ## speed of the core against that of the commit BASE (default: the last but one)
	$(BIN)/python tests/benchmarks/bench_compare.py $(BASE)

clean: ## remove the environment, builds and the demo
	rm -rf $(VENV) $(VENV)-yolo $(VENV)-lowest $(VENV)-newest build dist $(DEMO) results
