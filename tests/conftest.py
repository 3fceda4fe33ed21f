import functools
import os
import signal
from pathlib import Path

import jax
import pytest


# Public files that may not be shipped, if they lie beside the checkout.
BESIDE = Path(__file__).parents[2] / "shared" / "data"
if BESIDE.is_dir():
    os.environ.setdefault("CAMOJAB_DATA_DIR", str(BESIDE))


def pytest_addoption(parser):
    parser.addoption(
        "--float32", action="store_true", help="run in JAX's default single precision"
    )


def pytest_configure(config):
    config.addinivalue_line(
        "markers", "float64: meaningful in double precision only (the reason beside it)"
    )
    # What a shell starts in the background ignores interruptions, which tests send.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    single = config.getoption("--float32")
    if not single:
        # Compiling takes most of the time. Single precision is compiled as users do.
        os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=1")
    jax.config.update("jax_enable_x64", not single)
    jax.config.update("jax_numpy_rank_promotion", "raise")
    jax.config.update("jax_numpy_dtype_promotion", "strict")


def pytest_report_header(config):
    return f"jax_enable_x64: {jax.config.jax_enable_x64}"


def pytest_collection_modifyitems(config, items):
    if config.getoption("--float32"):
        skip = pytest.mark.skip(reason="double precision only")
        for item in items:
            if "float64" in item.keywords:
                item.add_marker(skip)


@pytest.fixture(autouse=True, scope="module")
def compiled_code_is_let_go():
    """Every compiled function maps memory, and a process may not map without end."""
    yield
    jax.clear_caches()


@pytest.fixture(scope="module")
def quick_compilation():
    """Compiling takes a thousand times as long as what is compiled."""
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", False)


@functools.cache
def _why_missing(name):
    from camojab.datasets import fetch, MissingData

    try:
        fetch(name)
    except MissingData as error:
        return str(error)
    return ""


def _need(*names):
    # Public files may not be shipped; where they cannot be had the reason is shown.
    for name in names:
        if reason := _why_missing(name):
            pytest.skip(reason)


@pytest.fixture
def real_data():
    """Skip the test, with the reason, unless the named public files can be had."""
    return _need


@pytest.fixture(scope="module")
def module_data():
    """The same for the fixtures of a module."""
    return _need
