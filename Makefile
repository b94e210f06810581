# make          environment, embedded campaigns, results; ends with the path of the report
# make test     all tests
# make picture  the README's pictures, from the results
# make paper    the paper at full size, the study of its twins, and their pictures (half an hour to two hours)
# make board    PDFs to print: a calibration board, the ladders' plates, on A4 and letter
# make bench    all measurements, and the page docs/benchmarks.md (hours)
# make bench-slurm  the embedded campaign through a Slurm of one node, against a run without (as root on Debian)
# make bench-s3     DVC with a server of an object store, and with what goes wrong there
# make bench-kills  a run killed twenty times, and what else may go wrong, on a tiny campaign
# make fuzz     100,000 broken inputs for each reader of foreign files (hours)
# make lint     style and workflow checks
# make makers   other programs' readers of calibrations, for the tests against them
# make lock     renew envs/*.lock.txt from pyproject.toml

PYTHON ?= python3
CORES ?= 2
UV_VERSION := 0.13.8

LOCK := envs/twingap.lock.txt
INSTALLED := .venv/installed.lock.txt
BIN := .venv/bin
UV := .tools/bin/uv

# uv brings its own certificates; behind a company's proxy the machine's are the ones that work.
SYSTEM_CERTIFICATES := $(wildcard /etc/ssl/certs/ca-certificates.crt)
ifneq ($(SYSTEM_CERTIFICATES),)
export SSL_CERT_FILE ?= $(SYSTEM_CERTIFICATES)
endif

.PHONY: results environment data test picture paper board bench bench-slurm bench-s3 bench-kills fuzz lint makers lock

results: environment data
	$(BIN)/snakemake --cores $(CORES)
	@echo "The report is $(CURDIR)/results/frame/report/index.html"

$(UV):
	$(PYTHON) -m venv --clear .tools
	.tools/bin/python -m pip install --quiet --disable-pip-version-check uv==$(UV_VERSION)

# The copy of the lock in .venv says what is installed there; it is written last, so an interrupted or an older
# installation is finished, not trusted.
environment: $(UV)
	@$(BIN)/python -c "import sys; sys.exit(sys.version_info[:2] != (3, 13))" 2>/dev/null \
		|| $(UV) venv --clear --quiet --python 3.13 .venv
	@cmp -s $(LOCK) $(INSTALLED) \
		|| { rm -f $(INSTALLED) \
		&& $(UV) pip sync --require-hashes --compile-bytecode --python $(BIN)/python $(LOCK) \
		&& cp $(LOCK) $(INSTALLED); }

# A pull that was killed leaves the file that it was copying, and the next one asks what to do with it.
# A pull that was killed makes DVC's next one fail, once.
PULL := $(BIN)/dvc pull --quiet --remote embedded data/raw/frame.dvc data/raw/aruco6x6_gridboard.dvc
data: environment
	@find data/raw -name '.??????????????????????.tmp' -delete
	@$(PULL) 2> /dev/null || $(PULL)

test: environment data
	$(BIN)/python -m pytest -n $(CORES) --dist loadfile

picture: results
	PYTHONPATH=scripts $(BIN)/python notebooks/front_picture.py results/frame docs/picture.png
	PYTHONPATH=scripts $(BIN)/python notebooks/method_pictures.py results/frame hp325 docs/method
	$(BIN)/snakemake --cores $(CORES) --config campaign=data/raw/aruco6x6_gridboard \
		-- results/aruco6x6_gridboard/tables/table1.csv
	PYTHONPATH=scripts $(BIN)/python notebooks/photograph_picture.py results/aruco6x6_gridboard \
		data/raw/aruco6x6_gridboard aruco6x6_gridboard docs/photographs.png
	PYTHONPATH=scripts:tests/bench $(BIN)/python notebooks/change_picture.py data/raw aruco6x6_gridboard docs/what-changed.png

paper: environment
	$(BIN)/snakemake --cores $(CORES) all twin_study --config experiment=config/experiments/paper.yaml
	PYTHONPATH=scripts $(BIN)/python notebooks/paper_picture.py results/paper docs/paper.png docs/paper-effects.png

board: environment
	$(BIN)/python scripts/print_board.py charuco --out prints/board.pdf
	$(BIN)/python scripts/print_board.py rig config/rigs/ladders.yaml --out prints/plates.pdf

bench: environment data
	$(BIN)/python tests/bench/run_benchmarks.py

# What only these need lies in folders of its own: nothing of it comes to .venv.
SLURM := .tools/slurm
S3 := .tools/s3

$(SLURM): envs/slurm.lock.txt | environment
	$(UV) pip install --quiet --require-hashes --no-deps --python $(BIN)/python --target $@ -r $<
	@touch $@

$(S3): envs/bench-s3.lock.txt | environment
	$(UV) venv --clear --quiet --python 3.13 $@
	$(UV) pip install --quiet --require-hashes --python $@/bin/python -r $<
	@touch $@

bench-slurm: data $(SLURM)
	command -v slurmctld munged > /dev/null || apt-get install -y -qq --no-install-recommends slurm-wlm munge
	PYTHONPATH=$(CURDIR)/$(SLURM) $(BIN)/python tests/bench/bench_slurm.py $(TINY)

bench-s3: data $(S3)
	$(BIN)/python tests/bench/bench_s3.py

bench-kills: environment data
	$(BIN)/python tests/bench/bench_kills.py
	$(BIN)/python tests/bench/bench_mishaps.py

INPUTS ?= 100000
fuzz: environment
	$(BIN)/python tests/bench/bench_fuzz.py --inputs $(INPUTS)

lint: environment data
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/snakefmt --check Snakefile rules
	$(BIN)/snakemake --lint

makers: environment
	$(UV) pip install --python $(BIN)/python --group makers

COMPILE = UV_CUSTOM_COMPILE_COMMAND="make lock" $(UV) pip compile --quiet --upgrade --universal --generate-hashes \
	--python-version 3.13

lock: $(UV)
	$(COMPILE) --all-extras --group dev --output-file $(LOCK) pyproject.toml
	$(COMPILE) --no-deps --group slurm --output-file envs/slurm.lock.txt
	$(COMPILE) --constraint $(LOCK) --group s3 --output-file envs/s3.lock.txt
	$(COMPILE) --constraint $(LOCK) --group bench-s3 --output-file envs/bench-s3.lock.txt
