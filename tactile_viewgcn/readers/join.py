"""How the recordings of several files become one source."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from math import prod
from os.path import commonpath
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, listed, once_each, several
from tactile_viewgcn.readers.child import check_unpacked, reading
from tactile_viewgcn.readers.layout import joining, stem_of
from tactile_viewgcn.readers.source import (
    MODEL_TOPIC,
    NUMBERS,
    Block,
    Form,
    Recording,
    Source,
    Values,
    check_shape,
    setting,
    sliced,
    storage_type,
)

COLUMN_BYTES = 32  # of the columns of one frame in a table


def joined(
    path: Path, groups: list[list[Path]], opened: Callable[..., list[Recording]], layout: str
) -> Source:
    """The source of the recordings in groups of files, mostly of one file, of which one group is in memory at a time.

    Args:
        path: the source's path, for its errors.
        opened: opens a group: first for its names and shapes, and again for its frames.
        layout: of the recordings' names.

    Raises:
        UserError: lists the files that cannot be read, or are unlike most others, or have the name
            of an earlier one; or the frames take far more room than their files, see
            `check_unpacked`.
    """
    headers, mistakes = list[_Header](), dict[Path, str]()
    known, doubles = dict[str, Path](), list[tuple[str, Path, Path]]()
    for group in groups:
        try:
            with reading(group[0]):
                read = _headers_of(group, opened)
        except UserError as error:
            mistakes[group[0]] = str(error)
            continue
        for header in read:
            name = header.recording.names["recording"]
            if name in known:
                doubles.append((name, known[name], header.file))
            known.setdefault(name, header.file)
        headers += read
    if doubles:
        mistakes = {doubles[0][2]: _doubled(doubles)} | mistakes
    # those that cannot be read stand first
    if mistakes := {**mistakes, **dict(_unlike(headers)), **mistakes}:
        raise UserError(listed(once_each(mistakes.items()), "; "))
    if not headers:
        raise UserError(f"{path}: no frames; expected at least one recording with frames in it")
    recordings = [header.recording for header in headers]
    dtype = np.result_type(*{header.dtype for header in headers})
    frames, shape = sum(header.frames for header in headers), headers[0].shape
    stored = sum(file.stat().st_size for group in groups for file in group)
    check_unpacked(path, frames * (prod(shape) * dtype.itemsize + COLUMN_BYTES), stored)
    ids = {
        "object": sorted(
            {each.names["object"] for each in recordings},
            key=lambda name: (name != EMPTY_HAND, name),
        ),
        "recording": [each.names["recording"] for each in recordings],
        "session": sorted({each.names["session"] for each in recordings}),
    }
    notes = list(recordings[0].notes)
    if dropped := sum(each.dropped for each in recordings):
        notes.append(
            Note(
                f"{several(dropped, 'frame')} without readings or object are left out",
                topic="frames",
            )
        )
    notes += _left_by_others(recordings)

    takes = [
        (each["object"], each.get("take", stem_of(each["recording"])))
        for each in (r.names for r in recordings)
    ]
    first = {take: number for number, take in reversed([*enumerate(takes)])}
    if len(first) < len(takes) and "take" not in recordings[0].names:
        one, twin = next(
            (first[take], number) for number, take in enumerate(takes) if first[take] < number
        )
        text = f"{len(takes):,} recordings have {len(first):,} names without hand, axis, device, part or copy, such as "
        text += f"{ids['recording'][one]} and {ids['recording'][twin]}, which are held out together"
        if other := joining(ids["recording"], layout):
            text += f"; to join their sensors, {setting(f'data.layout={other}')}"
        notes.append(Note(text, "warning", "parts"))

    number_of = {
        kind: {name: number for number, name in enumerate(names)} for kind, names in ids.items()
    }

    def columns_of(recording: Recording) -> dict[str, int]:
        """The numbers of a recording's names, by column."""
        columns = {kind: number_of[kind][recording.names[kind]] for kind in ids}
        if len(first) < len(takes):
            columns["take"] = first[takes[columns["recording"]]]
        return columns

    blocks = chain.from_iterable(_blocks_of(group, opened, columns_of) for group in groups)
    channels = (
        recordings[0].channel_names if len(recordings[0].channel_names) == prod(shape) else []
    )
    return Source(path, ids, shape, dtype, frames, blocks, notes, channels)


@dataclass(frozen=True)
class _Header:
    """A recording without its frames.

    Attributes:
        file: the first file that it lies in.
        recording: its names and notes, without values.
        columns: names of the values beside the pressure and the frames' numbers.
        shape: (H, W) of a frame; dtype: in which the table stores it; frames: their number.
    """

    file: Path
    recording: Recording
    columns: list[str]
    shape: tuple[int, int]
    dtype: np.dtype
    frames: int

    @property
    def traits(self) -> dict[str, Any]:
        """What all recordings of a source have in common."""
        return {
            "columns": self.columns,
            "shape": self.shape,
            "channels": self.recording.channel_names,
        }


def _headers_of(group: list[Path], opened: Callable[..., list[Recording]]) -> list[_Header]:
    """The recordings in a group of files; no frame is kept."""
    headers = list[_Header]()
    for recording in opened(group):
        shape, dtype = check_values(recording.values, str(group[0]))
        columns = [name for name in recording.values if name not in ("pressure", "frame")]
        frames = len(recording.values["pressure"])
        headers.append(
            _Header(group[0], replace(recording, values={}), columns, shape, dtype, frames)
        )
    return headers


