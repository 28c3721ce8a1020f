"""Fine-tuning: train the whole network on view sets, starting from a pretrained backbone."""

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
from tactile_viewgcn.training.view_sets import Batch, SetLoss, SubsetViewSets
from tactile_viewgcn.views.recording_clusters import RecordingClusters


class ViewSetTraining:
    """The training of a network on view sets.

    The view sets of the validation set and the first view sets of the training set are drawn here,
    before `fit` restores the generators. So a resumed training run gets the same view sets.

    Args:
        network: the network, on `compute`'s device.
        train: the training set.
        validation: the validation set, possibly without anchors.
        config: the batch size, and how view sets are drawn and features reused.
        compute: device and precision.
    """

    def __init__(
        self,
        network: ViewNetwork,
        *,
        train: SubsetViewSets,
        validation: SubsetViewSets,
        config: Finetune,
        compute: Compute,
    ):
        self._network = network
        self._train = train
        self._validation = validation
        self._config = config
        self._compute = compute
        self._first_sets = train.draw()
        self._validation_sets: Tensor | None = None
        if len(validation.anchors):
            self._validation_sets = torch.from_numpy(validation.draw())
        # the bank keeps the latest feature of each training frame, for use in the steps in which
        # the frame does not pass through the backbone
        self._uses_bank = config.feature_reuse > 1 and network.views > 1
        bank_size = len(train.frames) if self._uses_bank else 0
        self.loss = SetLoss(network, compute, bank_size)
        self.steps = num_batches(len(train.anchors), config.batch)
        self.generators = (train.noise_rng, train.rng)

    def batches(self, epoch: int) -> Iterator[Batch]:
        """Return the batches of an epoch, numbered from 0, with one view set for each anchor."""
        self._network.train()
        # later epochs find the bank filled, even in a resumed training run
        if self._uses_bank and epoch == 0:
            self.loss.fill_bank(self._train.frames, self._config.batch)
        if epoch == 0 or self._config.resample_views == "never":
            sets = self._first_sets
        else:
            sets = self._train.draw()
        return self._train.batches(sets, in_time_order=self._network.head.in_time_order)

    @torch.inference_mode()
    def validate(self) -> dict[str, float]:
        """Return the error rate on the validation set's view sets, if there are any."""
        if self._validation_sets is None:
            return {}
        network = self._network
        network.eval()
        frames = self._validation.frames
        with self._compute.autocast():
            features = extract_features(network.backbone, frames.split(INFERENCE_BATCH))
        sets = self._validation_sets.to(self._compute.device)
        logits = view_set_logits(network.head, features, sets)
        return {"validation_error": error_rate(logits, frames.labels[self._validation.anchors])}


def finetune_classifier(
    table: Frames,
    views: Views,
    pretrained: dict[str, dict[str, Tensor]],
    params: Params,
    compute: Compute,
    checkpoint_path: Path | None = None,
    on_epoch: OnEpoch | None = None,
) -> tuple[ViewNetwork, Progress]:
    """Return the network, trained from the pretrained weights on one view set per anchor and epoch.

    A system without weights to fine-tune is not trained. Its moments are still measured with
    `finetune.moments: clean`.

    Args:
        table: the kept frames.
        views: the clusters of the frames, and the viewpoints.
        pretrained: weights of the `backbone` and of its linear `classifier`.
        params: the sections `finetune`, `cluster` and `model`, and the seed are used.
        compute: device and precision.
        checkpoint_path: see `fit`.
        on_epoch: see `fit`.

    Returns:
        The network, and the progress. For each epoch the progress has the loss and, if there is a
        validation set, its error rate.

    Raises:
        UserError: the training run diverges, or `model` does not fit the number of views.
    """
    config = params.finetune
    network = _new_network(table, views, pretrained, params, compute)
    drawn_from = views
    if config.draw == "random":
        drawn_from = views.unclustered()
    train = SubsetViewSets(TRAIN, table, drawn_from, params, compute)
    if drawn_from.clustered:
        # a whole recording is then answered by view sets like those of the training run
        network.clusters = RecordingClusters(params.cluster)
    progress = Progress()
    if network.head.trainable:
        validation = SubsetViewSets(VALIDATION, table, views, params, compute)
        training = ViewSetTraining(
            network, train=train, validation=validation, config=config, compute=compute
        )
        backbone = {"params": network.backbone.parameters(), "lr": config.lr_backbone}
        head = {"params": network.head.parameters()}
        progress = fit(
            "finetune",
            config,
            training=training,
            optimiser=build_optimiser(config, [backbone, head]),
            checkpoint_path=checkpoint_path,
            on_epoch=on_epoch,
        )
    if config.moments == "clean":
        order = torch_generator(params.seed, "finetune.moments")
        measure_moments(network, train.frames, train.draw(), compute, order)
    return network, progress


