"""The recogniser as an MLflow model, called as MLflow calls it, and behind the server that MLflow starts."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from tactile_viewgcn import tracking
from tactile_viewgcn.recognition.mlflow_model import RecogniserModel
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tests.glove_data import recipe, table, trained
from tests.mlflow_stores import runs_of

pytestmark = pytest.mark.filterwarnings("default")  # MLflow's own
CLASSES = ["empty_hand", "object1", "object2", "object3"]
METADATA = {"classes": CLASSES, "views": 4, "shape": [12, 12], "dtype": "int16"}
EXPECTED = r"expected (sets, views, rows, columns) = (any, 4, 12, 12)"


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("model") / "classifier.pt"
    save_classifier(path, trained(), recipe().model, table())
    return path


def as_json(counts) -> np.ndarray:
    """Nested lists as MLflow hands them over."""
    return np.array(counts, dtype=object)


def some_counts() -> list:
    """Two view sets (2, 4, 12, 12) as nested lists."""
    return (514 + np.random.default_rng(0).poisson(3, (2, 4, 12, 12))).tolist()


def changed(value) -> list:
    """The same with another value in one place."""
    counts = some_counts()
    counts[1][2][3][4] = value
    return counts


def one_row_short() -> list:
    counts = some_counts()
    counts[0][0].pop()
    return counts


NUMBERS = "a number up to 1e+30 from every sensor"
WHOLE = "whole numbers from -32768 to 32767, raw counts as in training"

#: What is wrong -> (inputs, params, the whole line of the answer).
MISTAKES = {
    "unknown session": (
        some_counts(),
        {"session": "monday"},
        "session is 'monday'; expected one of 000, or give the baseline of the empty hand itself",
    ),
    "length of the baseline": (
        some_counts(),
        {"baseline": [514.0] * 3},
        "baseline has 3 values; expected 144, row by row",
    ),
    "session and baseline": (
        some_counts(),
        {"session": "000", "baseline": [514.0] * 144},
        "session '000' and a baseline are given; expected one of the two",
    ),
    "shape of a frame": (np.zeros((1, 4, 12, 11), int).tolist(), {}, f"counts has shape (1, 4, 12, 11); {EXPECTED}"),
    "NaN": (changed(float("nan")), {}, f"counts holds nan; expected {NUMBERS}"),
    "a number that int16 does not hold": (changed(-40_000), {}, f"counts holds -40000; expected {WHOLE}"),
    "an integer of many digits": (
        changed(10**400),
        {},
        "counts holds an integer of 309 digits or more; expected up to 1e+30",
    ),
    "true": (changed(True), {}, "counts holds True; expected integer counts or real numbers"),
    "an object": (changed({"a": 1}), {}, "counts holds {'a': 1}; expected integer counts or real numbers"),
    "a fraction": (changed(1.25), {}, f"counts holds 1.25; expected {WHOLE}"),
    "a number as text": (changed("515"), {}, "counts holds '515'; expected integer counts or real numbers"),
    "nothing": ([], {}, f"counts has shape (0,); {EXPECTED}"),
    "a row missing": (one_row_short(), {}, "counts is not rectangular; expected nested lists of equal lengths"),
}


def test_the_logged_model_gives_the_recogniser_s_probabilities_in_a_column_for_each_class(checkpoint, store, client):
    with tracking.stage_run("evaluate") as run:
        address = run.model(checkpoint, METADATA)
        assert runs_of(client)[0].info.status == "RUNNING"  # the stage goes on
    assert runs_of(client)[0].info.status == "FINISHED"
    import mlflow

    mlflow.set_tracking_uri(f"sqlite:///{store / 'mlflow.db'}")
    loaded, recogniser, counts = mlflow.pyfunc.load_model(address), Recogniser(checkpoint), np.array(some_counts())
    assert loaded.metadata.metadata == {"classes": CLASSES, "views": 4, "shape": [12, 12], "dtype": "int16"}
    assert loaded.metadata.get_output_schema().input_names() == list(loaded.predict(counts).columns) == CLASSES
    empty = np.arange(144.0) + 400
    for params, baseline in (
        ({}, None),
        ({"session": "000"}, recogniser.baseline("000")),
        ({"baseline": empty.tolist()}, empty.reshape(12, 12)),
    ):
        scalars = np.array(list(counts.ravel()), dtype=object).reshape(counts.shape)  # of NumPy's own type
        for numbers in counts, counts.astype(float), scalars:  # whole numbers may be written as floats
            expected = recogniser.probabilities(counts, baseline)
            np.testing.assert_array_equal(loaded.predict(numbers, params=params), expected)
    needs = Path(mlflow.pyfunc.get_model_dependencies(address)).read_text().split()
    assert f"torch=={version('torch').partition('+')[0]}" in needs  # +cpu is in no package index
    assert not [need for need in needs if "==" not in need]


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_line_that_mlflow_s_server_answers_with_status_400(checkpoint, mistake):
    inputs, params, line = MISTAKES[mistake]
    with pytest.raises(Exception, match="expected") as error:
        RecogniserModel(Recogniser(checkpoint)).predict({"counts": as_json(inputs)}, params)
    error.value.message = f"Failed to predict data '{inputs}'"  # as the server does
    assert json.loads(error.value.serialize_as_json())["message"] == line
    assert error.value.get_http_status_code() == 400


@contextmanager
def serve(folder: Path, model: str, **variables: str) -> Iterator[tuple[subprocess.Popen, str, Path]]:
    """The process of `mlflow models serve`, its address, and the file of what it prints, in a folder."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    words = [sys.executable, "-m", "mlflow", "models", "serve", "-m", model, "--env-manager", "local", "-p", port]
    scripts = str(Path(sys.executable).parent)  # of uvicorn, which MLflow calls by its name
    environment = os.environ | {"PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}"} | variables
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(words, cwd=folder, env=environment, stdout=log, stderr=log, start_new_session=True)
    try:
        yield process, f"http://127.0.0.1:{port}", folder / "log"
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)
        process.wait(30)


