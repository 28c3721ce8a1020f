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
from tactile_viewgcn.tables.frames import TRAIN, VALIDATION, Frames, full_scale
from tactile_viewgcn.tables.views import Views
from tactile_viewgcn.training.checkpoint import Progress
from tactile_viewgcn.training.inputs import FrameInputs, Noise
from tactile_viewgcn.training.loop import OnEpoch, error_rate, fit
from tactile_viewgcn.training.moments import measure_moments
from tactile_viewgcn.training.optim import build_optimiser, num_batches
from tactile_viewgcn.training.replay import Replay
from tactile_viewgcn.training.set_loss import FeatureBank, SetLoss
from tactile_viewgcn.views.sampling import anchor_first, sets_of


class SideViewSets:
    """The frames of one side, and the view sets drawn from their clusters `views`."""

    def __init__(self, side: int, table: Frames, views: Views, compute: Compute, seed: int, assignment: str):
        self._index, self._views, self._assignment, self._compute = table.on(side), views, assignment, compute
        self.rng = stream(seed, "finetune.draw", side)
        self.anchors = np.flatnonzero(table.anchor[self._index])
        self.frames = FrameInputs(table, self._index, compute)

    def draw(self) -> np.ndarray:
        """View sets (A, V) of indices into `frames`, one per anchor."""
        return sets_of(self._views, self._index, self.rng).draw(self.anchors, self.rng, self._assignment)

    def batches(
        self, drawn: np.ndarray, config: Finetune, noise: Noise, *, in_time_order: bool = False
    ) -> Iterator[tuple[Tensor, ...]]:
        """Batches of the drawn view sets (A, V) in random order; their sizes differ by one at most.

        Args:
            noise: of the frames that pass through the backbone.
            in_time_order: frames of a set are sorted; they are numbered in the order of time inside a recording.

        Yields:
            The arguments of `SetLoss.forward`. Its `sets` (B, k) are with `num_views: full` all
            V frames of each set; with `random` one k for the whole batch, from 1 to V, the anchor first where k < V.
            Its `fresh` (B, f) are the columns whose frames pass through the backbone, k / `feature_reuse` of them,
            rounded up; sorted, the anchor's always among them.
        """
        order = self.rng.permutation(len(drawn))
        for index in np.array_split(order, num_batches(len(order), config.batch)):
            sets, columns = drawn[index], anchor_first(drawn[index], self.anchors[index], self.rng)
            views = sets.shape[1]
            if config.num_views == "random" and (fewer := int(self.rng.integers(1, views + 1))) < views:
                sets = np.take_along_axis(sets, columns[:, :fewer], axis=1)
                columns, views = np.broadcast_to(np.arange(fewer), sets.shape), fewer
            fresh = np.sort(columns[:, : math.ceil(views / config.feature_reuse)], axis=1)
            if in_time_order:
                sets, fresh = sort_by_time(sets, fresh)
            passing = np.take_along_axis(sets, fresh, axis=1)
            frames, first = noise(self.frames[torch.from_numpy(passing.ravel())]), first_places(passing.ravel())
            labels = self._compute.gather(self.frames.labels, torch.from_numpy(sets[:, 0]))
            yield frames, labels, *(self._compute.to_device(torch.from_numpy(part)) for part in (sets, fresh, first))


def first_places(index: np.ndarray) -> np.ndarray:
    """For each entry of `index` (n,) the first place with that value."""
    _, first, place = np.unique(index, return_index=True, return_inverse=True)
    return first[place]


def sort_by_time(sets: np.ndarray, fresh: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """View sets (B, k) sorted by index, and where their columns `fresh` (B, f) are then, sorted too."""
    order = np.argsort(sets, axis=1, kind="stable")
    place = np.argsort(order, axis=1)
    return np.take_along_axis(sets, order, axis=1), np.sort(np.take_along_axis(place, fresh, axis=1), axis=1)


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
        checkpoint_path: where the training is saved after every epoch; a saved one is continued.
        on_epoch: see `fit`.

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
        on_device = torch_generator(seed, "finetune.noise", compute.device)
        noise = Noise(config.noise * full_scale(table.transform, table.scale), on_device)
        progress = _train(classifier, train, validation, noise, params, compute, checkpoint_path, on_epoch)
    if config.moments == "clean":
        measure_moments(classifier, train.frames, train.draw(), compute, torch_generator(seed, "finetune.moments"))
    return classifier, progress


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
    loss_of = Replay(SetLoss(network, bank, compute), network.parameters())
    backbone: dict = {"params": network.backbone.parameters(), "lr": config.lr_backbone}
    optimiser = build_optimiser(config, [backbone, {"params": network.head.parameters()}])
    parts = {"classifier": network, "noise": noise.rng, "draw": train.rng} | ({"bank": bank.values} if bank else {})

    def batches(epoch: int) -> Iterator[tuple[Tensor, ...]]:
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
            features = extract_features(network.backbone, validation.frames)
        logits = view_set_logits(network.head, features, validation_sets.to(compute.device))
        return {"validation_error": error_rate(logits, validation.frames.labels[validation.anchors])}

    steps = num_batches(len(train.anchors), config.batch)
    return fit("finetune", config, steps, optimiser, loss_of, batches, validate, parts, checkpoint_path, on_epoch)
