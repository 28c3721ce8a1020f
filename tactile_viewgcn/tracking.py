"""The one module that knows MLflow; only functions import it, since it loads slowly.

The run of `evaluate` is the pipeline's row in the experiment `tactile-viewgcn`; the runs of the
other stages are in `tactile-viewgcn/stages`. A run begins and ends with its stage, but for the row,
which begins so much earlier as the stages before took. The store is `mlflow.db` at the root of the
repository, with `mlruns/` in the same folder; MLflow's own variables override it, and a relative
`sqlite:///my.db` counts from the same root. With MLFLOW_TRACKING_URI=disabled nothing is logged. If
the store fails, that costs the run, with one warning, never the stage.
"""

import json
import os
import re
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from getpass import getuser
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock

from tactile_viewgcn.files import root
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.provenance import ROW, Record

EXPERIMENT = "tactile-viewgcn"
DISABLED = "disabled"
SQLITE = "sqlite:///"
# packages that a logged model needs
NEEDS = ("torch", "numpy", "scipy", "h5py", "pyyaml", "filelock", "pydantic", "tqdm")
# seconds to wait for other processes that make tables: a minute each on a busy machine
LOCKED = 300
SHOWN = 400  # letters of a warning, since a server may answer with a whole page
FORBIDDEN = r"""[/:.%"']"""  # letters in the name of a model
LONGEST = 5000  # letters of a tag
MOST_METRICS = 1000  # values in one call of MLflow's `log_batch`
# MLflow's pages then show training runs, not chats
KIND = {"mlflow.experimentKind": "custom_model_development"}
NOTE = "mlflow.note.content"  # tag with the description of a run, a model or an experiment
VIEW = "results"  # name of the saved view, which the address of the table ends with
VIEW_TAG = f"mlflow.sharedViewState.{VIEW}"
# columns of the saved view, and their widths
COLUMNS = {
    "attributes.`Run Name`": 340,
    "metrics.`error.whole`": 95,
    "metrics.`error.whole.low`": 120,
    "metrics.`error.whole.high`": 125,
    "metrics.`seconds.total`": 110,
    "metrics.`versus.head.error.whole`": 205,
}
ABOUT_ROWS = (
    "A row is an experiment: the whole pipeline from recordings to errors. `error.whole` is the "
    "share of whole test recordings that were answered wrongly, `low` and `high` are its 95 % "
    "interval, and `versus.head.error.whole` is the difference from the run of the commit."
)
ABOUT_STAGES = "A run is a stage. The rows of `{rows}` name the runs of their stages."
LOCAL = "http://127.0.0.1:5000"  # address of `mlflow ui`
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
    """A run in MLflow.

    Without a run, or after the store has failed, `id` is None and every method does nothing.

    Attributes:
        id: MLflow's id of the run, or None.
        description: what its page says first, before the notes.
    """

    def __init__(self, mlflow: Any = None, run_id: str | None = None, experiment: str = ""):
        self._mlflow = mlflow
        self._experiment = experiment
        self.id = run_id
        self.description = ""

    @property
    def table(self) -> str:
        """Return where MLflow shows the experiment's table; empty where that is unknown."""
        if not self.id:
            return ""
        place = f"/#/experiments/{self._experiment}/runs?viewStateShareKey={VIEW}"
        store = _address()
        if store.startswith(SQLITE):
            return f"mlflow ui, then {LOCAL}{place}"
        if store.startswith(("http://", "https://")):
            return re.sub("://.*@", "://", store).rstrip("/") + place
        return ""

    def log(self, function: str, *values: Any) -> Any:
        """Call one of MLflow's functions for this run, and return what it returns.

        Args:
            function: name of the function, such as `log_metrics`.
            values: its arguments.

        Returns:
            None without a run.
        """
        return self.attempt(lambda mlflow: getattr(mlflow, function)(*values))

    def attempt(self, log: Callable[[Any], Any]) -> Any:
        """Call `log` with the module MLflow, and return what it returns.

        Returns:
            None without a run, and after an error, which is printed as a warning.
        """
        if not self.id:
            return None
        try:
            return log(self._mlflow)
        except Exception as error:
            _warn(error)
            self.id = None
            return None

    def batch(
        self,
        tags: Mapping[str, str],
        parameters: Mapping[str, Any],
        metrics: Sequence[tuple[str, float, int]],
        model: str | None = None,
    ) -> None:
        """Log tags, parameters and metrics together, in as few calls as MLflow allows.

        Args:
            tags: texts by name.
            parameters: values by name.
            metrics: name, value and step of each.
            model: address of the logged model that has the metrics of step 0.
        """

        def log(mlflow: Any) -> None:
            entities = mlflow.entities
            now = int(time.time() * 1000)
            values = []
            for name, value, step in metrics:
                of_model = None
                if model and step == 0:
                    of_model = model.rpartition("/")[2]
                values.append(
                    entities.Metric(name, value, now, step, model_id=of_model, run_id=self.id)
                )
            client = mlflow.MlflowClient()
            client.log_batch(
                self.id,
                metrics=[],
                params=[entities.Param(name, str(value)) for name, value in parameters.items()],
                tags=[entities.RunTag(name, text) for name, text in tags.items()],
            )
            for start in range(0, len(values), MOST_METRICS):
                client.log_batch(self.id, metrics=values[start : start + MOST_METRICS])

        self.attempt(log)

    def dataset(self, source: str, digest: str) -> None:
        """Log path and digest of the data set, which MLflow shows in its column of datasets."""

        def log(mlflow: Any) -> None:
            dataset = mlflow.entities.Dataset(source, digest, "local", source)
            mlflow.MlflowClient().log_inputs(self.id, [mlflow.entities.DatasetInput(dataset)])

        self.attempt(log)

    def model(self, name: str, checkpoint: Path, metadata: dict[str, Any]) -> str | None:
        """Log the classifier as an MLflow model.

        It takes recordings of raw counts, and answers with a column for each class.

        Args:
            name: of the run, which the model has too but for letters that MLflow forbids.
            checkpoint: file of the classifier.
            metadata: stored with the model; its `classes` name the columns.

        Returns:
            The model's address for `mlflow.pyfunc.load_model`; None where nothing is logged.
        """

        def log(mlflow: Any) -> str:
            from mlflow.types import ColSpec, Schema, TensorSpec

            # recordings of any length; no fraction is cut off
            inputs = Schema([TensorSpec(np.dtype(object), (-1,), "recordings")])
            answers = Schema([ColSpec("float", name) for name in metadata["classes"]])
            with warnings.catch_warnings():
                # an example would copy frames of the data set
                warnings.filterwarnings("ignore", message=".*input example")
                logged = mlflow.pyfunc.log_model(
                    name=re.sub(FORBIDDEN, "-", name),
                    loader_module="tactile_viewgcn.recognition.mlflow_model",
                    data_path=str(checkpoint),
                    code_paths=[str(Path(__file__).parent)],
                    signature=mlflow.models.ModelSignature(inputs, answers),
                    pip_requirements=[f"{name}=={_public_version(name)}" for name in NEEDS],
                    metadata=metadata,
                )
            address: str = logged.model_uri
            return address

        address: str | None = self.attempt(log)
        return address

    def card(self, address: str, text: str) -> None:
        """Log the card of a logged model: MLflow shows it as the model's description.

        Args:
            address: of `model`.
            text: the card as Markdown, which the artifact model_card.md has too.
        """

        def log(mlflow: Any) -> None:
            mlflow.log_text(text, "model_card.md")
            mlflow.set_logged_model_tags(address.rpartition("/")[2], {NOTE: text})

        self.attempt(log)

    def record(self, record: Record) -> None:
        """Log what a stage did.

        These are its counts and costs, the md5 of its inputs, its notes as the run's description,
        and the record itself.
        """
        chosen: dict[str, Any] = {}
        numbers: dict[str, Any] = {}
        for name, value in record.counts.items():
            if name.startswith("resolved."):
                chosen[name] = value
            else:
                numbers[name] = value
        if record.stage != ROW:  # the row has the costs of all stages
            numbers["seconds"] = record.seconds
            numbers["peak_mb"] = record.peak_mb
        tags = dict(record.origin)
        for name, entry in record.inputs.items():
            if "md5" in entry:
                tags[f"md5.{name}"] = entry["md5"]
        notes = "\n".join(f"- {note}" for note in record.notes)
        tags[NOTE] = f"{self.description}\n\n{notes}".strip()[:LONGEST]
        self.log("log_params", chosen)
        self.log("log_metrics", numbers)
        self.log("set_tags", tags)
        self.log("log_text", record.text, f"{record.stage}.json")

    def end(self, status: str) -> None:
        """End the run with a status, or FAILED after the store has failed: content is missing."""
        if not self._mlflow:
            return
        if not self.id:
            status = "FAILED"
        with suppress(Exception):
            self._mlflow.end_run(status)


