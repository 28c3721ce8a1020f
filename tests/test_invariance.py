"""Invariance of a trained network's answers to threads, batch sizes, the order of frames, and
repetition.

Logits may differ by rounding, 1e-5 of the largest; view sets and answers may not differ.
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
    """Everything of an evaluation but its clock."""
    for precision in subject.precisions:
        results = {}
        for name, count in (("one", 1), ("two", 2), ("two again", 2)):
            with only(count):
                results[name] = evaluated(subject, precision)
        two_scores, two_answers = results["two"]
        for name in ("one", "two again"):
            scores, answers = results[name]
            row(
                f"logits, {name} against two, {precision}",
                max_rel_error(scores, two_scores),
                SINGLE,
            )
            row(
                f"answers of the trials, {name} against two, {precision}",
                share_different(answers, two_answers),
            )


@pytest.mark.stability("batches")
def test_batches_of_frames_and_view_sets_of_other_sizes_answer_alike(row, subject):
    inputs, head = subject.table.inputs(subject.table.on(TEST)[:MOST]), subject.classifier.head
    sets = np.sort(subject.sets(inputs, 24), axis=1)  # in the order of time
    for precision in subject.precisions:
        nodes = subject.features(inputs, precision)
        parts = np.array_split(inputs, 1 + len(inputs) // 20)
        split_nodes = torch.cat([subject.features(part, precision) for part in parts])
        whole, split = (
            subject.head_logits(head, given, sets, precision) for given in (nodes, split_nodes)
        )
        row(f"logits, batches of 20 frames, {precision}", max_rel_error(split, whole), SINGLE)
        alone = torch.cat([subject.head_logits(head, nodes, one[None], precision) for one in sets])
        row(f"logits, view set by view set, {precision}", max_rel_error(alone, whole), SINGLE)
    first = [subject.logits(inputs[one], np.arange(len(one))[None], "float32") for one in sets[:5]]
    together = subject.logits(inputs, sets[:5], "float32")
    row(
        "logits, a view set's frames alone, float32",
        max_rel_error(torch.cat(first), together),
        SINGLE,
    )


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


def compare_orders(row, subject, of=""):
    """Logits of the same view sets with the frames in another order, and of sets whose views are in
    another order.
    """
    inputs = subject.table.inputs(subject.table.on(TEST)[:MOST])
    order, sets = np.random.default_rng(0).permutation(len(inputs)), subject.sets(inputs, 100)
    for precision in subject.precisions:
        straight = subject.logits(inputs, sets, precision)
        shuffled = subject.logits(inputs[order], np.argsort(order)[sets], precision)
        # the order of the frames counts, that in which a set names them not
        if subject.classifier.head.in_time_order:
            assert max_rel_error(shuffled, straight) > SINGLE
            shuffled = subject.logits(inputs, sets[:, ::-1].copy(), precision)
        row(f"{of}logits, {precision}", max_rel_error(shuffled, straight), SINGLE)
        row(
            f"{of}answers, {precision}",
            share_different(shuffled.argmax(dim=1), straight.argmax(dim=1)),
        )


@contextmanager
def only(count: int) -> Iterator[None]:
    """A number of threads for torch and for the libraries under NumPy and scikit-learn."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        with threadpool_limits(count):
            assert torch.get_num_threads() == count
            yield
    finally:
        torch.set_num_threads(before)


def evaluated(subject: Subject, precision: str) -> tuple[torch.Tensor, np.ndarray]:
    """Logits of some view sets, and the answers of two trials of both protocols, clustering
    included.
    """
    index, classifier = subject.table.on(TEST), subject.classifier
    table = fewer_anchors(subject.table, 1 + int(subject.table.anchor[index].sum()) // MOST)
    inputs = table.inputs(index)
    nodes = subject.features(inputs, precision)
    params = replace(
        subject.params, evaluate=replace(subject.params.evaluate, trials=2, side="test")
    )
    trials = [run_trials(classifier, nodes, table, params, protocol) for protocol in PROTOCOLS]
    trials.append(answer_recordings(classifier, nodes, table, params, temperature=None))
    answers = np.concatenate([one.best[..., 0].ravel() for one in trials])
    return subject.head_logits(
        classifier.head, nodes, subject.sets(inputs, 100), precision
    ), answers