@pytest.fixture(scope="module")
def server(checkpoint, tmp_path_factory):
    """Where a logged model, registered under a name with an alias, is asked; starting takes about 20 seconds."""
    store = tmp_path_factory.mktemp("store")
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("MLFLOW_TRACKING_URI", raising=False)
        patch.setenv("DVC_ROOT", str(store))
        with tracking.stage_run("evaluate") as run:
            address = run.model(checkpoint, METADATA)
    import mlflow

    uri = f"sqlite:///{store / 'mlflow.db'}"
    client = mlflow.MlflowClient(uri, uri)
    client.create_registered_model("glove")
    entry = client.create_model_version("glove", address, run.id)
    client.set_registered_model_alias("glove", "best", entry.version)
    with serve(store, "models:/glove@best", MLFLOW_TRACKING_URI=uri, PYTHONPATH="") as (process, place, log):
        for _ in range(600):  # PYTHONPATH is empty: the model brings its code
            assert process.poll() is None, log.read_text()
            with suppress(OSError):
                urllib.request.urlopen(f"{place}/ping", timeout=5).close()
                break
            time.sleep(0.2)
        yield f"{place}/invocations"


def ask(address: str, body: bytes) -> tuple[int, dict]:
    """Status and content of the answer to a body of JSON."""
    request = urllib.request.Request(address, body, {"Content-Type": "application/json"})
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        return error.code, json.load(error)


@pytest.mark.slow
def test_the_server_answers_with_a_probability_for_each_class(server, checkpoint):
    for body in {"inputs": some_counts()}, {"inputs": {"counts": some_counts()}}, {"instances": some_counts()}:
        status, answer = ask(server, json.dumps(body | {"params": {"session": "000"}}).encode())
        assert status == 200
        assert [list(row) for row in answer["predictions"]] == [CLASSES, CLASSES]
        answered = [list(row.values()) for row in answer["predictions"]]
        recogniser = Recogniser(checkpoint)
        expected = recogniser.probabilities(np.array(some_counts()), recogniser.baseline("000"))
        np.testing.assert_allclose(answered, expected, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("mistake", MISTAKES)
def test_the_server_refuses_a_mistake_in_one_line(server, mistake):
    inputs, params, line = MISTAKES[mistake]
    status, answer = ask(server, json.dumps({"inputs": inputs, "params": params}).encode())
    assert (status, answer["message"]) == (400, line)
    assert "stack_trace" not in answer
