# make demo: finds a hidden effect (SEED=2: another one; EFFECT=motor_lag: that one); make test: runs all tests.
# Both first install missing packages (as root or through sudo) and build what has changed.
# make test SLOW=1: also those that build the wheel and another package, and run the commands of more pages than the tutorial
SHELL := /bin/bash
# ROS 1 needs the system's Python, which may not be the first python3 in PATH.
export PATH := /usr/bin:$(PATH)
MAKEFLAGS += --no-print-directory

tests_at_once := $(shell echo $$(($$(nproc) + 2)))  # two of them mostly sleep
noetic := $(wildcard /opt/ros/noetic/setup.sh)
in_ros := $(if $(noetic),source $(noetic) &&)
in_workspace := source build/devel/setup.bash &&
installed := build/.installed
configured := build/.configured$(UNITY)$(NATIVE)
SEED ?= 1
export SLOW
# CMake options in addition to the preset "default" (CMakePresets.json)
options := $(if $(UNITY),-DCMAKE_UNITY_BUILD=$(UNITY)) $(if $(NATIVE),-DGROUND_NATIVE=$(NATIVE)) \
  $(if $(CI),-Dground_warnings='-Wall;-Wextra;-Wshadow;-Werror')

.PHONY: build demo test fresh lint sanitize fuzz search promises falsify mutants coverage bench bench-hidden bench-mujoco bench-discover \
  bench-tracking \
  bench-soak bench-table bench-faults bench-plans \
  bench-commands bench-diagnose bench-history bench-rates bench-report replay docs install clean

build: $(configured)
	@.ci/build build

demo: build
	@$(in_workspace) rosrun ground demo --out build/demo --seed $(SEED) $(if $(EFFECT),--effect $(EFFECT))

test: $(configured)
	@.ci/build build
	@rm -rf build/test_results build/Testing  # ctest would use its own costs, not those of CMakeLists.txt
	@status=0; $(in_workspace) .ci/test $(tests_at_once) || status=1; \
	  /usr/bin/python3 .ci/summary.py build/test_results && exit $$status

# make test on what is committed, in a clean Debian 12, where nothing has been installed before. CI runs lint and docs there, too.
# SLOW=1: with the slow tests, as before a release
fresh:
	@clone=$$(mktemp -d /var/tmp/ground-clone.XXXXXX) && trap 'rm -rf "$$clone"' EXIT && \
	  git clone --quiet . "$$clone/ground" && ln -s "$$(realpath -m ../shared)" "$$clone/shared" && \
	  "$$clone/ground/.ci/fresh" make test $(if $(SLOW),SLOW=1)

# Spelling, Python and its types, XML, catkin packages, long functions; TIDY=1: clang-tidy over all C++ as well, which is slow.
lint: build
	@$(in_ros) .ci/lint $(if $(TIDY),spelling python types xml packages functions format tidy)

# All C++ tests under sanitizers: address and undefined behaviour, then threads.
sanitize: $(installed)
	@$(in_ros) .ci/sanitize

# Fuzzes every reader of external input, FUZZ_SECONDS for each.
fuzz: build
	@$(in_ros) FUZZ_SECONDS=$(FUZZ_SECONDS) .ci/fuzz

# Tries every sequence of events on the state machines of sender and controllers: 20 million transitions, minutes.
# TRANSITIONS=5000000: of each search
search: build
	@.ci/build build ground_search_test
	@GROUND_SEARCH_TRANSITIONS=$(or $(TRANSITIONS),1500000) build/devel/lib/ground/ground_search_test

# Takes the rule of each promise (test/requirements.toml) out of the product, and sees its test fail. OPTIONS="--only 3 7"
promises: build
	@.ci/build build ground_unit_tests
	@$(in_workspace) test/mutation/promises.py $(OPTIONS)

# Coverage of the C++ core by its unit tests: build/coverage/index.html.
coverage: $(installed)
	@$(in_ros) .ci/coverage

# Whether the tests notice random mutants of the C++ core. OPTIONS="--count 150 --seed 3", OPTIONS="--help"
mutants: build
	@$(in_ros) .ci/mutants $(OPTIONS)

# The thesis's table 3.1, then run times compared with peers, as a table and as build/bench.json.
# OPTIONS="--only steps fit"
bench: bench-table
	@$(in_workspace) test/bench/bench.py --json build/bench.json \
	  --peers "$$(test/bench/peer_python build/peers)" $(OPTIONS)

# Every verb on 30 s to 1 h of data and on 1 to 1000 bags: time, memory, first line; resumes after an
# interruption. OPTIONS="--only fit info --sizes 1h 100bags"
bench-commands: build
	@$(in_workspace) test/bench/commands.py $(OPTIONS)

