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
from tactile_viewgcn.systems import on_sensors, system_class
from tactile_viewgcn.systems.classifier import Classifier
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
from tactile_viewgcn.training.sensor_fitting import fit_sensors
from tactile_viewgcn.views.sampling import sets_of


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
            sets, columns = drawn[index], self._anchor_first(drawn[index], self.anchors[index])
            views = sets.shape[1]
            if config.num_views == "random" and (fewer := int(self.rng.integers(1, views + 1))) < views:
                sets = np.take_along_axis(sets, columns[:, :fewer], axis=1)
                columns, views = np.broadcast_to(np.arange(fewer), sets.shape), fewer
            yield sets, np.sort(columns[:, : math.ceil(views / config.feature_reuse)], axis=1)

    def _anchor_first(self, sets: np.ndarray, anchors: np.ndarray) -> np.ndarray:
        """The columns of each set (B, V), the anchor's first and the others in random order."""
        key = self.rng.random(sets.shape)
        key[np.arange(len(sets)), (sets == anchors[:, None]).argmax(axis=1)] = -1
        return np.argsort(key, axis=1)


def finetune_classifier(
    table: Frames,
    views: Views,
    pretrained: dict[str, dict[str, Tensor]],
    params: Params,
    compute: Compute,
    checkpoint_path: Path | None = None,
    on_epoch: OnEpoch | None = None,
) -> tuple[Classifier, Progress]:
    """The classifier, from the pretrained weights, trained on one view set per anchor and epoch.

    A system without weights to fine-tune is returned as it is initialised, but for `finetune.moments`.

    Args:
        pretrained: weights of the `backbone` and of its linear `classifier`.
        params: `seed`, `cluster.assignment`, `model`, `finetune` and `augment` are read.
        checkpoint_path: see `pretrain_backbone`.
        on_epoch: see `pretrain_backbone`.

    Returns:
        classifier, and the progress: per epoch the loss and, where there is a validation side, its error.

    Raises:
        UserError: the training diverges in its first epoch, or `model` does not fit the number of views.
    """
    config, seed = params.finetune, params.seed
    if on_sensors(params.model.system):
        return fit_sensors(table, views.viewpoints, params.model, config.num_views, seed)
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
        training = _Finetuning(classifier, train, validation, noise, params, compute)
        progress = training.run(checkpoint_path, on_epoch)
    if config.moments == "clean":
        measure_moments(classifier, train.frames, train.draw(), compute, torch_generator(seed, "finetune.moments"))
    return classifier, progress


class _Finetuning:
    """The training of a network on the view sets of one side; `noise` in units of network input."""

    def __init__(
        self,
        network: ViewNetwork,
        train: SideViewSets,
        validation: SideViewSets,
        noise: float,
        params: Params,
        compute: Compute,
    ):
        self.network, self.train, self.validation, self.compute = network, train, validation, compute
        self.config = config = params.finetune
        self.noise_rng = torch_generator(params.seed, "finetune.noise", compute.device)
        self.augment_frames = Augmentation(noise, params.augment, self.noise_rng)
        self.first_sets = train.draw()
        self.validation_sets = torch.from_numpy(validation.draw()) if len(validation.anchors) else None
        reuse = config.feature_reuse > 1 and network.views > 1
        self.bank = FeatureBank(len(train.frames), network.feature_shape, compute) if reuse else None
        loss = SetLoss(network, self.bank, self.augment_frames, compute)
        parallel_loss = distributed.parallel(loss, some_unused=config.num_views == "random")
        self.loss_of = Replay(parallel_loss, network.parameters(), [self.noise_rng])

    def run(self, checkpoint_path: Path | None, on_epoch: OnEpoch | None) -> Progress:
        """Train for all epochs, or those that are left."""
        config, network = self.config, self.network
        backbone: dict = {"params": network.backbone.parameters(), "lr": config.lr_backbone}
        optimiser = build_optimiser(config, [backbone, {"params": network.head.parameters()}])
        state = {"classifier": network, "optimiser": optimiser} | ({"bank": self.bank} if self.bank else {})
        rngs = {"noise": self.noise_rng}, {"draw": self.train.rng}
        checkpoint = Checkpoint(checkpoint_path, state, *rngs, self.compute.device)
        steps, factor = num_batches(len(self.train.anchors), config.batch), lr_lambda(config)
        return fit(
            "finetune", config.epochs, steps, optimiser, factor, self.losses, self.validate, checkpoint, on_epoch
        )

    def losses(self, epoch: int) -> Iterator[Tensor]:
        """The loss of each batch of an epoch, each computed when it is asked for."""
        config, train = self.config, self.train
        self.network.train()
        if self.bank is not None and epoch == 0:
            self.bank.fill(self.network.backbone, train.frames, batch=config.batch, augment_frames=self.augment_frames)
        drawn = self.first_sets if config.resample_views == "never" or epoch == 0 else train.draw()
        return set_losses(
            self.loss_of,
            train.frames,
            train.labels,
            train.batches(drawn, config),
            in_time_order=self.network.head.in_time_order,
            compute=self.compute,
        )

    @torch.inference_mode()
    def validate(self) -> dict[str, float]:
        """The error on the validation side, if there is one."""
        if self.validation_sets is None:
            return {}
        self.network.eval()
        with self.compute.autocast():
            features = extract_features(self.network.backbone, self.validation.frames)
        logits = view_set_logits(self.network.head, features, self.validation_sets.to(self.compute.device))
        return {"validation_error": error_rate(logits, self.validation.labels[self.validation.anchors])}
