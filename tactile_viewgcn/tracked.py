"""Reading what runs keep in MLflow, which is imported late, as in `tracking`."""

import tempfile
from pathlib import Path

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.store import DISABLED, SQLITE
from tactile_viewgcn.tracking import address, refusal


def artifact(run_id: str, name: str) -> bytes:
    """The content of a file that a run keeps.

    Raises:
        FileNotFoundError: the store has no such run, or the run no such file.
        UserError: tracking is disabled, or there is no store, or it does not answer.
    """
    uri = _store(f"MLflow run {run_id}")
    from mlflow import MlflowClient
    from mlflow.exceptions import MlflowException

    try:
        with tempfile.TemporaryDirectory() as folder:
            return Path(MlflowClient(uri).download_artifacts(run_id, name, folder)).read_bytes()
    except MlflowException as error:
        if error.error_code == "RESOURCE_DOES_NOT_EXIST":
            raise FileNotFoundError(name) from None
        raise refusal(uri, error) from None


def model_file(name: str, folder: Path) -> Path:
    """The classifier's file of `runs:/ID` or `models:/NAME/VERSION`, downloaded into a folder.

    Raises:
        UserError: tracking is disabled, or the store does not have it, or does not answer.
    """
    uri = _store(name)
    import mlflow
    from mlflow.exceptions import MlflowException

    mlflow.set_tracking_uri(uri)
    place = f"{name}/classifier" if name.startswith("runs:") and name.count("/") == 1 else name
    try:
        return next(Path(mlflow.artifacts.download_artifacts(place, dst_path=str(folder))).rglob("*.pt"))
    except StopIteration:
        raise UserError(f"{name}: a model of another kind; expected one that this project has logged") from None
    except (MlflowException, OSError) as error:
        raise UserError(
            f"{name}: MLflow store {uri}: {' '.join(str(error).split())}; is MLFLOW_TRACKING_URI right?"
        ) from None


def _store(what: str) -> str:
    """The store's address. A UserError, whose message begins with `what`, where tracking is disabled or no store is."""
    uri = address()
    if uri == DISABLED:
        raise UserError(f"{what}: MLFLOW_TRACKING_URI is {DISABLED}; name the store that has it")
    if uri.startswith(SQLITE) and not Path(uri.removeprefix(SQLITE).partition("?")[0]).exists():
        raise UserError(f"{what}: no MLflow store at {uri}; name the store that has it with MLFLOW_TRACKING_URI")
    return uri
