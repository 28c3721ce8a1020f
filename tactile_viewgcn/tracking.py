"""The one module that knows MLflow; only functions import it, since it loads slowly.

An evaluated pipeline is one row of the experiment `tactile-viewgcn`: the run of `evaluate`. The runs of the other
stages are in `tactile-viewgcn/stages`: a long training begins its own, `evaluate` makes the others from their records.
The store is `mlflow.db` at the root of the repository, with `mlruns/` beside it. MLflow's own variables override it,
and a relative `sqlite:///my.db` counts from the same root; with MLFLOW_TRACKING_URI=disabled nothing is logged.
"""

import os
import re
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from filelock import FileLock

from tactile_viewgcn.files import md5, root
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.provenance import Record, origin

EXPERIMENT = "tactile-viewgcn"
DISABLED, SQLITE = "disabled", "sqlite:///"
SERVER = re.compile(r"(https?://)(?:([^/:]*):?([^/]*)@)?([^@]*)")  # scheme, user, password, host and path
NEEDS = "torch", "numpy", "scipy", "h5py", "pyyaml", "filelock", "pydantic", "tqdm"  # packages of a logged model
LOCKED = 300  # seconds to wait for other processes that make tables or runs: a minute each on a busy machine
KIND = {"mlflow.experimentKind": "custom_model_development"}  # MLflow's pages then show trainings, not chats
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
    """A run in MLflow; without one, `id` is None and every method does nothing.

    A store that fails after the run has begun never fails the stage: one warning, and nothing more is logged.
    """

    def __init__(self, mlflow: Any = None, run_id: str | None = None, stages: str = ""):
        self._mlflow, self.id, self._stages = mlflow, run_id, stages  # `stages`: id of the stages' experiment

    def parameters(self, values: dict[str, Any]) -> None:
        """Log parameters by name, and counts that are constants."""
        self._log(lambda mlflow: mlflow.log_params(values, run_id=self.id))

    def metrics(self, values: dict[str, float], step: int = 0) -> None:
        """Log values by name, at a step such as an epoch or a trial."""
        self._log(lambda mlflow: mlflow.log_metrics(values, step, run_id=self.id))

    def tags(self, values: dict[str, Any]) -> None:
        """Set tags by name."""
        self._log(lambda mlflow: mlflow.set_tags(values))

    def dataset(self, source: str, digest: str) -> None:
        """Log the path and digest of the data set, which MLflow shows in its column of datasets."""

        def log(mlflow: Any) -> None:
            dataset = mlflow.entities.Dataset(source, digest, "local", source)
            mlflow.MlflowClient().log_inputs(self.id, [mlflow.entities.DatasetInput(dataset)])

        self._log(log)

    def artifacts(self, path: Path) -> None:
        """Log a file, or all files of a folder."""
        name = "log_artifacts" if path.is_dir() else "log_artifact"
        self._log(lambda mlflow: getattr(mlflow, name)(str(path), run_id=self.id))

    def stage(self, path: Path) -> None:
        """Link an earlier stage's run to this one; its record at `path` completes that run, or makes it, once.

        A link that fails costs a warning alone.
        """
        if self.id:
            try:
                with _one_at_a_time(_address()):
                    self._link(self._mlflow, path)
            except Exception as error:
                print(f"warning: {path}: {_reason(error)}; its run is not linked", file=sys.stderr, flush=True)

    def _link(self, mlflow: Any, path: Path) -> None:
        record, digest, client = Record.read(path.read_text()), md5(path), mlflow.MlflowClient()
        if not record.needed:
            return
        link, run_id = f"stage.{record.stage}", None
        if logged := client.search_runs([self._stages], f"tags.record = '{digest}'"):
            client.set_tag(self.id, link, logged[0].info.run_id)
            return
        with suppress(Exception):  # the stage's own run may be in a different store
            begun = client.get_run(record.run_id).info
            run_id = begun.run_id if begun.lifecycle_stage == "active" else None  # else a user has deleted it
        end = datetime.fromisoformat(record.origin["time"]).timestamp()
        begin = round(1000 * (end - record.seconds))
        run_id = run_id or client.create_run(self._stages, begin, {}, record.name).info.run_id
        client.set_tag(self.id, link, run_id)
        mlflow.log_params(record.params["values"] | record.counts, run_id=run_id)
        numbers = {name: value for name, value in record.counts.items() if isinstance(value, float)}
        mlflow.log_metrics(numbers | {"seconds": record.seconds, "peak_mb": record.peak_mb}, run_id=run_id)
        for name, curve in record.curves.items():
            shown = {metric.step for metric in client.get_metric_history(run_id, name)}
            epochs = [mlflow.entities.Metric(name, value, begin, epoch) for epoch, value in enumerate(curve, start=1)]
            client.log_batch(run_id, [each for each in epochs if each.step not in shown])
        mlflow.log_artifact(str(path), run_id=run_id)
        tags = [mlflow.entities.RunTag(*each) for each in (record.tags | {"record": digest}).items()]
        client.log_batch(run_id, tags=tags)
        client.set_terminated(run_id, end_time=round(1000 * end))

    def figure(self, name: str, figure: Any) -> None:
        """Log a Matplotlib figure as `name`."""
        self._log(lambda mlflow: mlflow.log_figure(figure, name))

    def model(self, checkpoint: Path, metadata: dict[str, Any]) -> str | None:
        """Log the classifier as an MLflow model, from view sets of raw counts (n, V, H, W) to a column for each class.

        Args:
            metadata: stored with the model; its `classes` name the columns.

        Returns:
            The model's address for `mlflow.pyfunc.load_model`; None where nothing is logged.
        """

        def log(mlflow: Any) -> str:
            from mlflow.types import ColSpec, ParamSchema, ParamSpec, Schema, TensorSpec

            signature = mlflow.models.ModelSignature(
                Schema([TensorSpec(np.dtype(object), (-1,), "counts")]),  # as int16 the server would cut fractions off
                Schema([ColSpec("float", name) for name in metadata["classes"]]),
                ParamSchema([ParamSpec("session", "string", ""), ParamSpec("baseline", "double", [], shape=(-1,))]),
            )
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", message=".*input example")  # that would copy frames of the data set
                return mlflow.pyfunc.log_model(
                    name="classifier",
                    loader_module="tactile_viewgcn.recognition.mlflow_model",
                    data_path=str(checkpoint),
                    code_paths=[str(Path(__file__).parent)],
                    signature=signature,
                    pip_requirements=[f"{name}=={version(name).partition('+')[0]}" for name in NEEDS],
                    metadata=metadata,
                ).model_uri

        return self._log(log)

    def _log(self, log: Callable[[Any], Any]) -> Any:
        if not self._mlflow:
            return None
        try:
            return log(self._mlflow)
        except Exception as error:
            print(f"warning: {_reason(error)}; the stage goes on without it", file=sys.stderr, flush=True)
            self._mlflow = self.id = None