# The thesis's table 3.1 over 200 draws of noise.
bench-table: build
	@.ci/build build ground_benchmarks
	@$(in_workspace) rosrun ground table_3_1

# Injects every fault three times and prints the worst case.
bench-faults: build
	@$(in_workspace) test/bench/faults.py

# Searches 100,000 flights for one that leaves the room within the bound that the controllers print.
# OPTIONS="--flights 2000 --room cfg/room/room_4x4.yaml"; OPTIONS=--bound: the bound only
falsify: build
	@$(in_workspace) test/bench/falsify.py $(OPTIONS)

# Diagnoses effects hidden in simulated crafts; prints a table; resumes after an interruption.
# OPTIONS="--kinds disturbed_null --count 20", OPTIONS="--help"
bench-hidden: build
	@$(in_workspace) test/bench/hidden.py --results build/hidden.jsonl \
	  --markdown build/hidden.md $(OPTIONS)

# Diagnoses crafts that MuJoCo's engine moves; prints a table; resumes after an interruption.
# OPTIONS="--count 24", OPTIONS="--help"
bench-mujoco: build
	@$(in_workspace) test/bench/mujoco_bench.py --python "$$(test/bench/peer_python build/peers)" \
	  --results build/mujoco.jsonl --markdown build/mujoco.md $(OPTIONS)

# Simulated crafts that find their hidden physics by flying, with chosen and with random experiments;
# prints a table; resumes after an interruption. OPTIONS="--kinds one none --count 20", OPTIONS="--help"
bench-discover: build
	@$(in_workspace) test/bench/discover.py --results build/discover.jsonl \
	  --markdown build/discover.md $(OPTIONS)

# The wait for a diagnosis. OPTIONS="--recordings DIR"
bench-diagnose: build
	@$(in_workspace) test/bench/diagnose_speed.py $(OPTIONS)

# How often `identify history` finds a slow decay, says a false one, and how long it takes: an hour.
# OPTIONS="--whole 0 --speed 0 --pool build/history.json" keeps estimates
bench-history: build
	@$(in_workspace) test/bench/history.py $(OPTIONS)

# How often p-values and intervals are wrong, beside what is claimed, as a table and as build/rates.json.
# OPTIONS="--only fitted --costly 60 --seed 5001"
bench-rates: build
	@$(in_workspace) test/bench/rates.py --json build/rates.json $(OPTIONS)

# docs/benchmarks.md from test/bench/figures.json, after what the benches have left in build/.
# OPTIONS="--results DIR", OPTIONS=--check
bench-report: build
	@$(in_workspace) test/bench/report.py $(OPTIONS)

# An hour of simulated experiment: memory, timing, warnings. OPTIONS="seconds:=600"
bench-soak: build
	@$(in_workspace) roslaunch ground soak.launch $(OPTIONS) 2>&1 | \
	  grep -aE 'of experiment|times:|soak:' | tee build/soak.txt; grep -q ': sound' build/soak.txt

# Controllers in closed loop, also with hidden effects before and after a diagnosis.
bench-tracking: build
	@$(in_workspace) test/bench/tracking.py $(OPTIONS)

# Plans of ModelPredictive: closed loops with noise, decisions with a deadline.
bench-plans: build
	@.ci/build build ground_benchmarks
	@$(in_workspace) for part in warm deadline; do rosrun ground plans $$part || exit 1; done

# Recordings and simulated runs through reader, fit and diagnosis, compared with the last release: minutes.
# OPTIONS="--only aevar", OPTIONS=--release
replay: build
	@$(in_workspace) test/replay/replay.py $(OPTIONS)

# The documentation from docs/ and from the code, hence always rebuilt; warnings, such as broken links, are errors.
# LINKCHECK=1 also checks external links, which needs a network.
docs: build
	@.ci/install-dependencies .ci/debian-packages-docs.txt
	@$(in_workspace) for builder in html $(if $(LINKCHECK),linkcheck); do \
	  /usr/bin/python3 -m sphinx -E -a -n -W --keep-going -q -b $$builder docs build/docs/$$builder || exit 1; \
	done
	@docs/check_math.py build/docs/html
	@echo "build/docs/html/index.html"

$(configured): $(installed)
	@$(in_ros) .ci/configure default $(options)
	@rm -f build/.configured*
	@touch $@

$(installed): .ci/debian-packages.txt .ci/python-packages.txt .ci/install-dependencies
	@mkdir -p build
	@.ci/install-dependencies
	@touch $@

clean:
	rm -rf build
