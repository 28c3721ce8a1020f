"""The one module that knows MLflow. Each stage that runs is one run; evaluate's trials are children of its own.

The store is `mlflow.db` at the root of the repository that `dvc` was called in (DVC_ROOT names it inside the
temporary workspaces of `dvc exp run --temp` and `--queue`), artifacts in `mlruns/` beside it. MLflow's own
environment variables override both, a relative `sqlite:///my.db` counts from the same root;
MLFLOW_TRACKING_URI=disabled leaves MLflow out altogether.
"""

import os
import subprocess
import sys
import time
import traceback
import urllib.error
import urllib.request
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from http.client import HTTPException
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from filelock import FileLock

from tactile_viewgcn.files import md5, root

if TYPE_CHECKING:
    from matplotlib.figure import Figure

EXPERIMENT = "tactile-viewgcn"
DISABLED = "disabled"
SQLITE = "sqlite:///"
REACH_SECONDS = 5
BATCH = 100  # parameters, MLflow's limit for one call


class TrackingError(RuntimeError):
    """The tracking server does not answer."""


class Run:
    """One MLflow run. Without a client every method does nothing, and no picture is drawn."""

    def __init__(self, client: Any = None, run_id: str | None = None, experiment: str | None = None, uri: str = ""):
        self._client, self.id, self._experiment, self._uri = client, run_id, experiment, uri
        self.md5s: dict[str, str] = {}

    def inputs(self, paths: dict[str, Path]) -> None:
        """Note the md5 of each input, under its name, in `md5s` too."""
        self.md5s = {name: md5(path) for name, path in paths.items()}
        self.tags({f"md5.{name}": digest for name, digest in self.md5s.items()})

    def parameters(self, values: dict[str, Any]) -> None:
        """Parameters by dotted key."""
        if self._client is None:
            return
        from mlflow.entities import Param

        entries = [Param(key, str(value)) for key, value in values.items()]
        for start in range(0, len(entries), BATCH):
            self._client.log_batch(self.id, params=entries[start : start + BATCH])

    def metrics(self, values: dict[str, float]) -> None:
        """One value each."""
        self.curves({key: [value] for key, value in values.items()})

    def curves(self, values: dict[str, list[float]], picture: str = "") -> None:
        """A value per epoch each, in one call, and a picture of them under that name; nothing where there are none."""
        if self._client is None or not values:
            return
        from mlflow.entities import Metric

        now = int(time.time() * 1000)
        entries = [
            Metric(key, float(value), now, step) for key, line in values.items() for step, value in enumerate(line)
        ]
        for start in range(0, len(entries), 10 * BATCH):
            self._client.log_batch(self.id, metrics=entries[start : start + 10 * BATCH])
        if picture:
            from tactile_viewgcn import plots

            self.figure(picture, lambda: plots.curves(values, Path(picture).stem))

    def tags(self, values: dict[str, Any]) -> None:
        """Tags by name."""
        if self._client is not None:
            for key, value in values.items():
                self._client.set_tag(self.id, key, str(value))

    def artifact(self, path: str | Path) -> None:
        """A file, as it is."""
        if self._client is not None:
            self._client.log_artifact(self.id, str(path))

    def text(self, text: str, name: str) -> None:
        """A text as a file of that name."""
        if self._client is not None:
            self._client.log_text(self.id, text, name)

    def figure(self, name: str, draw: "Callable[[], Figure]") -> None:
        """A picture, drawn only where it is kept."""
        if self._client is not None:
            self._client.log_figure(self.id, draw(), name)

    def child(self, name: str, metrics: dict[str, float], parameters: dict[str, Any]) -> None:
        """A finished run below this one."""
        if self._client is None:
            return
        run = self._client.create_run(self._experiment, run_name=name, tags={"mlflow.parentRunId": self.id})
        below = Run(self._client, run.info.run_id, self._experiment, self._uri)
        below.parameters(parameters)
        below.metrics(metrics)
        self._client.set_terminated(below.id, "FINISHED")

    def model(
        self, checkpoint: Path, views: int, shape: tuple[int, int], dtype: np.dtype, classes: list[str]
    ) -> str | None:
        """The classifier as an MLflow model: raw view sets of counts (n, V, H, W) in, probabilities out.

        Returns:
            Its address, by which `mlflow.pyfunc.load_model` finds it; None without tracking.
        """
        if self._client is None:
            return None
        import mlflow
        from mlflow.models import ModelSignature
        from mlflow.types import ParamSchema, ParamSpec, Schema, TensorSpec

        signature = ModelSignature(
            Schema([TensorSpec(dtype, (-1, views, *shape))]),
            Schema([TensorSpec(np.dtype(np.float32), (-1, len(classes)))]),
            ParamSchema([ParamSpec("session", "string", ""), ParamSpec("rest", "double", [], shape=(-1,))]),
        )
        mlflow.set_tracking_uri(self._uri)
        with warnings.catch_warnings(), mlflow.start_run(run_id=self.id):
            warnings.filterwarnings("ignore", message=".*input example")  # it would copy frames of the data set
            logged = mlflow.pyfunc.log_model(
                name="classifier",
                loader_module="tactile_viewgcn.served",
                data_path=str(checkpoint),
                code_paths=[str(Path(__file__).parent)],
                signature=signature,
                pip_requirements=["torch", "numpy", "h5py", "pyyaml"],
                metadata={"classes": classes},
            )
        return logged.model_uri


