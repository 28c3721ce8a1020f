"""Frames and recordings at their extremes: rest, filter, network input, and what is refused.

Sums are held against `math.fsum`, which rounds once; network input against the transform in float64.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

import h5py
import numpy as np

from studies.stability.case import Finding, Subject, apart, differing, refusal
from studies.stability.logits import SINGLE, single_and_exact, some_sets
from tactile_viewgcn.baseline import QUANTISATION, empty_hand_rest, trimmed
from tactile_viewgcn.clustering import cluster_table
from tactile_viewgcn.filtering import in_contact
from tactile_viewgcn.frames import Frames
from tactile_viewgcn.own_format import read_own
from tactile_viewgcn.preprocessing import prepare
from tactile_viewgcn.recordings import EMPTY_HAND, Recordings, write_recordings
from tactile_viewgcn.viewpoints import viewpoints

ROUNDING = 2.0**-22  # of single precision, twice over
REST = 500


def unusual_frames(subject: Subject) -> Iterator[Finding]:
    """Frames that no hand makes, over the table's own rests: network input and logits."""
    shape, rng = subject.table.counts.shape[1:], np.random.default_rng(0)
    usual = np.rint(subject.table.rest_mean[0]).astype(np.int64)
    touched = usual + rng.integers(0, 200, shape)
    one, rows = usual.copy(), touched.copy()
    one[tuple(side // 2 for side in shape)] += 150
    rows[:: max(2, shape[0] // 4)] = 0
    kinds = {
        "all zero": np.zeros(shape), "saturated at 1,023": np.full(shape, 1023), "constant at 600": np.full(shape, 600),
        "one sensor pressed": one, "dead rows": rows, "negative counts": -touched,
        "the least of 16 bits": np.full(shape, -(2**15)), "the most of 16 bits": np.full(shape, 2**15 - 1),
        "below the baseline": usual - 50,
    }  # fmt: skip
    table = _holding(subject.table, np.stack([touched, *kinds.values()]).astype(np.int16))
    inputs, exact_inputs = table.inputs(np.arange(len(kinds) + 1)), _exact_inputs(table)
    pattern = np.concatenate(
        [np.ones((1, subject.classifier.views), dtype=int), some_sets(2, subject.classifier.views, 7)]
    )
    sets = np.concatenate([pattern * (1 + number) for number in range(len(kinds))])
    both = single_and_exact(subject.classifier, inputs, sets, subject)
    found, exact = (logits.split(len(pattern)) for logits in both)
    for number, name in enumerate(kinds):
        yield Finding(f"network input, {name}", apart(inputs[1 + number], exact_inputs[1 + number]), ROUNDING)
        yield Finding(f"logits, {name}", apart(found[number], exact[number]), SINGLE)


def a_large_offset(subject: Subject) -> Iterator[Finding]:
    """Counts of a billion, and real numbers, whose signal is in their last digits."""
    rng = np.random.default_rng(0)
    for name, offset, kind in (("32-bit counts", 10**9, np.int32), ("real numbers", 1e9 + 1 / 3, np.float64)):
        counts = (offset + rng.integers(-3, 4, (400, 2, 2))).astype(kind)
        mean, noise = trimmed(counts)
        exact, spread = _moments(counts)
        lost = np.abs(mean - exact).max() / np.spacing(float(offset))
        yield Finding(f"mean rest, in last digits of the offset, {name}", float(lost), 1)
        yield Finding(f"rest noise, {name}", apart(noise, spread), ROUNDING)
        pressed = np.concatenate([counts, counts + kind(120)])
        with ingested(subject, {EMPTY_HAND: counts, "mug": pressed}) as recordings:
            rest = empty_hand_rest(recordings)
            table = _holding(subject.table, recordings.frames(np.arange(len(recordings))), rest.mean)
        yield Finding(f"network input, {name}", apart(table.inputs(np.arange(1200)), _exact_inputs(table)), ROUNDING)


def a_million_frames_of_drift(subject: Subject) -> Iterator[Finding]:
    """Rest that creeps up by one count in ten thousand frames, and two sensors at another gain and offset."""
    drift = REST + np.arange(10**6) // 10**4
    counts = np.stack([drift, 2 * drift - 300, 30 * drift, -drift], axis=1).reshape(-1, 2, 2).astype(np.int16)
    mean, noise = trimmed(counts)
    exact, spread = _moments(counts)
    yield Finding("mean rest", apart(mean, exact), ROUNDING)
    yield Finding("rest noise", apart(noise, spread), ROUNDING)


def a_sensor_without_rest_noise(subject: Subject) -> Iterator[Finding]:
    """Sensors, all but one, that read one number while nothing touches them: one count more is noise, two are contact.

    The same counts as whole numbers, and as real ones in a unit of their own, have the same frames in contact.
    """
    quiet, held = np.full((20, 3, 3), 500), np.repeat([0, 1, 2, 3, 40], 4)
    quiet[::3, 2, 2] += 1
    touched = np.broadcast_to(500 + held[:, None, None], (20, 3, 3))
    for name, kind, unit in (
        ("counts", np.int16, 1),
        ("real numbers", np.float32, 0.1),
        ("volts", np.float64, 5 / 1023),
    ):
        with ingested(
            subject, {EMPTY_HAND: (unit * quiet).astype(kind), "mug": (unit * touched).astype(kind)}
        ) as recordings:
            found = empty_hand_rest(recordings)
            contact = in_contact(recordings, found, sensors=8, sigmas=5.0)
            holds = recordings.columns["object"] == recordings.objects.index("mug")
        least = np.full(8, QUANTISATION * unit)
        yield Finding(f"rest noise, {name}", apart(found.noise.ravel()[:8], least), 1e-4)
        yield Finding(f"frames in contact, {name}", differing(contact[holds], held > 5 * QUANTISATION), 0)


def numbers_that_are_none(subject: Subject) -> Iterator[Finding]:
    """Own-format files with a number that no glove reads."""
    for value in (np.nan, np.inf, -np.inf, 1e300):
        counts = np.ones((6, 3, 3))
        counts[4, 1, 1] = value
        yield refusal(
            f"{value} in a file",
            lambda counts=counts: ingested(subject, {"mug": counts}),
            "pressure of frame 4 of recording mug is",
        )


def sensors_that_never_change(subject: Subject) -> Iterator[Finding]:
    """A glove that is not connected."""
    for value in (0, 1023):
        same = np.full((30, 4, 4), value, dtype=np.int16)
        with ingested(subject, {EMPTY_HAND: same, "mug": same, "mug 2": same}) as recordings:
            yield refusal(f"all counts {value}", lambda: _prepared(subject, recordings), "no sensor's count changes")


def too_little_data(subject: Subject) -> Iterator[Finding]:
    """Data that cannot be split."""
    rng = np.random.default_rng(0)
    noise = rng.integers(REST, REST + 200, (12, 4, 4)).astype(np.int16)
    for name, what, said in (
        ("one frame", {"mug": noise[:1]}, "no sensor's count changes"),
        ("one recording", {EMPTY_HAND: noise, "mug": noise}, "fewer than two classes left"),
        ("no empty hand", {"mug": noise, "mug 2": noise}, "no object is named 'empty_hand'"),
        ("no frames", {"mug": noise[:0]}, "no frames; expected at least one recording"),
    ):
        yield refusal(name, lambda what=what: _prepared(subject, ingested(subject, what)), said)


def one_live_sensor(subject: Subject) -> Iterator[Finding]:
    """Of 16 sensors one feels: clusters are stretches of its reading."""
    frames = _grip(12)
    frames[:, 1, 2] += 13 * np.arange(12, dtype=np.int16)
    with ingested(subject, _three_objects(frames)) as recordings:
        table = _prepared(subject, recordings)
    how = replace(subject.params.cluster, method="kmeans", scope="object", restarts=3, assignment="index")
    views = cluster_table(table, viewpoints(4), how, np.random.default_rng(0))
    yield Finding("live sensors more or less than one", abs(int(table.live.sum()) - 1), 0)
    breaks = 0
    for pool in np.unique(views.pool[views.cluster >= 0]):
        own = (views.pool == pool) & (views.cluster >= 0)
        order = np.argsort(table.counts[own][:, 1, 2], kind="stable")
        breaks += int((np.diff(views.cluster[own][order]) != 0).sum()) - (len(np.unique(views.cluster[own])) - 1)
    yield Finding("clusters that are no stretch", breaks, 0)


def time_stamps_that_repeat_or_run_back(subject: Subject) -> Iterator[Finding]:
    """The order in the file is the order of time, whatever the stamps say."""
    frames, tables = _grip(12, spread=40), []
    straight = np.arange(12) / 10
    for seconds in (straight, np.zeros(12), straight[::-1], np.where(straight > 0.5, straight - 5, straight)):
        with ingested(subject, _three_objects(frames), time=seconds) as recordings:
            tables.append(_prepared(subject, recordings))
    for name, table in zip(("all equal", "backwards", "a jump back"), tables[1:], strict=True):
        wrong = [
            differing(getattr(table, one), getattr(tables[0], one)) for one in ("counts", "label", "side", "anchor")
        ]
        yield Finding(f"frames, sides and anchors, {name}", max(wrong), 0)


def ingested(subject: Subject, pressures: dict[str, np.ndarray], **columns: np.ndarray) -> Recordings:
    """The table of own-format recordings of pressures (T, H, W) by name; what follows a blank numbers an object's."""
    folder = subject.folder / f"glove {len(list(subject.folder.iterdir()))}"
    folder.mkdir()
    for name, pressure in pressures.items():
        with h5py.File(folder / f"{name}.h5", "w") as file:
            file["pressure"] = pressure
            file.attrs.update({"object": name.split()[0], "session": "one"})
            for column, values in columns.items():
                file[column] = values
    write_recordings(folder / "table", read_own(folder), "")
    return Recordings(folder / "table")


def _prepared(subject: Subject, recordings: Recordings) -> Frames:
    """The frames of recordings of a small glove, sides being recordings."""
    how = replace(
        subject.params.preprocess, baseline="empty_hand", filter="contact", contact_sensors=1, balance_minimum=1,
        transform="clip", scale=150.0, empty_hand_class=True,
    )  # fmt: skip
    split = replace(subject.params.split, by="recording", folds=2, fold=0, validation=0.0)
    return prepare(recordings, how, split, np.random.default_rng(0))[0]


def _grip(frames: int, spread: int = 0) -> np.ndarray:
    """Counts (T, 4, 4) at rest, with so many counts of noise."""
    rng = np.random.default_rng(0)
    return (REST + (rng.integers(0, spread, (frames, 4, 4)) if spread else np.zeros((frames, 4, 4)))).astype(np.int16)


def _three_objects(frames: np.ndarray) -> dict[str, np.ndarray]:
    """Two recordings each of the empty hand, a mug and a ball that press (T, 4, 4) harder and harder."""
    still, soft, hard = np.full_like(frames, REST), frames, frames + (frames - REST) // 2
    found = {EMPTY_HAND: still, "mug": soft, "ball": hard}
    return found | {f"{name} 2": values for name, values in found.items()}


def _holding(table: Frames, counts: np.ndarray, rest: np.ndarray | None = None) -> Frames:
    """The table with other counts (n, H, W) and its own first rest, or another (1, H, W)."""
    mean = table.rest_mean[:1] if rest is None else rest
    return replace(table, counts=counts, rest=np.zeros(len(counts), dtype=int), rest_mean=mean)


def _exact_inputs(table: Frames) -> np.ndarray:
    """Network input float64 of all frames, by its definition."""
    excess = table.counts.astype(np.float64) - table.rest_mean[table.rest].astype(np.float64)
    return np.clip(excess / table.scale, 0, 1) if table.kind == "clip" else np.log1p(np.maximum(excess, 0))


def _moments(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (H, W) of counts (T, H, W), summed without rounding."""
    columns = [[float(x) for x in column] for column in counts.reshape(len(counts), -1).T]
    means = [math.fsum(column) / len(column) for column in columns]
    pairs = zip(columns, means, strict=True)
    spreads = [math.sqrt(math.fsum((x - mean) ** 2 for x in column) / len(column)) for column, mean in pairs]
    return tuple(np.array(values).reshape(counts.shape[1:]) for values in (means, spreads))


CASES = (
    unusual_frames,
    a_large_offset,
    a_million_frames_of_drift,
    a_sensor_without_rest_noise,
    numbers_that_are_none,
    sensors_that_never_change,
    too_little_data,
    one_live_sensor,
    time_stamps_that_repeat_or_run_back,
)
