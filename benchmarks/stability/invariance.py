"""What must not change an answer: the number of threads, the size of a batch, the order of frames, a second time.

Logits may differ by rounding, 1e-5 of the largest; view sets and answers not at all.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from benchmarks.stability.logits import SINGLE
from benchmarks.stability.rows import Quantity, max_rel_error, share_different
from benchmarks.stability.subject import Subject
from tactile_viewgcn.evaluation.trials import all_trials
from tactile_viewgcn.tables.frames import TEST

MOST = 200  # test frames


def threads(subject: Subject) -> Iterator[Quantity]:
    """Everything of an evaluation but its clock with one thread, with two, and with two again."""
    for precision in subject.precisions:
        results = {}
        for name, count in (("one", 1), ("two", 2), ("two again", 2)):
            with only(count):
                results[name] = _evaluated(subject, precision)
        two_scores, two_answers = results["two"]
        for name in ("one", "two again"):
            scores, answers = results[name]
            yield Quantity(f"logits, {name} against two, {precision}", max_rel_error(scores, two_scores), SINGLE)
            different = share_different(answers, two_answers)
            yield Quantity(f"answers of the trials, {name} against two, {precision}", different)


def batches(subject: Subject) -> Iterator[Quantity]:
    """Frames through the backbone in batches of another size, view sets through the system one by one."""
    inputs, head = subject.table.inputs(subject.table.on(TEST)[:MOST]), subject.classifier.head
    sets = subject.sets(inputs, 24)
    for precision in subject.precisions:
        nodes = subject.features(inputs, precision)
        parts = np.array_split(inputs, 1 + len(inputs) // 20)
        split_nodes = torch.cat([subject.features(part, precision) for part in parts])
        whole, split = (subject.head_logits(head, given, sets, precision) for given in (nodes, split_nodes))
        yield Quantity(f"logits, batches of 20 frames, {precision}", max_rel_error(split, whole), SINGLE)
        alone = torch.cat([subject.head_logits(head, nodes, one[None], precision) for one in sets])
        yield Quantity(f"logits, view set by view set, {precision}", max_rel_error(alone, whole), SINGLE)


def shuffled_rows(subject: Subject) -> Iterator[Quantity]:
    """The same frames in another order, and the same view sets."""
    if subject.classifier.head.in_time_order:
        return  # the order of frames is what such a system goes by
    inputs = subject.table.inputs(subject.table.on(TEST)[:MOST])
    order, sets = np.random.default_rng(0).permutation(len(inputs)), subject.sets(inputs, 100)
    for precision in subject.precisions:
        straight = subject.logits(inputs, sets, precision)
        shuffled = subject.logits(inputs[order], np.argsort(order)[sets], precision)
        yield Quantity(f"logits, {precision}", max_rel_error(shuffled, straight), SINGLE)
        yield Quantity(f"answers, {precision}", share_different(shuffled.argmax(dim=1), straight.argmax(dim=1)))


@contextmanager
def only(count: int) -> Iterator[None]:
    """So many threads for torch and for the libraries under NumPy and scikit-learn."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        with threadpool_limits(count):
            yield
    finally:
        torch.set_num_threads(before)


def _evaluated(subject: Subject, precision: str) -> tuple[torch.Tensor, np.ndarray]:
    """Logits of some view sets, and the answers of two trials of both protocols, clustering included.

    The anchors are at most MOST of those on the test side, evenly.
    """
    index, classifier = subject.table.on(TEST), subject.classifier
    anchors, few = index[subject.table.anchor[index]], np.zeros_like(subject.table.anchor)
    few[anchors[np.linspace(0, len(anchors) - 1, min(MOST, len(anchors))).astype(int)]] = True
    table = replace(subject.table, anchor=few)
    inputs = table.inputs(index)
    nodes = subject.features(inputs, precision)
    evaluate = replace(subject.params.evaluate, trials=2, side="test", protocols=["object", "recording"])
    trials = all_trials(classifier, nodes, table, subject.params.cluster, evaluate, subject.params.seed)
    answers = np.stack([one.predicted for one in trials.values()])
    return subject.head_logits(classifier.head, nodes, subject.sets(inputs, 100), precision), answers


CHECKS = (threads, batches, shuffled_rows)