def _blocks_of(
    group: list[Path],
    opened: Callable[..., list[Recording]],
    columns_of: Callable[[Recording], dict[str, int]],
) -> Iterator[Block]:
    """The frames of a group of files in blocks, which keep no other frame in memory."""
    with reading(group[0]):
        for recording in opened(group):
            count = len(recording.values["pressure"])
            values = recording.values | {
                kind: np.full(count, number) for kind, number in columns_of(recording).items()
            }
            if "time" in values:
                time = values["time"][:].astype(np.float64)
                values["time"] = time - time[:1]
            for block in sliced(values, count):
                yield {name: np.array(column) for name, column in block.items()}


def _doubled(doubles: list[tuple[str, Path, Path]]) -> str:
    """What is wrong with files of recordings that are there twice, with one example, and what to type."""
    name, one, other = doubles[0]
    text = f"{other}: recording {name!r}, as in {one}"
    if len(doubles) > 1:
        text += f", and {several(len(doubles) - 1, 'more recording')} alike"
    if one.suffix == other.suffix:
        return f"{text}; name each by its file without the ending, or in HDF5 by the attribute `recording`"
    folder = Path(commonpath([one.parent, other.parent]))
    kept = f"--include='*/' --include='*{one.suffix}' --exclude='*'"
    remedy = f"rsync -a {kept} {quote(str(folder))}/ {quote(str(folder) + '_' + one.suffix[1:])}/"
    text += f"; are {one.suffix} and {other.suffix} two forms of the same?"
    return f"{text} Copy one form and inspect that folder: {remedy}"


def _left_by_others(recordings: list[Recording]) -> list[Note]:
    """A note on columns that are left out of other recordings than the first, which has its notes already."""
    first = {note.text for note in recordings[0].notes}
    texts = Counter(
        note.text for each in recordings for note in each.notes if note.topic == MODEL_TOPIC
    )
    return [Note(text, topic=MODEL_TOPIC) for text in texts if text not in first]


def side_by_side(recordings: Mapping[Path, list[Recording]], form: Form) -> list[Recording]:
    """The recordings of one file; or of several one, whose sensors are those of all, joined along the last axis.

    Times and flags are the first file's. Channels, but those that the form leaves out, are named by
    where a file's path differs; of a model's sensors they are in its order.
    """
    first, *others = recordings
    if not others:
        return recordings[first]
    parts = [part for parts in recordings.values() for part in parts]
    (frames, rows, _), pressure, channels = (
        parts[0].values["pressure"].shape,
        list[np.ndarray](),
        list[str](),
    )
    for file, part in zip(recordings, parts, strict=True):
        counts = part.values["pressure"]
        if counts.shape[:2] != (frames, rows):
            what = f"frames and rows {counts.shape[:2]}; expected {(frames, rows)} as in {first}, to be joined with it"
            raise UserError(f"{file}: {what}; to join none, {setting('data.layout=auto')}")
        pressure.append(counts[()])
        channels += [
            f"{part.names['part']}_{name}"
            for name in part.channel_names or range(1, counts.shape[2] + 1)
        ]
    names = channels if rows == 1 else []
    kept = (
        [at for at, name in enumerate(names) if name not in form.left_out] if names else slice(None)
    )
    if names and set(form.sensors) <= set(names) and len(set(names)) == len(names) and form.sensors:
        kept = [names.index(name) for name in form.sensors]
    values = parts[0].values | {"pressure": np.concatenate(pressure, axis=-1)[..., kept]}
    left = [
        *(name for part in parts for name in part.left_out),
        *{*names}.intersection(form.left_out),
    ]
    return [
        replace(
            parts[0], values=values, channel_names=np.array(names)[kept].tolist(), left_out=left
        )
    ]


def _unlike(headers: list[_Header]) -> Iterator[tuple[Path, str]]:
    """Files whose recordings are unlike most, and what is wrong in each; last the channels, which often explain it."""
    traits = [(header.file, header.traits) for header in headers]
    for what in traits[0][1] if traits else ():
        texts = [str(each[what]) for _, each in traits]
        # each once
        of_files = dict.fromkeys(
            (file, text) for (file, _), text in zip(traits, texts, strict=True)
        )
        usual = Counter(text for _, text in of_files).most_common(1)[0][0]
        example, expected = traits[texts.index(usual)]
        for (file, each), text in zip(traits, texts, strict=True):
            if text != usual:
                names = (
                    {*each[what]} ^ {*expected[what]}
                    if what == "channels" and each[what] and expected[what]
                    else {}
                )
                left = ", ".join(f"leave_out:{name}" for name in sorted(names))
                remedy = f"; {setting(f'data.columns=[{left}]')}" if left else ""
                yield file, f"{file}: {what} {text}; expected {usual} as in {example}{remedy}"


def check_values(values: Values, where: str) -> tuple[tuple[int, int], np.dtype]:
    """Shape (H, W) of pressure (T, H, W), and the type in which the table stores it; columns have to be (T,)."""
    shape, frames = check_shape(values["pressure"].shape, where), values["pressure"].shape[:1]
    for name, column in values.items():
        if name != "pressure" and (column.shape != frames or column.dtype.kind not in NUMBERS):
            what = f"shape {column.shape} and type {column.dtype}"
            raise UserError(
                f"{where}: {name} has {what}; expected {frames}, a number for each frame"
            )
    return shape, storage_type(values["pressure"].dtype, where)
