"""One fit, from the table of frames to a calibrated classifier: training, weights of members, calibration."""

import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.intervals import percent_interval, proportion_interval
from tactile_viewgcn.members.convolutions import SAMPLE
from tactile_viewgcn.members.examples import Examples
from tactile_viewgcn.members.features import every_few, is_array
from tactile_viewgcn.members.representation import (
    NETWORK,
    Representation,
    contact_unit,
    successive_noise,
)
from tactile_viewgcn.messages import NEW_SESSION, Note, UserError, several
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.params import Member, Model, Params, on_sensors
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.calibration import (
    Classifier,
    calibration_warning,
    network_temperature,
)
from tactile_viewgcn.recognition.network_training import NetworkMember
from tactile_viewgcn.recognition.out_of_fold import LeftOut
from tactile_viewgcn.systems import load_system
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.frames import TEST, TRAIN, VALIDATION, Frames, Views
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.loop import OnEpoch, Progress
from tactile_viewgcn.views.sampling import powers_of_two

#: members where `model.members` is auto
ARRAY = ["kernel", "pooled_kernel", "svm", "trees", NETWORK]
CHANNELS = ["trees", "svm", "convolutions"]
UNWEIGHED = ["kernel", "pooled_kernel"]  # the members for an array where nothing can be left out
SCALE_FRAMES = 20_000  # by which readings are scaled


class Fitted(NamedTuple):
    """A trained classifier, its model options without `auto`, and the temperature of its answers to recordings."""

    classifier: Classifier
    model: Model
    temperature: float | None
    progress: Progress
    notes: list[Note]


def fit_classifier(
    table: Frames,
    views: Views,
    pretrained: dict[str, dict[str, Tensor]],
    params: Params,
    compute: Compute,
    checkpoint_path: Path | None = None,
    on_epoch: OnEpoch | None = None,
    *,
    ask_network: bool = True,
) -> Fitted:
    """Train the classifier that `params.model` names, and calibrate it where groups can be left out for that.

    A network is calibrated on the validation side, a system on the sensors by cross-validation on
    the training side.

    Args:
        ask_network: `auto` has the member `network` for arrays, which takes minutes. For the other
            arguments see `finetune_classifier`.
    """
    if on_sensors(params.model.system):
        return _fit_sensors(table, views, params, compute, ask_network=ask_network)
    network, progress = finetune_classifier(
        table, views, pretrained, params, compute, checkpoint_path, on_epoch
    )
    temperature = (
        network_temperature(network, table, compute) if len(table.on(VALIDATION)) else None
    )
    remedy = "record objects more often, or raise finetune.epochs"
    notes = [
        *calibration_warning(temperature, "validation groups", remedy),
        *_of_new_sessions(table, None, {}),
    ]
    return Fitted(network, params.model, temperature, progress, notes)


def _fit_sensors(
    table: Frames, views: Views, params: Params, compute: Compute, *, ask_network: bool
) -> Fitted:
    """Fit the members to the training recordings, weighed where they are `auto`, and calibrate them."""
    begin, seed = time.perf_counter(), params.seed
    auto = params.model.members == "auto"
    members = members_of(params.model, table.live)
    recordings = training_recordings(table)
    examples = examples_of(table, recordings, members, powers_of_two(len(views.viewpoints)), seed)
    members, notes = _each_once(members, examples)
    on_sensors = [name for name in members if name != NETWORK]
    first = np.array([index[0] for index in recordings])
    left = LeftOut(examples, table.group[first], seed)
    network = None
    wanted = NETWORK in members
    if wanted and auto:
        wanted, why = _wants_network(left, on_sensors, asked=ask_network)
        notes += why
    if wanted:
        member = NetworkMember(table, views, recordings, seed, compute)
        network, why = _network(left, member, is_only=not on_sensors)
        notes += why
    if network is None:
        members = [name for name in members if name != NETWORK]
    weights = dict.fromkeys(members, 1.0)
    if auto:
        weights, weighed = _weights(left, members)
        notes += weighed
    temperature = left.temperature(weights)
    notes += calibration_warning(
        temperature, "left-out training groups", "record each object more often"
    )
    network = network if NETWORK in weights else None
    system = load_system(params.model.system)
    classifier = system.SensorClassifier([*weights], views.viewpoints, len(table.classes), network)
    classifier.fit(examples, [*weights.values()], seed)
    notes += _of_new_sessions(table, LeftOut(examples, table.session[first], seed), weights)
    model = replace(params.model, members=cast(list[Member], [*weights]))
    return Fitted(
        classifier, model, temperature, Progress(seconds=time.perf_counter() - begin), notes
    )


def members_of(model: Model, live: np.ndarray) -> list[str]:
    """The members that `model.members` names; `auto` depends on whether the sensors, bool (H, W), are an array."""
    if model.members != "auto":
        return [*model.members]
    return [*ARRAY] if is_array(live) else [*CHANNELS]


def _each_once(members: list[str], examples: Examples) -> tuple[list[str], list[Note]]:
    """The members without `pooled_kernel` where it is the same classifier as `kernel`: on recordings of one frame."""
    is_twice = {"kernel", "pooled_kernel"} <= set(members) and bool((examples.lengths == 1).all())
    if not is_twice:
        return members, []
    text = "pooled_kernel: left out, since on recordings of one frame it is the same classifier as kernel"
    return [name for name in members if name != "pooled_kernel"], [Note(text, topic="recogniser")]


def _wants_network(left: LeftOut, others: list[str], *, asked: bool) -> tuple[bool, list[Note]]:
    """Whether `auto` tries the network: where groups can be left out, and the other members answer some wrongly."""
    if not asked:
        text = f"a network may err less: TactileClassifier(system={NETWORK!r}) trains one"
        return False, [Note(text, topic="recogniser")]
    if not left.answered.any():
        return False, []
    return bool(left.wrong(left.weighed(others)).any()), []


