"""What an inspection shows: a rehearsal of `preprocess`, recommended settings, and further facts of the recordings."""

from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from math import isqrt
from pathlib import Path

import numpy as np
import pandas as pd

from tactile_viewgcn.frames.auto import choose
from tactile_viewgcn.frames.folds import complete_folds
from tactile_viewgcn.frames.leak import QuickError
from tactile_viewgcn.frames.split import SPLIT_SEED, published_test, split_groups
from tactile_viewgcn.intervals import FEW, proportion_interval
from tactile_viewgcn.messages import Note, UserError, warnings_of
from tactile_viewgcn.params import PreprocessSection
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.readers.layout import other_order
from tactile_viewgcn.readers.source import AUTO, Form, setting
from tactile_viewgcn.sensors.features import every_few, is_array
from tactile_viewgcn.sensors.representation import Representation, contact_unit
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.frames import frame_rates
from tactile_viewgcn.tables.look import held_together, look_at
from tactile_viewgcn.tables.recordings import Recordings, recordings_of
from tactile_viewgcn.tables.remarks import remarks

SAMPLE = 2000  # frames, of all for the variation of a sensor, of an object for its mean
MOST_FOLDS = 5
GRID = 16  # sensors in one row, from which on they may be those of a grid
MEMBER, FOLDS = "pooled_kernel", 5  # of the quick error
ASKED = PreprocessSection()  # nothing: all `auto`