@contextmanager
def stage_run(name: str) -> Iterator[Run]:
    """The run of one stage: FINISHED when the block ends well, else FAILED with its traceback as artifact.

    Raises:
        TrackingError: the server does not answer; before the block runs.
    """
    uri = _store(os.environ.get("MLFLOW_TRACKING_URI") or f"{SQLITE}mlflow.db")
    if uri == DISABLED:
        yield Run()
        return
    os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")  # MLflow looks when it is imported
    os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")
    client, experiment = _open(uri)
    tags = {"stage": name, "command": " ".join(sys.orig_argv[1:])} | _revision()
    if "DVC_EXP_NAME" in os.environ:
        tags["dvc.experiment"] = os.environ["DVC_EXP_NAME"]
    from mlflow.exceptions import MlflowException

    try:
        run = Run(client, client.create_run(experiment, run_name=name, tags=tags).info.run_id, experiment, uri)
    except MlflowException as error:
        raise _refusal(uri, error) from None
    status = "FAILED"
    try:
        yield run
        status = "FINISHED"
    except (KeyboardInterrupt, SystemExit):
        status = "KILLED"
        raise
    except MlflowException as error:  # the server went away, or refuses what it is given
        raise _refusal(uri, error) from error
    except Exception:
        with suppress(MlflowException):  # the stage's own error is the one to tell
            run.text(traceback.format_exc(), "traceback.txt")
        raise
    finally:
        with suppress(MlflowException):
            client.set_terminated(run.id, status)


def _refusal(uri: str, error: Exception) -> TrackingError:
    return TrackingError(
        f"MLflow store {uri}: {' '.join(str(error).split())}; correct MLFLOW_TRACKING_URI, or set it to {DISABLED}"
    )


def _store(uri: str) -> str:
    """A store's address with an absolute path: DVC deletes a temporary workspace, and what is relative to it."""
    path = uri.removeprefix(SQLITE)
    if path == uri or path.startswith((":memory:", "file:")):
        return uri
    return f"{SQLITE}{root() / path}"  # a path that is absolute already, after a fourth slash, stays so


def _open(uri: str) -> tuple[Any, str]:
    """A client and the experiment's id; a fresh store is made by one process at a time."""
    if uri.startswith(("http://", "https://")):
        _reach(uri)
    from mlflow import MlflowClient
    from mlflow.exceptions import MlflowException

    name = os.environ.get("MLFLOW_EXPERIMENT_NAME", EXPERIMENT)
    local = uri.startswith("sqlite:")
    try:
        with FileLock(root() / "mlflow.db.lock") if local else nullcontext():
            client = MlflowClient(tracking_uri=uri)
            found = client.get_experiment_by_name(name)
            if found is None:
                place = (root() / "mlruns").as_uri() if local else None
                return client, client.create_experiment(name, artifact_location=place)
    except (MlflowException, OSError, ImportError) as error:
        raise _refusal(uri, error) from None
    if found.lifecycle_stage == "deleted":
        remedy = f"restore it (mlflow experiments restore -x {found.experiment_id}) or name another"
        raise TrackingError(f"MLflow experiment {name!r} is deleted; {remedy} with MLFLOW_EXPERIMENT_NAME")
    return client, found.experiment_id


def _reach(uri: str) -> None:
    """Any answer will do, a refusal too: MLflow itself would try for minutes."""
    try:
        urllib.request.urlopen(f"{uri.rstrip('/')}/health", timeout=REACH_SECONDS).close()
    except urllib.error.HTTPError:
        return
    except (OSError, ValueError, HTTPException) as error:
        raise TrackingError(
            f"MLflow server {uri} does not answer ({error}); start it, correct MLFLOW_TRACKING_URI, "
            f"or set it to {DISABLED}"
        ) from None


def _revision() -> dict[str, str]:
    """The git revision of the code that runs, and whether it was changed; nothing outside git."""

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], capture_output=True, text=True, check=True).stdout.strip()

    try:
        return {
            "mlflow.source.git.commit": git("rev-parse", "HEAD"),
            "git.dirty": str(bool(git("status", "--porcelain", "--untracked-files=no"))).lower(),
        }
    except (OSError, subprocess.CalledProcessError):
        return {}
