"""Settings of the whole suite: strict JAX, run-time shape checks, no silent skips."""

import gc
import hashlib
import os
import platform
import shutil
from pathlib import Path

import jax
import jaxtyping
import numpy as np
import pytest

os.environ.setdefault("JAX_PLATFORMS", "cpu")
jaxtyping.install_import_hook("shjax", "beartype.beartype")


_CPUINFO = Path("/proc/cpuinfo")
_PROCESSOR = (
    sorted({line for line in _CPUINFO.read_text().splitlines() if "flags" in line})
    if _CPUINFO.exists()
    else platform.processor()
)


def pytest_addoption(parser):
    parser.addoption(
        "--float32", action="store_true", help="run with JAX's default single precision"
    )


_MAX_COMPILED = 4 * 2**30  # bytes of compiled programs kept between runs


def _compiled(config) -> str:
    """Where compiled programs are kept, in pytest's own cache: ``--cache-clear`` empties.

    Workers and the next run share it. It is of one kind of processor: programs hold its
    instructions.
    """
    kind = hashlib.sha256(f"{platform.machine()}{_PROCESSOR}".encode()).hexdigest()[:12]
    folder = config.cache.mkdir(f"compiled-{kind}")
    if not hasattr(config, "workerinput"):
        held = sum(file.stat().st_size for file in folder.iterdir())
        if held > _MAX_COMPILED:
            shutil.rmtree(folder)
            folder.mkdir()
    return str(folder)


# XLA's older code generator compiles a third faster; the flags are of these versions.
_QUICK_FLAGS = (
    "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
)


def _compile_quickly(config) -> None:
    """In double precision: the float32 lane, and commands, see the code that users run.

    The flags are read once, when the first array is made, and are then taken back, so that
    processes that tests start do not inherit them.
    """
    known = jax.__version_info__[:2] == (0, 10)
    if config.getoption("--float32") or not known or "XLA_FLAGS" in os.environ:
        return
    os.environ["XLA_FLAGS"] = _QUICK_FLAGS
    jax.devices()
    del os.environ["XLA_FLAGS"]


def _take_one_processor() -> None:
    """As many workers as processors: each keeps to its own, and no thread waits."""
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if worker is None or not hasattr(os, "sched_setaffinity"):
        return
    free = sorted(os.sched_getaffinity(0))
    if int(os.environ["PYTEST_XDIST_WORKER_COUNT"]) >= len(free):
        os.sched_setaffinity(0, {free[int(worker[2:]) % len(free)]})


def pytest_configure(config):
    workers = getattr(config.option, "numprocesses", None) or 0
    if workers >= (os.cpu_count() or 1):  # for the workers, before they import NumPy
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _take_one_processor()
    _compile_quickly(config)
    compiled = _compiled(config)
    jax.config.update("jax_compilation_cache_dir", compiled)
    # Commands would tell of a half-written program of another worker: each its own.
    own = f"{compiled}-commands-{os.environ.get('PYTEST_XDIST_WORKER', 'main')}"
    os.environ["JAX_COMPILATION_CACHE_DIR"] = own
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.05"
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.05)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
    jax.config.update("jax_enable_x64", not config.getoption("--float32"))
    jax.config.update("jax_numpy_rank_promotion", "raise")
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    jax.config.update("jax_debug_nans", True)


def _runs_in_float32(item) -> bool:
    """Tests that ask for the lane's type, and the examples of the docstrings."""
    if item.get_closest_marker("x64"):
        return False
    names = getattr(item, "fixturenames", ())
    return "dtype" in names or not isinstance(item, pytest.Function)


def pytest_collection_modifyitems(config, items):
    if config.getoption("--float32"):
        kept = [item for item in items if _runs_in_float32(item)]
        dropped = [item for item in items if not _runs_in_float32(item)]
        config.hook.pytest_deselected(items=dropped)
        items[:] = kept


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """In CI everything a test needs is there: a skip is a failure."""
    report = yield
    if report.skipped and os.environ.get("CI") and not hasattr(report, "wasxfail"):
        report.outcome = "failed"
        report.longrepr = f"skipped in CI: {report.longrepr}"
    return report


_MAPPINGS = Path("/proc/self/maps")
_MAX_MAPPINGS = 30_000  # Linux allows a process 65 530


@pytest.fixture(autouse=True)
def _room_for_compiled_code():
    """Drop compiled programs before a long run has no memory mappings left for more."""
    yield
    if _MAPPINGS.exists() and _MAPPINGS.read_bytes().count(b"\n") > _MAX_MAPPINGS:
        jax.clear_caches()
        gc.collect()


@pytest.fixture(autouse=True)
def _compiled_quickly(request):
    """Most tests compile longer than they run: XLA leaves most optimisations out.

    Not for slow tests, and not in the float32 lane, which see the code that users run.
    """
    quickly = not (
        request.config.getoption("--float32") or request.node.get_closest_marker("slow")
    )
    jax.config.update("jax_disable_most_optimizations", quickly)


@pytest.fixture
def rng():
    return np.random.default_rng(20010812)


@pytest.fixture
def dtype():
    """The widest type of this lane."""
    return np.dtype(jax.numpy.result_type(float))


@pytest.fixture(scope="session")
def data():
    """The folder of measured data; see experiments/data.py."""
    from experiments.data import data_folder

    folder = data_folder()
    if not folder.is_dir():
        pytest.skip(f"no measured data at {folder}; set SHJAX_DATA")
    return folder


@pytest.fixture
def as_a_user():
    """Without the suite's own checks, so that the library's refusals are what is seen.

    The NaN check, too, would stop a bad input before the library does.
    """
    jaxtyping.config.update("jaxtyping_disable", True)
    with jax.debug_nans(False):
        yield
    jaxtyping.config.update("jaxtyping_disable", False)
