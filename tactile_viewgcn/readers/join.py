"""How the recordings of several files become one source."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, listed, once_each, several
from tactile_viewgcn.readers.child import reading
from tactile_viewgcn.readers.layout import joining, stem_of
from tactile_viewgcn.readers.source import (
    NUMBERS,
    Block,
    Recording,
    Source,
    Values,
    check_shape,
    setting,
    sliced,
    storage_type,
)


def joined(path: Path, groups: list[list[Path]], opened: Callable[..., list[Recording]], layout: str) -> Source:
    """The source of the recordings in groups of files, mostly of one file, of which one group is in memory at a time.

    Args:
        path: the source's path, for its errors.
        opened: opens a group: first for its names and shapes, and again for its frames.
        layout: of the recordings' names.

    Raises:
        UserError: lists the files that cannot be read, or are unlike most others, or have the name of an earlier one.
    """
    traits, headers, mistakes = list[tuple[Path, dict[str, Any]]](), list[Recording](), dict[Path, str]()
    dtypes, frames, known = set[np.dtype](), 0, dict[str, Path]()
    for file, *others in groups:
        try:
            with reading(file):
                for recording in opened([file, *others]):
                    shape, dtype = check_values(recording.values, str(file))
                    if (name := recording.names["recording"]) in known:
                        remedy = "name each by its file without the ending, or in HDF5 by the attribute `recording`"
                        raise UserError(f"{file}: recording {name!r}, as in {known[name]}; {remedy}")
                    known[name] = file
                    columns = [name for name in recording.values if name not in ("pressure", "frame")]
                    traits.append((file, {"columns": columns, "shape": shape, "channels": recording.channel_names}))
                    headers.append(replace(recording, values={}))
                    dtypes.add(dtype)
                    frames += len(recording.values["pressure"])
        except UserError as error:
            mistakes[file] = str(error)
    if mistakes := {**mistakes, **dict(_unlike(traits)), **mistakes}:  # those that cannot be read stand first
        raise UserError(listed(once_each(mistakes.items()), "; "))
    ids = {
        "object": sorted({header.names["object"] for header in headers}, key=lambda name: (name != EMPTY_HAND, name)),
        "recording": [header.names["recording"] for header in headers],
        "session": sorted({header.names["session"] for header in headers}),
    }
    notes = list(headers[0].notes)
    if dropped := sum(header.dropped for header in headers):
        notes.append(Note(f"{several(dropped, 'frame')} without readings or object are left out", topic="frames"))

    takes = [(each["object"], each.get("take", stem_of(each["recording"]))) for each in (h.names for h in headers)]
    first = {take: number for number, take in reversed([*enumerate(takes)])}
    if len(first) < len(takes) and "take" not in headers[0].names:
        one, twin = next((first[take], number) for number, take in enumerate(takes) if first[take] < number)
        text = f"{len(takes):,} recordings have {len(first):,} names without hand, axis, device or part, such as "
        text += f"{ids['recording'][one]} and {ids['recording'][twin]}, which are held out together"
        if other := joining(ids["recording"], layout):
            text += f"; to join their sensors, {setting(f'data.layout={other}')}"
        notes.append(Note(text, "warning", "parts"))

    def blocks() -> Iterator[Block]:
        for group in groups:
            with reading(group[0]):
                for recording in opened(group):
                    values, at = recording.values, {kind: ids[kind].index(recording.names[kind]) for kind in ids}
                    if len(first) < len(takes):
                        at["take"] = first[takes[at["recording"]]]
                    count = len(values["pressure"])
                    values |= {kind: np.full(count, number) for kind, number in at.items()}
                    if "time" in values:
                        time = values["time"][:].astype(np.float64)
                        values["time"] = time - time[:1]
                    yield from sliced(values, count)

    channels = headers[0].channel_names if len(headers[0].channel_names) == shape[0] * shape[1] else []
    return Source(path, ids, shape, np.result_type(*dtypes), frames, blocks(), notes, channels)


def side_by_side(recordings: Mapping[Path, list[Recording]], left_out: list[str]) -> list[Recording]:
    """The recordings of one file; or of several one, whose sensors are those of all, joined along the last axis.

    Times and flags are the first file's. Channels, but those in `left_out`, are named by where a file's path differs.
    """
    first, *others = recordings
    if not others:
        return recordings[first]
    parts = [part for parts in recordings.values() for part in parts]
    (frames, rows, _), pressure, channels = parts[0].values["pressure"].shape, list[np.ndarray](), list[str]()
    for file, part in zip(recordings, parts, strict=True):
        counts = part.values["pressure"]
        if counts.shape[:2] != (frames, rows):
            what = f"frames and rows {counts.shape[:2]}; expected {(frames, rows)} as in {first}, to be joined with it"
            raise UserError(f"{file}: {what}; to join none, {setting('data.layout=auto')}")
        pressure.append(counts[()])
        channels += [f"{part.names['part']}_{name}" for name in part.channel_names or range(1, counts.shape[2] + 1)]
    names = channels if rows == 1 else []
    kept = [at for at, name in enumerate(names) if name not in left_out] if names else slice(None)
    values = parts[0].values | {"pressure": np.concatenate(pressure, axis=-1)[..., kept]}
    left = [*(name for part in parts for name in part.left_out), *{*names}.intersection(left_out)]
    return [replace(parts[0], values=values, channel_names=np.array(names)[kept].tolist(), left_out=left)]


def _unlike(traits: list[tuple[Path, dict[str, Any]]]) -> Iterator[tuple[Path, str]]:
    """Files whose recordings are unlike most, and what is wrong in each; last the channels, which often explain it."""
    for what in traits[0][1] if traits else ():
        texts = [str(each[what]) for _, each in traits]
        of_files = dict.fromkeys((file, text) for (file, _), text in zip(traits, texts, strict=True))  # each once
        usual = Counter(text for _, text in of_files).most_common(1)[0][0]
        example, expected = traits[texts.index(usual)]
        for (file, each), text in zip(traits, texts, strict=True):
            if text != usual:
                names = (
                    {*each[what]} ^ {*expected[what]} if what == "channels" and each[what] and expected[what] else {}
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
            raise UserError(f"{where}: {name} has {what}; expected {frames}, a number for each frame")
    return shape, storage_type(values["pressure"].dtype, where)
