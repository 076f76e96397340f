RANKS ?= 2
MPIRUN ?= mpirun
OUT ?= out/plane-shear-2d
# How make run enters a folder that holds a run: continue or keep it; START=--overwrite starts again.
START ?= --resume auto

# Where make install installs.
PREFIX ?= /usr/local
export PREFIX DESTDIR STRIP

PROGRAM := target/release/gshear-mpi
REDUCE := target/release/gshear-reduce

# Open MPI wants to be told twice that root is meant, as in a container.
ifeq ($(shell id -u),0)
export OMPI_ALLOW_RUN_AS_ROOT := 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1
endif
# More ranks than cores are slow, but right.
export OMPI_MCA_rmaps_base_oversubscribe ?= 1
# Bound ranks of two runs would share the first cores and leave the others idle.
export OMPI_MCA_hwloc_base_binding_policy ?= none
export MPIRUN
.PHONY: help deps build run test lint python docs tables scaling bench accuracy stress faults queues peers million studies book own-law mpich wheel manual install uninstall release clean

help:
	@echo "make run       run the default scene on RANKS=$(RANKS) ranks and write its report ($(OUT)); START=--overwrite starts again"
	@echo "make test      make lint, every test of every crate, those through mpirun among them, and make python"
	@echo "make lint      format, lints and types of Rust and Python, rustdoc without warnings: minutes"
	@echo "make python    tests of the Python package in python/; a part of make test"
	@echo "make book      the book of docs/ and the API into target/book, without warnings, every link checked"
	@echo "make docs      write the tables of keys and columns in docs/ and docs/scene.schema.json"
	@echo "make build     build target/release/gshear-mpi and gshear-reduce"
	@echo "make scaling   pairs, ghosts, messages and bytes on ranks and threads against counts by geometry; speeds"
	@echo "make bench     benchmarks"
	@echo "make accuracy  against an independent integration, and error against run time: writes into docs/, minutes"
	@echo "make stress    where it is hard: writes docs/figures/stress.csv, minutes"
	@echo "make faults    1,000 failing calls, 1,000 kills, 1,000 damaged files (docs/validation/faults.md): hours"
	@echo "make queues    job scripts on Slurm, Flux and stand-ins, ranks on two hosts; not a part of make test"
	@echo "make peers     speed beside LAMMPS, LIGGGHTS and DIRT, which it installs"
	@echo "make million   a million spheres in shear: packs a sample, repeats it, says speed and memory"
	@echo "make studies   runs and figures of docs/validation/new.md, from nothing: hours"
	@echo "make own-law   a program with a law, an adhesion and an observable of its own (examples/own_law): digests on 1 rank, on 2, and resumed"
	@echo "make mpich     builds with MPICH, which it installs, into target/mpich; tests exchange and digests"
	@echo "make wheel     the wheel with both programs into target/wheel/dist, for pip on any Linux with glibc 2.28; TARGET=aarch64"
	@echo "make install   programs, manual pages, completions, scenes and docs into PREFIX=$(PREFIX); make uninstall removes them"
	@echo "make manual    programs, manual pages and completions into target/, before a sudo make install"
	@echo "make release   tarball, Debian package, wheel and checksums of this version into target/dist"
	@echo "make deps      install the system packages that are missing (Debian, Ubuntu)"
	@echo "make clean     remove target/ (results in out/ stay)"

deps:
	@scripts/deps

build: deps
	cargo build --release --locked

run: build
	$(MPIRUN) -n $(RANKS) $(PROGRAM) --out $(OUT) $(START)
	$(REDUCE) report $(OUT)/run.h5
	@echo
	@echo "Results in $(OUT); open $(OUT)/report/index.html"
	@cd $(OUT) && du -sh --apparent-size -- * | awk '{ printf "  %-24s %s\n", $$2, $$1 }'

# Two tests a core, since many wait. The environment of what they start is theirs (tests/common/environment.rs,
# python/tests/environment.py).
# All in the release profile: the tests run real programs, and one profile builds the dependencies once.
test: lint
	RUST_TEST_THREADS=$$(( 2 * $$(nproc) )) cargo test --release --locked --workspace
	$(MAKE) python

