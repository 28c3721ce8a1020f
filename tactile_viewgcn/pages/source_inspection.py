"""Inspects recordings: it tries `preprocess` on them, recommends settings, and measures more."""

from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from math import isqrt
from pathlib import Path

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.decide import decide
from tactile_viewgcn.frames.folds import complete_folds
from tactile_viewgcn.frames.leak import QuickError
from tactile_viewgcn.frames.split import SPLIT_SEED, published_test, split_groups
from tactile_viewgcn.intervals import FEW, proportion_interval
from tactile_viewgcn.members.frame_values import every_few
from tactile_viewgcn.members.pooled_kernel import PooledKernelMember
from tactile_viewgcn.members.representation import Representation, contact_unit
from tactile_viewgcn.messages import Note, UserError, warnings_of
from tactile_viewgcn.params import PreprocessSection
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.readers.layout import other_order
from tactile_viewgcn.readers.source import AUTO, Form, setting
from tactile_viewgcn.sensor_array import is_array
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.frames import frame_rates
from tactile_viewgcn.tables.look import held_together, look_at
from tactile_viewgcn.tables.recordings import Recordings, recordings_of
from tactile_viewgcn.tables.remarks import remarks

# largest number of frames that a sensor's variation and an object's mean picture rest on
SAMPLE = 2000
MOST_FOLDS = 5
GRID = 16  # sensors in one row; so many or more can be a grid
QUICK_FOLDS = 5  # of the quick error
ALL_AUTO = PreprocessSection()  # settings of `preprocess` if the user sets none


