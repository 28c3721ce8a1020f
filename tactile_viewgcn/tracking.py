"""Runs in MLflow: one run for each stage, with what the stage was given, did and found.

The run of `evaluate` is the pipeline's row in the experiment `tactile-viewgcn`. The runs of the
other stages are in the experiment `tactile-viewgcn/stages`. A run begins and ends with its stage.
Only the row begins earlier, by the seconds that the stages before it took.

With MLFLOW_TRACKING_URI=disabled nothing is logged. If the store fails, the run is lost and one
warning is printed; the stage itself goes on. Only functions import MLflow, since it loads slowly.
"""

import json
import os
import re
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from getpass import getuser
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from filelock import FileLock

from tactile_viewgcn.mlflow_store import DISABLED, SQLITE, database_file, error_line, store_address
from tactile_viewgcn.provenance import ROW, Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EXPERIMENT = "tactile-viewgcn"
# packages that a logged model needs
NEEDS = ("torch", "numpy", "scipy", "h5py", "pyyaml", "filelock", "pydantic", "tqdm")
# seconds to wait for other processes that make tables; each takes a minute on a busy machine
LOCKED = 300
FORBIDDEN = r"""[/:.%"']"""  # letters that MLflow forbids in the name of a model
LONGEST = 5000  # letters of a tag
MOST_METRICS = 1000  # values in one call of MLflow's `log_batch`
# with this tag MLflow's pages show training runs, not chats
KIND = {"mlflow.experimentKind": "custom_model_development"}
NOTE = "mlflow.note.content"  # tag with the description of a run, a model or an experiment
VIEW = "results"  # name of the saved view; the address of the table ends with it
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
    "share of whole test recordings that were answered wrongly; `low` and `high` are the ends of "
    "its 95 % interval. `versus.head.error.whole` is the difference from the run of the commit."
)
ABOUT_STAGES = "Each run is a stage. The rows of `{rows}` name the runs of their stages."
LOCAL = "http://127.0.0.1:5000"  # address of `mlflow ui`


class Run:
    """A run in MLflow.

    If there is no run, or the store has failed, `id` is None and every method does nothing.

    Attributes:
        id: MLflow's id of the run, or None.
        description: the beginning of the run's page in MLflow; the notes follow it.
    """

    def __init__(self, mlflow: Any = None, run_id: str | None = None, experiment: str = ""):
        self._mlflow = mlflow
        self._experiment = experiment
        self.id = run_id
        self.description = ""

    @property
    def table(self) -> str:
        """Return where MLflow shows the experiment's table; empty if this is not known."""
        if not self.id:
            return ""
        place = f"/#/experiments/{self._experiment}/runs?viewStateShareKey={VIEW}"
        store = store_address()
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
            None if there is no run.
        """
        return self.attempt(lambda mlflow: getattr(mlflow, function)(*values))

    def attempt(self, log: Callable[[Any], Any]) -> Any:
        """Call `log` with the module MLflow, and return what it returns.

        Returns:
            None if there is no run, or after an error, which is printed as a warning.
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
            metrics: name, value and step of each metric.
            model: address of the logged model, which gets the metrics of step 0 too.
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
        """Log the path and the digest of the data set, for MLflow's column of datasets."""

        def log(mlflow: Any) -> None:
            dataset = mlflow.entities.Dataset(source, digest, "local", source)
            mlflow.MlflowClient().log_inputs(self.id, [mlflow.entities.DatasetInput(dataset)])

        self.attempt(log)

    def model(self, name: str, checkpoint: Path, metadata: dict[str, Any]) -> str | None:
        """Log the classifier as an MLflow model.

        The model takes recordings of raw counts, and answers with a column for each class.

        Args:
            name: name of the run. The model gets the same name, with `-` for the letters that
                MLflow forbids.
            checkpoint: file of the classifier.
            metadata: stored with the model; its `classes` name the columns.

        Returns:
            The model's address for `mlflow.pyfunc.load_model`; None if nothing is logged.
        """

        def log(mlflow: Any) -> str:
            from mlflow.types import ColSpec, Schema, TensorSpec

            # the type `object` allows recordings of any length, and cuts off no fractions
            inputs = Schema([TensorSpec(np.dtype(object), (-1,), "recordings")])
            answers = Schema([ColSpec("float", name) for name in metadata["classes"]])
            with warnings.catch_warnings():
                # no example is given, since it would copy frames of the data set
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

    def pages(self, figures: Mapping[str, "Figure"], texts: Mapping[str, str]) -> None:
        """Log figures and texts as artifacts, by the names of their files."""

        def log(mlflow: Any) -> None:
            for file, figure in figures.items():
                mlflow.log_figure(figure, file)
            for file, text in texts.items():
                mlflow.log_text(text, file)

        self.attempt(log)

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
        """Log what a stage did, by its record.

        Logged are the counts and the costs, the md5 of the inputs, the notes as the run's
        description, and the record itself.
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
        """End the run with a status; with FAILED if the store failed, since content is missing."""
        if not self._mlflow:
            return
        if not self.id:
            status = "FAILED"
        with suppress(Exception):
            self._mlflow.end_run(status)


def _public_version(package: str) -> str:
    """Return the version of an installed package, without the name of the build."""
    return version(package).partition("+")[0]


@contextmanager
def stage_run(record: Record, before: float = 0.0) -> Iterator[Run]:
    """Yield the run of a stage.

    At the beginning the run gets the record's name, parameters and origin, and at the end the whole
    record. Its status becomes FINISHED if the block ends well. Otherwise the status is FAILED or
    KILLED, and the traceback becomes an artifact.

    Args:
        record: the stage's record, which gets the id of the run.
        before: seconds that earlier stages took; MLflow counts them as time of this run.
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
    """Return a new run in the experiment of rows or of stages.

    Experiments that are missing are made. If the store fails, a warning is printed, and the
    returned run does nothing.
    """
    uri = store_address()
    if uri == DISABLED:
        return Run()
    rows = os.environ.get("MLFLOW_EXPERIMENT_NAME", EXPERIMENT)
    stages = f"{rows}/stages"
    try:
        import mlflow

        mlflow.set_tracking_uri(uri)
        descriptions = {rows: ABOUT_ROWS, stages: ABOUT_STAGES.format(rows=rows)}
        _make_experiments(mlflow, descriptions, database_file(uri))
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
    """Return the name of the user; empty if the user has no name, as in some containers."""
    try:
        return getuser()
    except (KeyError, OSError):
        return ""


def _make_experiments(mlflow: Any, descriptions: dict[str, str], database: Path | None) -> None:
    """Make the experiments that the store lacks; one process of this machine makes the tables.

    Each experiment has a description, and a saved view of its table, without which MLflow shows no
    metric.

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
            with suppress(Exception):  # a process on another machine can be faster
                if not experiment:
                    client.create_experiment(name, artifacts, tags)
                elif VIEW_TAG not in experiment.tags:  # made by an earlier version
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


def _warn(error: Exception) -> None:
    print(
        f"warning: {error_line(error)}; the stage goes on without it", file=sys.stderr, flush=True
    )
