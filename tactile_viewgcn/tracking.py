"""The one module that knows MLflow, and imports it late.

An evaluated pipeline is one row of the experiment `tactile-viewgcn`: the run of `evaluate`. The runs of the other
stages lie in `tactile-viewgcn/stages`: a long training begins its own, `evaluate` makes the others from their records.
The store is `mlflow.db` at the root of the repository, with `mlruns/` beside it. MLflow's own variables override it,
and a relative `sqlite:///my.db` counts from the same root; MLFLOW_TRACKING_URI=disabled leaves MLflow out.
"""

import json
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

import numpy as np
from filelock import FileLock

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import md5, root
from tactile_viewgcn.provenance import run_tags

EXPERIMENT = "tactile-viewgcn"
DISABLED, SQLITE = "disabled", "sqlite:///"
NEEDS = "torch", "numpy", "scipy", "h5py", "pyyaml", "filelock", "pydantic", "tqdm"  # of every logged model
LOCKED = 300  # seconds for which other processes may make tables or runs: a minute, on a machine that is full
COSTS = "seconds", "peak_mb", "threads.fewest", "threads.most"  # of a stage's record
KIND = {"mlflow.experimentKind": "custom_model_development"}  # its pages show trainings, not chats
SETTINGS = {  # MLflow reads them when it is imported
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "2",  # by default it tries a dead server for minutes
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "10",  # seconds
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_LOGGING_LEVEL": "WARNING",
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
    "GIT_PYTHON_REFRESH": "quiet",
}


class Run:
    """MLflow's run under way; without one, its `id` is None and every method does nothing.

    A store that fails later never fails a stage: a warning says so once, and nothing more is logged.
    """

    def __init__(self, mlflow: Any = None, run_id: str | None = None, stages: str = ""):
        self._mlflow, self.id, self._stages = mlflow, run_id, stages  # the last is an experiment's id

    def parameters(self, values: dict[str, Any]) -> None:
        """Log parameters, and counts that are no result, by name."""
        self._log(lambda mlflow: mlflow.log_params(values, run_id=self.id))

    def metrics(self, values: dict[str, float], step: int = 0) -> None:
        """Log a value each, of a step such as an epoch or a trial."""
        self._log(lambda mlflow: mlflow.log_metrics(values, step, run_id=self.id))

    def tags(self, values: dict[str, Any]) -> None:
        """Set tags by name."""
        self._log(lambda mlflow: mlflow.set_tags(values))

    def dataset(self, source: str, digest: str) -> None:
        """Log the data set by its path and digest, in MLflow's own column of datasets."""

        def log(mlflow: Any) -> None:
            dataset = mlflow.entities.Dataset(source, digest, "local", source)
            mlflow.MlflowClient().log_inputs(self.id, [mlflow.entities.DatasetInput(dataset)])

        self._log(log)

    def artifacts(self, path: Path) -> None:
        """Log a file, or all files of a folder, as they are."""
        name = "log_artifacts" if path.is_dir() else "log_artifact"
        self._log(lambda mlflow: getattr(mlflow, name)(str(path), run_id=self.id))

    def stage(self, path: Path) -> None:
        """Link an earlier stage's run to this one; it is completed, or made, from the stage's record, once.

        A link that fails costs a warning alone.
        """
        if self.id:
            try:
                with _one_at_a_time(_address()):
                    self._link(self._mlflow, path)
            except Exception as error:
                print(f"warning: {path}: {_reason(error)}; its run is not linked", file=sys.stderr, flush=True)

    def _link(self, mlflow: Any, path: Path) -> None:
        record, digest, client = json.loads(path.read_text()), md5(path), mlflow.MlflowClient()
        if not record["needed"]:
            return
        link = f"stage.{record['stage']}"
        if logged := client.search_runs([self._stages], f"tags.record = '{digest}'"):
            client.set_tag(self.id, link, logged[0].info.run_id)
            return
        end, entities, run_id = datetime.fromisoformat(record["origin"]["time"]).timestamp(), mlflow.entities, None
        with suppress(Exception):  # its own run may be in a different store
            begun = client.get_run(record["run_id"]).info
            run_id = begun.run_id if begun.lifecycle_stage == "active" else None  # else a user has deleted it
        begin = round(1000 * (end - record["seconds"]))
        run_id = run_id or client.create_run(self._stages, begin, {}, record["name"]).info.run_id
        client.set_tag(self.id, link, run_id)
        mlflow.log_params(record["params"]["values"] | record["counts"], run_id=run_id)
        numbers = {name: value for name, value in record["counts"].items() if isinstance(value, float)}
        mlflow.log_metrics(numbers | {name: record[name] for name in COSTS if name in record}, run_id=run_id)
        for name, curve in record["curves"].items():
            shown = {metric.step for metric in client.get_metric_history(run_id, name)}
            epochs = [entities.Metric(name, value, begin, epoch) for epoch, value in enumerate(curve, start=1)]
            client.log_batch(run_id, [each for each in epochs if each.step not in shown])
        mlflow.log_artifact(str(path), run_id=run_id)
        client.log_batch(
            run_id, tags=[entities.RunTag(*each) for each in (record["tags"] | {"record": digest}).items()]
        )
        client.set_terminated(run_id, end_time=round(1000 * end))

    def figure(self, name: str, figure: Any) -> None:
        """Log a picture of Matplotlib; draw one only where there is an `id`."""
        self._log(lambda mlflow: mlflow.log_figure(figure, name))

    def model(self, checkpoint: Path, metadata: dict[str, Any]) -> str | None:
        """Log the classifier as an MLflow model: view sets of raw counts (n, V, H, W) in, a column for each class out.

        Args:
            metadata: kept with the model; its `classes` name the columns.

        Returns:
            Its address, for `mlflow.pyfunc.load_model`; None where it is not logged.
        """

        def log(mlflow: Any) -> str:
            from mlflow.types import ColSpec, ParamSchema, ParamSpec, Schema, TensorSpec

            signature = mlflow.models.ModelSignature(
                Schema([TensorSpec(np.dtype(object), (-1,), "counts")]),  # as int16 its server would cut fractions off
                Schema([ColSpec("float", name) for name in metadata["classes"]]),
                ParamSchema([ParamSpec("session", "string", ""), ParamSpec("baseline", "double", [], shape=(-1,))]),
            )
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", message=".*input example")  # it would copy frames of the data set
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
    """The run of one stage: FINISHED when the block ends well, else FAILED or KILLED, with its traceback as artifact.

    Args:
        name: shown to people; the stage's by default. params: logged at once.
        row: an evaluated pipeline, a row of the experiment that people compare.

    Raises:
        UserError: the store does not open; before the block runs.
    """
    if _address() == DISABLED:
        yield Run()
        return
    try:
        mlflow, (rows, stages) = _open(_address())
        run = mlflow.start_run(experiment_id=rows if row else stages, run_name=name or stage, tags=run_tags(stage))
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
            mlflow.end_run(status if logged.id else "FAILED")  # without all that it should hold


