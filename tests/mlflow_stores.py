"""Fresh MLflow stores, whose tables, which MLflow takes seconds to make, are made once a session; runs in them.

And a server that answers as MLflow's does, as far as a stage asks it.
"""

import json
import tempfile
from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

from tactile_viewgcn.tracking import EXPERIMENT


def fresh_store(path: Path) -> str:
    """The address of a new store at `path`, without experiments of ours."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(_tables())
    return f"sqlite:///{path}"


def runs_of(client, name=f"{EXPERIMENT}/stages") -> list:
    """The runs of an experiment."""
    return client.search_runs([client.get_experiment_by_name(name).experiment_id])


@cache
def _tables() -> bytes:
    from mlflow import MlflowClient

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mlflow.db"
        MlflowClient(f"sqlite:///{path}")
        return path.read_bytes()


@contextmanager
def server(user: str, password: str) -> Iterator[tuple[str, list[str]]]:
    """Host and port of a server that asks for user and password, and the paths that it has answered, as they come."""
    run = {"run_id": "0" * 32, "run_uuid": "0" * 32, "artifact_uri": "mlflow-artifacts:/1", "lifecycle_stage": "active"}
    content = {"experiment": {"experiment_id": "1", "lifecycle_stage": "active"}, "run": {"info": run}}
    expected = f"Basic {b64encode(f'{user}:{password}'.encode()).decode()}"
    answered: list[str] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            self.rfile.read(int(self.headers.get("Content-Length", 0)))
            allowed = self.headers["Authorization"] == expected
            self.send_response(200 if allowed else 401)
            self.end_headers()
            if allowed:
                answered.append(self.path.partition("?")[0].partition("/mlflow")[2])
                self.wfile.write(json.dumps(content).encode())

        do_POST = do_PUT = do_GET

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as started:
        Thread(target=started.serve_forever, daemon=True).start()
        yield f"127.0.0.1:{started.server_port}", answered
        started.shutdown()