def _network(
    left: LeftOut, member: NetworkMember, *, is_only: bool
) -> tuple[ViewNetwork | None, list[Note]]:
    """Train the network, and give `left` its answers to the recordings that are left out.

    It is left out as a whole where its trainings would pass more readings than are allowed, or one
    of them diverges.

    Args:
        is_only: there is no other member, so that it is trained whatever it takes.

    Returns:
        The network, trained on all training recordings, or None where it is left out; and notes on
            this.

    Raises:
        UserError: it is the only member, and a training diverges.
    """
    alone = f"it may err less: `dvc exp run $(tactile-viewgcn preset {NETWORK})` trains it as the only classifier"
    readings = member.readings(left.folds)
    trainings = several(len(left.folds) + 1, "training")
    work = f"its {trainings} would read {readings:.2g} sensor readings, and the limit is {member.most_readings:.2g}"
    if readings > member.most_readings and not is_only:
        return None, [Note(f"{NETWORK}: left out, since {work}; {alone}", topic="recogniser")]
    try:
        shares = member.left_out(left.folds)
        network = member.train()
    except UserError as error:
        if is_only:
            raise
        return None, [Note(f"{NETWORK}: left out: {error}; {alone}", topic="recogniser")]
    left.shares[NETWORK] = shares
    parts = several(len(left.folds), "part")
    text = f"{NETWORK}: trained without each of {parts} of the training groups, then with all; "
    text += f"its {trainings} read {readings:.2g} sensor readings"
    return network, [Note(text, topic="recogniser")]


def _weights(left: LeftOut, members: list[str]) -> tuple[dict[str, float], list[Note]]:
    """Weights by the answers to recordings left out; notes: the members that have any, then the error of each alone."""
    key = "model.members"
    if not left.answered.any():
        members = [name for name in members if name in UNWEIGHED] or members
        text = "no object has two groups to train on, so that none can be left out: taken without a comparison"
        return dict.fromkeys(members, 1.0), [Note(text, "choice", "recogniser", key, members)]
    weights = left.weighed(members)
    groups = several(len(np.unique(left.groups[left.answered])), "training group")
    text = f"their log-probabilities have weights, fitted on {groups}, each left out of the fits that answer it"
    notes = [Note(text, "choice", "recogniser", key, [*weights])]
    for name in sorted(members, key=lambda name: -weights.get(name, 0)):
        weight, error = weights.get(name, 0), float(left.wrong({name: 1}).mean())
        text = f"{name}: weight {weight:.2g}; alone {100 * error:.1f} % of whole recordings wrong"
        notes.append(
            Note(
                text,
                topic="members",
                key=key,
                value={"member": name, "weight": weight, "error": error},
            )
        )
    return weights, notes


def _of_new_sessions(table: Frames, left: LeftOut | None, weights: dict[str, float]) -> list[Note]:
    """A note with the error for a new session, the mean over sessions, or one that says how to measure it.

    There is none where the test itself is of new sessions, or the training of one.

    Args:
        left: its groups are the sessions of the training recordings; None of a network, which
            cannot leave out one.
    """
    trained, tested = (np.unique(table.session[table.on(side)]) for side in (TRAIN, TEST))
    if len(trained) < 2 or not np.isin(tested, trained).any() or (left and not left.answered.any()):
        return []
    if not left or NETWORK in weights:
        text = f"no network was trained without a session: split.by=session measures the error for {NEW_SESSION}"
        return [Note(text, topic="new session")]
    wrong = left.wrong(weights)
    low, high = proportion_interval(wrong, np.arange(len(wrong)), stream(0, "new session")) or (
        None,
        None,
    )
    mean = float(wrong.mean())
    text = f"{percent_interval(mean, low, high)} % of whole recordings of {NEW_SESSION} wrong; "
    text += f"{len(wrong)} training sessions, each left out of the fits that answer it"
    return [Note(text, topic="new session", value={"mean": mean, "low": low, "high": high})]


def training_recordings(table: Frames) -> list[np.ndarray]:
    """Indices of the frames of each recording of the training side.

    A recording of several objects or split groups is one of each.
    """
    train = table.on(TRAIN)
    columns = np.stack([table.label[train], table.group[train], table.recording[train]])
    recording, sizes = np.unique(columns, axis=1, return_inverse=True, return_counts=True)[1:]
    return np.split(train[np.argsort(recording.ravel(), kind="stable")], np.cumsum(sizes)[:-1])


def examples_of(
    table: Frames,
    recordings: list[np.ndarray],
    members: Iterable[str],
    sizes: Sequence[int],
    seed: int,
) -> Examples:
    """The examples of training recordings, whole and as view sets of the given numbers of frames."""

    def read(number: int) -> np.ndarray:
        return table.inputs(every_few(recordings[number]), "counts")[:, table.live]

    sample = table.inputs(evenly(table.on(TRAIN), SCALE_FRAMES), "counts")[:, table.live]
    noise = successive_noise(table.counts, table.recording, table.on(TRAIN), table.live)
    representation = Representation.of(table.live, sample, contact_unit(sample, noise))
    if "convolutions" in members:
        drawn = np.random.default_rng(seed).permutation(len(recordings))[:SAMPLE]
        representation.convolutions.fit(
            [representation.scaled(read(number)) for number in drawn.tolist()], seed
        )
    labels = table.label[[index[0] for index in recordings]].astype(np.int64)
    return Examples(read, labels, representation, sizes, len(table.classes), seed)
