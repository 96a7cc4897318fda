# Needs only make and Python >= 3.11. Choose another interpreter with: make demo PYTHON=python3.12
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
# As a path: with a finder Python takes a clone called jaxmm, right below where one is, for the package itself.
EDITABLE := --config-settings editable_mode=compat -e

.PHONY: demo paper report test setup setup-peers weights lint bench bench-smoke bench-gate fuzz clean

demo: setup
	$(BIN)/jaxmm reproduce configs/demo.toml

# Table I whole, with ablations, buildings, sweeps and the thesis's scans (those where JAXMM_DATA holds them): 2 1/2 hours.
paper: setup
	$(BIN)/jaxmm reproduce configs/paper.toml

# Tables, report and figures out of that run, beside it.
report: setup
	$(BIN)/python -m paper.results runs/paper --out runs/paper/results
	$(BIN)/python -m paper.report --results runs/paper/results --out runs/paper/report.md --html runs/paper/report.html
	$(BIN)/python -m paper.figures runs/paper --out runs/paper/figures

# All but those that make whole runs again, notebooks, clusters and the paper's figures; `make test ALL=1` makes these, too,
# and `make test LONG=1` these alone.
test: setup
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder $(if $(filter-out 0,$(ALL)),,-m "$(if $(filter-out 0,$(LONG)),,not )long")

setup: .venv/current

# The stamp is written last, so an installation that was cut off starts again.
.venv/current: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; v = sys.version_info; v >= (3, 11) or sys.exit("jaxmm needs Python >= 3.11, got %d.%d; try make PYTHON=python3.11" % v[:2])'
	$(PYTHON) -m venv .venv
	$(PIP) install -r requirements.lock
	$(PIP) install --no-deps --no-build-isolation $(EDITABLE) .
	@touch $@

# Open3D and PyTorch, the benchmarks' opponents and the tests' witnesses; large, and never needed to use jaxmm.
setup-peers: setup
	$(PIP) install -c requirements.lock $(EDITABLE) '.[peers]'

# The default models, from nothing: 20 minutes, and what judges objects, which learns from what they say: one and a quarter hours, and the low rooms after that.
# The run folder holds how the models came about, the file of the judge how it did.
weights: setup
	$(BIN)/jaxmm train configs/weights.toml --out runs/weights
	cp runs/weights/models.safetensors jaxmm/weights/default.safetensors
	cp runs/weights/calibration.json jaxmm/weights/calibration.json
	$(BIN)/python -m jaxmm.runs.object_training --out runs/weights/rooms.safetensors --draws runs/draws
	$(BIN)/python -m jaxmm.runs.flat_training --judge runs/weights/rooms.safetensors --out runs/weights/low.safetensors --band 1 --draws runs/draws
	$(BIN)/python -m jaxmm.runs.flat_training --judge runs/weights/low.safetensors --out jaxmm/weights/objects.safetensors --band 2 --draws runs/draws

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python -m pytest tests/test_lock.py

# Hours. Those that take files come last, where JAXMM_DATA holds building files and the thesis's repository, and where
# `make weights` has left its run. Left out are unchanged and commands, which compare two checkouts.
bench: setup-peers
	$(BIN)/python -m benchmarks.rays
	$(BIN)/python -m benchmarks.triangles
	$(BIN)/python -m benchmarks.neighbours
	$(BIN)/python -m benchmarks.voxels
	$(BIN)/python -m benchmarks.growth
	$(BIN)/python -m benchmarks.rooms
	$(BIN)/python -m benchmarks.pairs
	$(BIN)/python -m benchmarks.train
	$(BIN)/python -m benchmarks.detect
	$(BIN)/python -m benchmarks.latency
	$(BIN)/python -m benchmarks.poses --out runs/poses
	$(BIN)/python -m benchmarks.deviations
	$(BIN)/python -m benchmarks.mirrors
	$(BIN)/python -m benchmarks.flats
	$(BIN)/python -m benchmarks.pose_search
	$(BIN)/python -m benchmarks.matrix
	$(BIN)/python -m benchmarks.accuracy --out runs/accuracy
	$(BIN)/python -m benchmarks.objects --out runs/objects
	$(BIN)/python -m benchmarks.pillars --out runs/pillars.json
	$(BIN)/python -m benchmarks.detections --out runs/detections
	$(BIN)/python -m benchmarks.sensors --out runs/sensors
	$(BIN)/python -m benchmarks.clouds --out runs/clouds
	$(BIN)/python -m benchmarks.rivals --out runs/rivals.json
	$(BIN)/python -m benchmarks.dynamic_maps --out runs/dynamic_maps.json
	$(BIN)/python -m benchmarks.rows --out runs/rows
	$(BIN)/python -m benchmarks.large_scans
	$(BIN)/python -m benchmarks.clients --out runs/clients.json
	$(BIN)/python -m benchmarks.clients.page_frames --json runs/page_frames.json || [ $$? -eq 2 ]
ifneq ($(wildcard $(JAXMM_DATA)/ifc),)
	$(BIN)/python -m benchmarks.buildings $(JAXMM_DATA)/ifc --out runs/buildings
	$(BIN)/python -m benchmarks.stations $(JAXMM_DATA)/ifc/Schependomlaan_V_L_Constructief.ifc
	$(BIN)/python -m benchmarks.progress $(JAXMM_DATA)/ifc --out runs/progress
	$(BIN)/python -m benchmarks.outdoors $(JAXMM_DATA)/ifc --out runs/outdoors
	$(BIN)/python -m benchmarks.classes $(JAXMM_DATA)/ifc --out runs/classes
endif
ifneq ($(wildcard $(JAXMM_DATA)/real),)
	JAXMM_DATA=$(JAXMM_DATA) $(BIN)/python -m benchmarks.reality
endif
ifneq ($(wildcard $(JAXMM_DATA)/thesis),)
	$(BIN)/python -m benchmarks.released $(JAXMM_DATA)/thesis
endif
ifneq ($(wildcard runs/weights/models.safetensors),)
	test -e runs/ablation || $(BIN)/python -m benchmarks.ablation runs/weights --out runs/ablation
endif
	$(BIN)/python -m benchmarks.ablation --imperfections --out runs/imperfections --rooms 12 --steps 400

# Every benchmark at its smallest size, to see that all still run: five minutes. Exit code 2 says that files are missing.
bench-smoke: setup-peers
	@for file in $$(grep -l __main__ benchmarks/*.py) $$(dirname benchmarks/*/__main__.py); do \
		name=$$(basename $$file .py); echo "== benchmarks.$$name"; \
		$(BIN)/python -m benchmarks.$$name --smoke || [ $$? -eq 2 ] || exit 1; \
	done

# Six commands beside the build of the last release, in turns: fails where one takes 15 % more time, by the clock and in
# computing. Without a tag it is the commit named here. Five minutes; not in CI, where machines differ.
GATE_AGAINST ?= $(shell git describe --tags --abbrev=0 2>/dev/null || echo 114547d)
bench-gate: setup
	$(BIN)/python -m benchmarks.commands --against $(GATE_AGAINST) --cheapest --most 1.15

# Ten thousand mutations of valid files for every reader, in subprocesses under limits of time and memory.
fuzz: setup
	$(BIN)/python -m tests.fuzz --count 10000

clean:
	rm -rf .venv .cache runs *.egg-info