@contextmanager
def stage_run(stage: str, name: str = "", params: dict[str, Any] | None = None, *, row: bool = False) -> Iterator[Run]:
    """The run of one stage: FINISHED when the block ends well, else FAILED or KILLED, with the traceback as artifact.

    Args:
        name: for people; the stage's name by default.
        params: parameters that are logged at once.
        row: whether it is an evaluated pipeline, a row of the experiment that people compare.

    Raises:
        UserError: the store does not open; the block does not run then.
    """
    if _address() == DISABLED:
        yield Run()
        return
    try:
        mlflow, (rows, stages) = _open(_address())
        run = mlflow.start_run(experiment_id=rows if row else stages, run_name=name or stage, tags=origin(stage))
    except Exception as error:
        raise UserError(f"{_reason(error)}; correct MLFLOW_TRACKING_URI, or set it to {DISABLED}") from error
    logged, status = Run(mlflow, run.info.run_id, stages), "FINISHED"
    try:
        logged.parameters(params or {})
        yield logged
    except BaseException as error:
        status = "FAILED" if isinstance(error, Exception) else "KILLED"
        with suppress(Exception):  # the stage's own error is the one to report
            mlflow.log_text(traceback.format_exc(), "traceback.txt")
        raise
    finally:
        with suppress(Exception):
            mlflow.end_run(status if logged.id else "FAILED")  # the store failed, and the run is not complete


def _open(uri: str) -> tuple[Any, list[str]]:
    """MLflow with its store, and the ids of the experiments of rows and of stages, which are created if needed."""
    import mlflow

    mlflow.set_tracking_uri(uri)
    names, folder = _experiments(), _database(uri).parent if uri.startswith(SQLITE) else None
    with _one_at_a_time(uri):  # one process makes the tables
        client, place = mlflow.MlflowClient(), (folder / "mlruns").as_uri() if folder else None
        _check_place(client, uri)
        for each in names:
            if not client.get_experiment_by_name(each):
                with suppress(Exception):  # a process on another machine may be faster
                    client.create_experiment(each, place, KIND)
    return mlflow, [mlflow.set_experiment(each).experiment_id for each in names]


