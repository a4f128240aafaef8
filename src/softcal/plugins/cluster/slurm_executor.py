"""Jobs of a SLURM queue, each a worker of a Dask cluster that is made for the run (dask-jobqueue)."""

from __future__ import annotations

import contextlib
import shutil
import signal
import threading
from collections.abc import Generator
from pathlib import Path
from typing import Any

from softcal.errors import Fault, InputError, ParameterError
from softcal.executors.executor import register_executor
from softcal.extras import require_extra
from softcal.plugins.cluster.dask_executor import DaskExecutor
from softcal.processes import SAFE

_JOBS = 4
# Where Dask's configuration says nothing else. The certificates of a run lie in the home, which the machines share.
_DEFAULTS = {"cores": 1, "processes": 1, "memory": "4GB", "shared_temp_directory": str(Path.home())}


@register_executor
class SlurmExecutor(DaskExecutor):
    """Calls by jobs that are queued as the executor is made, and cancelled as it is closed.

    What a job gets (cores, memory, walltime, account) is said in Dask's configuration, `jobqueue.slurm`. The scheduler
    runs in this process; it and its workers know each other by certificates of their own (TLS).
    """

    name = "slurm"
    summary = "jobs of a SLURM queue: slurm, or slurm:QUEUE"

    @classmethod
    def at(cls, address: str, workers: int | None) -> SlurmExecutor:
        """So many jobs, four by default, of a queue ("": the default one).

        Raises
        ------
        ParameterError
            For a name of a queue with blanks, which would be other options of the job.
        InputError
            Where dask-jobqueue or SLURM is not installed, or a job cannot be queued.
        """
        if len(address.split()) > 1:
            raise ParameterError(Fault("this is no queue", "--on", f"'slurm:{address}'", "a name without blanks"))
        require_extra("cluster", "distributed", "dask_jobqueue", where="--on", got="'slurm'")
        import dask.config

        with _ctrl_c_kept():
            from dask_jobqueue.slurm import SLURMCluster
        if shutil.which("sbatch") is None:
            attempt = "this command on a machine of the cluster that submits jobs"
            raise InputError(Fault("SLURM's sbatch is not on this machine", "--on", "'slurm'", "", attempt))
        options: dict[str, Any] = {
            name: dask.config.get(f"jobqueue.slurm.{name.replace('_', '-')}", None) or default
            for name, default in _DEFAULTS.items()
        }
        if address:
            options["queue"] = address
        first = dask.config.get("jobqueue.slurm.job-script-prologue", None) or []
        options["job_script_prologue"] = [*first, *(f"export {name}={value}" for name, value in SAFE.items())]
        try:
            cluster = SLURMCluster(
                **options,
                security=True,
                protocol="tls://",
                scheduler_options={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
            )
        except (OSError, RuntimeError, ValueError) as error:
            raise _not_queued(error) from error
        try:
            cluster.scale(jobs=workers or _JOBS)
            return cls(cluster.scheduler_address, cluster=cluster)
        except BaseException as error:
            cluster.close()
            if isinstance(error, OSError | RuntimeError | ValueError):
                raise _not_queued(error) from error
            raise


def _not_queued(error: Exception) -> InputError:
    why = str(error).splitlines()[0] if str(error) else type(error).__name__
    return InputError(Fault("no job can be queued", "--on", f"'slurm' ({why})"))


@contextlib.contextmanager
def _ctrl_c_kept() -> Generator[None]:
    """Keep the answer to Ctrl-C, which dask-jobqueue replaces as it is imported."""
    if threading.current_thread() is not threading.main_thread():
        yield  # an import fails there where it sets a signal, so it has been made before, or cannot be
        return
    before = signal.getsignal(signal.SIGINT)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
