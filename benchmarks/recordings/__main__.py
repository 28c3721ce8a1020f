"""Error rates of the classifier and of simple methods, on the same folds of labelled recordings.

A set is a folder of files OBJECT/RECORDING.npy, each (T, C) or (T, H, W). It can have a groups.csv
with the columns file and group. With `--groups sessions` a set is any source that the package
reads, and its sessions, such as persons, are the groups.
"""

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import click
import numpy as np
import pandas as pd
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import StratifiedGroupKFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from benchmarks.command import Row, markdown
from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.files import write_file
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.tables.recordings import frames_by_recording, recordings_of

Recordings = list[np.ndarray]  # each (T, H, W)

SEED = 0
# names of the columns of a method
ERROR = "{}, error, %"
SECONDS = "{}, s"
SIMPLE: dict[str, Callable[[], Any]] = {  # methods on statistics of a recording
    "trees": lambda: ExtraTreesClassifier(300, random_state=SEED),
    "svc": lambda: make_pipeline(StandardScaler(), SVC(C=10)),
    "logistic": lambda: make_pipeline(StandardScaler(), LogisticRegression(max_iter=1000)),
}
OURS = "ours"
MINIROCKET = "minirocket"
METHODS = [OURS, *SIMPLE, MINIROCKET]
WITH_AEON = METHODS if find_spec("aeon") else METHODS[:-1]  # methods that can run here
LEAST_LENGTH = 9  # number of frames that a kernel of MiniRocket needs
COLUMNS = ["set", "channels", "recordings", "classes", "groups"]
for _method in METHODS:
    COLUMNS += [ERROR.format(_method), SECONDS.format(_method)]


class LabelledSet(NamedTuple):
    """Labelled recordings.

    Attributes:
        recordings: n arrays (T, H, W).
        labels: (n,) object of each recording.
        groups: (n,) number of the group with which each recording is held out.
    """

    recordings: Recordings
    labels: np.ndarray
    groups: np.ndarray


@click.command()
@click.argument(
    "folders",
    nargs=-1,
    required=True,
    type=click.Path(exists=True, file_okay=False, path_type=Path),
)
@click.option(
    "--folds",
    default=4,
    show_default=True,
    help="Number of folds. A set with fewer groups has fewer folds.",
)
@click.option(
    "--groups",
    type=click.Choice(["file", "sessions", "none"]),
    default="file",
    show_default=True,
    help="What is held out together. file: the groups of groups.csv, or each recording if there is "
    "no such file; sessions: sessions, such as persons; none: each recording.",
)
@click.option(
    "--layout",
    default="auto",
    show_default=True,
    help="Value of data.layout for the sets, with --groups sessions.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="CSV file with a row for each set. Rows of other sets stay in it.",
)
@click.option(
    "--only",
    default=",".join(WITH_AEON),
    show_default=True,
    help="Methods to run, with commas between them.",
)
def main(
    folders: tuple[Path, ...], folds: int, groups: str, layout: str, out: Path | None, only: str
) -> None:
    """Compare methods on the sets in FOLDERS.

    The regret is the error rate of ours minus the lowest error rate of trees, svc and logistic.
    """
    methods = only.split(",")
    check_methods(methods)
    rows: dict[str, Row] = {}
    if out and out.exists():
        rows = {row["set"]: row for row in pd.read_csv(out).to_dict("records")}
    for folder in folders:
        try:
            if groups == "sessions":
                labelled = read_sessions(folder, layout)
            else:
                labelled = read_folder(folder, by_file=groups == "file")
        except UserError as error:
            raise click.ClickException(str(error)) from None
        row = rows.setdefault(folder.name, {"set": folder.name})
        row |= measured(labelled, folds, methods)
        if out:
            table = pd.DataFrame(rows.values(), columns=COLUMNS)
            write_file(out, table.to_csv(index=False, float_format="%.2f"))
    names = [folder.name for folder in folders]
    table = pd.DataFrame([rows[name] for name in names], names, COLUMNS)
    cells = table.astype(object).where(table.notna(), "-")
    click.echo(markdown(cells.to_dict("records")))
    least = table[[ERROR.format(name) for name in SIMPLE]].min(axis=1)
    regret = (table[ERROR.format(OURS)] - least).dropna()
    if len(regret):
        click.echo(
            f"\nRegret: mean {regret.mean():.1f} points, largest {regret.max():.1f} points "
            f"({regret.idxmax()})."
        )


def check_methods(methods: list[str]) -> None:
    """Raise a ClickException if a method is unknown, or cannot run here."""
    wrong = sorted(set(methods) - set(METHODS))
    if wrong:
        raise click.ClickException(
            f"--only has {', '.join(wrong)}; expected some of {', '.join(METHODS)}"
        )
    if MINIROCKET in methods and MINIROCKET not in WITH_AEON:
        raise click.ClickException(f"--only has {MINIROCKET}, which needs aeon: `pip install aeon`")


