"""The one module that knows MLflow, and imports it late.

An evaluated pipeline is one row of the experiment `tactile-viewgcn`: the run of `evaluate`. The runs of the other
stages lie in `tactile-viewgcn/stages`.

The store is `mlflow.db` at the root of the repository that `dvc` was called in (DVC_ROOT names it inside the
temporary workspaces of `dvc exp run --temp` and `--queue`), artifacts in `mlruns/` beside it. MLflow's own
environment variables override both, a relative `sqlite:///my.db` counts from the same root;
MLFLOW_TRACKING_URI=disabled leaves MLflow out altogether.
"""

import os
import socket
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from filelock import FileLock

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.process import is_running
from tactile_viewgcn.provenance import run_tags
from tactile_viewgcn.tracking_store import DISABLED, address, check_store, existing_address, refusal, store_folder

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EXPERIMENT = "tactile-viewgcn"
MODEL_NEEDS = "torch", "numpy", "h5py", "pyyaml", "filelock"  # packages that every logged model needs
PARAMETERS_AT_ONCE = 100  # MLflow's limit for one call
KIND = {"mlflow.experimentKind": "custom_model_development"}  # its pages show trainings, not chats
STORE = "store"  # tag of an experiment: the folder of the database that it was created in


class Run:
    """One MLflow run. Without a client every method does nothing, and no picture is drawn."""

    def __init__(self, client: Any = None, run_id: str | None = None, uri: str = ""):
        self._client, self.id, self._uri = client, run_id, uri

    def parameters(self, values: dict[str, Any]) -> None:
        """Log parameters, and counts that are no result, by name."""
        if self._client is None:
            return
        from mlflow.entities import Param

        entries = [Param(key, str(value)) for key, value in values.items()]
        for start in range(0, len(entries), PARAMETERS_AT_ONCE):
            self._client.log_batch(self.id, params=entries[start : start + PARAMETERS_AT_ONCE])

    def metrics(self, values: dict[str, float], step: int = 0) -> None:
        """Log one value each, of a step such as an epoch, in one call."""
        self._log({key: {step: value} for key, value in values.items()})

    def series(self, values: dict[str, list[float]]) -> None:
        """Log a value for each of the steps 1, 2, ... in one call."""
        self._log({key: dict(enumerate(line, start=1)) for key, line in values.items()})

    def _log(self, values: dict[str, dict[int, float]]) -> None:
        if self._client is None or not values:
            return
        from mlflow.entities import Metric

        now = int(time.time() * 1000)
        entries = [Metric(key, float(x), now, step) for key, steps in values.items() for step, x in steps.items()]
        self._client.log_batch(self.id, metrics=entries)

    def tags(self, values: dict[str, Any]) -> None:
        """Set tags by name, in one call."""
        if self._client is None:
            return
        from mlflow.entities import RunTag

        self._client.log_batch(self.id, tags=[RunTag(key, str(value)) for key, value in values.items()])

    def dataset(self, source: str, digest: str) -> None:
        """Log the data set by its path and digest, in MLflow's own column of datasets."""
        if self._client is None:
            return
        from mlflow.entities import Dataset, DatasetInput

        self._client.log_inputs(self.id, [DatasetInput(Dataset(source, digest, "local", source))])

    def artifacts(self, path: Path) -> None:
        """Log a file, or all files of a folder, as they are."""
        if self._client is None:
            return
        log = self._client.log_artifacts if path.is_dir() else self._client.log_artifact
        log(self.id, str(path))

    def text(self, text: str, name: str) -> None:
        """Log a text as a file of that name."""
        if self._client is not None:
            self._client.log_text(self.id, text, name)

    def figure(self, name: str, draw: "Callable[[], Figure]") -> None:
        """Log a picture, which is drawn only where there is a store."""
        if self._client is not None:
            self._client.log_figure(self.id, draw(), name)

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
            Its address, for `mlflow.pyfunc.load_model`; None without tracking.
        """
        if self._client is None:
            return None
        import mlflow
        from mlflow.models import ModelSignature
        from mlflow.types import ColSpec, ParamSchema, ParamSpec, Schema, TensorSpec

        signature = ModelSignature(
            Schema([TensorSpec(np.dtype(object), (-1,), "counts")]),
            Schema([ColSpec("float", name) for name in classes]),
            ParamSchema([ParamSpec("session", "string", ""), ParamSpec("baseline", "double", [], shape=(-1,))]),
        )
        needs = [f"{name}=={version(name).partition('+')[0]}" for name in (*MODEL_NEEDS, *packages)]
        mlflow.set_tracking_uri(self._uri)
        with warnings.catch_warnings(), mlflow.start_run(run_id=self.id):
            warnings.filterwarnings("ignore", message=".*input example")  # it would copy frames of the data set
            logged = mlflow.pyfunc.log_model(
                name="classifier",
                loader_module="tactile_viewgcn.recognition.mlflow_model",
                data_path=str(checkpoint),
                code_paths=[str(Path(__file__).parent)],
                signature=signature,
                pip_requirements=needs,
                metadata={"classes": classes, "views": views, "shape": list(shape), "dtype": str(dtype)},
            )
        self._client.update_run(self.id, status="RUNNING")  # the block has ended MLflow's run, the stage goes on
        return logged.model_uri


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

    refusal = MlflowException.invalid_parameter_value(message)
    refusal.json_kwargs = {"message": message}  # its server would put all of the input in front of it
    return refusal


@contextmanager
def stage_run(stage: str, name: str | None = None, *, row: bool = False) -> Iterator[Run]:
    """The run of one stage: FINISHED when the block ends well, else FAILED with its traceback as artifact.

    Runs of this machine whose process is gone without closing them are closed first, as KILLED.

    Args:
        name: what people see; the stage's where it is left out.
        row: an evaluated pipeline, a row of the experiment that people compare.

    Raises:
        UserError: the store does not answer, or refuses; before the block runs.
    """
    uri = address()
    if uri == DISABLED:
        yield Run()
        return
    from mlflow.exceptions import MlflowException

    try:
        client, rows, stages = _open(uri)
        _close_killed(client, [rows, stages])
        experiment = rows if row else stages
        run = Run(client, client.create_run(experiment, run_name=name or stage, tags=run_tags(stage)).info.run_id, uri)
    except (MlflowException, OSError, ImportError) as error:
        raise refusal(uri, error) from None
    status = "FAILED"
    try:
        yield run
        status = "FINISHED"
    except (KeyboardInterrupt, SystemExit):
        status = "KILLED"
        raise
    except MlflowException as error:  # the server went away, or refuses what it is given
        raise refusal(uri, error) from error
    except Exception:
        with suppress(MlflowException):  # the stage's own error is the one to tell
            run.text(traceback.format_exc(), "traceback.txt")
        raise
    finally:
        with suppress(MlflowException):
            client.set_terminated(run.id, status)


def _close_killed(client: Any, experiments: list[str]) -> None:
    """Close this machine's runs that are RUNNING though their process is gone, as after `kill -9`."""
    running = f"attributes.status = 'RUNNING' and tags.host = '{socket.gethostname()}'"
    for run in client.search_runs(experiments, running):
        if "pid" in (tags := run.data.tags) and not is_running(int(tags["pid"]), tags.get("start_ticks", "")):
            client.set_terminated(run.info.run_id, "KILLED")