def _experiments() -> tuple[str, str]:
    """Names of the experiments of rows and of stages."""
    name = os.environ.get("MLFLOW_EXPERIMENT_NAME", EXPERIMENT)
    return name, f"{name}/stages"


def _check_place(client: Any, uri: str) -> None:
    """Raise a UserError for a database that has been moved: it holds the absolute path of the files beside it."""
    here = _database(uri).parent / "mlruns"
    for experiment in filter(
        None, map(client.get_experiment_by_name, _experiments() if uri.startswith(SQLITE) else ())
    ):
        place = Path(unquote(experiment.artifact_location.removeprefix("file://")))
        if experiment.artifact_location.startswith("file://") and place != here and not place.exists():
            raise UserError(f"moved: its files were in {place}; make that a link to {here}, or move the store back")


def _one_at_a_time(uri: str) -> AbstractContextManager[Any]:
    """Context in which no other process of this machine makes tables or runs in a database; a server needs no lock."""
    if not uri.startswith(SQLITE):
        return nullcontext()
    return FileLock(_database(uri).parent / "mlflow.db.lock", timeout=LOCKED)


def _address() -> str:
    """The store's address, with an absolute path, since DVC deletes the temporary workspaces of experiments.

    User and password of a server go to MLflow's variables for them, so that no message and no page has them.

    Raises:
        UserError: neither a server, nor SQLite, nor disabled: other databases keep no models and pictures.
    """
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)
    uri = os.environ.get("MLFLOW_TRACKING_URI") or f"{SQLITE}mlflow.db"
    if uri == DISABLED:
        return uri
    if uri.startswith(SQLITE):
        return f"{SQLITE}{root() / uri.removeprefix(SQLITE)}"
    if not (parts := SERVER.fullmatch(uri)):
        raise UserError(
            "MLFLOW_TRACKING_URI: expected the address of a server (mlflow server --backend-store-uri DATABASE), with "
            f"%2F for a / in its password; or sqlite:///FILE, or {DISABLED}"
        )
    scheme, user, password, place = parts.groups()
    credentials = {"MLFLOW_TRACKING_USERNAME": user, "MLFLOW_TRACKING_PASSWORD": password}
    os.environ |= {name: unquote(text) for name, text in credentials.items() if text}
    return scheme + place


def _database(uri: str) -> Path:
    return Path(uri.removeprefix(SQLITE).partition("?")[0])


def _reason(error: Exception) -> str:
    """The store and its error in one line."""
    text, _, query = str(error).partition("\n[SQL:")
    text += "; close the program that holds it, and try again" * bool(query and "locked" in text)
    return " ".join(f"MLflow store {_address()}: {text}".split())[:400]  # a server may answer with a whole page


def read_artifact(run_id: str, name: str) -> bytes:
    """The content of an artifact of a run; errors as in `download_model`."""
    with tempfile.TemporaryDirectory() as folder:
        return _download(f"runs:/{run_id}/{name}", Path(folder)).read_bytes()


def download_model(name: str, folder: Path) -> Path:
    """The classifier's file of `runs:/ID` or `models:/NAME/VERSION`, downloaded into a folder.

    Raises:
        UserError: there is no store, or it has no such model, or does not answer; or tracking is disabled.
    """
    place = f"{name}/classifier" if name.startswith("runs:") and name.count("/") == 1 else name
    for file in _download(place, folder).rglob("*.pt"):
        return file
    raise UserError(f"{name}: a model of another kind; expected one that this project has logged")


def _download(name: str, folder: Path) -> Path:
    uri = _address()
    if uri == DISABLED or (uri.startswith(SQLITE) and not _database(uri).exists()):
        raise UserError(f"{name}: no MLflow store: {uri}; set MLFLOW_TRACKING_URI to the store that has it")
    import mlflow

    try:
        mlflow.set_tracking_uri(uri)
        _check_place(mlflow.MlflowClient(), uri)
        return Path(mlflow.artifacts.download_artifacts(name, dst_path=str(folder)))
    except Exception as error:
        raise UserError(f"{name}: {_reason(error)}; is MLFLOW_TRACKING_URI right?") from error


def bad_request(message: str) -> Exception:
    """MLflow's exception for a mistake of the user: the server answers 400 and the message, without a traceback."""
    from mlflow.exceptions import MlflowException

    exception = MlflowException.invalid_parameter_value(message)
    exception.json_kwargs = {"message": message}  # by default the server puts the whole input before the message
    return exception