class Overview:
    """R recordings of O objects; each measurement is made when it is first read.

    Args:
        recordings: the table of raw counts; its frames stay mapped after its file is deleted.
        form: the form in which the source was read.
        preprocess: settings of `preprocess`. For a setting `auto`, the inspection chooses like the
            stage `preprocess`.

    Attributes:
        remarks: notes on the source and its table, see `tables.remarks`, and the warnings of
            `choice`.
        groups: for each value of `split.by`, the number of groups of each object (O,); 0 for the
            empty hand. Copies of a recording are one group.
        choice: what `auto` becomes on all recordings. The stage `preprocess` itself looks only at
            the training set.
        states: states of the hand in all frames.
        in_contact: bool (T,), frames of contact with an object.
        rates: see `frame_rates`.
        settings: recommended values with reasons, as notes of level `choice`: what `auto` becomes,
            the preset and the split. The scale is left out, since only networks read it. The number
            of pressed sensors is left out if no contact is looked for.
        label, session: (R,) index of each recording's object and session.
    """

    def __init__(
        self, recordings: Recordings, form: Form = AUTO, preprocess: PreprocessSection = ALL_AUTO
    ):
        look = look_at(recordings)
        self.remarks = remarks(recordings, look)
        recordings = held_together(recordings, look)
        columns = recordings.columns
        self.recordings = recordings
        self.form = form
        self.preprocess = preprocess
        self.groups = _groups(recordings)
        split = split_settings(self.groups)
        self._group = split_groups(columns, str(split[0].value))
        every_frame = np.arange(len(recordings))
        self.choice = decide(recordings, every_frame, preprocess, self._group)
        self.states = self.choice.states
        self.in_contact = self.states.contact & ~recordings.empty_hand
        self.rates = frame_rates(columns["time"], columns["recording"])
        self.remarks += grid_notes(recordings.shape, form)
        self.remarks += warnings_of(self.choice.notes)
        self.settings = [*self._chosen_settings(), *split]
        first = np.unique(columns["recording"], return_index=True)[1]
        self.label = columns["object"][first]
        self.session = columns["session"][first]

    def _chosen_settings(self) -> list[Note]:
        """Return the recommended settings without the split, see `settings`."""
        hidden = {"preprocess.scale"}
        if not self.finds_contact:
            hidden.add("preprocess.contact_sensors")
        settings = [
            note for note in self.choice.notes if note.level == "choice" and note.key not in hidden
        ]
        recordings = len(np.unique(self.recordings.columns["recording"]))
        if recordings == len(self.recordings):
            settings.append(_choice("views", 1, "every recording is one frame"))
        settings.append(
            _choice("preset", "best", "it weighs several classifiers on your training recordings")
        )
        return settings

    @property
    def is_array(self) -> bool:
        """Return whether the sensors are an array, and not channels of possibly several kinds."""
        return is_array(self.recordings.live)

    @property
    def finds_contact(self) -> bool:
        """Return whether frames of contact were told apart from frames of the open hand."""
        return self.is_array or not self.states.all_contact

    def setting(self, key: str) -> str:
        """Return the recommended value of a parameter."""
        return next(str(note.value) for note in self.settings if note.key == key)

    def excess(self, index: np.ndarray) -> np.ndarray:
        """Return the counts (n, S) above the baseline of frames (n,), at the sensors that vary."""
        baseline = self.choice.baseline
        open_hand = baseline.mean[baseline.of_frame[index]]
        excess: np.ndarray = self.states.counts[index] - open_hand[:, self.recordings.live]
        return excess

    @cached_property
    def error(self) -> QuickError | None:
        """Return the quick classifier's error; None if fewer than two objects have two groups."""
        return self.quick_error()

    @cached_property
    def session_error(self) -> QuickError | None:
        """Return the quick classifier's error for a new session.

        It is None if fewer than two objects have two sessions, or the published split is taken.
        """
        if self.setting("split.by") == "source":
            return None
        return self.quick_error(group=self.recordings.columns["session"])

    def quick_error(self, of: str = "object", group: np.ndarray | None = None) -> QuickError | None:
        """Return the error of recognising objects, or sessions, from the frames in contact.

        One member of `sensors` answers whole recordings. Each fold holds out a fifth of the groups.

        Args:
            of: the column whose values are recognised.
            group: (T,) the group of each frame; None takes the groups of the recommended split.

        Returns:
            The error; None if recordings of fewer than two objects can be held out.
        """
        if group is None:
            group = self._group
        columns = self.recordings.columns
        contact = np.flatnonzero(self.in_contact)
        keys = pd.DataFrame(
            {"label": columns[of], "group": group, "recording": columns["recording"]}
        ).iloc[contact]
        parts = keys.groupby(list(keys)).indices
        if not parts:
            return None
        labels, groups, _ = np.array(list(parts), dtype=np.int64).T
        frames = [contact[rows] for rows in parts.values()]
        answers = self._out_of_fold_answers(frames, labels, groups)
        return _error_of(answers, labels, groups, len(contact))

    def _out_of_fold_answers(
        self, frames: list[np.ndarray], labels: np.ndarray, groups: np.ndarray
    ) -> np.ndarray:
        """Return the quick member's answer (P,) to each part; -1 if no fold holds the part out.

        Args:
            frames: frames in contact of each of the P parts.
            labels: (P,) the object or session of each part.
            groups: (P,) the group of each part, which is held out as a whole.
        """
        contact = np.flatnonzero(self.in_contact)
        sample = self.excess(evenly(contact, SAMPLE))
        noise = float(np.median(self.states.noise))
        live = self.recordings.live
        representation = Representation.of(live, sample, contact_unit(sample, noise))
        member = PooledKernelMember(representation, int(labels.max()) + 1)
        parts = list[np.ndarray]()
        for index in frames:
            readings = representation.scaled(self.excess(every_few(index)))
            parts.append(member.recording_points(readings[None]))
        points = np.concatenate(parts)
        answers = np.full(len(labels), -1)
        for held_out in complete_folds(groups, labels, QUICK_FOLDS):
            estimator = member.estimator()
            fitted = estimator.fit(points[~held_out], labels[~held_out], SPLIT_SEED)
            best = fitted.predict_proba(points[held_out]).argmax(axis=1)
            answers[held_out] = fitted.classes[best]
        return answers

    @cached_property
    def counts(self) -> dict[str, np.ndarray]:
        """Return the number of each recording's frames (R,) by kind; `recordings` has ones.

        The kinds are `frames`, `in contact` and `open hand`. If the source flags the frames in
        which an object is held, there is also `flagged`.
        """
        columns = self.recordings.columns
        kinds = {
            "frames": np.ones_like(self.states.open),
            "in contact": self.states.contact,
            "open hand": self.states.open,
        }
        flags = [name for name in ("grasp_valid", "valid") if name in columns]
        if flags:
            kinds["flagged"] = columns[flags[0]]
        table = pd.DataFrame(kinds).groupby(columns["recording"]).sum()
        counts = {"recordings": np.ones(len(table), dtype=np.int64)}
        for name in table:
            counts[name] = table[name].to_numpy()
        return counts


def _error_of(
    answers: np.ndarray, labels: np.ndarray, groups: np.ndarray, frames: int
) -> QuickError | None:
    """Return the error of answers, in which all groups count alike.

    It is None if fewer than two objects were answered.

    Args:
        answers: (P,) the answer to each part; -1 if no fold held it out.
        labels: (P,) the object or session of each part.
        groups: (P,) the group of each part.
        frames: number of frames in all parts.
    """
    answered = answers >= 0
    objects = np.unique(labels[answered])
    if len(objects) < 2:
        return None
    wrong = pd.Series(answers != labels)[answered].groupby(groups[answered]).mean().to_numpy()
    rng = stream(SPLIT_SEED, "quick error")
    interval = proportion_interval(wrong, np.arange(len(wrong)), rng)
    low, high = interval or (0.0, 1.0)
    chance = 1 - np.bincount(labels[answered]).max() / answered.sum()
    return QuickError(
        error=float(wrong.mean()),
        low=low,
        high=high,
        chance=float(chance),
        groups=len(wrong),
        frames=frames,
        objects_left_out=len(np.unique(labels)) - len(objects),
    )


