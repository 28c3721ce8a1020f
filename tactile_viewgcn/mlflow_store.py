"""The store of MLflow: its address, and what is read back from it.

The store is `mlflow.db` at the root of the repository, with `mlruns/` in the same folder. MLflow's
own variables override it, and a relative `sqlite:///my.db` counts from the same root.
"""

import os
import re
import tempfile
from pathlib import Path
from typing import Any

from tactile_viewgcn.files import root
from tactile_viewgcn.messages import UserError

DISABLED = "disabled"
SQLITE = "sqlite:///"
SHOWN = 400  # letters of a warning, since a server may answer with a whole page
SETTINGS = {  # MLflow reads them when it is imported
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",  # by default MLflow tries a dead server for minutes
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "10",  # seconds
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_LOGGING_LEVEL": "CRITICAL",  # it logs an error with its traceback before it raises it
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
    "GIT_PYTHON_REFRESH": "quiet",
}


def store_address() -> str:
    """Return the store's address.

    The path of a file is absolute, since DVC deletes the temporary workspaces of experiments.
    """
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)
    uri = os.environ.get("MLFLOW_TRACKING_URI") or f"{SQLITE}mlflow.db"
    if uri.startswith(SQLITE):
        return f"{SQLITE}{root() / uri.removeprefix(SQLITE)}"
    return uri


def database_file(uri: str) -> Path | None:
    """Return the file of an SQLite store; None for a server."""
    if not uri.startswith(SQLITE):
        return None
    return Path(uri.removeprefix(SQLITE).partition("?")[0])


def error_line(error: Exception) -> str:
    """Return the store and its error in one line.

    Of an error that might repeat a password only the kind is named.
    """
    address, passwords = re.subn("://.*@", "://", store_address())
    text = str(error).partition("\n[SQL:")[0]
    if passwords:
        text = type(error).__name__
    return " ".join(f"MLflow store {address}: {text}".split())[:SHOWN]


def read_artifact(run_id: str, name: str) -> bytes:
    """Return the content of an artifact of a run.

    Raises:
        UserError: as in `download_model`.
    """
    with tempfile.TemporaryDirectory() as folder:
        return _download(f"runs:/{run_id}/{name}", Path(folder)).read_bytes()


def download_model(name: str, folder: Path) -> Path:
    """Return the classifier's file of a model in MLflow, after downloading it into a folder.

    Args:
        name: `runs:/ID` or `models:/NAME/VERSION`.
        folder: the place of the file.

    Raises:
        UserError: there is no store, or it has no such model, or does not answer; or tracking is
            disabled.
    """
    for file in _download(name, folder).rglob("*.pt"):
        return file
    raise UserError(f"{name}: a model of another kind; expected one that this project has logged")


def _download(name: str, folder: Path) -> Path:
    """Return the path of an artifact, downloaded into a folder; errors as in `download_model`."""
    uri = store_address()
    database = database_file(uri)
    if uri == DISABLED or (database and not database.exists()):
        raise UserError(
            f"{name}: no MLflow store: {uri}; set MLFLOW_TRACKING_URI to the store that has it"
        )
    import mlflow

    try:
        mlflow.set_tracking_uri(uri)
        whole_run = re.fullmatch("runs:/([0-9a-f]{32})(/classifier)?", name)
        if whole_run:
            name = _model_of(mlflow, whole_run[1]) or name
        return Path(mlflow.artifacts.download_artifacts(name, dst_path=str(folder)))
    except Exception as error:
        raise UserError(f"{name}: {error_line(error)}; is MLFLOW_TRACKING_URI right?") from None


def _model_of(mlflow: Any, run_id: str) -> str | None:
    """Return the address of the model that a run has logged; None where it has logged none."""
    outputs = mlflow.MlflowClient().get_run(run_id).outputs
    for model in outputs.model_outputs if outputs else []:
        return f"models:/{model.model_id}"
    return None


def bad_request(message: str) -> Exception:
    """Return MLflow's exception for a mistake of the user.

    The server answers with 400 and the message, without a traceback.
    """
    from mlflow.exceptions import MlflowException

    exception: Exception = MlflowException.invalid_parameter_value(message)
    # by default the server puts the whole input before the message
    exception.json_kwargs = {"message": message}  # type: ignore[attr-defined]
    return exception