def _public_version(package: str) -> str:
    """Return the version of an installed package, without the name of its build."""
    return version(package).partition("+")[0]


@contextmanager
def stage_run(record: Record, before: float = 0.0) -> Iterator[Run]:
    """Yield the run of a stage.

    It begins with the record's name, parameters and origin, and ends with all of the record. Its
    status is FINISHED when the block ends well, else FAILED or KILLED, with the traceback as
    artifact.

    Args:
        record: the stage's record, which gets the id of the run.
        before: seconds that other stages took, which MLflow counts to this run.
    """
    run = _begin(record, before)
    record.run_id = run.id
    run.log("log_params", record.params.get("values", {}))
    try:
        yield run
        run.record(record)
    except BaseException as error:
        status = "FAILED" if isinstance(error, Exception) else "KILLED"
        run.log("log_text", traceback.format_exc(), "traceback.txt")
        run.end(status)
        raise
    run.end("FINISHED")


def _begin(record: Record, before: float) -> Run:
    """Return a new run in the experiment of rows or of stages, which are made if needed.

    If the store fails, a warning is printed, and the run is none.
    """
    uri = _address()
    if uri == DISABLED:
        return Run()
    rows = os.environ.get("MLFLOW_EXPERIMENT_NAME", EXPERIMENT)
    stages = f"{rows}/stages"
    try:
        import mlflow

        mlflow.set_tracking_uri(uri)
        descriptions = {rows: ABOUT_ROWS, stages: ABOUT_STAGES.format(rows=rows)}
        _make_experiments(mlflow, descriptions, _database(uri))
        experiment = mlflow.set_experiment(rows if record.stage == ROW else stages).experiment_id
        created = mlflow.MlflowClient().create_run(
            experiment,
            start_time=int((time.time() - before) * 1000),
            run_name=record.name or record.stage,
            tags=record.origin | {"mlflow.user": _user(), "mlflow.source.name": record.stage},
        )
        run = mlflow.start_run(created.info.run_id)
        return Run(mlflow, run.info.run_id, experiment)
    except Exception as error:
        _warn(error)
        return Run()


