"""``--scheduler``: work of a verb on the machines of a dask cluster."""

import asyncio
from contextlib import contextmanager

from sklearn_mcmd._extras import import_extra

SECONDS = 5.0  # that a scheduler has for its answer


@contextmanager
def joblib_by(scheduler):
    """Make joblib send its work to the scheduler of dask.distributed at this address."""
    distributed = import_extra("distributed", "dask", "--scheduler")
    import joblib

    try:
        # A client that fails to connect leaves threads and messages, so one asks before.
        asyncio.run(_connect(distributed, scheduler))
    except (OSError, ValueError) as err:
        raise ValueError(f"--scheduler {scheduler}: no scheduler of dask answers: {err}") from err
    with distributed.Client(scheduler, timeout=SECONDS, set_as_default=False) as client:
        try:
            client.wait_for_workers(1, timeout=SECONDS)
        except TimeoutError as err:
            raise ValueError(
                f"--scheduler {scheduler}: has no workers; start some with: dask worker {scheduler}"
            ) from err
        with joblib.parallel_config(backend="dask", client=client):
            yield


async def _connect(distributed, scheduler):
    arguments = distributed.Security().get_connection_args("client")
    connection = await distributed.core.connect(scheduler, timeout=SECONDS, **arguments)
    await connection.close()