# What is found without running anything. The environment of Python is made beside the compiler.
lint: deps
	cargo fmt --check
	scripts/python-env & made=$$!; cargo clippy --release --locked --workspace --all-targets -- -D warnings && wait $$made
	cargo clippy --release --locked --test queues -- -D warnings
	RUSTDOCFLAGS="-D warnings" cargo doc --release --locked --no-deps --workspace
	cd python && ../target/python/bin/ruff format --check --config pyproject.toml . ../scripts
	cd python && ../target/python/bin/ruff check --config pyproject.toml . ../scripts
	cd python && ../target/python/bin/mypy

# The programs are named because others may come first in the path.
python: build
	@scripts/python-env
	cd python && GSHEAR_MPI=$(abspath $(PROGRAM)) GSHEAR_REDUCE=$(abspath $(REDUCE)) ../target/python/bin/pytest --durations=5 \
		--numprocesses $$(nproc) --dist loadfile

# From the declarations of the keys; a test says when it is due.
docs:
	cargo test --release --locked -p gshear-scene --lib -- --ignored --exact reference::tests::write_the_reference
	cargo test --release --locked -p gshear-store --lib -- --ignored write_columns_to_docs
	scripts/book.py pages

# mdBook comes as a package, or is built (scripts/book-deps).
book: deps
	RUSTDOCFLAGS="-D warnings" cargo doc --release --locked --no-deps --workspace
	scripts/book.py pages --check
	scripts/book.py build --mdbook "$$(scripts/book-deps)" --api target/doc

# Compare out/studies with docs/figures.
studies: build
	@scripts/python-env
	scripts/studies out/studies

# Not a part of make test, since it compiles every crate again.
own-law: deps
	@scripts/own-law

mpich: deps
	@scripts/mpich-test

# TARGET=aarch64 for that processor (docs/howto/install.md).
wheel:
	@scripts/wheel $(if $(TARGET),--target $(TARGET))

manual: deps
	@scripts/manual

# DESTDIR=FOLDER installs below another root, STRIP=1 without symbols.
install:
	@scripts/install

uninstall:
	@scripts/install --uninstall

release: deps
	@scripts/release

# Which tables under docs/figures are of an older physics.
tables:
	python3 scripts/tables.py

scaling: build
	@scripts/scaling

bench: deps
	cargo bench --locked --bench speed

accuracy: deps
	cargo bench --locked --bench accuracy -- measure
	cargo test --release --locked -p gshear-dem --test all -- --ignored --exact laws::write_the_orders_of_every_law

stress: deps
	cargo test --release --locked --test all -- --ignored --exact --nocapture stress::all_into_the_table

# FAULTS=100 KILLS=100 DAMAGED=100 for fewer, FAULT_RANKS=1,2 for these numbers of ranks, FAULT_SEED=7 for others.
faults: deps
	cargo test --release --locked --test all -- --ignored --nocapture faults:: damage::

# What is not installed is skipped.
queues: deps
	cargo test --release --locked --test queues -- --nocapture

# Options of benches/peers/run, such as PEERS="--grains 1000 --ranks 1".
peers: build
	@scripts/peers-deps
	@benches/peers/run --lammps $(abspath target/peers/bin/lmp) $(PEERS)
	@scripts/python-env
	target/python/bin/python scripts/validation/chute.py

# A packing is made once; 75 is the exit code of a run that was stopped.
out/million/packing.data: | build
	$(MPIRUN) -n $(RANKS) $(PROGRAM) configs/gouge-default.toml --set time.collision_speed=none --out out/million/packing --overwrite --stop-at 1 || [ $$? -eq 75 ]
	$(REDUCE) export out/million/packing/checkpoint.h5 --format lammps-data --out $@

million: build out/million/packing.data
	$(MPIRUN) -n $(RANKS) $(PROGRAM) configs/packing-million.toml --out out/million/shear --resume auto
	$(REDUCE) info out/million/shear/run.h5

clean:
	cargo clean
