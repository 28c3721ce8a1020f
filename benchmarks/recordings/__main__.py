"""Errors of the classifier on sets of labelled recordings, beside those of plain methods on the same folds.

A set is a folder of OBJECT/RECORDING.npy, (T, C) or (T, H, W). Its groups.csv, if any, has columns
file and group. With `--groups sessions` it is any source that the package reads, and its sessions,
such as persons, are the groups.
"""

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import click
import numpy as np
import pandas as pd
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import StratifiedGroupKFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from benchmarks.command import markdown
from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.files import write_file
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.tables.recordings import frames_by_recording, recordings_of

SEED, ERROR, SECONDS = 0, "{}, error, %", "{}, s"
SIMPLE = {  # on statistics of a recording
    "trees": lambda: ExtraTreesClassifier(300, random_state=SEED),
    "svc": lambda: make_pipeline(StandardScaler(), SVC(C=10)),
    "logistic": lambda: make_pipeline(StandardScaler(), LogisticRegression(max_iter=1000)),
}
OURS, MINIROCKET = "ours", "minirocket"
METHODS = [OURS, *SIMPLE, MINIROCKET]
WITH_AEON = METHODS if find_spec("aeon") else METHODS[:-1]  # that can run here
LEAST_LENGTH = 9  # frames that a kernel of MiniRocket has
COLUMNS = ["set", "channels", "recordings", "classes", "groups"]
for _method in METHODS:
    COLUMNS += [ERROR.format(_method), SECONDS.format(_method)]


class LabelledSet(NamedTuple):
    """Labelled recordings.

    Attributes:
        recordings: arrays (T, H, W).
        labels: (n,) object of each.
        groups: (n,) number of the group that each is held out with.
    """

    recordings: list[np.ndarray]
    labels: np.ndarray
    groups: np.ndarray


@click.command()
@click.argument(
    "folders",
    nargs=-1,
    required=True,
    type=click.Path(exists=True, file_okay=False, path_type=Path),
)
@click.option("--folds", default=4, show_default=True, help="Fewer where a set has fewer groups.")
@click.option(
    "--groups",
    type=click.Choice(["file", "sessions", "none"]),
    default="file",
    show_default=True,
    help="What is held out together: by groups.csv, else each recording; sessions, such as persons; each recording.",
)
@click.option(
    "--layout",
    default="auto",
    show_default=True,
    help="With --groups sessions: data.layout of the sets.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="CSV with a row of each set; what it has of others stays.",
)
@click.option("--only", default=",".join(WITH_AEON), show_default=True, help="Methods to run.")
def main(
    folders: tuple[Path, ...], folds: int, groups: str, layout: str, out: Path | None, only: str
) -> None:
    """Compare methods on the sets in FOLDERS. Regret: error of ours above the least of trees, svc and logistic."""
    names = only.split(",")
    wrong = sorted(set(names) - set(METHODS))
    if wrong:
        raise click.ClickException(
            f"--only has {', '.join(wrong)}; expected some of {', '.join(METHODS)}"
        )
    if MINIROCKET in names and MINIROCKET not in WITH_AEON:
        raise click.ClickException(f"--only has {MINIROCKET}, which needs aeon: `pip install aeon`")
    rows = {}
    if out and out.exists():
        rows = {row["set"]: row for row in pd.read_csv(out).to_dict("records")}
    for folder in folders:
        try:
            labelled = (
                read_sessions(folder, layout)
                if groups == "sessions"
                else read_folder(folder, groups == "file")
            )
        except UserError as error:
            raise click.ClickException(str(error)) from None
        rows[folder.name] = (
            rows.get(folder.name, {}) | {"set": folder.name} | measured(labelled, folds, names)
        )
        if out:
            write_file(
                out,
                pd.DataFrame(rows.values(), columns=COLUMNS).to_csv(
                    index=False, float_format="%.2f"
                ),
            )
    table = pd.DataFrame(
        [rows[folder.name] for folder in folders], [folder.name for folder in folders], COLUMNS
    )
    click.echo(markdown(table.astype(object).where(table.notna(), "-").to_dict("records")))
    regret = (
        table[ERROR.format(OURS)] - table[[ERROR.format(name) for name in SIMPLE]].min(axis=1)
    ).dropna()
    if len(regret):
        click.echo(
            f"\nRegret: {regret.mean():.1f} points in the mean, {regret.max():.1f} at most, on {regret.idxmax()}."
        )