def _open(uri: str) -> tuple[Any, list[str]]:
    """MLflow with its store, and the ids of the experiments of rows and of stages, created where there are none."""
    if not uri.startswith((SQLITE, "http:", "https:")):  # a database keeps no models and pictures
        raise ValueError("expected a server (mlflow server --backend-store-uri DATABASE), or sqlite:///FILE")
    import mlflow

    mlflow.set_tracking_uri(uri)
    name = os.environ.get("MLFLOW_EXPERIMENT_NAME", EXPERIMENT)
    names, folder = (name, f"{name}/stages"), _database(uri).parent if uri.startswith(SQLITE) else None
    with _one_at_a_time(uri):  # one process makes the tables
        client, place = mlflow.MlflowClient(), (folder / "mlruns").as_uri() if folder else None
        for each in names:
            if not client.get_experiment_by_name(each):
                with suppress(Exception):  # a process of another machine may be faster
                    client.create_experiment(each, place, KIND)
    return mlflow, [mlflow.set_experiment(each).experiment_id for each in names]


def _one_at_a_time(uri: str) -> AbstractContextManager[Any]:
    """Context in which no other process of this machine makes tables or runs in a database; none for a server."""
    if not uri.startswith(SQLITE):
        return nullcontext()
    return FileLock(_database(uri).parent / "mlflow.db.lock", timeout=LOCKED)


def _address() -> str:
    """The store's address, a path in it absolute: DVC deletes the temporary workspaces of experiments."""
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)
    uri = os.environ.get("MLFLOW_TRACKING_URI") or f"{SQLITE}mlflow.db"
    return f"{SQLITE}{root() / uri.removeprefix(SQLITE)}" if uri.startswith(SQLITE) else uri


def _database(uri: str) -> Path:
    return Path(uri.removeprefix(SQLITE).partition("?")[0])


def _reason(error: Exception) -> str:
    """The store and what is wrong with it, in one line and without a password."""
    text = " ".join(f"MLflow store {_address()}: {error}".split())
    return re.sub(r"//[^/\s]*@", "//", text)[:300]  # a server may answer with a page


def read_artifact(run_id: str, name: str) -> bytes:
    """The content of a file that a run keeps; errors as of `download_model`."""
    with tempfile.TemporaryDirectory() as folder:
        return _download(f"runs:/{run_id}/{name}", Path(folder)).read_bytes()


def download_model(name: str, folder: Path) -> Path:
    """The classifier's file of `runs:/ID` or `models:/NAME/VERSION`, downloaded into a folder.

    Raises:
        UserError: there is no store, or it does not have it, or does not answer; or tracking is disabled.
    """
    place = f"{name}/classifier" if name.startswith("runs:") and name.count("/") == 1 else name
    for file in _download(place, folder).rglob("*.pt"):
        return file
    raise UserError(f"{name}: a model of another kind; expected one that this project has logged")


def _download(name: str, folder: Path) -> Path:
    uri = _address()
    if uri == DISABLED or (uri.startswith(SQLITE) and not _database(uri).exists()):
        raise UserError(f"{name}: no MLflow store: {uri}; name the one that has it with MLFLOW_TRACKING_URI")
    import mlflow

    try:
        mlflow.set_tracking_uri(uri)
        return Path(mlflow.artifacts.download_artifacts(name, dst_path=str(folder)))
    except Exception as error:
        raise UserError(f"{name}: {_reason(error)}; is MLFLOW_TRACKING_URI right?") from error


def bad_request(message: str) -> Exception:
    """MLflow's exception for a mistake of the user: its server answers 400 and the message, without a traceback."""
    from mlflow.exceptions import MlflowException

    exception = MlflowException.invalid_parameter_value(message)
    exception.json_kwargs = {"message": message}  # its server would put all of the input in front of it
    return exception
