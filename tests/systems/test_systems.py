"""What every system may know, and what all have in common."""

import json
import subprocess
import sys
from dataclasses import fields
from inspect import signature
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import torch
import torch.nn.functional as functional

from stages.dependencies import imported_modules
from tactile_viewgcn import params
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.nn.network import count_weights, view_set_logits
from tactile_viewgcn.nn.system import ViewSystem, shape_classifier
from tactile_viewgcn.systems import OnBackbone, OnSensors, System, system_class
from tactile_viewgcn.systems.classifier import build_classifier
from tactile_viewgcn.training.losses import sort_by_time
from tests.small_tables import recipe
from tests.systems.small_systems import CUBE, built, fill, some_views

ROOT = Path(__file__).parents[2]
SYSTEMS = get_args(System)
ESTIMATORS = set(get_args(OnSensors))  # tests/sensors/test_frame_estimator.py, test_sensor_maximum.py
NETWORKS = list(get_args(OnBackbone))
ORDERLESS = {"mvcnn", "mean", "vote", "gvcnn", "rotationnet"}


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_system_asks_only_for_what_it_can_be_given(name):
    system = system_class(name)
    assert issubclass(system, ViewSystem)
    assert system.__module__ == f"tactile_viewgcn.nn.{name}"
    known = {"classes", "features", "maps", "views", "viewpoints"} | {field.name for field in fields(params.Model)}
    assert set(signature(system).parameters) <= known
    assert "classes" in signature(system).parameters


def test_only_systems_with_a_geometry_know_the_viewpoints():
    assert {name for name in SYSTEMS if "viewpoints" in signature(system_class(name)).parameters} == {
        "view_gcn", "gcn", "rotationnet"}  # fmt: skip


def test_only_gvcnn_and_conv_lstm_take_maps():
    assert {name for name in SYSTEMS if system_class(name).takes == "maps"} == {"gvcnn", "conv_lstm"}
    assert {name for name in NETWORKS if system_class(name).takes == "features"} == set(NETWORKS) - {
        "gvcnn",
        "conv_lstm",
    }
    assert {name for name in SYSTEMS if system_class(name).takes == "sensors"} == ESTIMATORS


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_perceptron_is_refused_where_and_only_where_maps_are_taken(name):
    changes = (f"model.system={name}", "model.backbone.kind=perceptron")
    if system_class(name).takes == "maps":
        with pytest.raises(UserError, match=f"model.system is {name}, which needs feature maps"):
            recipe(*changes)
    else:
        assert recipe(*changes).model.system == name


@pytest.mark.parametrize("name", sorted(set(SYSTEMS) - {"ensemble"}))
def test_a_system_s_file_imports_no_other_s(name):
    modules = imported_modules(ROOT / "tactile_viewgcn" / "nn" / f"{name}.py")
    assert not modules & {f"tactile_viewgcn.nn.{other}" for other in SYSTEMS}
    bases = {"system"} if name in NETWORKS else {"frame_estimator", "sensor_maximum", "sensor_system"}
    assert modules & {f"tactile_viewgcn.nn.{base}" for base in bases}


BUILD_EACH_ALONE = """
import json, sys
import torch
from tactile_viewgcn import nn
from tactile_viewgcn.systems.classifier import build_classifier
from tactile_viewgcn.params import load

systems = json.loads(sys.argv[1])
modules = {f"tactile_viewgcn.nn.{name}": name for name in systems}
found = {}
for built in [None, *systems]:
    for module, name in modules.items():
        sys.modules.pop(module, None)
        vars(nn).pop(name, None)
    if built:
        params = load("params.yaml", (f"model.system={built}", "model.backbone.width=2"))
        build_classifier(torch.randn(4, 3), 3, params.model, (12, 12))
    found[str(built)] = [name for module, name in modules.items() if module in sys.modules]
    if built is None:
        assert not found.pop("None")
print(json.dumps(found))
"""


def test_a_classifier_of_one_system_loads_no_other():
    command = [sys.executable, "-c", BUILD_EACH_ALONE, json.dumps(SYSTEMS)]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    loaded = json.loads(result.stdout)
    assert set(loaded.pop("ensemble")) == ESTIMATORS
    assert loaded == {name: [name] for name in SYSTEMS if name != "ensemble"}


@pytest.mark.parametrize("name", NETWORKS)
def test_the_order_of_the_views_matters_where_it_should_and_nowhere_else(name):
    classifier = built(name, "model.neighbours=2")
    views = some_views(classifier)
    with torch.inference_mode():
        moved = (classifier.head(views)[0] - classifier.head(views[:, [2, 0, 3, 1]])[0]).abs().max()
    assert moved < 1e-5 if name in ORDERLESS else moved > 1e-3


