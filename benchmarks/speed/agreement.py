"""Whether fast and plain say the same: logits and answers of one trained network."""

import torch
from torch import Tensor

from benchmarks.speed import plain
from benchmarks.speed.sample import Sample
from tactile_viewgcn.device import Compute
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.split import TEST
from tactile_viewgcn.nn.backbone import extract_features
from tactile_viewgcn.nn.network import view_set_logits

TOLERANCE = {"float32": 1e-5, "bfloat16": 2e-2}  # of the largest logit
WITHIN = 0.9  # share of the view sets whose logits are to be within the tolerance


@torch.inference_mode()
def agreement(sample: Sample) -> list[dict]:
    """A row for each precision of the fast path, against the plain one in float32, on view sets of the test side.

    Raises:
        UserError: the logits differ by more than the tolerance.
    """
    classifier, sets, (frames, _), rows = sample.classifier, sample.view_sets(TEST), sample.tensors(TEST), []
    with torch.backends.cudnn.flags(enabled=True, allow_tf32=False):
        expected = plain.logits(plain.plain_classifier(classifier), frames, sets)
        for precision, tolerance in TOLERANCE.items():
            compute = Compute(frames.device, precision)
            with compute.autocast():
                features = extract_features(classifier.backbone, compute.frames(frames.squeeze(1)))
            logits = view_set_logits(classifier.head, features, torch.from_numpy(sets).to(frames.device))
            row = differences(logits, expected)
            if not row["difference"] <= tolerance:
                raise UserError(
                    f"the fast path in {precision} differs from the plain one by {row['difference']:.2g} of the "
                    f"largest logit; expected at most {tolerance:g} in {WITHIN:.0%} of the view sets"
                )
            rows.append({"fast path": precision} | row)
    return rows


def differences(logits: Tensor, expected: Tensor) -> dict[str, float | int]:
    """How far logits (A, classes) are from the plain ones, as a share of the largest logit.

    `difference` is what nine in ten view sets stay within, `largest` that of all: the graph selects views by a maximum,
    and where two views are nearly as good, rounding may take the other one.
    """
    error = (logits - expected).abs().amax(dim=-1) / expected.abs().max()
    return {
        "view sets": len(logits),
        "difference": float(error.quantile(WITHIN, interpolation="higher")),
        "largest": float(error.max()),
        "changed answers": int((logits.argmax(dim=-1) != expected.argmax(dim=-1)).sum()),
    }
