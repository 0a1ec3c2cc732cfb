"""Settings of the whole suite: strict JAX, run-time shape checks, no silent skips."""

import gc
import os
import tempfile
from pathlib import Path

import jax
import jaxtyping
import numpy as np
import pytest

os.environ.setdefault("JAX_PLATFORMS", "cpu")
jaxtyping.install_import_hook("shjax", "beartype.beartype")


def pytest_addoption(parser):
    parser.addoption(
        "--float32", action="store_true", help="run with JAX's default single precision"
    )


def pytest_configure(config):
    # The processes that tests start share what they compile; this one keeps to itself.
    compiled = tempfile.TemporaryDirectory(prefix="shjax-compiled-")
    config.add_cleanup(compiled.cleanup)
    os.environ["JAX_COMPILATION_CACHE_DIR"] = compiled.name
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.1"
    jax.config.update("jax_compilation_cache_dir", None)
    jax.config.update("jax_enable_x64", not config.getoption("--float32"))
    jax.config.update("jax_numpy_rank_promotion", "raise")
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    jax.config.update("jax_debug_nans", True)


def pytest_collection_modifyitems(config, items):
    if config.getoption("--float32"):
        kept = [item for item in items if not item.get_closest_marker("x64")]
        dropped = [item for item in items if item.get_closest_marker("x64")]
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
_MOST_MAPPINGS = 30_000  # Linux allows a process 65 530


@pytest.fixture(autouse=True)
def _room_for_compiled_code():
    """Drop compiled programs before a long run has no memory mappings left for more."""
    yield
    if _MAPPINGS.exists() and _MAPPINGS.read_bytes().count(b"\n") > _MOST_MAPPINGS:
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
