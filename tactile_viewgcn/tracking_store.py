"""Where MLflow's store is, without MLflow itself.

It is `mlflow.db` at the root of the repository that `dvc` was called in (DVC_ROOT names it inside the temporary
workspaces of `dvc exp run --temp` and `--queue`), artifacts in `mlruns/` beside it. MLflow's own environment variables
override both, a relative `sqlite:///my.db` counts from the same root; MLFLOW_TRACKING_URI=disabled leaves MLflow out.
"""

import os
import sqlite3
import urllib.error
import urllib.request
from contextlib import closing
from http.client import HTTPException
from pathlib import Path

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import root

DISABLED = "disabled"
SQLITE = "sqlite:///"
DATABASES = "postgresql", "mysql", "mssql"  # that MLflow can also open without a server
REACH_SECONDS = 5
LOCK_SECONDS = 10  # that a database may be locked; stages that run at once lock it for less
QUIET = {  # MLflow looks when it is imported
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_LOGGING_LEVEL": "WARNING",  # it tells of the tables that it creates
    "MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR": "false",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
    "GIT_PYTHON_REFRESH": "quiet",
}


class StoreLocked(Exception):
    """Another program has locked the store's database."""


def address() -> str:
    """The address of the store, a path in it absolute: DVC deletes a temporary workspace, and what is relative to it.

    MLflow is told to be quiet.
    """
    for name, value in QUIET.items():
        os.environ.setdefault(name, value)
    uri = os.environ.get("MLFLOW_TRACKING_URI") or f"{SQLITE}mlflow.db"
    path = uri.removeprefix(SQLITE)
    if path == uri or path.startswith((":memory:", "file:")):
        return uri
    return f"{SQLITE}{root() / path}"  # a path that is absolute already, after a fourth slash, stays so


def existing_address(what: str) -> str:
    """The store's address. A UserError, whose message begins with `what`, where tracking is disabled or no store is."""
    uri = address()
    if uri == DISABLED:
        raise UserError(f"{what}: MLFLOW_TRACKING_URI is {DISABLED}; name the store that has it")
    if uri.startswith(SQLITE) and not Path(uri.removeprefix(SQLITE).partition("?")[0]).exists():
        raise UserError(f"{what}: no MLflow store at {uri}; name the store that has it with MLFLOW_TRACKING_URI")
    return uri


def store_folder(uri: str) -> Path | None:
    """The folder of an SQLite store and of its artifacts; None of any other store, which has its own place."""
    if not uri.startswith("sqlite:"):
        return None
    return Path(uri.removeprefix(SQLITE).partition("?")[0]).parent if uri.startswith(f"{SQLITE}/") else root()


def check_store(uri: str) -> None:
    """Refuse a server that does not answer within seconds, and a database without a server, before any work.

    MLflow itself would try a server for minutes. Behind a database it would keep models and pictures in the working
    folder, which DVC deletes after an experiment, and processes that open a fresh one at once would fail.

    Raises:
        StoreLocked: its file is locked for ten seconds, where MLflow would try for half a minute and fail.
    """
    scheme = uri.partition(":")[0]
    if scheme.partition("+")[0] in DATABASES:
        raise UserError(
            f"MLFLOW_TRACKING_URI is a {scheme} database, which keeps no models and pictures; expected a server in "
            "front of it: mlflow server --backend-store-uri DATABASE --artifacts-destination FOLDER"
        )
    if store_folder(uri):
        _check_lock(uri)
    if scheme not in ("http", "https"):
        return
    try:
        urllib.request.urlopen(f"{uri.rstrip('/')}/health", timeout=REACH_SECONDS).close()
    except urllib.error.HTTPError:
        return  # any answer will do
    except (OSError, ValueError, HTTPException) as error:
        raise UserError(
            f"MLflow server {uri} does not answer ({error}); start it, correct MLFLOW_TRACKING_URI, "
            f"or set it to {DISABLED}"
        ) from None


def _check_lock(uri: str) -> None:
    path = Path(uri.removeprefix(SQLITE).partition("?")[0])
    if not path.is_file():
        return
    try:
        with closing(sqlite3.connect(path, timeout=LOCK_SECONDS)) as database:
            database.execute("BEGIN IMMEDIATE")
    except sqlite3.Error as error:  # other errors are MLflow's to tell
        if error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_BUSY:  # beyond it the code says how
            raise StoreLocked(f"locked by another program for {LOCK_SECONDS} s") from None


def is_locked(error: BaseException | None) -> bool:
    """Whether an error comes from a database that another program has locked."""
    while error and not isinstance(error, sqlite3.OperationalError):
        error = error.__cause__ or error.__context__
    codes = sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED
    return isinstance(error, sqlite3.OperationalError) and error.sqlite_errorcode in codes


def refusal(uri: str, error: Exception) -> UserError:
    """The error of a store that does not do what it is asked."""
    return UserError(
        f"MLflow store {uri}: {' '.join(str(error).split())}; correct MLFLOW_TRACKING_URI, or set it to {DISABLED}"
    )