def _open(uri: str) -> tuple[Any, str, str]:
    """A client, and the ids of the experiments of rows and stages; a fresh store is made by one process at a time."""
    check_store(uri)
    from mlflow import MlflowClient

    name, folder = os.environ.get("MLFLOW_EXPERIMENT_NAME", EXPERIMENT), store_folder(uri)
    with FileLock(folder / "mlflow.db.lock") if folder else nullcontext():
        client = MlflowClient(tracking_uri=uri)
        return client, _experiment(client, name, folder), _experiment(client, f"{name}/stages", folder)


def _experiment(client: Any, name: str, folder: Path | None) -> str:
    """The id of an experiment, created where there is none.

    One that came to this `folder` in a copied or moved database would write its artifacts to where it was created: it
    keeps its runs under a name that says so, and the one that was here before, or a new one, takes its place.
    """
    from mlflow.exceptions import MlflowException

    experiment = client.get_experiment_by_name(name)
    if experiment is not None and experiment.lifecycle_stage == "deleted":
        remedy = f"restore it (mlflow experiments restore -x {experiment.experiment_id}) or name another"
        raise UserError(f"MLflow experiment {name!r} is deleted; {remedy} with MLFLOW_EXPERIMENT_NAME")
    if folder is not None and experiment is not None and experiment.tags.get(STORE, str(folder)) != str(folder):
        moved = f"{name} of {experiment.tags[STORE]}"
        client.rename_experiment(experiment.experiment_id, moved)
        print(f"MLflow: the runs that came with this copy are in the experiment {moved!r}, new ones in {name!r}")
        experiment = client.get_experiment_by_name(f"{name} of {folder}")
        if experiment is not None:
            client.rename_experiment(experiment.experiment_id, name)
    if experiment is not None:
        return experiment.experiment_id
    place, tags = (None, {}) if folder is None else ((folder / "mlruns").as_uri(), {STORE: str(folder)})
    with suppress(MlflowException):
        return client.create_experiment(name, place, tags | KIND)
    faster = client.get_experiment_by_name(name)  # another process's: no file locks a server's store
    return faster.experiment_id if faster else client.create_experiment(name, place, tags | KIND)
