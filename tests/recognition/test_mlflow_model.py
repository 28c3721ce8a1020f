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
COUNTS = 514 + np.random.default_rng(0).poisson(3, (2, 4, 12, 12))  # two view sets


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("model") / "classifier.pt"
    save_classifier(path, trained(), recipe().model, table())
    return path


def changed(value) -> list:
    """The counts as nested lists, with a different value in one place."""
    counts = COUNTS.tolist()
    counts[1][2][3][4] = value
    return counts


#: inputs, params, and what the line of the answer names
MISTAKES = {
    "unknown session": (COUNTS.tolist(), {"session": "monday"}, ["'monday'", "000"]),
    "length of the baseline": (COUNTS.tolist(), {"baseline": [514.0] * 3}, ["baseline", "(3,)", "(12, 12)"]),
    "session and baseline": (COUNTS.tolist(), {"session": "000", "baseline": [514.0] * 144}, ["'000'", "baseline"]),
    "shape of a frame": (np.zeros((1, 4, 12, 11), int).tolist(), {}, ["(1, 4, 12, 11)", "(any, 4, 12, 12)"]),
    "NaN": (changed(float("nan")), {}, ["nan", "1e+30"]),
    "a number that int16 does not hold": (changed(-40_000), {}, ["-40000", "-32768 to 32767"]),
    "an integer of many digits": (changed(10**400), {}, ["309 digits", "1e+30"]),
    "true": (changed(True), {}, ["counts holds True"]),
    "an object": (changed({"a": 1}), {}, ["counts holds {'a': 1}"]),
    "a fraction": (changed(1.25), {}, ["counts holds 1.25"]),
    "a number as text": (changed("515"), {}, ["counts holds '515'"]),
    "lists too deep": (np.zeros((1,) * 40).tolist(), {}, ["1, 1, 1", "(any, 4, 12, 12)"]),
    "nothing": ([], {}, ["(0,)", "(any, 4, 12, 12)"]),
    "a row missing": ([[COUNTS[0, 0].tolist()[:-1], *COUNTS[0, 1:].tolist()]], {}, ["counts holds [", "equal lengths"]),
}


def test_the_logged_model_gives_the_recogniser_s_probabilities_in_a_column_for_each_class(checkpoint, store, client):
    with tracking.stage_run("evaluate") as run:
        address = run.model(checkpoint, METADATA)
        assert runs_of(client)[0].info.status == "RUNNING"  # the stage goes on
    assert runs_of(client)[0].info.status == "FINISHED"
    import mlflow

    mlflow.set_tracking_uri(f"sqlite:///{store / 'mlflow.db'}")
    loaded, recogniser = mlflow.pyfunc.load_model(address), Recogniser(checkpoint)
    assert loaded.metadata.metadata == METADATA
    assert loaded.metadata.get_output_schema().input_names() == list(loaded.predict(COUNTS).columns) == CLASSES
    empty = np.arange(144.0) + 400
    for params, baseline in (
        ({}, None),
        ({"session": "000"}, recogniser.baseline("000")),
        ({"baseline": empty.tolist()}, empty.reshape(12, 12)),
    ):
        scalars = np.array(list(COUNTS.ravel()), dtype=object).reshape(COUNTS.shape)  # of NumPy's own type
        for numbers in COUNTS, COUNTS.astype(float), scalars:  # whole numbers may be written as floats
            expected = recogniser.probabilities(COUNTS, baseline)
            np.testing.assert_array_equal(loaded.predict(numbers, params=params), expected)
    needs = Path(mlflow.pyfunc.get_model_dependencies(address)).read_text().split()
    assert f"torch=={version('torch').partition('+')[0]}" in needs  # +cpu is in no package index
    assert not [need for need in needs if "==" not in need]


@pytest.mark.parametrize("inputs, params, named", MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_one_line_that_mlflow_s_server_answers_with_status_400(checkpoint, inputs, params, named):
    with pytest.raises(Exception, match="expected") as error:  # MLflow gives nested lists as an array of objects
        RecogniserModel(Recogniser(checkpoint)).predict({"counts": np.array(inputs, dtype=object)}, params)
    error.value.message = f"Failed to predict data '{inputs}'"  # as the server does
    line = json.loads(error.value.serialize_as_json())["message"]
    assert [name for name in named if name not in line] == [] and len(line.splitlines()) == 1
    assert error.value.get_http_status_code() == 400


def ask(address: str, body: dict) -> tuple[int, dict]:
    """Status and content of the answer to a body of JSON."""
    request = urllib.request.Request(address, json.dumps(body).encode(), {"Content-Type": "application/json"})
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        return error.code, json.load(error)


@contextmanager
def serve(folder: Path, model: str, **variables: str) -> Iterator[str]:
    """The address of `mlflow models serve` of a model; starting takes about 20 seconds."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    words = [sys.executable, "-m", "mlflow", "models", "serve", "-m", model, "--env-manager", "local", "-p", port]
    scripts = str(Path(sys.executable).parent)  # of uvicorn, which MLflow calls by its name
    environment = os.environ | {"PATH": f"{scripts}{os.pathsep}{os.environ['PATH']}"} | variables
    address, log = f"http://127.0.0.1:{port}", folder / "log"
    with log.open("w") as file:
        process = subprocess.Popen(words, cwd=folder, env=environment, stdout=file, stderr=file, start_new_session=True)
    try:
        for _ in range(600):
            assert process.poll() is None, log.read_text()
            with suppress(OSError):
                urllib.request.urlopen(f"{address}/ping", timeout=5).close()
                break
            time.sleep(0.2)
        yield f"{address}/invocations"
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)
        process.wait(30)


@pytest.mark.slow
def test_a_registered_model_is_served(checkpoint, store, client):
    """PYTHONPATH is empty: the model brings its code."""
    with tracking.stage_run("evaluate") as run:
        address = run.model(checkpoint, METADATA)
    client.create_registered_model("glove")
    entry = client.create_model_version("glove", address, run.id)
    client.set_registered_model_alias("glove", "best", entry.version)
    recogniser, params = Recogniser(checkpoint), {"params": {"session": "000"}}
    expected, counts = recogniser.probabilities(COUNTS, recogniser.baseline("000")), COUNTS.tolist()
    uri = f"sqlite:///{store / 'mlflow.db'}"
    with serve(store, "models:/glove@best", MLFLOW_TRACKING_URI=uri, PYTHONPATH="") as address:
        for body in {"inputs": counts}, {"inputs": {"counts": counts}}, {"instances": counts}:
            status, answer = ask(address, body | params)
            assert status == 200 and [list(row) for row in answer["predictions"]] == [CLASSES, CLASSES]
            answered = [list(row.values()) for row in answer["predictions"]]
            np.testing.assert_allclose(answered, expected, rtol=1e-4)
        for inputs, wrong, named in MISTAKES.values():
            status, answer = ask(address, {"inputs": inputs, "params": wrong})
            assert status == 400 and [name for name in named if name not in answer["message"]] == []
            assert "stack_trace" not in answer
