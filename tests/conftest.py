"""What every test shares: reproducible hypothesis runs, no screen, and the place of the shared measurements."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

ROOT = Path(__file__).resolve().parents[1]

# Before anything imports matplotlib: a test must not open a window.
os.environ.setdefault("MPLBACKEND", "Agg")

# Before anything imports NumPy, and for every process that a test starts: tests run in several processes, which get a
# core each. (Intel's library rounds by the number of threads, so that this also makes results the same everywhere.)
for _variable in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_variable] = "1"

# On CI the same examples every time, and no deadline anywhere: the first call may compile a kernel.
settings.register_profile("default", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("ci", parent=settings.get_profile("default"), derandomize=True, print_blob=True)
settings.load_profile("ci" if os.environ.get("CI") else "default")


@pytest.fixture(scope="session", autouse=True)
def _heard_signals() -> None:
    """Let the stop signals be heard where the caller has set them to be ignored (`nohup make test`, `trap '' INT`).

    Tests send them to themselves and to processes that they start, which inherit what is ignored, and not a handler.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, lambda *_: None)


@pytest.fixture(scope="session", autouse=True)
def _kernels_of_one_signature() -> Generator[None]:
    """Numba's cache on disk may mix up two signatures of a kernel that two processes compile at the same time."""
    yield
    kernels = {
        f"{module}.{name}": value
        for module, held in list(sys.modules.items())
        if module.startswith("softcal.mechanics.")
        for name, value in list(vars(held).items())
        if getattr(value, "nopython_signatures", ())
    }
    several = {name: kernel.signatures for name, kernel in kernels.items() if len(kernel.signatures) > 1}
    assert not several


@pytest.fixture(scope="module")
def small_balls() -> Generator[None]:
    """A point in a body is a sum over a ball around it: here of fewer points, of which derivatives are as exact."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softcal.mechanics.attachment.OCTANT_POINTS", 5)
        yield


@pytest.fixture(scope="session")
def repository() -> Path:
    """The root of the repository."""
    return ROOT


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real measurements and SOFA curves beside the repository; skips where it is absent."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no ../shared/data beside the repository")
    return folder


@pytest.fixture(scope="module")
def postgresql() -> Generator[str]:
    """The URL of a PostgreSQL server of the test's own."""
    from postgres_server import postgres

    with postgres() as url:
        yield url


@pytest.fixture(scope="module")
def mysql() -> Generator[str]:
    """The URL of a MariaDB server of the test's own."""
    from mariadb_server import mariadb

    with mariadb() as url:
        yield url