class Overview:
    """R recordings with frames, of O objects, as an inspection shows them; each measurement is made when it is read.

    Args:
        recordings: the table of raw counts; its frames stay mapped after its file is gone.
        form: as which the source was read.
        asked: settings of `preprocess`, kept; `auto` where the inspection chooses as `preprocess`
            does.

    Attributes:
        remarks: notes on the source and its table, see `tables.remarks`, and the warnings of
            `choice`.
        groups: by `split.by`, each object's number of groups (O,), 0 for the empty hand; copies of
            a recording are one.
        choice: what `auto` becomes on all recordings, where `preprocess` looks at the training side
            alone.
        states: of the hand, in all frames.
        in_contact: bool (T,), frames of contact with an object.
        rates: see `frame_rates`.
        settings: recommended values with reasons, of level `choice`: what `auto` becomes, but for
            the scale, which networks alone read, and for the sensors of a contact that is not
            looked for; the preset; and the split.
        label, session: (R,) index of each recording's object and session.
    """

    def __init__(self, recordings: Recordings, form: Form = AUTO, asked: PreprocessSection = ASKED):
        look = look_at(recordings)
        self.remarks = remarks(recordings, look)
        recordings = held_together(recordings, look)
        columns = recordings.columns
        self.recordings, self.form = recordings, form
        self.groups = _groups(recordings)
        split, everything = split_settings(self.groups), np.arange(len(recordings))
        self._group = split_groups(columns, str(split[0].value))
        self.asked, self.choice = asked, choose(recordings, everything, asked, self._group)
        self.states = self.choice.states
        self.in_contact = self.states.contact & ~recordings.empty_hand
        self.rates = frame_rates(columns["time"], columns["recording"])
        self.remarks += [*grid_notes(recordings.shape, form), *warnings_of(self.choice.notes)]
        unseen = {"preprocess.scale"}
        if not self.finds_contact:
            unseen.add("preprocess.contact_sensors")
        settings = [
            note for note in self.choice.notes if note.level == "choice" and note.key not in unseen
        ]
        if len(np.unique(columns["recording"])) == len(recordings):
            settings.append(_choice("views", 1, "every recording is one frame"))
        best = _choice("preset", "best", "it weighs classifiers on your training recordings")
        self.settings = [*settings, best, *split]
        first = np.unique(columns["recording"], return_index=True)[1]
        self.label, self.session = columns["object"][first], columns["session"][first]

    @property
    def is_array(self) -> bool:
        """Whether the sensors are an array, else channels that may be of unlike kind."""
        return is_array(self.recordings.live)

    @property
    def finds_contact(self) -> bool:
        """Whether frames of contact were told from those of the open hand."""
        return self.is_array or not self.states.all_contact

    def setting(self, key: str) -> str:
        """The recommended value of a parameter."""
        return next(str(note.value) for note in self.settings if note.key == key)

    def excess(self, index: np.ndarray) -> np.ndarray:
        """Counts (n, S) above the chosen baseline, of the sensors that vary, for frames (n,)."""
        baseline = self.choice.baseline
        return (
            self.states.counts[index]
            - baseline.mean[baseline.of_frame[index]][:, self.recordings.live]
        )

    @cached_property
    def error(self) -> QuickError | None:
        """Of the quick classifier on contact; None where no two objects have two groups."""
        return self.quick_error()

    @cached_property
    def session_error(self) -> QuickError | None:
        """The same for a new session; None where no two objects have two sessions, or the published split is taken."""
        if self.setting("split.by") == "source":
            return None
        return self.quick_error(group=self.recordings.columns["session"])

    def quick_error(self, of: str = "object", group: np.ndarray | None = None) -> QuickError | None:
        """Error of telling objects apart, or sessions, by whole recordings' frames in contact.

        A member of `sensors` answers them, a fifth of the groups left out at a time. None unless
        recordings of two objects can be left out.

        Args:
            of: the column with what is told apart.
            group: (T,) what is left out; None for the groups of the recommended split.
        """
        columns, live, contact = (
            self.recordings.columns,
            self.recordings.live,
            np.flatnonzero(self.in_contact),
        )
        group = self._group if group is None else group
        keys = pd.DataFrame(
            {"label": columns[of], "group": group, "recording": columns["recording"]}
        ).iloc[contact]
        parts = keys.groupby(list(keys)).indices
        if not parts:
            return None
        labels, groups, _ = np.array(list(parts), dtype=np.int64).T
        sample, noise = self.excess(evenly(contact, SAMPLE)), float(np.median(self.states.noise))
        read = Representation.of(live, sample, contact_unit(sample, noise))
        counts = (self.excess(every_few(contact[at])) for at in parts.values())
        points = np.concatenate(
            [read.of_recordings(MEMBER, read.scaled(each)[None]) for each in counts]
        )
        answers = np.full(len(labels), -1)
        for left in complete_folds(groups, labels, FOLDS):
            fitted = read.estimator(MEMBER).fit(points[~left], labels[~left], SPLIT_SEED)
            answers[left] = fitted.classes[fitted.predict_proba(points[left]).argmax(axis=1)]
        answered = answers >= 0
        if len(np.unique(labels[answered])) < 2:
            return None
        wrong = pd.Series(answers != labels)[answered].groupby(groups[answered]).mean().to_numpy()
        low, high = proportion_interval(
            wrong, np.arange(len(wrong)), stream(SPLIT_SEED, "quick error")
        ) or (0.0, 1.0)
        chance = 1 - np.bincount(labels[answered]).max() / answered.sum()
        objects_left_out = len(np.unique(labels)) - len(np.unique(labels[answered]))
        return QuickError(
            float(wrong.mean()),
            low,
            high,
            float(chance),
            len(wrong),
            len(contact),
            objects_left_out,
        )

    @cached_property
    def counts(self) -> dict[str, np.ndarray]:
        """Number of each recording's frames (R,) by kind; `recordings` are ones.

        The kinds are `frames`, `in contact`, `open hand` and, where the source flags that an object
        is held, `flagged`.
        """
        states, columns = self.states, self.recordings.columns
        kinds = {
            "frames": np.ones_like(states.open),
            "in contact": states.contact,
            "open hand": states.open,
        }
        if flags := [columns[name] for name in ("grasp_valid", "valid") if name in columns]:
            kinds["flagged"] = flags[0]
        counts = pd.DataFrame(kinds).groupby(columns["recording"]).sum()
        return {"recordings": np.ones(len(counts), dtype=np.int64)} | {
            name: counts[name].to_numpy() for name in counts
        }


