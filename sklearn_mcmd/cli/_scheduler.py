"""``--scheduler``: work of a verb on the machines of a dask cluster."""

import asyncio
from contextlib import contextmanager
from typing import Annotated

import typer

from sklearn_mcmd._extras import import_extra

__all__ = ["Scheduler", "engine"]

SECONDS = 5.0  # that a scheduler has for its answer

Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Divide the work among the workers of this dask scheduler, such as tcp://node1:8786. "
        "They must see the folder of OUT.",
        show_default="processes of this machine",
        hidden=True,
    ),
]


@contextmanager
def engine(scheduler):
    """Make joblib send its work to a scheduler of dask.distributed, if there is an address."""
    if scheduler is None:
        yield
        return
    distributed = import_extra("distributed", "dask", "--scheduler")
    import joblib

    try:
        # A client that fails to connect leaves threads and messages, so one asks before.
        asyncio.run(_ask(distributed, scheduler))
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


async def _ask(distributed, scheduler):
    arguments = distributed.Security().get_connection_args("client")
    connection = await distributed.core.connect(scheduler, timeout=SECONDS, **arguments)
    await connection.close()
