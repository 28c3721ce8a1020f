"""The recogniser as an MLflow model, called as MLflow calls it, and behind the server that MLflow starts."""

import json
import os
import re
import shlex
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
from tactile_viewgcn.provenance import Record
from tactile_viewgcn.recognition.mlflow_model import RecogniserModel
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tests.glove_data import ROOT, recipe, table, trained
from tests.mlflow_stores import runs_of

pytestmark = pytest.mark.filterwarnings("default")  # MLflow's own
CLASSES = ["empty_hand", "object1", "object2", "object3"]
METADATA = {"classes": CLASSES, "views": 4, "shape": [12, 12], "dtype": "int16"}
RECORDINGS = [(514 + np.random.default_rng(0).poisson(3, (count, 12, 12))) for count in (6, 4)]


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("model") / "classifier.pt"
    save_classifier(path, trained(), recipe().model, table())
    return path


def changed(value) -> list:
    """The recordings as nested lists, with a different value in one place."""
    counts = [recording.tolist() for recording in RECORDINGS]
    counts[1][2][3][4] = value
    return counts


#: inputs, and what the line of the answer names
MISTAKES = {
    "shape of a frame": (np.zeros((1, 4, 12, 11), int).tolist(), ["recording 0", "12 x 11", "12 x 12"]),
    "NaN": (changed(float("nan")), ["recording 1", "nan", "1e+30"]),
    "a number that int16 does not hold": (changed(-40_000), ["-40000", "-32768 to 32767"]),
    "a number as text": (changed("515"), ["recording 1: pressure is of type <U"]),
    "true": (changed(True), ["recording 1 holds true"]),
    "one recording, not in a list": (RECORDINGS[0].tolist(), ["recording 0: frames of 1 x 12", "12 x 12", "[X]"]),
    "a row missing": ([[RECORDINGS[0][0].tolist()[:-1], *RECORDINGS[0][1:].tolist()]], ["recording 0 is ragged"]),
}


def objects(recordings: list) -> np.ndarray:
    """Recordings as an array of objects, as MLflow's server gives them."""
    return np.array(recordings, dtype=object)


def test_the_logged_model_gives_the_recogniser_s_answers_in_a_column_for_each_class(checkpoint, store, client):
    with tracking.stage_run(Record("evaluate")) as run:
        address = run.model(checkpoint, METADATA)
        assert runs_of(client, tracking.EXPERIMENT)[0].info.status == "RUNNING"  # the stage goes on
    assert runs_of(client, tracking.EXPERIMENT)[0].info.status == "FINISHED"
    import mlflow

    mlflow.set_tracking_uri(f"sqlite:///{store / 'mlflow.db'}")
    loaded, recogniser = mlflow.pyfunc.load_model(address), Recogniser(checkpoint)
    assert loaded.metadata.metadata == METADATA
    assert loaded.metadata.get_output_schema().input_names() == CLASSES
    expected = [recogniser.answer(recording).probabilities for recording in RECORDINGS]
    lists = objects([recording.tolist() for recording in RECORDINGS])
    for numbers in (lists, objects(RECORDINGS), {"recordings": objects(RECORDINGS)}):
        table = loaded.predict(numbers)
        assert list(table.columns) == CLASSES
        np.testing.assert_array_equal(table, expected)
    first = RECORDINGS[0][None]
    for numbers in (first, first.astype(float), first.astype(object)):  # whole numbers may be written as floats
        np.testing.assert_array_equal(loaded.predict(numbers), expected[:1])
    assert loaded.predict(first[:0]).shape == (0, 4)
    needs = Path(mlflow.pyfunc.get_model_dependencies(address)).read_text().split()
    assert f"torch=={version('torch').partition('+')[0]}" in needs  # +cpu is in no package index
    assert not [need for need in needs if "==" not in need]


def test_the_request_that_the_manual_posts_is_answered_as_it_shows(checkpoint, store, client, monkeypatch):
    """The server's own function reads the body that the manual's program writes and its `curl` posts."""
    _, serving = (ROOT / "docs" / "experiments.md").read_text().split("## Serve it")
    program, curl, shown = (
        next(text for text in re.findall(rf"```{kind}\n(.*?)```", serving, re.DOTALL) if word in text)
        for kind, word in (("python", "request.json"), ("bash", "curl"), ("json", "predictions"))
    )
    monkeypatch.chdir(store)
    np.save("recording.npy", RECORDINGS[0])
    exec(program, {})
    with tracking.stage_run(Record("evaluate")) as run:
        address = run.model(checkpoint, METADATA)
    import mlflow
    from mlflow.pyfunc import scoring_server

    mlflow.set_tracking_uri(f"sqlite:///{store / 'mlflow.db'}")
    words, model = shlex.split(curl.replace("\\\n", " ")), mlflow.pyfunc.load_model(address)
    content, body = (words[words.index(option) + 1] for option in ("-H", "-d"))
    text, schema = Path(body.removeprefix("@")).read_text(), model.metadata.get_input_schema()
    response = scoring_server.invocations(text, content.removeprefix("Content-Type: "), model, schema)
    answer, example = json.loads(response.response), json.loads(shown)
    assert response.status == 200 and answer.keys() == example.keys() and words[-1].endswith("/invocations")
    expected = Recogniser(checkpoint).answer(RECORDINGS[0]).probabilities
    assert [list(row) for row in answer["predictions"]] == [CLASSES]
    np.testing.assert_allclose(list(answer["predictions"][0].values()), expected, rtol=1e-4)
    posted = json.dumps({"inputs": changed(True)})
    with pytest.raises(Exception, match="recording 1 holds true or false"):
        scoring_server.invocations(posted, "application/json", model, schema)


@pytest.mark.parametrize("inputs, named", MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_one_line_that_mlflow_s_server_answers_with_status_400(checkpoint, inputs, named):
    with pytest.raises(Exception, match="expected") as error:
        RecogniserModel(Recogniser(checkpoint)).predict({"recordings": objects(inputs)})
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
    with tracking.stage_run(Record("evaluate")) as run:
        address = run.model(checkpoint, METADATA)
    client.create_registered_model("glove")
    entry = client.create_model_version("glove", address, run.id)
    client.set_registered_model_alias("glove", "best", entry.version)
    expected = [Recogniser(checkpoint).answer(recording).probabilities for recording in RECORDINGS]
    counts, uri = [recording.tolist() for recording in RECORDINGS], f"sqlite:///{store / 'mlflow.db'}"
    with serve(store, "models:/glove@best", MLFLOW_TRACKING_URI=uri, PYTHONPATH="") as address:
        for body in {"inputs": counts}, {"inputs": {"recordings": counts}}, {"instances": counts}:
            status, answer = ask(address, body)
            assert status == 200 and [list(row) for row in answer["predictions"]] == [CLASSES, CLASSES]
            answered = [list(row.values()) for row in answer["predictions"]]
            np.testing.assert_allclose(answered, expected, rtol=1e-4)
        for inputs, named in MISTAKES.values():
            status, answer = ask(address, {"inputs": inputs})
            assert status == 400 and [name for name in named if name not in answer["message"]] == []
            assert "stack_trace" not in answer
