"""Finds the store of MLflow, and reads artifacts and models back from it.

The store is `mlflow.db` at the root of the repository, with `mlruns/` in the same folder. MLflow's
own variables override it. A relative path such as `sqlite:///my.db` counts from the same root. Only
functions import MLflow, since it loads slowly.
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
RUN_ID = "[0-9a-f]{32}"  # a pattern of the id of a run
SHOWN = 400  # letters of a message, since a server can answer with a whole page
SETTINGS = {  # MLflow reads these variables when it is imported
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",  # by default MLflow tries a dead server for minutes
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "10",  # seconds
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_LOGGING_LEVEL": "CRITICAL",  # else MLflow logs the traceback of an error it raises
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
    "GIT_PYTHON_REFRESH": "quiet",
}


def store_address() -> str:
    """Return the address of the store, and set MLflow's variables that are not set.

    The path of a file is made absolute, since DVC deletes the temporary workspaces of experiments.
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
    """Return one line that names the store and its error.

    If the error could repeat a password, only the kind of the error is named.
    """
    address, passwords = re.subn("://.*@", "://", store_address())
    text = str(error).partition("\n[SQL:")[0]
    if passwords:
        text = type(error).__name__
    return " ".join(f"MLflow store {address}: {text}".split())[:SHOWN]


def read_artifact(run_id: str, name: str) -> bytes:
    """Return the content of an artifact of a run.

    Raises:
        UserError: see `download_model`.
    """
    with tempfile.TemporaryDirectory() as folder:
        return _download(f"runs:/{run_id}/{name}", Path(folder)).read_bytes()


def download_model(name: str, folder: Path) -> Path:
    """Return the classifier's file of a model in MLflow, after downloading it into a folder.

    Args:
        name: `runs:/ID` or `models:/NAME/VERSION`.
        folder: the folder for the file.

    Raises:
        UserError: there is no store, it has no such model, it does not answer, or tracking is
            disabled.
    """
    for file in _download(name, folder).rglob("*.pt"):
        return file
    raise UserError(f"{name}: a model of another kind; expected a model that this project logged")


def _download(name: str, folder: Path) -> Path:
    """Download an artifact into a folder, and return its path; errors as in `download_model`."""
    uri = store_address()
    database = database_file(uri)
    if uri == DISABLED or (database and not database.exists()):
        raise UserError(
            f"{name}: no MLflow store: {uri}; set MLFLOW_TRACKING_URI to the store that has it"
        )
    import mlflow

    try:
        mlflow.set_tracking_uri(uri)
        whole_run = re.fullmatch(f"runs:/({RUN_ID})(/classifier)?", name)
        if whole_run:
            name = _model_of(mlflow, whole_run[1]) or name
        return Path(mlflow.artifacts.download_artifacts(name, dst_path=str(folder)))
    except Exception as error:
        raise UserError(f"{name}: {error_line(error)}; is MLFLOW_TRACKING_URI right?") from None


def _model_of(mlflow: Any, run_id: str) -> str | None:
    """Return the address of the model that a run has logged; None if it has logged no model."""
    outputs = mlflow.MlflowClient().get_run(run_id).outputs
    for model in outputs.model_outputs if outputs else []:
        return f"models:/{model.model_id}"
    return None
