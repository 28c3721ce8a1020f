"""Whether fast and plain say the same: logits, answers and selected views of one trained network."""

from types import SimpleNamespace

import numpy as np
import torch
from torch import Tensor

from studies.speed import plain
from studies.speed.sample import Sample, tensors
from tactile_viewgcn.classifier import Classifier, logits_of_sets
from tactile_viewgcn.clustering import cluster_pools, pool_ids
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.nn.backbone import features_of
from tactile_viewgcn.nn.view_gcn import System as ViewGCN
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.split import TEST
from tactile_viewgcn.views import ViewSets

TOLERANCE = {"float32": 1e-5, "bfloat16": 2e-2}  # of the largest logit
SAME = 0.9  # share of the view sets that are to select the same views


def agreement(one: Sample, params: SimpleNamespace, device: torch.device) -> list[dict]:
    """A row for each precision of the fast path, against the plain one in float32, on view sets of the test side.

    Raises:
        ValueError: the logits differ by more than the tolerance.
    """
    frames, labels = tensors(one.table, TEST, Compute(device, "float32"))
    sets, rows = sets_to_compare(one, params), []
    labels = labels[torch.from_numpy(sets[:, 0]).to(device)]  # those of a view set are one
    with torch.backends.cudnn.flags(enabled=True, allow_tf32=False):
        slow = plain.PlainClassifier(one.classifier)
        expected, kept = selecting(slow.head, lambda: plain.logits(slow, frames, sets))
        for precision in TOLERANCE:
            compute = Compute(device, precision)
            found, chosen = selecting(
                one.classifier.head, lambda c=compute: fast_logits(one.classifier, frames, sets, c)
            )
            rows.append({"fast path": precision} | differences(found, expected, chosen, kept, labels))
            refuse(rows[-1])
    return rows


def sets_to_compare(one: Sample, params: SimpleNamespace) -> np.ndarray:
    """A view set (V,) around each anchor of the test side, (A, V), of indices into its frames."""
    index, rng = one.table.on(TEST), stream(params.seed, "speed.test_sets")
    pool = pool_ids(one.table.label[index], one.table.recording[index], one.table.side[index], "object")
    points = one.table.inputs(index)[:, one.table.live]
    cluster = cluster_pools(points, pool, params.views, params.cluster, rng)
    return ViewSets(cluster, pool, params.views).draw(np.flatnonzero(one.table.anchor[index]), rng)


def fast_logits(classifier: Classifier, frames: Tensor, sets: np.ndarray, compute: Compute) -> Tensor:
    """Logits (A, classes) of the view sets as the evaluation has them: each frame through the backbone once."""
    classifier.eval().to(compute.device, memory_format=torch.channels_last)
    with torch.inference_mode(), compute.autocast():
        features = features_of(classifier.backbone, compute.frames(frames.squeeze(1)))
    with torch.inference_mode():
        return logits_of_sets(classifier.head, features, torch.from_numpy(sets).to(compute.device))


def selecting(head: ViewGCN, work) -> tuple[Tensor, list[Tensor]]:
    """What the work gives, and the positions (A, m, 3) of the views that each sampler of the head keeps meanwhile."""
    kept = [[] for _ in head.samplers]
    hooks = [
        sampler.register_forward_hook(lambda _, __, out, own=own: own.append(out[1]))
        for sampler, own in zip(head.samplers, kept, strict=True)
    ]
    found = work()
    for hook in hooks:
        hook.remove()
    return found, [torch.cat(positions) for positions in kept]


def differences(
    found: Tensor, expected: Tensor, chosen: list[Tensor], kept: list[Tensor], labels: Tensor
) -> dict[str, float | int]:
    """How far logits (A, classes) and selected views, positions (A, m, 3) of each sampler, are from the plain ones.

    `difference` is the largest of the logits', as a share of the largest logit, over the view sets that select the same
    views by both ways: a selection is a maximum, and where two views are nearly as good, rounding takes the other one.
    """
    others = [(mine != its).any(dim=-1) for mine, its in zip(chosen, kept, strict=True)]  # (A, m) each
    same = ~torch.cat([torch.zeros(len(found), 1, dtype=torch.bool, device=found.device), *others], dim=1).any(dim=1)
    apart = (found - expected).abs().amax(dim=-1) / expected.abs().max()
    answers, true = found.argmax(dim=-1), expected.argmax(dim=-1)
    return {
        "view sets": len(found),
        "with the same views": int(same.sum()),
        "difference": float(apart[same].max()) if same.any() else float("inf"),
        "of all": float(apart.max()),
        "selected views": sum(other.numel() for other in others),
        "changed": sum(int(other.sum()) for other in others),
        "changed answers": int((answers != true).sum()),
        "points of accuracy": 100 * float((answers == labels).float().mean() - (true == labels).float().mean()),
    }


def refuse(row: dict) -> None:
    """ValueError where the fast path is further from the plain one than its tolerance."""
    precision, limit = row["fast path"], TOLERANCE[row["fast path"]]
    if row["with the same views"] < SAME * row["view sets"]:
        raise ValueError(
            f"the fast path in {precision} selects the plain one's views in {row['with the same views']} of "
            f"{row['view sets']} view sets; expected {SAME:.0%} of them or more"
        )
    if not row["difference"] <= limit:
        raise ValueError(
            f"the fast path in {precision} differs from the plain one by {row['difference']:.2g} of the largest logit; "
            f"expected at most {limit:g}"
        )