def read_folder(folder: Path, *, by_file: bool) -> LabelledSet:
    """Return the recordings OBJECT/RECORDING.npy of a folder.

    Args:
        folder: the set.
        by_file: whether groups.csv has the groups, if there is one. Otherwise each recording is a
            group.
    """
    paths = sorted(folder.glob("*/*.npy"))
    recordings = []
    for path in paths:
        array = np.load(path)
        if array.ndim == 2:
            array = array[:, None]
        recordings.append(array)
    labels = np.array([path.parent.name for path in paths])
    file = folder / "groups.csv"
    if not (by_file and file.exists()):
        return LabelledSet(recordings, labels, np.arange(len(paths)))
    group = pd.read_csv(file, index_col="file", dtype=str)["group"]
    names = [path.relative_to(folder).as_posix() for path in paths]
    return LabelledSet(recordings, labels, group[names].factorize()[0])


def read_sessions(folder: Path, layout: str) -> LabelledSet:
    """Return the recordings of a source of the package, whose sessions are the groups.

    Args:
        folder: the source.
        layout: value of data.layout, see params.yaml.

    Raises:
        UserError: the folder is no source, or has only one session.
    """
    recordings = []
    labels = []
    groups = []
    with recordings_of(str(folder), Form(layout=layout)) as table:
        for index in frames_by_recording(table):
            recordings.append(np.array(table.counts[index]))
            labels.append(table.objects[table.columns["object"][index[0]]])
            groups.append(table.columns["session"][index[0]])
    if len(set(groups)) < 2:
        raise UserError(
            f"{folder}: one session; expected two or more. If folders are the sessions, give "
            "--layout, such as SESSION/OBJECT/FILE"
        )
    return LabelledSet(recordings, np.array(labels), np.array(groups))


def measured(labelled: LabelledSet, folds: int, methods: list[str]) -> Row:
    """Return the row of a set: error rate in %, and seconds to learn and answer, for each method.

    The seconds are the mean over folds. A method that fails has NaN for both.

    Args:
        labelled: the set.
        folds: number of folds; fewer if the set has fewer groups.
        methods: some of `METHODS`.
    """
    recordings, labels, groups = labelled
    folds = min(folds, len(set(groups)))
    splits = StratifiedGroupKFold(folds, shuffle=True, random_state=SEED)
    row: Row = {
        "channels": recordings[0][0].size,
        "recordings": len(recordings),
        "classes": len(set(labels)),
        "groups": len(set(groups)),
    }
    for method in methods:
        wrong = 0.0
        begin = perf_counter()
        try:
            for train, test in splits.split(labels, labels, groups):
                known = LabelledSet([recordings[i] for i in train], labels[train], groups[train])
                predicted = answers(method, known, [recordings[i] for i in test])
                wrong += sum(predicted != labels[test])
        except Exception as error:
            click.echo(f"{method}: {type(error).__name__}: {error}", err=True)
            wrong = np.nan
            begin = np.nan
        row[ERROR.format(method)] = 100 * wrong / len(recordings)
        row[SECONDS.format(method)] = (perf_counter() - begin) / folds
    return row


def answers(method: str, known: LabelledSet, new: Recordings) -> np.ndarray:
    """Return the labels (n,) that a method gives to n new recordings.

    Args:
        method: one of `METHODS`.
        known: the recordings that the method learns from.
        new: the recordings to answer.
    """
    if method == MINIROCKET:
        return minirocket(known, new)
    predicted: np.ndarray
    if method == OURS:
        classifier = TactileClassifier().fit(known.recordings, known.labels, known.groups)
        predicted = classifier.predict(new)
    else:
        estimator = SIMPLE[method]().fit(statistics(known.recordings), known.labels)
        predicted = estimator.predict(statistics(new))
    return predicted


def minirocket(known: LabelledSet, new: Recordings) -> np.ndarray:
    """Return the labels (n,) that MiniRocket of aeon gives to n new recordings.

    MiniRocket needs recordings of one length. So all recordings are resampled to the median length
    of the known ones.

    Args:
        known: the recordings that the method learns from.
        new: the recordings to answer.
    """
    from aeon.classification.convolution_based import MiniRocketClassifier
    from aeon.transformations.collection.unequal_length import Resizer

    length = int(np.median([len(recording) for recording in known.recordings]))
    resizer = Resizer(max(length, LEAST_LENGTH))
    classifier = MiniRocketClassifier(random_state=SEED)
    classifier.fit(resizer.fit_transform(_series(known.recordings)), known.labels)
    predicted: np.ndarray = classifier.predict(resizer.fit_transform(_series(new)))
    return predicted


def _series(recordings: Recordings) -> list[np.ndarray]:
    """Return series (C, T) of recordings (T, H, W)."""
    return [recording.reshape(len(recording), -1).T.astype(np.float64) for recording in recordings]


def statistics(recordings: Recordings) -> np.ndarray:
    """Return statistics (n, 5C) of n recordings, five of each channel over all frames.

    The statistics are mean, standard deviation, minimum, maximum and median.
    """
    kinds = (np.mean, np.std, np.min, np.max, np.median)
    rows = []
    for recording in recordings:
        of_channels = [kind(recording, axis=0).ravel() for kind in kinds]
        rows.append(np.concatenate(of_channels))
    return np.array(rows)


if __name__ == "__main__":
    main()
