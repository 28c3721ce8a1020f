"""The study's rows: what was taken, in units that people know, with the shares of the limits."""

from types import SimpleNamespace

import numpy as np

from studies.speed import limits, plain, recipe
from studies.speed.pairs import PLAIN_SETS
from studies.speed.sample import Sample, tensors
from studies.speed.steps import BATCHES, FRAMES
from studies.speed.turns import Pair, share
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.split import TEST, TRAIN

COLUMNS = ("what", "size", "unit", "fast", "plain", "ratio", "of products", "of convolutions")


def row(
    what: str, size: str, unit: str, fast: float, plain: float | str = "", ratio: float | str = "", **shares
) -> dict:
    """A row with every column; what it lacks stays empty."""
    values = (what, size, unit, fast, plain, ratio, shares.get("of_products", ""), shares.get("of_convolutions", ""))
    return dict(zip(COLUMNS, values, strict=True))


def of_rate(what: str, size: str, unit: str, pair: Pair) -> dict:
    """Units of work a second."""
    return row(what, size, unit, *pair.rates, pair.ratio)


def of_time(what: str, size: str, unit: str, pair: Pair, scale: float = 1.0) -> dict:
    """Seconds per unit of work, times a scale."""
    return row(what, size, unit, *(scale * seconds for seconds in pair.each), pair.ratio)


def frame_operations(one: Sample, compute: Compute) -> float:
    """Of the backbone's convolutions on a frame, forward and backward."""
    backbone = plain.PlainBackbone(one.classifier.backbone)
    return limits.operations(backbone, tensors(one.table, TRAIN, compute)[0][:1])


def of_limits(taken: dict[str, np.ndarray], one: Sample, compute: Compute) -> list[dict]:
    """The machine's rates: products, memory, the backbone's convolutions."""
    device, found = compute.device.type, []
    products = 2.0 * limits.SIDE[device] ** 3
    for name in limits.DTYPES:
        rate = products / float(np.median(taken[f"product {name}"])) / 1e9
        found.append(row("limit: matrix product", f"{limits.SIDE[device]}^3, {name}", "GFLOP/s", rate))
    bandwidth = limits.ADDED * limits.NUMBERS[device] / float(np.median(taken["addition"])) / 1e9
    size = f"sum of two arrays of {4 * limits.NUMBERS[device] >> 20} MiB"
    found.append(row("limit: memory", size, "GB/s", bandwidth))
    work = FRAMES * frame_operations(one, compute)
    product = taken[f"product {compute.precision}"] / products
    for batch in BATCHES:
        seconds = taken[f"kernels {batch}"]
        of_products = share(seconds / work, product)
        size = f"batch {batch}, {compute.precision}"
        rate = work / float(np.median(seconds)) / 1e9
        found.append(row("limit: convolutions alone", size, "GFLOP/s", rate, of_products=of_products))
    return found


def of_steps(taken: dict[str, np.ndarray], one: Sample, compute: Compute) -> list[dict]:
    """A training step of the backbone, in frames and in operations a second."""
    operations, found = frame_operations(one, compute), []
    product = taken[f"product {compute.precision}"] / (2.0 * limits.SIDE[compute.device.type] ** 3)
    for batch in BATCHES:
        pair = Pair(taken[f"fast {batch}"], taken[f"plain {batch}"], FRAMES, FRAMES)
        found.append(of_rate("training step of the backbone", f"batch {batch}", "frames/s", pair))
        shares = {
            "of_products": share(pair.fast / (FRAMES * operations), product),
            "of_convolutions": share(pair.fast, taken[f"kernels {batch}"]),
        }
        size = f"batch {batch}, {operations / 1e6:.0f} MFLOP a frame"
        rates = [rate * operations / 1e9 for rate in pair.rates]
        found.append(row("training step of the backbone", size, "GFLOP/s", *rates, pair.ratio, **shares))
    return found


def of_finetuning(tuned: dict[int, Pair], one: Sample, params: SimpleNamespace) -> list[dict]:
    """An epoch of fine-tuning with each `finetune.reuse`."""
    found = []
    for reuse, pair in tuned.items():
        configured = ", as configured" if reuse == params.finetune.reuse else ""
        size = f"reuse {reuse}{configured}; {pair.fast_work:.0f} view sets, plain {pair.plain_work:.0f}"
        found.append(of_time("fine-tuning", size, "ms per view set", pair, 1e3))
    return found


def of_evaluation(evaluated: Pair, features: Pair, one: Sample, params: SimpleNamespace) -> list[dict]:
    """All trials, and the backbone's part."""
    anchors = int((one.table.anchor & (one.table.side == TEST)).sum())
    size = f"{params.evaluate.trials} trials x {len(params.evaluate.scope)} protocols x {anchors} view sets"
    extrapolated = f"; plain from one trial of each protocol and {min(PLAIN_SETS, anchors)} view sets"
    frames = f"{features.fast_work:.0f} frames"
    return [
        of_time("evaluation", size + extrapolated, "s", evaluated),
        of_rate("features without learning", frames, "frames/s", features),
    ]


def of_recipe(
    taken: dict[str, np.ndarray],
    tuned: dict[int, Pair],
    evaluated: Pair,
    features: Pair,
    one: Sample,
    params: SimpleNamespace,
) -> list[dict]:
    """The paper's whole recipe on STAG's size, from these medians."""
    steps = Pair(taken["fast 32"], taken["plain 32"], FRAMES, FRAMES)
    anchors = int((one.table.anchor & (one.table.side == TEST)).sum())
    sets = params.evaluate.trials * len(params.evaluate.scope) * anchors
    frame, configured = features.each[0], tuned[params.finetune.reuse]
    trial = max(0.0, evaluated.each[0] - frame * features.fast_work) / sets
    fast = recipe.Costs(steps.each[0], configured.each[0], frame, trial)
    slow = recipe.Costs(steps.each[1], configured.each[1], 0.0, evaluated.each[1] / sets)
    others = {f"reuse {n}": pair.each[0] for n, pair in tuned.items() if n != params.finetune.reuse}
    return recipe.rows(fast, slow, others)