@pytest.mark.parametrize("name", NETWORKS)
def test_a_system_in_time_order_sees_a_set_s_frames_sorted_and_the_others_as_drawn(name):
    classifier = built(name, "model.neighbours=2")
    features = torch.randn(20, *classifier.feature_shape, generator=torch.Generator().manual_seed(2))
    sets = torch.tensor([[3, 7, 11, 19], [0, 5, 5, 8]])
    with torch.inference_mode():
        rising, shuffled = (view_set_logits(classifier.head, features, s) for s in (sets, sets[:, [2, 0, 3, 1]]))
        direct = classifier.head(features[sets])[0]
    torch.testing.assert_close(rising, direct)
    assert classifier.head.in_time_order == (name in {"cnn_lstm", "conv_lstm"})
    if classifier.head.in_time_order:
        assert torch.equal(rising, shuffled)
    elif name not in ORDERLESS:
        assert (rising - shuffled).abs().max() > 1e-3


def test_view_sets_in_the_order_of_time_by_hand():
    sets, fresh = sort_by_time(np.array([[5, 2, 9, 1], [4, 4, 1, 0]]), np.array([[0, 3], [1, 2]]))
    assert sets.tolist() == [[1, 2, 5, 9], [0, 1, 4, 4]]
    assert fresh.tolist() == [[0, 2], [1, 3]]


@pytest.mark.parametrize("name", NETWORKS)
def test_fewer_views_are_taken_where_a_system_says_so(name):
    classifier = built(name)
    assert classifier.head.takes_fewer == (name not in {"stag", "rotationnet"})
    for count in range(1, 4) if classifier.head.takes_fewer else []:
        logits = classifier.head(some_views(classifier, count=count))[0]
        assert logits.shape == (3, 5)
        assert logits.isfinite().all()


@pytest.mark.parametrize("name", NETWORKS)
def test_a_loss_moves_every_weight(name):
    classifier = built(name).train()
    views, labels = 3 * some_views(classifier), torch.tensor([0, 1, 2])
    logits, aux = classifier.head(views)
    classifier.head.loss(logits, aux, labels).backward()
    still = {key for key, weight in classifier.head.named_parameters() if not weight.grad.abs().sum() > 0}
    assert still == set()


@pytest.mark.parametrize("name", NETWORKS)
def test_the_loss_is_cross_entropy_but_for_the_two_that_have_their_own(name):
    classifier = built(name)
    logits, aux = classifier.head(some_views(classifier))
    loss, labels = classifier.head.loss(logits, aux, torch.tensor([0, 1, 2])), torch.tensor([0, 1, 2])
    same = torch.allclose(loss, functional.cross_entropy(logits, labels))
    assert same == (name not in {"view_gcn", "rotationnet"})


@pytest.mark.parametrize("name", NETWORKS)
def test_logits_in_float64_are_nearly_those_in_float32(name):
    classifier = built(name)
    with torch.inference_mode():
        single = classifier.head(some_views(classifier))[0]
        double = classifier.double().head(some_views(classifier).double())[0]
    assert double.dtype == torch.float64
    torch.testing.assert_close(single.double(), double, rtol=1e-4, atol=1e-5)


FEATURES, VIEWS, CLASSES = 128, 8, 27
ANSWER = FEATURES * CLASSES + CLASSES


@pytest.mark.parametrize(
    ("name", "weights"),
    [
        ("stag", VIEWS * FEATURES * FEATURES + FEATURES + ANSWER),
        ("mvcnn", FEATURES * FEATURES + FEATURES + ANSWER),
        ("mean", FEATURES * FEATURES + FEATURES + ANSWER),
        ("cnn_lstm", 4 * (2 * FEATURES * FEATURES + 2 * FEATURES) + ANSWER),
        ("conv_lstm", 4 * FEATURES * (2 * FEATURES * 9 + 1) + ANSWER),
        ("gvcnn", FEATURES * 8 * 8 + 1 + FEATURES * FEATURES + FEATURES + ANSWER),
        ("gcn", 3 * (FEATURES * FEATURES + FEATURES) + ANSWER),
        ("rotationnet", (FEATURES + 1) * VIEWS * (CLASSES + 1)),
        ("vote", ANSWER),
    ],
)
def test_the_number_of_weights_of_each_head(name, weights):
    classifier = build_classifier(CUBE, CLASSES, recipe(f"model.system={name}").model)
    assert count_weights(classifier.head) == weights


def test_the_shape_classifier_by_hand():
    classifier = shape_classifier(2, 2, 1, 0.5).eval()
    fill(classifier[0].weight, [[1, 1], [1, -1]])
    fill(classifier[0].bias, [0, -3])
    fill(classifier[3].weight, [1, 10])
    fill(classifier[3].bias, [1])
    assert classifier(torch.tensor([[2.0, 4]])).item() == pytest.approx(6 + 10 * 0.2 * -5 + 1)
