"""What must not change an answer: the number of threads, the size of a batch, the order of frames, a second time.

Logits may differ by rounding, 1e-5 of the largest; view sets and answers not at all.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import torch
from threadpoolctl import threadpool_limits

from studies.stability.case import Finding, Subject, apart, differing
from studies.stability.logits import SINGLE, features, in_precision, joined, logits, some_sets
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.evaluation import all_trials
from tactile_viewgcn.params import Evaluate
from tactile_viewgcn.split import TEST

MOST = 200  # test frames
TRIALS = Evaluate(trials=2, stop_at=0.0, scope=["object", "recording"])


def threads(subject: Subject) -> Iterator[Finding]:
    """Everything of an evaluation but its clock with one thread, with two, and with two again."""
    for precision in _precisions(subject):
        compute = in_precision(precision, subject)
        found = {}
        for name, count in (("one", 1), ("two", 2), ("two again", 2)):
            with only(count):
                found[name] = _evaluated(subject, compute)
        for name in ("one", "two again"):
            yield Finding(f"logits, {name} against two, {precision}", apart(found[name][0], found["two"][0]), SINGLE)
            yield Finding(
                f"answers of the trials, {name} against two, {precision}", differing(found[name][1], found["two"][1]), 0
            )


def batches(subject: Subject) -> Iterator[Finding]:
    """Frames through the backbone in batches of another size, view sets through the system one by one."""
    inputs = _inputs(subject)
    sets = some_sets(len(inputs), subject.classifier.views, 24)
    for precision in _precisions(subject):
        compute = in_precision(precision, subject)
        nodes = features(subject.classifier, inputs, compute)
        parts = torch.cat(
            [features(subject.classifier, part, compute) for part in np.array_split(inputs, 1 + len(inputs) // 20)]
        )
        whole, split = (joined(subject.classifier.head, given, sets, compute) for given in (nodes, parts))
        yield Finding(f"logits, batches of 20 frames, {precision}", apart(split, whole), SINGLE)
        alone = torch.cat([joined(subject.classifier.head, nodes, own[None], compute) for own in sets])
        yield Finding(f"logits, view set by view set, {precision}", apart(alone, whole), SINGLE)


def shuffled_rows(subject: Subject) -> Iterator[Finding]:
    """The same frames in another order, and the same view sets."""
    inputs = _inputs(subject)
    order = np.random.default_rng(0).permutation(len(inputs))
    sets = some_sets(len(inputs), subject.classifier.views, 100)
    if subject.classifier.head.in_time_order:
        return  # the order of frames is what such a system goes by
    for precision in _precisions(subject):
        compute = in_precision(precision, subject)
        straight = logits(subject.classifier, inputs, sets, compute)
        found = logits(subject.classifier, inputs[order], np.argsort(order)[sets], compute)
        yield Finding(f"logits, {precision}", apart(found, straight), SINGLE)
        yield Finding(f"answers, {precision}", differing(found.argmax(dim=1), straight.argmax(dim=1)), 0)


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


def _evaluated(subject: Subject, compute: Compute) -> tuple[torch.Tensor, np.ndarray]:
    """Logits of some view sets, and the answers of two trials of both protocols, clustering included."""
    index = subject.table.on(TEST)
    table = replace(subject.table, anchor=_some(subject.table.anchor, index))
    nodes = features(subject.classifier, table.inputs(index), compute)
    found = joined(subject.classifier.head, nodes, some_sets(len(index), subject.classifier.views, 100), compute)
    trials = all_trials(subject.classifier, nodes, table, subject.params.cluster, TRIALS, subject.params.seed)
    return found, np.stack([one.predicted for one in trials.values()])


def _some(anchor: np.ndarray, index: np.ndarray) -> np.ndarray:
    """The anchors (n,) of which at most MOST on the test side are left, evenly."""
    own = index[anchor[index]]
    chosen = np.zeros_like(anchor)
    chosen[own[np.linspace(0, len(own) - 1, min(MOST, len(own))).astype(int)]] = True
    return chosen


def _inputs(subject: Subject) -> np.ndarray:
    return subject.table.inputs(subject.table.on(TEST)[:MOST])


def _precisions(subject: Subject) -> list[str]:
    """Single precision, and what the evaluation uses where that is another."""
    return list(dict.fromkeys(["float32", subject.compute.precision]))


CASES = (threads, batches, shuffled_rows)
