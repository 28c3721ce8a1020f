"""Fresh MLflow stores. Their tables take seconds to make, so they are made once."""

import tempfile
from functools import cache
from pathlib import Path

from tactile_viewgcn.tracking import EXPERIMENT


def fresh_store(path: Path) -> str:
    """Return the address of a new store at `path`, without experiments of this project."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(_tables())
    return f"sqlite:///{path}"


def runs_of(client, name=f"{EXPERIMENT}/stages") -> list:
    """Return the runs of an experiment."""
    return client.search_runs([client.get_experiment_by_name(name).experiment_id])


@cache
def _tables() -> bytes:
    """Return the content of a database without runs."""
    from mlflow import MlflowClient

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mlflow.db"
        MlflowClient(f"sqlite:///{path}")
        return path.read_bytes()
