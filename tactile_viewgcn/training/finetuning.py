"""Fine-tuning: the whole network is trained on view sets, from a pretrained backbone."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.backbone import INFERENCE_BATCH, extract_features
from tactile_viewgcn.nn.network import ViewNetwork, view_set_logits
from tactile_viewgcn.params import Finetune, Params
from tactile_viewgcn.randomness import torch_generator, torch_seed
from tactile_viewgcn.systems import system_class
from tactile_viewgcn.tables.frames import TRAIN, VALIDATION, Frames, Views
from tactile_viewgcn.training.inputs import FrameInputs
from tactile_viewgcn.training.loop import OnEpoch, Progress, error_rate, fit
from tactile_viewgcn.training.optim import build_optimiser, num_batches
from tactile_viewgcn.training.view_sets import Batch, SetLoss, SideViewSets
from tactile_viewgcn.views.recording_clusters import RecordingClusters


def finetune_classifier(
    table: Frames,
    views: Views,
    pretrained: dict[str, dict[str, Tensor]],
    params: Params,
    compute: Compute,
    checkpoint_path: Path | None = None,
    on_epoch: OnEpoch | None = None,
) -> tuple[ViewNetwork, Progress]:
    """The network, from the pretrained weights, trained on one view set per anchor and epoch.

    A system without weights to fine-tune is not trained; `finetune.moments` clean still measures
    its moments.

    Args:
        pretrained: weights of the `backbone` and of its linear `classifier`.
        checkpoint_path: see `fit`; on_epoch too.

    Returns:
        network, and the progress: per epoch the loss and, where there is a validation side, its
            error.

    Raises:
        UserError: the training diverges, or `model` does not fit the number of views.
    """
    config, seed = params.finetune, params.seed
    torch.manual_seed(torch_seed(seed, "finetune.weights"))  # initial weights and dropout
    viewpoints, (height, width) = torch.from_numpy(views.viewpoints), table.live.shape
    system = system_class(params.model.system)
    network = ViewNetwork(system, viewpoints, len(table.classes), params.model, (height, width))
    network.backbone.load_state_dict(pretrained["backbone"])
    network.head.load_frame_classifier(pretrained["classifier"])
    if not config.backbone_dropout:
        network.backbone.dropout.p = 0.0
    # type: ignore[call-overload]  # torch's types lack it
    network.to(compute.device, memory_format=torch.channels_last)
    drawn_from, progress = views.unclustered() if config.draw == "random" else views, Progress()
    train = SideViewSets(TRAIN, table, drawn_from, params, compute)
    if drawn_from.clustered:
        # a whole recording is answered as the network was trained
        network.clusters = RecordingClusters(params.cluster)
    if network.head.trainable:
        validation = SideViewSets(VALIDATION, table, views, params, compute)
        progress = _train(network, train, validation, config, compute, checkpoint_path, on_epoch)
    if config.moments == "clean":
        measure_moments(
            network, train.frames, train.draw(), compute, torch_generator(seed, "finetune.moments")
        )
    return network, progress


def _train(
    network: ViewNetwork,
    train: SideViewSets,
    validation: SideViewSets,
    config: Finetune,
    compute: Compute,
    checkpoint_path: Path | None,
    on_epoch: OnEpoch | None,
) -> Progress:
    """Train the network on view sets of the training side; after each epoch it answers those of the validation side."""
    # before `fit` restores the generators: a resumed training gets the same first sets
    first_sets = train.draw()
    validation_sets = torch.from_numpy(validation.draw()) if len(validation.anchors) else None
    # the bank keeps the latest feature of each training frame, for frames that do not pass the
    # backbone in a step
    uses_bank = config.feature_reuse > 1 and network.views > 1
    loss = SetLoss(network, compute, bank_size=len(train.frames) if uses_bank else 0)
    backbone: dict = {"params": network.backbone.parameters(), "lr": config.lr_backbone}
    optimiser = build_optimiser(config, [backbone, {"params": network.head.parameters()}])

    def batches(epoch: int) -> Iterator[Batch]:
        network.train()
        if uses_bank and epoch == 0:  # later epochs have it, those of a resumed training too
            loss.fill_bank(train.frames, config.batch)
        sets = first_sets if config.resample_views == "never" or epoch == 0 else train.draw()
        return train.batches(sets, in_time_order=network.head.in_time_order)

    @torch.inference_mode()
    def validate() -> dict[str, float]:
        if validation_sets is None:
            return {}
        network.eval()
        with compute.autocast():
            features = extract_features(network.backbone, validation.frames.split(INFERENCE_BATCH))
        logits = view_set_logits(network.head, features, validation_sets.to(compute.device))
        return {
            "validation_error": error_rate(logits, validation.frames.labels[validation.anchors])
        }

    steps, generators = num_batches(len(train.anchors), config.batch), (train.noise_rng, train.rng)
    return fit(
        "finetune",
        config,
        steps,
        loss,
        optimiser,
        batches,
        validate,
        generators,
        checkpoint_path,
        on_epoch,
    )


@torch.no_grad()
def measure_moments(
    network: ViewNetwork,
    frames: FrameInputs,
    drawn: np.ndarray,
    compute: Compute,
    order: torch.Generator,
) -> None:
    """Replace the running moments of batch normalisation by those of frames without noise and dropout.

    A tactile frame is mostly zeros, so even weak noise changes the moments of every map. The
    backbone's are measured first, then the head's, each as the mean over batches in random order.
    The network is left in evaluation mode.

    Args:
        frames: (n, 1, H, W), of the training side.
        drawn: view sets (A, V) of indices into them.
        order: CPU generator, of the order of the batches.
    """
    with compute.autocast():
        _average_moments(network.backbone, len(frames), frames.__getitem__, order)
        features = extract_features(network.backbone, frames.split(INFERENCE_BATCH))
    sets = torch.from_numpy(np.sort(drawn, axis=1) if network.head.in_time_order else drawn)
    _average_moments(
        network.head, len(sets), lambda index: features[compute.to_device(sets[index])], order
    )
    network.eval()


def _average_moments(
    module: nn.Module, count: int, batch_of: Callable[[Tensor], Tensor], order: torch.Generator
) -> None:
    """Replace a module's running moments by their mean over the batches that `batch_of` makes of indices."""
    norms = [
        layer for layer in module.modules() if isinstance(layer, nn.modules.batchnorm._BatchNorm)
    ]
    if not norms:
        return
    module.train()
    for layer in module.modules():
        if isinstance(layer, nn.modules.dropout._DropoutNd):
            layer.eval()
    batches = torch.randperm(count, generator=order).tensor_split(
        num_batches(count, INFERENCE_BATCH)
    )
    for number, index in enumerate(batches, start=1):
        for norm in norms:
            # the moments are the mean over the batches so far; no training follows
            norm.momentum = 1 / number
        module(batch_of(index))