def _user() -> str:
    """Return the name of the user; empty where it has none, as in some containers."""
    try:
        return getuser()
    except (KeyError, OSError):
        return ""


def _make_experiments(mlflow: Any, descriptions: dict[str, str], database: Path | None) -> None:
    """Make the experiments that the store lacks; one process of this machine makes the tables.

    Each has its description, and the saved view of its table: without it MLflow shows no metric.

    Args:
        mlflow: the module.
        descriptions: by name of the experiment.
        database: file of an SQLite store; None for a server.
    """
    artifacts: str | None = None
    lock: AbstractContextManager[Any] = nullcontext()
    if database:
        artifacts = (database.parent / "mlruns").as_uri()
        lock = FileLock(database.with_name("mlflow.db.lock"), timeout=LOCKED)
    with lock:
        client = mlflow.MlflowClient()
        for name, description in descriptions.items():
            tags = {**KIND, NOTE: description, VIEW_TAG: _view()}
            experiment = client.get_experiment_by_name(name)
            with suppress(Exception):  # a process on another machine may be faster
                if not experiment:
                    client.create_experiment(name, artifacts, tags)
                elif VIEW_TAG not in experiment.tags:  # of an earlier version
                    for tag in (NOTE, VIEW_TAG):
                        client.set_experiment_tag(experiment.experiment_id, tag, tags[tag])


def _view() -> str:
    """Return the saved view of an experiment's table, as MLflow's pages keep it."""
    chosen = [name for name in COLUMNS if name.startswith("metrics.")]
    state = {
        "selectedColumns": chosen,
        "columnOrder": list(COLUMNS),
        "columnWidths": COLUMNS,
        "orderByKey": "attributes.`Created`",
        "orderByAsc": False,
    }
    return json.dumps(state)


def _address() -> str:
    """Return the store's address.

    The path of a file is absolute, since DVC deletes the temporary workspaces of experiments.
    """
    for name, value in SETTINGS.items():
        os.environ.setdefault(name, value)
    uri = os.environ.get("MLFLOW_TRACKING_URI") or f"{SQLITE}mlflow.db"
    if uri.startswith(SQLITE):
        return f"{SQLITE}{root() / uri.removeprefix(SQLITE)}"
    return uri


def _database(uri: str) -> Path | None:
    """Return the file of an SQLite store; None for a server."""
    if not uri.startswith(SQLITE):
        return None
    return Path(uri.removeprefix(SQLITE).partition("?")[0])


def _warn(error: Exception) -> None:
    print(f"warning: {_reason(error)}; the stage goes on without it", file=sys.stderr, flush=True)


def _reason(error: Exception) -> str:
    """Return the store and its error in one line.

    Of an error that might repeat a password only the kind is named.
    """
    address, passwords = re.subn("://.*@", "://", _address())
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
    uri = _address()
    database = _database(uri)
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
        raise UserError(f"{name}: {_reason(error)}; is MLFLOW_TRACKING_URI right?") from None


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