def _new_network(
    table: Frames,
    views: Views,
    pretrained: dict[str, dict[str, Tensor]],
    params: Params,
    compute: Compute,
) -> ViewNetwork:
    """Return the network with the pretrained weights.

    The arguments are the same as in `finetune_classifier`.
    """
    torch.manual_seed(torch_seed(params.seed, "finetune.weights"))  # initial weights and dropout
    height, width = table.live.shape
    network = ViewNetwork(
        system_class(params.model.system),
        torch.from_numpy(views.viewpoints),
        len(table.classes),
        params.model,
        (height, width),
    )
    network.backbone.load_pretrained(pretrained["backbone"])
    network.head.load_frame_classifier(pretrained["classifier"])
    if not params.finetune.backbone_dropout:
        network.backbone.dropout.p = 0.0
    # torch's types lack the memory format
    network.to(compute.device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    return network


@torch.no_grad()
def measure_moments(
    network: ViewNetwork,
    frames: FrameInputs,
    drawn: np.ndarray,
    compute: Compute,
    order: torch.Generator,
) -> None:
    """Replace the running moments of batch normalisation by moments of frames without noise.

    A tactile frame is mostly zeros, so even weak noise changes the moments of every map. The
    moments are measured without dropout too. The backbone comes first, then the head, each with the
    mean over batches in random order. The network is left in evaluation mode.

    Args:
        network: the network whose moments are replaced.
        frames: (n, 1, H, W), of the training set.
        drawn: view sets (A, V) of indices of these frames.
        compute: device and precision.
        order: CPU generator that draws the order of the batches.
    """
    with compute.autocast():
        _average_moments(network.backbone, len(frames), frames.__getitem__, order)
        features = extract_features(network.backbone, frames.split(INFERENCE_BATCH))
    if network.head.in_time_order:
        drawn = np.sort(drawn, axis=1)
    sets = torch.from_numpy(drawn)

    def views_of(index: Tensor) -> Tensor:
        return features[compute.to_device(sets[index])]

    _average_moments(network.head, len(sets), views_of, order)
    network.eval()


def _average_moments(
    module: nn.Module, count: int, batch_of: Callable[[Tensor], Tensor], order: torch.Generator
) -> None:
    """Replace a module's running moments by their mean over batches.

    Args:
        module: backbone or head.
        count: number of frames or view sets.
        batch_of: function from indices (k,) to the module's input.
        order: CPU generator that draws the order of the batches.
    """
    norms = [
        layer for layer in module.modules() if isinstance(layer, nn.modules.batchnorm._BatchNorm)
    ]
    if not norms:
        return
    module.train()
    for layer in module.modules():
        if isinstance(layer, nn.modules.dropout._DropoutNd):
            layer.eval()
    shuffled = torch.randperm(count, generator=order)
    batches = shuffled.tensor_split(num_batches(count, INFERENCE_BATCH))
    for number, index in enumerate(batches, start=1):
        for norm in norms:
            # makes the moments the mean over the batches so far. No training follows, so the
            # momentum is not set back
            norm.momentum = 1 / number
        module(batch_of(index))
