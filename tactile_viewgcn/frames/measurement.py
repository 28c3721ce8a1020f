"""Baselines and filters compared on the training side: the error of a quick classifier, and whether objects leak."""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import (
    Baseline,
    constant_baseline,
    empty_hand_baseline,
    of_empty_hand,
    quiet_baseline,
    require_live,
)
from tactile_viewgcn.frames.filtering import passing
from tactile_viewgcn.frames.grasp_baseline import grasp_baseline
from tactile_viewgcn.frames.inspection import Inspection
from tactile_viewgcn.frames.leak import check_leak
from tactile_viewgcn.frames.open_hand import OpenHand, find_open_hand
from tactile_viewgcn.frames.quick_error import QuickError, quick_error
from tactile_viewgcn.frames.split import SPLIT_SEED, sides_of_split, split_groups, surplus_groups
from tactile_viewgcn.params import Preprocess, Split
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.readers.source import TEST as PUBLISHED_TEST
from tactile_viewgcn.tables.frames import TEST
from tactile_viewgcn.tables.recordings import Recordings

BASELINES = ("empty_hand", "grasp", "quiet", "none")  # an earlier one is taken unless a later one errs clearly less
FILTERS = ("flags", "contact")  # likewise; without a baseline every frame is kept where there are no flags
CLEARLY = 2.0  # standard errors; of three baselines that err alike one is lower by 1 in 40 % of the cases, by 2 in 7 %


@dataclass(frozen=True)
class Measurement:
    """What a quick classifier makes of settings on the training side.

    Attributes:
        baselines: error on frames of contact by each baseline that the recordings allow, on the same frames.
        leaks: error on frames without contact by the same, but for those where it cannot be measured.
        filters: error by each filter that the recordings allow, above one baseline.
    """

    baselines: dict[str, QuickError]
    leaks: dict[str, QuickError]
    filters: dict[str, QuickError]

    def counts(self) -> dict[str, float]:
        """The errors by the names that they are logged under."""
        measured = {"baseline": self.baselines, "leak": self.leaks, "filter": self.filters}
        return {f"measured.{what}.{kind}": errors[kind].error for what, errors in measured.items() for kind in errors}

    def best_baseline(self) -> str | None:
        """The first baseline that errs within two standard errors of the lowest, of those that do not tell the object.

        Where all tell it, that which tells it least; None without a measurement.
        """
        leaking = [kind for kind in self.baselines if kind in self.leaks and self.leaks[kind].tells_object]
        if self.baselines and len(leaking) == len(self.baselines):
            return max(leaking, key=lambda kind: self.leaks[kind].error)
        return _first_of_lowest({kind: error for kind, error in self.baselines.items() if kind not in leaking})

    def best_filter(self) -> str | None:
        """The first filter that errs within two standard errors of the lowest; None without a measurement."""
        return _first_of_lowest(self.filters)


def measure_baseline(recordings: Recordings, params: Preprocess, hand: OpenHand | None = None) -> Baseline:
    """The baseline that `preprocess.baseline` names; without `hand` the open hand is found where it is needed.

    Raises:
        UserError: no sensor that varies; no frames to estimate the baseline from.
    """
    require_live(recordings)
    if params.baseline == "empty_hand":
        return empty_hand_baseline(recordings)
    if params.baseline == "quiet":
        return quiet_baseline(recordings, params.quiet_share)
    if params.baseline == "grasp":
        sensors, sigmas = params.contact_sensors, params.contact_sigmas
        return grasp_baseline(recordings, hand or find_open_hand(recordings, sensors=sensors, sigmas=sigmas))
    return constant_baseline(recordings, params.zero)


def possible_baselines(recordings: Recordings, hand: OpenHand, params: Preprocess) -> dict[str, Baseline]:
    """The baselines that the recordings allow, by `preprocess.baseline`: one, or all where that is `auto`."""
    baselines = {}
    for kind in BASELINES if params.baseline == "auto" else (params.baseline,):
        with suppress(UserError):
            baselines[kind] = measure_baseline(recordings, replace(params, baseline=kind), hand)
    return baselines


