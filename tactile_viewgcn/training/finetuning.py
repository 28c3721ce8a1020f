"""Fine-tuning: the whole network is trained on view sets, from a pretrained backbone."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.backbone import extract_features
from tactile_viewgcn.nn.network import ViewNetwork, view_set_logits
from tactile_viewgcn.params import Finetune, Params
from tactile_viewgcn.randomness import stream, torch_generator, torch_seed
from tactile_viewgcn.systems import system_class
from tactile_viewgcn.tables.frames import TRAIN, VALIDATION, Frames
from tactile_viewgcn.tables.transform import full_scale
from tactile_viewgcn.tables.views import Views
from tactile_viewgcn.training import distributed
from tactile_viewgcn.training.augmentation import Augmentation
from tactile_viewgcn.training.checkpoint import Checkpoint, Progress
from tactile_viewgcn.training.feature_bank import FeatureBank
from tactile_viewgcn.training.inputs import FrameInputs
from tactile_viewgcn.training.loop import OnEpoch, fit
from tactile_viewgcn.training.losses import SetLoss, error_rate, set_losses
from tactile_viewgcn.training.moments import measure_moments
from tactile_viewgcn.training.optim import build_optimiser, lr_lambda, num_batches
from tactile_viewgcn.training.replay import Replay
from tactile_viewgcn.views.sampling import anchor_first, sets_of


class SideViewSets:
    """The frames of one side as tensors, and the view sets drawn from their clusters `views`."""

    def __init__(self, side: int, table: Frames, views: Views, compute: Compute, seed: int, assignment: str):
        self._index, self._views, self._assignment = table.on(side), views, assignment
        self.rng = stream(seed, "finetune.draw", side)
        self.anchors = np.flatnonzero(table.anchor[self._index])
        self.frames = FrameInputs(table, self._index, compute)
        self.labels = torch.from_numpy(table.label[self._index].astype(np.int64)).to(compute.device)

    def draw(self) -> np.ndarray:
        """View sets (A, V) of indices into `frames`, one per anchor."""
        return sets_of(self._views, self._index, self.rng).draw(self.anchors, self.rng, self._assignment)

    def batches(self, drawn: np.ndarray, config: Finetune) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Batches of the drawn view sets (A, V) in random order; their sizes differ by one at most.

        Yields:
            sets (B, k): with `num_views: full` all V frames of each set; with `random` one k for the whole batch, from
                1 to V, the anchor first where k < V.
            fresh (B, f): the columns whose frames pass through the backbone, k / `feature_reuse` of them, rounded up;
                sorted, the anchor's always among them.
        """
        order = self.rng.permutation(len(drawn))
        for index in np.array_split(order, num_batches(len(order), config.batch)):
            sets, columns = drawn[index], anchor_first(drawn[index], self.anchors[index], self.rng)
            views = sets.shape[1]
            if config.num_views == "random" and (fewer := int(self.rng.integers(1, views + 1))) < views:
                sets = np.take_along_axis(sets, columns[:, :fewer], axis=1)
                columns, views = np.broadcast_to(np.arange(fewer), sets.shape), fewer
            yield sets, np.sort(columns[:, : math.ceil(views / config.feature_reuse)], axis=1)


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
        checkpoint_path: see `pretrain_backbone`.
        on_epoch: see `pretrain_backbone`.

    Returns:
        network, and the progress: per epoch the loss and, where there is a validation side, its error.

    Raises:
        UserError: the training diverges, or `model` does not fit the number of views.
    """
    config, seed = params.finetune, params.seed
    torch.manual_seed(torch_seed(seed, "finetune.weights"))  # initial weights and dropout
    viewpoints, (height, width) = torch.from_numpy(views.viewpoints), table.live.shape
    system = system_class(params.model.system)
    classifier = ViewNetwork(system, viewpoints, len(table.classes), params.model, (height, width))
    classifier.backbone.load_state_dict(pretrained["backbone"])
    classifier.head.load_frame_classifier(pretrained["classifier"])
    if not config.backbone_dropout:
        classifier.backbone.dropout.p = 0.0
    classifier.to(compute.device, memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's types lack it
    drawn_from, progress = views.unclustered() if config.draw == "random" else views, Progress()
    train = SideViewSets(TRAIN, table, drawn_from, compute, seed, params.cluster.assignment)
    if classifier.head.trainable:
        validation = SideViewSets(VALIDATION, table, views, compute, seed, params.cluster.assignment)
        noise = config.noise * full_scale(table.transform, table.scale)
        progress = _train(classifier, train, validation, noise, params, compute, checkpoint_path, on_epoch)
    if config.moments == "clean":
        measure_moments(classifier, train.frames, train.draw(), compute, torch_generator(seed, "finetune.moments"))
    return classifier, progress


def _train(
    network: ViewNetwork,
    train: SideViewSets,
    validation: SideViewSets,
    noise: float,
    params: Params,
    compute: Compute,
    checkpoint_path: Path | None,
    on_epoch: OnEpoch | None,
) -> Progress:
    """Train the network on the view sets of one side; `noise` in units of network input."""
    config = params.finetune
    on_device = torch_generator(params.seed, "finetune.noise", compute.device)
    augment_frames = Augmentation(noise, params.augment, on_device)
    first_sets = train.draw()
    validation_sets = torch.from_numpy(validation.draw()) if len(validation.anchors) else None
    reuse = config.feature_reuse > 1 and network.views > 1
    bank = FeatureBank(len(train.frames), network.feature_shape, compute) if reuse else None
    loss = SetLoss(network, bank, augment_frames, compute)
    parallel_loss = distributed.parallel(loss, some_unused=config.num_views == "random")
    loss_of = Replay(parallel_loss, network.parameters(), [on_device])
    backbone: dict = {"params": network.backbone.parameters(), "lr": config.lr_backbone}
    optimiser = build_optimiser(config, [backbone, {"params": network.head.parameters()}])
    checkpoint = Checkpoint(
        checkpoint_path,
        {"classifier": network, "optimiser": optimiser} | ({"bank": bank} if bank else {}),
        {"noise": on_device},
        {"draw": train.rng},
        compute.device,
    )

    def losses(epoch: int) -> Iterator[Tensor]:
        network.train()
        if bank is not None and epoch == 0:
            bank.fill(network.backbone, train.frames, batch=config.batch, augment_frames=augment_frames)
        plan = train.batches(first_sets if config.resample_views == "never" or epoch == 0 else train.draw(), config)
        in_time_order = network.head.in_time_order
        return set_losses(loss_of, train.frames, train.labels, plan, in_time_order=in_time_order, compute=compute)

    @torch.inference_mode()
    def validate() -> dict[str, float]:
        if validation_sets is None:
            return {}
        network.eval()
        with compute.autocast():
            features = extract_features(network.backbone, validation.frames)
        logits = view_set_logits(network.head, features, validation_sets.to(compute.device))
        return {"validation_error": error_rate(logits, validation.labels[validation.anchors])}

    steps, factor = num_batches(len(train.anchors), config.batch), lr_lambda(config)
    return fit("finetune", config.epochs, steps, optimiser, factor, losses, validate, checkpoint, on_epoch)