def inspect_source(
    path: str | Path,
    form: Form = AUTO,
    preprocess: PreprocessSection = ALL_AUTO,
    *,
    catalogue: Path | None = None,
) -> Overview:
    """Inspect a source in any form that `ingest` reads, see `readers.discovery.discover`.

    Two levels of folders can be in two orders. They are read in the other order if the readings
    show which session a recording is of, but not which object.

    Args:
        path: of the source.
        form: the form in which the source is read.
        preprocess: see `Overview`.
        catalogue: file to which the catalogue of the recordings is written.

    Returns:
        The overview of the recordings.

    Raises:
        UserError: the source has mistakes; the message lists them.
        FileNotFoundError: there is nothing at that path.
    """
    with recordings_of(path, form, catalogue=catalogue) as recordings:
        overview = Overview(recordings, form, preprocess)
    layout = next((note for note in overview.remarks if note.key == "data.layout"), None)
    if not layout:
        return overview
    objects_are_told = _beats_chance(overview.error)
    sessions_are_told = _beats_chance(overview.quick_error("session"))
    if objects_are_told and not sessions_are_told:
        overview.remarks[overview.remarks.index(layout)] = replace(layout, level="info")
    elif sessions_are_told and not objects_are_told:
        other_form = replace(form, layout=other_order(str(layout.value)))
        overview = inspect_source(path, other_form, preprocess, catalogue=catalogue)
        remedy = setting(f"data.layout={layout.value}")
        text = (
            f"folders are taken in the order {overview.form.layout}: readings tell the outer "
            f"folders apart, and not the inner folders. If that is wrong, {remedy}"
        )
        overview.remarks.append(replace(layout, text=text, value=overview.form.layout))
    return overview


def _beats_chance(error: QuickError | None) -> bool:
    return error is not None and error.beats_chance


def _groups(recordings: Recordings) -> dict[str, np.ndarray]:
    """Return `Overview.groups`; the groups of `source` are its training set and its test set."""
    of_object = ~recordings.empty_hand
    columns = {name: values[of_object] for name, values in recordings.columns.items()}
    groups = dict[str, np.ndarray]()
    for by in ("source", "recording", "grasp"):
        with suppress(UserError):  # no such column
            group = split_groups(columns, by)
            if by == "source":
                group = published_test(columns["split"])
            numbers = pd.Series(group).groupby(columns["object"]).nunique()
            every_object = range(len(recordings.objects))
            groups[by] = numbers.reindex(every_object, fill_value=0).to_numpy()
    return groups


def grid_notes(shape: tuple[int, int], form: Form) -> list[Note]:
    """Return a note on how to read sensors in one row as a grid, if they can be a grid.

    Args:
        shape: (rows, columns) of a frame.
        form: the form that the user gave. If it sets a shape, there is no note.

    Returns:
        One note, or none.
    """
    rows, sensors = shape
    root = isqrt(sensors)
    is_one_row = rows == 1 and form.shape == "auto"
    is_divisible = any(sensors % count == 0 for count in range(2, root + 1))
    may_be_grid = sensors >= GRID and is_divisible
    if not is_one_row or not may_be_grid:
        return []
    advice = "ROWS COLUMNS"
    if root**2 == sensors:
        advice = f"{root} {root}"
    text = (
        f"{sensors} sensors in one row: if they are a grid, row after row, add `--shape {advice}`"
    )
    return [Note(text, topic="shape")]


def _choice(key: str, value: str | int, reason: str) -> Note:
    return Note(reason, "choice", key.split(".")[0], key, value)


def split_settings(groups: dict[str, np.ndarray]) -> list[Note]:
    """Return the split to recommend: which groups are held out, and in how many folds.

    Recordings are held out. If less than half of the objects have two recordings, grasps are held
    out instead. A published split is taken if every object is in both of its sets.

    Args:
        groups: see `Overview.groups`.

    Returns:
        Notes of level `choice`, the first one on `split.by`.
    """
    recorded = groups["recording"] > 0
    if "source" in groups and (groups["source"][recorded] == 2).all():
        reason = "every object is in the published training set and in the test set"
        return [_choice("split.by", "source", reason)]
    unused = ""
    if "source" in groups:
        unused = "; the sets that the source names are not used, as not every object is in both"
    by = "recording"
    twice_recorded = groups["recording"] >= 2
    if "grasp" in groups and twice_recorded.sum() < 0.5 * recorded.sum():
        by = "grasp"
    repeated = groups[by] >= 2
    if repeated.sum() < 2:
        reason = f"no whole recording can be held out: record each object twice{unused}"
        return [_choice("split.by", by, reason)]
    fewest = int(groups[by][repeated].min())
    # if there are enough groups, each fold tests at least FEW of them
    folds = max(2, min(MOST_FOLDS, fewest // 2, int(groups[by].sum()) // FEW))
    why_by = f"tested objects have {fewest} {by}s or more, and whole {by}s are held out{unused}"
    why_folds = f"the {by}s are divided into {folds} parts; split.fold says which part is tested"
    return [_choice("split.by", by, why_by), _choice("split.folds", folds, why_folds)]
