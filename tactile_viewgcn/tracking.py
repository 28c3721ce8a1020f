"""The one module that knows MLflow; only functions import it, since it loads slowly.

The run of `evaluate` is the pipeline's row in the experiment `tactile-viewgcn`; the runs of the
other stages are in `tactile-viewgcn/stages`. A run begins with its stage and ends with it. The
store is `mlflow.db` at the root of the repository, with `mlruns/` beside it; MLflow's own variables
override it, and a relative `sqlite:///my.db` counts from the same root. With
MLFLOW_TRACKING_URI=disabled nothing is logged. What the store cannot do costs the run, with one
warning, never the stage.
"""

import os
import re
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock

from tactile_viewgcn.files import root
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.provenance import ROW, Record

EXPERIMENT = "tactile-viewgcn"
DISABLED, SQLITE = "disabled", "sqlite:///"
# packages of a logged model
NEEDS = "torch", "numpy", "scipy", "h5py", "pyyaml", "filelock", "pydantic", "tqdm"
# seconds to wait for other processes that make tables: a minute each on a busy machine
LOCKED = 300
# letters of a warning, since a server may answer with a whole page, and of a tag
SHOWN, LONGEST = 400, 5000
# MLflow's pages then show trainings, not chats
KIND = {"mlflow.experimentKind": "custom_model_development"}
SETTINGS = {  # MLflow reads them when it is imported
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",  # by default MLflow tries a dead server for minutes
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "10",  # seconds
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_LOGGING_LEVEL": "CRITICAL",  # it logs an error with its traceback before it raises it
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
    "GIT_PYTHON_REFRESH": "quiet",
}


class Run:
    """A run in MLflow; without one, or after the store has failed, `id` is None and every method does nothing."""

    def __init__(self, mlflow: Any = None, run_id: str | None = None):
        self._mlflow, self.id = mlflow, run_id

    def log(self, function: str, *values: Any) -> Any:
        """What one of MLflow's functions returns, such as `log_metrics`, called for this run; None without a run."""
        return self.attempt(lambda mlflow: getattr(mlflow, function)(*values))

    def attempt(self, log: Callable[[Any], Any]) -> Any:
        """What `log` returns, called with the module MLflow; None without a run, and after an error, with a warning."""
        if not self.id:
            return None
        try:
            return log(self._mlflow)
        except Exception as error:
            _warn(error)
            self.id = None

    def dataset(self, source: str, digest: str) -> None:
        """Log the path and digest of the data set, which MLflow shows in its column of datasets."""

        def log(mlflow: Any) -> None:
            dataset = mlflow.entities.Dataset(source, digest, "local", source)
            mlflow.MlflowClient().log_inputs(self.id, [mlflow.entities.DatasetInput(dataset)])

        self.attempt(log)

    def model(self, checkpoint: Path, metadata: dict[str, Any]) -> str | None:
        """Log the classifier as an MLflow model, from recordings of raw counts to a column for each class.

        Args:
            metadata: stored with the model; its `classes` name the columns.

        Returns:
            The model's address for `mlflow.pyfunc.load_model`; None where nothing is logged.
        """

        def log(mlflow: Any) -> str:
            from mlflow.types import ColSpec, Schema, TensorSpec

            signature = mlflow.models.ModelSignature(
                # of any length; no fraction is cut off
                Schema([TensorSpec(np.dtype(object), (-1,), "recordings")]),
                Schema([ColSpec("float", name) for name in metadata["classes"]]),
            )
            with warnings.catch_warnings():
                # that would copy frames of the data set
                warnings.filterwarnings("ignore", message=".*input example")
                return mlflow.pyfunc.log_model(
                    name="classifier",
                    loader_module="tactile_viewgcn.recognition.mlflow_model",
                    data_path=str(checkpoint),
                    code_paths=[str(Path(__file__).parent)],
                    signature=signature,
                    pip_requirements=[
                        f"{name}=={version(name).partition('+')[0]}" for name in NEEDS
                    ],
                    metadata=metadata,
                ).model_uri

        return self.attempt(log)

    def record(self, record: Record) -> None:
        """Log what a stage did: its counts and costs, md5 of inputs, and the record itself; notes as description."""
        chosen = {
            name: value for name, value in record.counts.items() if name.startswith("resolved.")
        }
        numbers = {name: value for name, value in record.counts.items() if name not in chosen}
        if record.stage != ROW:  # it has the costs of all stages
            numbers |= {"seconds": record.seconds, "peak_mb": record.peak_mb}
        digests = {
            f"md5.{name}": entry["md5"] for name, entry in record.inputs.items() if "md5" in entry
        }
        notes = "\n".join(f"- {note}" for note in record.notes)
        self.log("log_params", chosen)
        self.log("log_metrics", numbers)
        self.log("set_tags", record.origin | digests | {"mlflow.note.content": notes[:LONGEST]})
        self.log("log_text", record.text, f"{record.stage}.json")

    def end(self, status: str) -> None:
        """End the run with a status; FAILED after the store has failed, since the run lacks something."""
        if self._mlflow:
            with suppress(Exception):
                self._mlflow.end_run(status if self.id else "FAILED")