def training_frames(
    recordings: Recordings, baselines: dict[str, Baseline], params: Preprocess, split: Split
) -> np.ndarray:
    """bool (T,): frames of groups that are on the training side whichever baseline and filter are chosen.

    Groups are dealt to the sides after the filter, which may drop some of them.
    """
    columns, group = recordings.columns, split_groups(recordings.columns, split.by)
    if split.by == "source":
        return columns["split"] != PUBLISHED_TEST
    training = np.ones(len(recordings), dtype=bool)
    for baseline in baselines.values():
        for keep in possible_filters(recordings, baseline, params).values():
            kept = keep if params.empty_hand_class else keep & ~of_empty_hand(recordings)
            label, of_kept = columns["object"][kept], group[kept]
            side = sides_of_split(split, of_kept, label)
            unused = side == TEST
            if split.train_groups != "all":
                unused |= surplus_groups(side, of_kept, label, most=split.train_groups)
            cell = group * len(recordings.objects) + columns["object"]
            training &= ~np.isin(cell, cell[kept][unused])
    return training


def possible_filters(recordings: Recordings, baseline: Baseline, params: Preprocess) -> dict[str, np.ndarray]:
    """bool (T,) frames that pass each filter that the recordings allow, by `preprocess.filter`: one, or all of `auto`.

    Flags are allowed where every object has some.
    """
    objects, filters = recordings.columns["object"], {}
    for kind in FILTERS if params.filter == "auto" else (params.filter,):
        with suppress(UserError):
            passed = passing(recordings, baseline, replace(params, filter=kind))[0]
            without = np.setdiff1d(objects[~of_empty_hand(recordings)], objects[passed])
            if kind != "flags" or not len(without) or params.filter != "auto":
                filters[kind] = passed
    return filters


def measure_baselines(
    recordings: Recordings,
    inspection: Inspection,
    baselines: dict[str, Baseline],
    group: np.ndarray,
    training: np.ndarray,
) -> Measurement:
    """The errors of contact and without it by each baseline, on training frames bool (T,) of groups (T,)."""
    errors: dict[str, QuickError] = {}
    leaks: dict[str, QuickError] = {}
    for kind, baseline in baselines.items():
        error = _error(recordings, inspection, baseline, group, training & inspection.in_hand)
        rng = stream(SPLIT_SEED, "leak")
        leak = (
            None if inspection.all_contact else check_leak(recordings, baseline, inspection.hand, group, rng, training)
        )
        errors |= {kind: error} if error else {}
        leaks |= {kind: leak} if leak else {}
    return Measurement(errors, leaks, {})


def measure_filters(
    recordings: Recordings,
    inspection: Inspection,
    baseline: Baseline,
    params: Preprocess,
    group: np.ndarray,
    training: np.ndarray,
    cells: np.ndarray,
) -> dict[str, QuickError]:
    """The error by each filter above a baseline, over cells (C, 2) of object and group: wrong where nothing is kept."""
    errors = {}
    for kind, passed in possible_filters(recordings, baseline, params).items():
        if error := _error(recordings, inspection, baseline, group, training & passed):
            errors[kind] = error.among(cells)
    return errors


def _error(
    recordings: Recordings, inspection: Inspection, baseline: Baseline, group: np.ndarray, usable: np.ndarray
) -> QuickError | None:
    """The error by usable frames (T,) of log(1 + excess), whose unit is what a pressed sensor reads at least."""
    hand = inspection.hand
    unit = hand.sigmas * np.median(hand.noise[np.unique(inspection.session)])

    def readings(index: np.ndarray) -> np.ndarray:
        excess = hand.counts[index] - baseline.mean[baseline.of_frame[index]][:, recordings.live]
        return np.log1p(np.maximum(excess / unit, 0))

    usable = usable & ~of_empty_hand(recordings)
    return quick_error(readings, usable, recordings.columns["object"], group, stream(SPLIT_SEED, "measurement"))


def _first_of_lowest(errors: dict[str, QuickError]) -> str | None:
    """The first of some settings that errs within two standard errors, paired over groups, of the lowest."""
    if not errors:
        return None
    lowest = min(errors.values(), key=lambda error: error.error)
    for kind, error in errors.items():
        more, standard_error = error.more_than(lowest)
        if more <= CLEARLY * standard_error:
            return kind
    return None
