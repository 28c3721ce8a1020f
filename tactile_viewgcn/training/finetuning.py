"""Fine-tuning: the whole network is trained on view sets, from a pretrained backbone."""

from collections.abc import Iterator
from pathlib import Path

import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.backbone import INFERENCE_BATCH, extract_features
from tactile_viewgcn.nn.network import ViewNetwork, view_set_logits
from tactile_viewgcn.params import Params
from tactile_viewgcn.randomness import torch_generator, torch_seed
from tactile_viewgcn.systems import system_class
from tactile_viewgcn.tables.frames import TRAIN, VALIDATION, Frames, full_scale
from tactile_viewgcn.tables.views import Views
from tactile_viewgcn.training.inputs import Noise
from tactile_viewgcn.training.loop import OnEpoch, Progress, error_rate, fit
from tactile_viewgcn.training.moments import measure_moments
from tactile_viewgcn.training.optim import build_optimiser, num_batches
from tactile_viewgcn.training.view_sets import Batch, FeatureBank, SetLoss, SideViewSets


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

    A system without weights to fine-tune is returned as it is initialised, but for `finetune.moments`.

    Args:
        pretrained: weights of the `backbone` and of its linear `classifier`.
        checkpoint_path: see `fit`; on_epoch too.

    Returns:
        network, and the progress: per epoch the loss and, where there is a validation side, its error.

    Raises:
        UserError: the training diverges, or `model` does not fit the number of views.
    """
    config, seed, assignment = params.finetune, params.seed, params.cluster.assignment
    torch.manual_seed(torch_seed(seed, "finetune.weights"))  # initial weights and dropout
    viewpoints, (height, width) = torch.from_numpy(views.viewpoints), table.live.shape
    system = system_class(params.model.system)
    network = ViewNetwork(system, viewpoints, len(table.classes), params.model, (height, width))
    network.backbone.load_state_dict(pretrained["backbone"])
    network.head.load_frame_classifier(pretrained["classifier"])
    if not config.backbone_dropout:
        network.backbone.dropout.p = 0.0
    network.to(compute.device, memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's types lack it
    drawn_from, progress = views.unclustered() if config.draw == "random" else views, Progress()
    train = SideViewSets(TRAIN, table, drawn_from, compute, seed, assignment)
    if network.head.trainable:
        validation = SideViewSets(VALIDATION, table, views, compute, seed, assignment)
        on_device = torch_generator(seed, "finetune.noise", compute.device)
        noise = Noise(config.noise * full_scale(table.transform, table.scale), on_device)
        progress = _train(network, train, validation, noise, params, compute, checkpoint_path, on_epoch)
    if config.moments == "clean":
        measure_moments(network, train.frames, train.draw(), compute, torch_generator(seed, "finetune.moments"))
    return network, progress


def _train(
    network: ViewNetwork,
    train: SideViewSets,
    validation: SideViewSets,
    noise: Noise,
    params: Params,
    compute: Compute,
    checkpoint_path: Path | None,
    on_epoch: OnEpoch | None,
) -> Progress:
    """Train the network on the view sets of one side."""
    config, first_sets = params.finetune, train.draw()
    validation_sets = torch.from_numpy(validation.draw()) if len(validation.anchors) else None
    reuse = config.feature_reuse > 1 and network.views > 1
    bank = FeatureBank(len(train.frames), network.feature_shape, compute) if reuse else None
    loss = SetLoss(network, bank, compute)
    backbone: dict = {"params": network.backbone.parameters(), "lr": config.lr_backbone}
    optimiser = build_optimiser(config, [backbone, {"params": network.head.parameters()}])

    def batches(epoch: int) -> Iterator[Batch]:
        network.train()
        if bank is not None and epoch == 0:
            bank.fill(network.backbone, train.frames, batch=config.batch, noise=noise)
        drawn = first_sets if config.resample_views == "never" or epoch == 0 else train.draw()
        return train.batches(drawn, config, noise, in_time_order=network.head.in_time_order)

    @torch.inference_mode()
    def validate() -> dict[str, float]:
        if validation_sets is None:
            return {}
        network.eval()
        with compute.autocast():
            features = extract_features(network.backbone, validation.frames.split(INFERENCE_BATCH))
        logits = view_set_logits(network.head, features, validation_sets.to(compute.device))
        return {"validation_error": error_rate(logits, validation.frames.labels[validation.anchors])}

    steps, generators = num_batches(len(train.anchors), config.batch), (noise.rng, train.rng)
    return fit("finetune", config, steps, loss, optimiser, batches, validate, generators, checkpoint_path, on_epoch)
