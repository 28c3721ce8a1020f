"""A trained network answers alike for any number of threads, batch size and order of frames.

Logits may differ by rounding, 1e-5 of the largest logit. View sets and answers may not differ.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
import torch
from threadpoolctl import threadpool_limits

from benchmarks.stability.rows import max_rel_error, share_different
from tactile_viewgcn.evaluation.trials import PROTOCOLS, answer_recordings, run_trials
from tactile_viewgcn.tables.frames import TEST
from tests.glove_data import CPU, fewer_anchors, recipe, table
from tests.systems.small_systems import built
from tests.trained_network import SINGLE, Subject

MOST = 200  # test frames


@pytest.mark.stability("threads")
def test_one_thread_two_and_two_again_answer_alike(row, subject):
    for precision in subject.precisions:
        results = {}
        for name, count in (("one", 1), ("two", 2), ("two again", 2)):
            with only(count):
                results[name] = evaluated(subject, precision)
        two_scores, two_answers = results["two"]
        for name in ("one", "two again"):
            scores, answers = results[name]
            pair = f"{name} against two, {precision}"
            row(f"logits, {pair}", max_rel_error(scores, two_scores), SINGLE)
            row(f"answers of the trials, {pair}", share_different(answers, two_answers))


@pytest.mark.stability("batches")
def test_batches_of_frames_and_view_sets_of_other_sizes_answer_alike(row, subject):
    head = subject.classifier.head
    inputs = subject.table.inputs(subject.table.on(TEST)[:MOST])
    sets = np.sort(subject.sets(inputs, 24), axis=1)  # in the order of time
    for precision in subject.precisions:
        nodes = subject.features(inputs, precision)
        parts = np.array_split(inputs, 1 + len(inputs) // 20)
        split_nodes = torch.cat([subject.features(part, precision) for part in parts])
        whole = subject.head_logits(head, nodes, sets, precision)
        split = subject.head_logits(head, split_nodes, sets, precision)
        row(f"logits, batches of 20 frames, {precision}", max_rel_error(split, whole), SINGLE)
        singly = []
        for view_set in sets:
            singly.append(subject.head_logits(head, nodes, view_set[None], precision))
        error = max_rel_error(torch.cat(singly), whole)
        row(f"logits, view set by view set, {precision}", error, SINGLE)
    singly = []
    for frames in sets[:5]:
        view_set = np.arange(len(frames))[None]
        singly.append(subject.logits(inputs[frames], view_set, "float32"))
    together = subject.logits(inputs, sets[:5], "float32")
    error = max_rel_error(torch.cat(singly), together)
    row("logits, a view set's frames alone, float32", error, SINGLE)


@pytest.mark.stability("shuffled rows")
def test_frames_in_another_order_answer_alike(row, subject):
    compare_orders(row, subject)


@pytest.mark.stability("shuffled rows")
def test_a_system_in_time_order_goes_by_the_recording_s_own_order(row):
    frames = table()
    for name in ("cnn_lstm", "conv_lstm"):
        subject = Subject(built(name), frames, recipe(f"model.system={name}"), CPU)
        assert subject.classifier.head.in_time_order
        compare_orders(row, subject, f"{name}: ")


def compare_orders(row, subject, prefix=""):
    """Compare the answers to the same view sets with the frames in another order.

    A system in time order goes by the order of the frames, so its view sets name their frames in
    another order instead.
    """
    inputs = subject.table.inputs(subject.table.on(TEST)[:MOST])
    order = np.random.default_rng(0).permutation(len(inputs))
    sets = subject.sets(inputs, 100)
    for precision in subject.precisions:
        straight = subject.logits(inputs, sets, precision)
        shuffled = subject.logits(inputs[order], np.argsort(order)[sets], precision)
        if subject.classifier.head.in_time_order:
            assert max_rel_error(shuffled, straight) > SINGLE
            shuffled = subject.logits(inputs, sets[:, ::-1].copy(), precision)
        row(f"{prefix}logits, {precision}", max_rel_error(shuffled, straight), SINGLE)
        different = share_different(shuffled.argmax(dim=1), straight.argmax(dim=1))
        row(f"{prefix}answers, {precision}", different)


@contextmanager
def only(count: int) -> Iterator[None]:
    """Give torch and the libraries under NumPy and scikit-learn a number of threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        with threadpool_limits(count):
            assert torch.get_num_threads() == count
            yield
    finally:
        torch.set_num_threads(before)


def evaluated(subject: Subject, precision: str) -> tuple[torch.Tensor, np.ndarray]:
    """Return logits of some view sets, and all answers of an evaluation with two trials."""
    classifier = subject.classifier
    index = subject.table.on(TEST)
    table = fewer_anchors(subject.table, 1 + int(subject.table.anchor[index].sum()) // MOST)
    inputs = table.inputs(index)
    nodes = subject.features(inputs, precision)
    evaluate = replace(subject.params.evaluate, trials=2, side="test")
    params = replace(subject.params, evaluate=evaluate)
    trials = [run_trials(classifier, nodes, table, params, protocol) for protocol in PROTOCOLS]
    trials.append(answer_recordings(classifier, nodes, table, params, temperature=None))
    answers = np.concatenate([protocol.best[..., 0].ravel() for protocol in trials])
    sets = subject.sets(inputs, 100)
    return subject.head_logits(classifier.head, nodes, sets, precision), answers