@contextmanager
def stage_run(record: Record) -> Iterator[Run]:
    """The run of a stage: it begins with the record's name, parameters and origin, and ends with all of the record.

    It is FINISHED when the block ends well, else FAILED or KILLED, with the traceback as artifact.
    """
    run = _begin(record)
    record.run_id = run.id
    run.log("log_params", record.params.get("values", {}))
    try:
        yield run
        run.record(record)
    except BaseException as error:
        run.log("log_text", traceback.format_exc(), "traceback.txt")
        run.end("FAILED" if isinstance(error, Exception) else "KILLED")
        raise
    run.end("FINISHED")


def _begin(record: Record) -> Run:
    """A new run in the experiment of rows or of stages, which are made if needed; on an error none, and a warning."""
    uri = _address()
    if uri == DISABLED:
        return Run()
    rows, database = os.environ.get("MLFLOW_EXPERIMENT_NAME", EXPERIMENT), _database(uri)
    try:
        import mlflow

        mlflow.set_tracking_uri(uri)
        place = (database.parent / "mlruns").as_uri() if database else None
        lock = (
            FileLock(database.with_name("mlflow.db.lock"), timeout=LOCKED)
            if database
            else nullcontext()
        )
        with lock:  # one process of this machine makes the tables
            client = mlflow.MlflowClient()
            for name in (rows, f"{rows}/stages"):
                if not client.get_experiment_by_name(name):
                    with suppress(Exception):  # a process on another machine may be faster
                        client.create_experiment(name, place, KIND)
        mlflow.set_experiment(rows if record.stage == ROW else f"{rows}/stages")
        run = mlflow.start_run(run_name=record.name or record.stage, tags=record.origin)
        return Run(mlflow, run.info.run_id)
    except Exception as error:
        _warn(error)
        return Run()


def _address() -> str:
    """The store's address, with an absolute path, since DVC deletes the temporary workspaces of experiments."""
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)
    uri = os.environ.get("MLFLOW_TRACKING_URI") or f"{SQLITE}mlflow.db"
    return f"{SQLITE}{root() / uri.removeprefix(SQLITE)}" if uri.startswith(SQLITE) else uri


def _database(uri: str) -> Path | None:
    """The file of an SQLite store; None for a server."""
    return Path(uri.removeprefix(SQLITE).partition("?")[0]) if uri.startswith(SQLITE) else None


def _warn(error: Exception) -> None:
    print(f"warning: {_reason(error)}; the stage goes on without it", file=sys.stderr, flush=True)


def _reason(error: Exception) -> str:
    """The store and its error in one line: its text, or its kind alone where that might repeat a password."""
    address, secret = re.subn("://.*@", "://", _address())
    text = type(error).__name__ if secret else str(error).partition("\n[SQL:")[0]
    return " ".join(f"MLflow store {address}: {text}".split())[:SHOWN]


def read_artifact(run_id: str, name: str) -> bytes:
    """The content of an artifact of a run; errors as in `download_model`."""
    with tempfile.TemporaryDirectory() as folder:
        return _download(f"runs:/{run_id}/{name}", Path(folder)).read_bytes()


def download_model(name: str, folder: Path) -> Path:
    """The classifier's file of `runs:/ID` or `models:/NAME/VERSION`, downloaded into a folder.

    Raises:
        UserError: there is no store, or it has no such model, or does not answer; or tracking is
            disabled.
    """
    place = f"{name}/classifier" if name.startswith("runs:") and name.count("/") == 1 else name
    for file in _download(place, folder).rglob("*.pt"):
        return file
    raise UserError(f"{name}: a model of another kind; expected one that this project has logged")


def _download(name: str, folder: Path) -> Path:
    uri = _address()
    database = _database(uri)
    if uri == DISABLED or (database and not database.exists()):
        raise UserError(
            f"{name}: no MLflow store: {uri}; set MLFLOW_TRACKING_URI to the store that has it"
        )
    import mlflow

    try:
        mlflow.set_tracking_uri(uri)
        return Path(mlflow.artifacts.download_artifacts(name, dst_path=str(folder)))
    except Exception as error:
        raise UserError(f"{name}: {_reason(error)}; is MLFLOW_TRACKING_URI right?") from None


def bad_request(message: str) -> Exception:
    """MLflow's exception for a mistake of the user: the server answers 400 and the message, without a traceback."""
    from mlflow.exceptions import MlflowException

    exception = MlflowException.invalid_parameter_value(message)
    # by default the server puts the whole input before the message
    exception.json_kwargs = {"message": message}
    return exception