def read_folder(folder: Path, by_file: bool) -> LabelledSet:
    """Read OBJECT/RECORDING.npy; the groups are those of groups.csv, if `by_file` and if there is one."""
    paths = sorted(folder.glob("*/*.npy"))
    recordings = []
    for path in paths:
        array = np.load(path)
        recordings.append(array if array.ndim == 3 else array[:, None])
    labels = np.array([path.parent.name for path in paths])
    file = folder / "groups.csv"
    if not (by_file and file.exists()):
        return LabelledSet(recordings, labels, np.arange(len(paths)))
    group = pd.read_csv(file, index_col="file", dtype=str)["group"]
    names = [path.relative_to(folder).as_posix() for path in paths]
    return LabelledSet(recordings, labels, group[names].factorize()[0])


def read_sessions(folder: Path, layout: str) -> LabelledSet:
    """Read a source of the package, whose sessions are the groups.

    Raises:
        UserError: it is no source, or has one session only.
    """
    recordings, labels, groups = [], [], []
    with recordings_of(str(folder), Form(layout=layout)) as table:
        for index in frames_by_recording(table):
            recordings.append(np.array(table.counts[index]))
            labels.append(table.objects[table.columns["object"][index[0]]])
            groups.append(table.columns["session"][index[0]])
    if len(set(groups)) < 2:
        raise UserError(
            f"{folder}: one session; expected two or more, or --layout such as SESSION/OBJECT/FILE"
        )
    return LabelledSet(recordings, np.array(labels), np.array(groups))


def measured(labelled: LabelledSet, folds: int, names: list[str]) -> dict:
    """Row of a set: errors in %, and seconds to learn and answer, the mean over folds; none of a method that fails."""
    recordings, labels, groups = labelled
    folds = min(folds, len(set(groups)))
    parts = StratifiedGroupKFold(folds, shuffle=True, random_state=SEED)
    row = {
        "channels": recordings[0][0].size,
        "recordings": len(recordings),
        "classes": len(set(labels)),
        "groups": len(set(groups)),
    }
    for name in names:
        wrong, begin = 0.0, perf_counter()
        try:
            for learnt, asked in parts.split(labels, labels, groups):
                known = [recordings[number] for number in learnt]
                new = [recordings[number] for number in asked]
                wrong += sum(
                    answers(name, known, labels[learnt], groups[learnt], new) != labels[asked]
                )
        except Exception as error:
            click.echo(f"{name}: {type(error).__name__}: {error}", err=True)
            wrong = begin = np.nan
        row[ERROR.format(name)] = 100 * wrong / len(recordings)
        row[SECONDS.format(name)] = (perf_counter() - begin) / folds
    return row


def answers(
    name: str, learnt: list, labels: np.ndarray, groups: np.ndarray, asked: list
) -> np.ndarray:
    """Labels that a method gives to recordings."""
    if name == OURS:
        return TactileClassifier().fit(learnt, labels, groups).predict(asked)
    if name == MINIROCKET:
        return minirocket(learnt, labels, asked)
    return SIMPLE[name]().fit(statistics(learnt), labels).predict(statistics(asked))


def minirocket(learnt: list, labels: np.ndarray, asked: list) -> np.ndarray:
    """Labels by MiniRocket of aeon, which needs one length: all are resampled to the median of the learnt ones."""
    from aeon.classification.convolution_based import MiniRocketClassifier
    from aeon.transformations.collection.unequal_length import Resizer

    def series(recordings: list) -> list[np.ndarray]:
        """Series (C, T) of recordings (T, H, W)."""
        return [
            recording.reshape(len(recording), -1).T.astype(np.float64) for recording in recordings
        ]

    length = int(np.median([len(recording) for recording in learnt]))
    resize: Callable = Resizer(max(length, LEAST_LENGTH)).fit_transform
    classifier = MiniRocketClassifier(random_state=SEED).fit(resize(series(learnt)), labels)
    return classifier.predict(resize(series(asked)))


def statistics(recordings: list) -> np.ndarray:
    """Mean, standard deviation, minimum, maximum and median (n, 5C) of each channel over all frames."""
    kinds = (np.mean, np.std, np.min, np.max, np.median)
    return np.array(
        [np.concatenate([kind(x, axis=0).ravel() for kind in kinds]) for x in recordings]
    )


if __name__ == "__main__":
    main()
