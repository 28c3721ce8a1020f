"""The recogniser answers as an MLflow model, also to MLflow's server and in another process."""

import json
import os
import re
import shlex
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from tactile_viewgcn import tracking
from tactile_viewgcn.provenance import Record
from tactile_viewgcn.recognition.mlflow_model import RecogniserModel
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tests.glove_data import ROOT, answer_of, recipe, table, trained
from tests.mlflow_stores import runs_of

pytestmark = pytest.mark.filterwarnings("default")  # MLflow's own
CLASSES = ["empty_hand", "object1", "object2", "object3"]
METADATA = {"classes": CLASSES, "views": 4, "shape": [12, 12], "dtype": "int16"}
RECORDINGS = [514 + np.random.default_rng(0).poisson(3, (frames, 12, 12)) for frames in (6, 4)]


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("model") / "classifier.pt"
    save_classifier(path, trained(), recipe().model, table())
    return path


def changed(value) -> list:
    """Return the recordings as nested lists, with a different value in one place."""
    counts = [recording.tolist() for recording in RECORDINGS]
    counts[1][2][3][4] = value
    return counts


def objects(recordings: list) -> np.ndarray:
    """Return recordings as an array of objects, as MLflow's server gives them."""
    return np.array(recordings, dtype=object)


def code_block(page: str, language: str, word: str) -> str:
    """Return the first block of code in a language that holds a word."""
    blocks = re.findall(rf"```{language}\n(.*?)```", page, re.DOTALL)
    return next(block for block in blocks if word in block)


def test_the_logged_model_gives_the_recogniser_s_answers_in_a_column_for_each_class(
    checkpoint, store, client
):
    with tracking.stage_run(Record("evaluate")) as run:
        address = run.model("classifier", checkpoint, METADATA)
        assert runs_of(client, tracking.EXPERIMENT)[0].info.status == "RUNNING"  # the stage goes on
    assert runs_of(client, tracking.EXPERIMENT)[0].info.status == "FINISHED"
    import mlflow

    mlflow.set_tracking_uri(f"sqlite:///{store / 'mlflow.db'}")
    loaded = mlflow.pyfunc.load_model(address)
    recogniser = Recogniser(checkpoint)
    assert loaded.metadata.metadata == METADATA
    assert loaded.metadata.get_output_schema().input_names() == CLASSES
    expected = [answer_of(recogniser, recording).probabilities for recording in RECORDINGS]
    lists = objects([recording.tolist() for recording in RECORDINGS])
    for recordings in (lists, objects(RECORDINGS), {"recordings": objects(RECORDINGS)}):
        answers = loaded.predict(recordings)
        assert list(answers.columns) == CLASSES
        np.testing.assert_array_equal(answers, expected)
    first = RECORDINGS[0][None]
    # whole numbers may be written as floats
    for recordings in (first, first.astype(float), first.astype(object)):
        np.testing.assert_array_equal(loaded.predict(recordings), expected[:1])
    assert loaded.predict(first[:0]).shape == (0, 4)
    requirements = Path(mlflow.pyfunc.get_model_dependencies(address)).read_text().split()
    torch_version = version("torch").partition("+")[0]  # +cpu is in no package index
    assert f"torch=={torch_version}" in requirements
    assert not [requirement for requirement in requirements if "==" not in requirement]


def test_the_request_that_the_manual_posts_is_answered_as_it_shows(
    checkpoint, store, client, monkeypatch
):
    """The manual's program writes the body that its `curl` posts.

    The server's own function reads it.
    """
    page = (ROOT / "docs" / "serve.md").read_text()
    program = code_block(page, "python", "request.json")
    curl = code_block(page, "bash", "curl")
    shown = code_block(page, "json", "predictions")
    monkeypatch.chdir(store)
    np.save("recording.npy", RECORDINGS[0])
    exec(program, {})
    with tracking.stage_run(Record("evaluate")) as run:
        address = run.model("classifier", checkpoint, METADATA)
    import mlflow
    from mlflow.pyfunc import scoring_server

    mlflow.set_tracking_uri(f"sqlite:///{store / 'mlflow.db'}")
    words = shlex.split(curl.replace("\\\n", " "))
    model = mlflow.pyfunc.load_model(address)
    content_type = words[words.index("-H") + 1].removeprefix("Content-Type: ")
    body = Path(words[words.index("-d") + 1].removeprefix("@")).read_text()
    schema = model.metadata.get_input_schema()
    response = scoring_server.invocations(body, content_type, model, schema)
    answer = json.loads(response.response)
    example = json.loads(shown)
    assert response.status == 200
    assert answer.keys() == example.keys()
    assert words[-1].endswith("/invocations")
    expected = answer_of(Recogniser(checkpoint), RECORDINGS[0]).probabilities
    assert [list(row) for row in answer["predictions"]] == [CLASSES]
    np.testing.assert_allclose(list(answer["predictions"][0].values()), expected, rtol=1e-4)
    counts = [RECORDINGS[0].tolist()]
    for posted in {"inputs": {"recordings": counts}}, {"instances": counts}:
        response = scoring_server.invocations(json.dumps(posted), "application/json", model, schema)
        assert json.loads(response.response) == answer
    posted = json.dumps({"inputs": changed(True)})
    with pytest.raises(Exception, match="recording 1 holds true or false"):
        scoring_server.invocations(posted, "application/json", model, schema)


def test_a_mistake_is_one_line_that_mlflow_s_server_answers_with_status_400(checkpoint):
    model = RecogniserModel(Recogniser(checkpoint))
    recordings = objects(changed(float("nan")))
    with pytest.raises(Exception, match="expected") as error:
        model.predict({"recordings": recordings})
    error.value.message = "Failed to predict data '[[[["  # as the server does
    line = json.loads(error.value.serialize_as_json())["message"]
    assert "recording 1 holds nan" in line
    assert "1e+30" in line
    assert len(line.splitlines()) == 1
    assert error.value.get_http_status_code() == 400


@pytest.mark.slow
def test_a_registered_model_answers_in_a_process_of_its_own(checkpoint, store, client):
    """The model brings its code, so PYTHONPATH is empty.

    MLflow reads the file as its server reads the body of a request.
    """
    with tracking.stage_run(Record("evaluate")) as run:
        address = run.model("classifier", checkpoint, METADATA)
    client.create_registered_model("glove")
    entry = client.create_model_version("glove", address, run.id)
    client.set_registered_model_alias("glove", "best", entry.version)
    request = {"inputs": [recording.tolist() for recording in RECORDINGS]}
    (store / "request.json").write_text(json.dumps(request))
    options = "--env-manager local -t json -m models:/glove@best -i request.json -o answer.json"
    command = [sys.executable, "-m", "mlflow", "models", "predict", *options.split()]
    environment = os.environ | {
        "MLFLOW_TRACKING_URI": f"sqlite:///{store / 'mlflow.db'}",
        "PYTHONPATH": "",
    }
    subprocess.run(command, cwd=store, env=environment, check=True)
    rows = json.loads((store / "answer.json").read_text())["predictions"]
    recogniser = Recogniser(checkpoint)
    expected = [answer_of(recogniser, recording).probabilities for recording in RECORDINGS]
    assert [list(row) for row in rows] == [CLASSES, CLASSES]
    np.testing.assert_allclose([list(row.values()) for row in rows], expected, rtol=1e-4)
