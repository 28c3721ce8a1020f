"""Errors of the classifier on sets of labelled recordings, beside those of plain methods on the same folds.

A set is a folder of OBJECT/RECORDING.npy, (T, C) or (T, H, W). Its groups.csv, if any, has columns file and group.
"""

from pathlib import Path
from time import perf_counter

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

SEED, ERROR, SECONDS = 0, "{}, error, %", "{}, s"
SIMPLE = {  # on statistics of a recording
    "trees": lambda: ExtraTreesClassifier(300, random_state=SEED),
    "svc": lambda: make_pipeline(StandardScaler(), SVC(C=10)),
    "logistic": lambda: make_pipeline(StandardScaler(), LogisticRegression(max_iter=1000)),
}
METHODS = ["ours", *SIMPLE]
COLUMNS = ["set", "channels", "recordings", "classes", *(text.format(m) for m in METHODS for text in (ERROR, SECONDS))]


@click.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--folds", default=4, show_default=True, help="Fewer where a set has fewer groups.")
@click.option("--out", type=click.Path(path_type=Path), help="CSV with a row of each set; what it has of others stays.")
@click.option("--only", default=",".join(METHODS), show_default=True, help="Methods to run.")
def main(folders: tuple[Path, ...], folds: int, out: Path | None, only: str) -> None:
    """Compare methods on the sets in FOLDERS. Regret: error of ours above the least of trees, svc and logistic."""
    if wrong := sorted(set(only.split(",")) - set(METHODS)):
        raise click.ClickException(f"--only has {', '.join(wrong)}; expected some of {', '.join(METHODS)}")
    rows = {row["set"]: row for row in pd.read_csv(out).to_dict("records")} if out and out.exists() else {}
    for folder in folders:
        rows[folder.name] = rows.get(folder.name, {}) | measured(folder, folds, only.split(","))
        if out:
            write_file(out, pd.DataFrame(rows.values(), columns=COLUMNS).to_csv(index=False, float_format="%.2f"))
    table = pd.DataFrame([rows[folder.name] for folder in folders], [folder.name for folder in folders], COLUMNS)
    click.echo(markdown(table.astype(object).where(table.notna(), "-").to_dict("records")))
    regret = (table[ERROR.format("ours")] - table[[ERROR.format(name) for name in SIMPLE]].min(axis=1)).dropna()
    if len(regret):
        click.echo(
            f"\nRegret: {regret.mean():.1f} points in the mean, {regret.max():.1f} at most, on {regret.idxmax()}."
        )


def measured(folder: Path, folds: int, names: list[str]) -> dict:
    """Row of a set: errors in %, and seconds to learn and answer, the mean over folds; none of a method that fails."""
    paths = sorted(folder.glob("*/*.npy"))
    labels, groups = np.array([path.parent.name for path in paths]), np.arange(len(paths))
    recordings = [x if x.ndim == 3 else x[:, None] for x in map(np.load, paths)]
    if (file := folder / "groups.csv").exists():
        group = pd.read_csv(file, index_col="file", dtype=str)["group"]
        groups = group[[path.relative_to(folder).as_posix() for path in paths]].factorize()[0]
    parts = StratifiedGroupKFold(folds := min(folds, len(set(groups))), shuffle=True, random_state=SEED)
    row = {"set": folder.name, "channels": recordings[0][0].size, "recordings": len(paths), "classes": len(set(labels))}
    for name in names:
        wrong, begin = 0.0, perf_counter()
        try:
            for learnt, asked in parts.split(labels, labels, groups):
                x, z = ([recordings[i] for i in part] for part in (learnt, asked))
                wrong += sum(answers(name, x, labels[learnt], groups[learnt], z) != labels[asked])
        except Exception as error:
            click.echo(f"{folder}, {name}: {type(error).__name__}: {error}", err=True)
            wrong = begin = np.nan
        row |= {ERROR.format(name): 100 * wrong / len(paths), SECONDS.format(name): (perf_counter() - begin) / folds}
    return row


def answers(name: str, learnt: list, labels: np.ndarray, groups: np.ndarray, asked: list) -> np.ndarray:
    """Labels that a method gives to recordings."""
    if name == "ours":
        return TactileClassifier().fit(learnt, labels, groups).predict(asked)
    return SIMPLE[name]().fit(statistics(learnt), labels).predict(statistics(asked))


def statistics(recordings: list) -> np.ndarray:
    """Mean, standard deviation, minimum, maximum and median (n, 5C) of each channel over all frames."""
    kinds = (np.mean, np.std, np.min, np.max, np.median)
    return np.array([np.concatenate([kind(x, axis=0).ravel() for kind in kinds]) for x in recordings])


if __name__ == "__main__":
    main()