def inspect_source(
    path: str | Path,
    form: Form = AUTO,
    asked: PreprocessSection = ASKED,
    *,
    catalogue: Path | None = None,
) -> Overview:
    """Inspect a source in any form that `ingest` reads, see `readers.discovery.discover`.

    Folders that may be in two orders are read in the other one if readings tell sessions apart and
    not objects.

    Args:
        path: of the source.
        form: as which files are read.
        asked: settings of `preprocess`, see `Overview`.
        catalogue: file to which the catalogue of the recordings is written.

    Raises:
        UserError: lists the mistakes of the source.
        FileNotFoundError: nothing at that path.
    """
    with recordings_of(path, form, catalogue=catalogue) as recordings:
        overview = Overview(recordings, form, asked)
    note = next((note for note in overview.remarks if note.key == "data.layout"), None)
    if not note:
        return overview
    predicted = [
        bool(each and each.beats_chance)
        for each in (overview.error, overview.quick_error("session"))
    ]
    if predicted == [True, False]:
        overview.remarks[overview.remarks.index(note)] = replace(note, level="info")
    elif predicted == [False, True]:
        form = replace(form, layout=other_order(str(note.value)))
        overview = inspect_source(path, form, asked, catalogue=catalogue)
        text = f"folders are taken in the order {overview.form.layout}: readings tell the outer ones apart, not the "
        text += f"inner ones. If that is wrong, {setting(f'data.layout={note.value}')}"
        overview.remarks.append(replace(note, text=text, value=overview.form.layout))
    return overview


def _groups(recordings: Recordings) -> dict[str, np.ndarray]:
    """See `Overview.groups`; of `source` the groups are its two sides."""
    of_object = ~recordings.empty_hand
    columns = {name: values[of_object] for name, values in recordings.columns.items()}
    groups = dict[str, np.ndarray]()
    for by in ("source", "recording", "grasp"):
        with suppress(UserError):  # no such column
            group = split_groups(columns, by)
            if by == "source":
                group = published_test(columns["split"])
            numbers = pd.Series(group).groupby(columns["object"]).nunique()
            groups[by] = numbers.reindex(range(len(recordings.objects)), fill_value=0).to_numpy()
    return groups


def grid_notes(shape: tuple[int, int], form: Form) -> list[Note]:
    """How sensors in one row are read as a grid, where the user has not said that they are none."""
    side = isqrt(shape[1])
    divisible = any(shape[1] % rows == 0 for rows in range(2, side + 1))
    text = f"{shape[1]} sensors in one row: if they are a grid, row after row, add "
    text += f"`--shape {f'{side} {side}' if side**2 == shape[1] else 'ROWS COLUMNS'}`"
    return (
        [Note(text, topic="shape")]
        if shape[0] == 1 and shape[1] >= GRID and divisible and form.shape == "auto"
        else []
    )


def _choice(key: str, value: str | int, reason: str) -> Note:
    return Note(reason, "choice", key.split(".")[0], key, value)


def split_settings(groups: dict[str, np.ndarray]) -> list[Note]:
    """Hold out recordings, or grasps where less than half of the objects have two recordings."""
    recorded, repeated = groups["recording"] > 0, groups["recording"] >= 2
    if "source" in groups and (groups["source"][recorded] == 2).all():
        return [_choice("split.by", "source", "every object is on both published sides")]
    by = "grasp" if "grasp" in groups and repeated.sum() < 0.5 * recorded.sum() else "recording"
    repeated = groups[by] >= 2
    if repeated.sum() < 2:
        return [
            _choice("split.by", by, "no whole recording can be held out: record each object twice")
        ]
    fewest = int(groups[by][repeated].min())
    # each tests FEW in all, if there are
    folds = max(2, min(MOST_FOLDS, fewest // 2, int(groups[by].sum()) // FEW))
    return [
        _choice(
            "split.by",
            by,
            f"an object has {fewest} {by}s or more, of which whole ones are held out",
        ),
        _choice("split.folds", folds, f"{by}s in {folds} parts; split.fold says which is tested"),
    ]
