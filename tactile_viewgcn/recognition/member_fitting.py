"""Fits the members on the sensors: chooses them, weighs them and calibrates their answers."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tactile_viewgcn.device import Compute
from tactile_viewgcn.members.by_name import answering_sets, build_members
from tactile_viewgcn.members.examples import Examples
from tactile_viewgcn.members.kernel import FITTED_FRAMES
from tactile_viewgcn.members.member import Member
from tactile_viewgcn.members.network import NETWORK, NetworkMember
from tactile_viewgcn.messages import Note, UserError, several
from tactile_viewgcn.params import Member as MemberName
from tactile_viewgcn.params import Model, Params
from tactile_viewgcn.progress import steps
from tactile_viewgcn.recognition.calibration import calibration_warning
from tactile_viewgcn.recognition.network_training import PresetTraining
from tactile_viewgcn.recognition.new_sessions import (
    NOT_MEASURED,
    is_test_of_known_sessions,
    new_session_note,
)
from tactile_viewgcn.recognition.out_of_fold import OutOfFold
from tactile_viewgcn.recognition.training_recordings import examples_of, training_recordings
from tactile_viewgcn.sensor_array import is_array
from tactile_viewgcn.tables.frames import Frames, Views
from tactile_viewgcn.views.sampling import powers_of_two

#: the members if `model.members` is auto
ARRAY: list[MemberName] = ["kernel", "pooled_kernel", "svm", "trees", NETWORK]
CHANNELS: list[MemberName] = ["trees", "svm", "convolutions"]
UNWEIGHED = ["kernel", "pooled_kernel"]  # the members for an array if nothing can be held out
TOPIC = "recogniser"
KEY = "model.members"
ONLY_NETWORK = (
    f"its error can be lower: `dvc exp run $(tactile-viewgcn preset {NETWORK})` "
    "trains it as the only classifier"
)


class FittedMembers(NamedTuple):
    """Fitted members, and all that makes them a classifier.

    Attributes:
        members: the members that answer whole recordings, in the order of `model.members`.
        for_sets: the members that answer view sets, see `answering_sets`.
        weights: of the members' log-probabilities, by name.
        temperature: calibrates the answers to recordings; None if no group can be held out.
        examples: the training recordings.
        notes: on what was chosen, and on error rates.
    """

    members: list[Member]
    for_sets: list[Member]
    weights: dict[str, float]
    temperature: float | None
    examples: Examples
    notes: list[Note]


def fit_members(
    table: Frames, views: Views, params: Params, compute: Compute, *, ask_network: bool
) -> FittedMembers:
    """Fit the members to the training recordings; if they are `auto`, choose and weigh them.

    Args:
        table: the frames of all sets; members are fitted to the training set.
        views: the viewpoints.
        params: all parameters.
        compute: the device and the precision of a network.
        ask_network: whether `auto` can choose the member `network`, which trains for minutes.

    Raises:
        UserError: the network is the only member, and a training run diverges.
    """
    seed = params.seed
    is_auto = params.model.members == "auto"
    recordings = training_recordings(table)
    examples = examples_of(table, recordings, powers_of_two(len(views.viewpoints)), seed)
    names, notes = _without_twins(member_names(params.model, table.live), examples)
    first_frames = [index[0] for index in recordings]
    out_of_fold = OutOfFold.of(examples.labels, table.group[first_frames])

    on_sensors = [name for name in names if name != NETWORK]
    members = build_members(on_sensors, examples.representation, examples.classes)
    for member in members:
        member.measure(examples, seed=seed)
        out_of_fold = out_of_fold.with_member(member, examples, seed=seed)

    wants_network = NETWORK in names
    if wants_network and is_auto:
        wants_network, why_not = _wants_network(out_of_fold, allowed=ask_network)
        notes += why_not
    if wants_network:
        training = PresetTraining(table, views, recordings, seed=seed, compute=compute)
        network, out_of_fold, outcome = _try_network(
            training, out_of_fold, examples, seed=seed, is_only=not members
        )
        notes.append(outcome)
        if network is not None:
            members = _in_order(names, [*members, network])

    weights = {member.name: 1.0 for member in members}
    if is_auto:
        weights, choice = _weigh(out_of_fold, list(weights))
        notes += choice
    members = [member for member in members if member.name in weights]
    temperature = out_of_fold.temperature(weights)
    remedy = "record each object more often"
    notes += calibration_warning(temperature, "held-out training groups", remedy)
    for_sets = answering_sets(members, examples.representation, examples.classes)
    _fit(members, for_sets, examples, seed)
    sessions = table.session[first_frames]
    notes += _new_session_notes(table, sessions, members, weights, examples, seed)
    return FittedMembers(members, for_sets, weights, temperature, examples, notes)


def member_names(model: Model, live: np.ndarray) -> list[MemberName]:
    """Return the members that `model.members` names; for `auto`, the members that suit the sensors.

    Args:
        model: the section `model` of params.yaml.
        live: bool (H, W) sensors.
    """
    if model.members != "auto":
        return list(model.members)
    if is_array(live):
        return list(ARRAY)
    return list(CHANNELS)


def _without_twins(
    names: list[MemberName], examples: Examples
) -> tuple[list[MemberName], list[Note]]:
    """Return the members, without `pooled_kernel` if `kernel` is the same classifier.

    The two are the same if every recording is one frame, and `kernel` is fitted to all of them.
    """
    has_both = {"kernel", "pooled_kernel"} <= set(names)
    are_single_frames = bool((examples.lengths == 1).all())
    if not (has_both and are_single_frames and len(examples.lengths) <= FITTED_FRAMES):
        return names, []
    text = "pooled_kernel: not used, since it is the same classifier as kernel "
    text += "on recordings of one frame"
    others: list[MemberName] = [name for name in names if name != "pooled_kernel"]
    return others, [Note(text, topic=TOPIC)]


def _in_order(names: Sequence[str], members: Sequence[Member]) -> list[Member]:
    """Return the members in the order of these names."""
    of_name = {member.name: member for member in members}
    return [of_name[name] for name in names if name in of_name]


def _wants_network(out_of_fold: OutOfFold, *, allowed: bool) -> tuple[bool, list[Note]]:
    """Return whether `auto` tries the network, and a note if the caller does not allow it.

    `auto` tries the network if groups can be held out, and the other members answer some of them
    wrongly.

    Args:
        out_of_fold: the answers of the other members.
        allowed: whether the caller allows a network.
    """
    if not allowed:
        text = f"a network can have a lower error: TactileClassifier(system={NETWORK!r}) trains one"
        return False, [Note(text, topic=TOPIC)]
    if not out_of_fold.folds:
        return False, []
    weights = out_of_fold.member_weights(list(out_of_fold.answers))
    return bool(out_of_fold.group_errors(weights).any()), []


def _try_network(
    training: PresetTraining,
    out_of_fold: OutOfFold,
    examples: Examples,
    *,
    seed: int,
    is_only: bool,
) -> tuple[NetworkMember | None, OutOfFold, Note]:
    """Train the network without each fold, then on all training recordings.

    The network is skipped if its training runs would read more sensor readings than are allowed;
    this is known before the first of them. It is also skipped if one of them diverges.

    Args:
        training: of the network.
        out_of_fold: the folds, and the other members' answers.
        examples: the training recordings.
        seed: of the training runs.
        is_only: whether there is no other member. Then the network is trained in any case.

    Returns:
        The fitted network, or None if it was skipped; the out-of-fold answers, now with the
            network's answers; and a note.

    Raises:
        UserError: the network is the only member, and a training run diverges.
    """
    readings = training.readings(out_of_fold.folds)
    runs = several(len(out_of_fold.folds) + 1, "training run")
    if readings > training.most_readings and not is_only:
        text = f"{NETWORK}: skipped, since its {runs} would read {readings:.2g} sensor readings, "
        text += f"and the limit is {training.most_readings:.2g}; {ONLY_NETWORK}"
        return None, out_of_fold, Note(text, topic=TOPIC)
    network = NetworkMember(examples.representation, examples.classes, training=training)
    try:
        answers = out_of_fold.with_member(network, examples, seed=seed)
        network.fit(examples, np.ones(len(examples.labels), dtype=bool), seed=seed)
    except UserError as error:
        if is_only:
            raise
        text = f"{NETWORK}: skipped: {error}; {ONLY_NETWORK}"
        return None, out_of_fold, Note(text, topic=TOPIC)
    parts = several(len(out_of_fold.folds), "part")
    text = f"{NETWORK}: trained without each of {parts} of the training groups, then with all; "
    text += f"its {runs} read {readings:.2g} sensor readings"
    return network, answers, Note(text, topic=TOPIC)


def _weigh(out_of_fold: OutOfFold, names: list[str]) -> tuple[dict[str, float], list[Note]]:
    """Return the members' weights by their out-of-fold answers, without members of no weight.

    The notes have the choice first, then each member's weight, and its error as the only member.
    """
    if not out_of_fold.folds:
        names = [name for name in names if name in UNWEIGHED] or names
        text = "no object has two groups to train on, so no group can be held out, "
        text += "and the members were not compared"
        return dict.fromkeys(names, 1.0), [Note(text, "choice", TOPIC, KEY, names)]
    weights = out_of_fold.member_weights(names)
    held_out_groups = np.unique(out_of_fold.groups[out_of_fold.held_out])
    groups = several(len(held_out_groups), "training group")
    text = f"the weights of their log-probabilities were fitted to {groups}; "
    text += "each group was held out of the fits that answered it"
    notes = [Note(text, "choice", TOPIC, KEY, list(weights))]
    for name in sorted(names, key=lambda name: -weights.get(name, 0)):
        weight = weights.get(name, 0)
        error = float(out_of_fold.group_errors({name: 1}).mean())
        text = f"{name}: weight {weight:.2g}; as the only member it answers "
        text += f"{100 * error:.1f} % of whole recordings wrongly, a mean over the groups"
        value = {"member": name, "weight": weight, "error": error}
        notes.append(Note(text, topic="members", key=KEY, value=value))
    return weights, notes


def _fit(
    members: Sequence[Member], for_sets: Sequence[Member], examples: Examples, seed: int
) -> None:
    """Fit the members to all training recordings and view sets, except the fitted network."""
    every_recording = np.ones(len(examples.labels), dtype=bool)
    on_sensors = [member for member in members if member.name != NETWORK]
    for member in steps(on_sensors, "fits of whole recordings", "members"):
        member.fit(examples, every_recording, seed=seed)
    for member in for_sets:
        member.fit_sets(examples, seed=seed)


def _new_session_notes(
    table: Frames,
    sessions: np.ndarray,
    members: Sequence[Member],
    weights: dict[str, float],
    examples: Examples,
    seed: int,
) -> list[Note]:
    """Return a note on the error for a new session, if the test set has known sessions only.

    The note says so if the error was not measured.

    Args:
        table: the frames of all sets.
        sessions: (R,) session of each training recording.
        members: of the classifier.
        weights: of the members.
        examples: the training recordings.
        seed: of the fits.
    """
    by_session = OutOfFold.of(examples.labels, sessions)
    if not is_test_of_known_sessions(table) or not by_session.folds:
        return []
    if NETWORK in weights:
        return [NOT_MEASURED]
    for member in members:
        by_session = by_session.with_member(member, examples, seed=seed)
    return [new_session_note(by_session, weights)]
