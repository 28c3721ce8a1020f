"""The one module that knows MLflow, and imports it late.

An evaluated pipeline is one row of the experiment `tactile-viewgcn`: the run of `evaluate`. The runs of the other
stages lie in `tactile-viewgcn/stages`. Where the store is: see `tracking_store`.
"""

import os
import socket
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import locked
from tactile_viewgcn.process import is_running
from tactile_viewgcn.provenance import run_tags
from tactile_viewgcn.tracking_store import (
    DISABLED,
    StoreLocked,
    address,
    check_store,
    existing_address,
    is_locked,
    refusal,
    store_folder,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EXPERIMENT = "tactile-viewgcn"
MODEL_NEEDS = "torch", "numpy", "h5py", "pyyaml", "filelock"  # packages that every logged model needs
KIND = {"mlflow.experimentKind": "custom_model_development"}  # its pages show trainings, not chats
MOST_LETTERS = 200  # of a reason that is printed
STORE = "store"  # tag of an experiment: the folder of the database that it was created in


class Run:
    """MLflow's run under way; without one, its `id` is None and every method does nothing.

    No stage is lost for its row: where the store fails, a line says so, and nothing more is logged.
    """

    def __init__(self, mlflow: Any = None, run_id: str | None = None):
        self._mlflow, self.id = mlflow, run_id

    def parameters(self, values: dict[str, Any]) -> None:
        """Log parameters, and counts that are no result, by name."""
        self._log(lambda mlflow: mlflow.log_params(values))

    def metrics(self, values: dict[str, float], step: int = 0) -> None:
        """Log a value each, of a step such as an epoch or a trial."""
        self._log(lambda mlflow: mlflow.log_metrics(values, step))

    def tags(self, values: dict[str, Any]) -> None:
        """Set tags by name."""
        self._log(lambda mlflow: mlflow.set_tags(values))

    def dataset(self, source: str, digest: str) -> None:
        """Log the data set by its path and digest, in MLflow's own column of datasets."""

        def log(mlflow: Any) -> None:
            from mlflow.entities import Dataset, DatasetInput

            mlflow.MlflowClient().log_inputs(self.id, [DatasetInput(Dataset(source, digest, "local", source))])

        self._log(log)

    def artifacts(self, path: Path) -> None:
        """Log a file, or all files of a folder, as they are."""
        self._log(lambda mlflow: (mlflow.log_artifacts if path.is_dir() else mlflow.log_artifact)(str(path)))

    def text(self, text: str, name: str) -> None:
        """Log a text as a file of that name."""
        self._log(lambda mlflow: mlflow.log_text(text, name))

    def figure(self, name: str, figure: "Figure") -> None:
        """Log a picture; draw one only where there is an `id`."""
        self._log(lambda mlflow: mlflow.log_figure(figure, name))

    def model(
        self,
        checkpoint: Path,
        views: int,
        shape: tuple[int, int],
        dtype: np.dtype,
        classes: list[str],
        packages: tuple[str, ...] = (),
    ) -> str | None:
        """Log the classifier as an MLflow model: view sets of raw counts (n, V, H, W) in, a column for each class out.

        Its requirements name the versions that are installed. The signature says no type of the counts: of `int16`
        MLflow's server would cut fractions off before the model sees them. Shape and type are in the metadata.

        Args:
            packages: what its system needs besides.

        Returns:
            Its address, for `mlflow.pyfunc.load_model`; None where it is not logged.
        """
        metadata = {"classes": classes, "views": views, "shape": list(shape), "dtype": str(dtype)}
        return self._log(lambda mlflow: _log_model(mlflow, checkpoint, packages, metadata))

    def _log(self, log: Callable[[Any], Any]) -> Any:
        if not self._mlflow:
            return None
        from mlflow.exceptions import MlflowException

        try:
            return log(self._mlflow)
        except (MlflowException, OSError) as error:  # OSError: of the disk
            _not_logged(error)
            self._mlflow = self.id = None
            return None


def _log_model(mlflow: Any, checkpoint: Path, packages: tuple[str, ...], metadata: dict[str, Any]) -> str:
    from mlflow.models import ModelSignature
    from mlflow.types import ColSpec, ParamSchema, ParamSpec, Schema, TensorSpec

    signature = ModelSignature(
        Schema([TensorSpec(np.dtype(object), (-1,), "counts")]),
        Schema([ColSpec("float", name) for name in metadata["classes"]]),
        ParamSchema([ParamSpec("session", "string", ""), ParamSpec("baseline", "double", [], shape=(-1,))]),
    )
    needs = [f"{name}=={version(name).partition('+')[0]}" for name in (*MODEL_NEEDS, *packages)]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*input example")  # it would copy frames of the data set
        logged = mlflow.pyfunc.log_model(
            name="classifier",
            loader_module="tactile_viewgcn.recognition.mlflow_model",
            data_path=str(checkpoint),
            code_paths=[str(Path(__file__).parent)],
            signature=signature,
            pip_requirements=needs,
            metadata=metadata,
        )
    return logged.model_uri


def _not_logged(error: Exception) -> None:
    """Say that a stage goes on without its row, and why."""
    text = " ".join(str(error).split())[:MOST_LETTERS]
    print(f"warning: MLflow store {address()}: {text}; the stage goes on without it", file=sys.stderr, flush=True)


@contextmanager
def stage_run(stage: str, name: str | None = None, *, row: bool = False) -> Iterator[Run]:
    """The run of one stage: FINISHED when the block ends well, else FAILED with its traceback as artifact, or KILLED.

    Args:
        name: what people see; the stage's where it is left out.
        row: an evaluated pipeline, a row of the experiment that people compare.

    A store that another program has locked is left out, with a warning.

    Raises:
        UserError: the store does not answer, or refuses; before the block runs.
    """
    uri = address()
    if uri == DISABLED:
        yield Run()
        return
    run_id = None
    try:
        run_id = _start(uri, stage, name or stage, row)
    except StoreLocked as error:
        _not_logged(error)
    if not run_id:
        yield Run()
        return
    import mlflow

    logged, status = Run(mlflow, run_id), "FAILED"
    try:
        yield logged
        status = "FINISHED" if logged.id else "FAILED"  # without all that it should hold
    except (KeyboardInterrupt, SystemExit):
        status = "KILLED"
        raise
    except Exception:
        with suppress(Exception):  # the stage's own error is the one to tell
            mlflow.log_text(traceback.format_exc(), "traceback.txt")
        raise
    finally:
        with suppress(Exception):
            mlflow.end_run(status)


def _start(uri: str, stage: str, name: str, row: bool) -> str:
    """The id of a run that begins in a store that answers."""
    check_store(uri)
    import mlflow
    from mlflow.exceptions import MlflowException

    try:
        mlflow.set_tracking_uri(uri)
        rows, stages = _experiments(uri)
        _close_killed([rows, stages])
        run = mlflow.start_run(experiment_id=rows if row else stages, run_name=name, tags=run_tags(stage))
        return run.info.run_id
    except (MlflowException, OSError, ImportError) as error:
        if is_locked(error):
            raise StoreLocked("locked by another program") from None
        raise refusal(uri, error) from None


def _close_killed(experiments: list[str]) -> None:
    """Close this machine's runs whose process is gone, as after `kill -9`."""
    from mlflow import MlflowClient

    running = f"attributes.status = 'RUNNING' and tags.host = '{socket.gethostname()}'"
    for run in MlflowClient().search_runs(experiments, running):
        if "pid" in (tags := run.data.tags) and not is_running(int(tags["pid"]), tags.get("start_ticks", "")):
            MlflowClient().set_terminated(run.info.run_id, "KILLED")


def _experiments(uri: str) -> list[str]:
    """The ids of the experiments of rows and stages; a fresh store is made by one process at a time."""
    name, folder = os.environ.get("MLFLOW_EXPERIMENT_NAME", EXPERIMENT), store_folder(uri)
    with locked(folder / "mlflow.db.lock") if folder else nullcontext():
        return [_experiment(name, folder), _experiment(f"{name}/stages", folder)]


def _experiment(name: str, folder: Path | None) -> str:
    """The id of an experiment, created where there is none; of another one where its artifacts lie in another folder.

    That is so in a database that was copied or moved.
    """
    from mlflow import MlflowClient
    from mlflow.exceptions import MlflowException

    client = MlflowClient()
    experiment = client.get_experiment_by_name(name)
    if experiment and folder and experiment.tags.get(STORE, str(folder)) != str(folder):
        return _experiment(f"{name} in {folder}", folder)
    if experiment and experiment.lifecycle_stage == "deleted":
        remedy = f"restore it (mlflow experiments restore -x {experiment.experiment_id}) or name another"
        raise UserError(f"MLflow experiment {name!r} is deleted; {remedy} with MLFLOW_EXPERIMENT_NAME")
    if experiment:
        return experiment.experiment_id
    place, tags = ((folder / "mlruns").as_uri(), {STORE: str(folder)}) if folder else (None, {})
    try:
        return client.create_experiment(name, place, tags | KIND)
    except MlflowException:
        faster = client.get_experiment_by_name(name)  # another process's: no file locks a server's store
        if faster is None:
            raise
        return faster.experiment_id


def read_artifact(run_id: str, name: str) -> bytes:
    """The content of a file that a run keeps.

    Raises:
        FileNotFoundError: the store has no such run, or the run no such file.
        UserError: tracking is disabled, or there is no store, or it does not answer.
    """
    uri = existing_address(f"MLflow run {run_id}")
    from mlflow import MlflowClient
    from mlflow.exceptions import MlflowException

    try:
        with tempfile.TemporaryDirectory() as folder:
            return Path(MlflowClient(uri).download_artifacts(run_id, name, folder)).read_bytes()
    except MlflowException as error:
        if error.error_code == "RESOURCE_DOES_NOT_EXIST":
            raise FileNotFoundError(name) from None
        raise refusal(uri, error) from None


def download_model(name: str, folder: Path) -> Path:
    """The classifier's file of `runs:/ID` or `models:/NAME/VERSION`, downloaded into a folder.

    Raises:
        UserError: tracking is disabled, or the store does not have it, or does not answer.
    """
    uri = existing_address(name)
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


def bad_request(message: str) -> Exception:
    """MLflow's exception for a mistake of the user: its server answers 400 and the message, without a traceback."""
    from mlflow.exceptions import MlflowException

    exception = MlflowException.invalid_parameter_value(message)
    exception.json_kwargs = {"message": message}  # its server would put all of the input in front of it
    return exception
