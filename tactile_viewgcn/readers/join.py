"""Join the sensors of several files, and find recordings that differ from the others."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from tactile_viewgcn.messages import UserError, common_folder, several
from tactile_viewgcn.readers.naming import Named
from tactile_viewgcn.readers.source import Form, Recording, columns_setting, setting


def side_by_side(
    files: Sequence[Path], parts: Sequence[str], recordings: Sequence[Recording], form: Form
) -> Recording:
    """Return one recording with the sensors of several, joined along the last axis.

    Times and flags come from the first recording. The name of each channel begins with its part.
    Channels that the form leaves out are dropped. If the form names a model's sensors, the channels
    are in the model's order.

    Args:
        files: the file of each recording.
        parts: the part of the sensors in each recording, such as left and right.
        recordings: the recordings, with pressure (T, H, W) of the same T and H.
        form: the form in which they are read.

    Raises:
        UserError: the recordings differ in their number of frames or rows.
    """
    first = recordings[0]
    frames, rows, _ = first.values["pressure"].shape
    pressure = list[np.ndarray]()
    channels = list[str]()
    left_out = list[str]()
    for file, part, recording in zip(files, parts, recordings, strict=True):
        counts = recording.values["pressure"]
        if counts.shape[:2] != (frames, rows):
            what = f"(frames, rows) are {counts.shape[:2]}"
            expected = f"expected {(frames, rows)} as in {files[0]}, to be joined with it"
            remedy = setting("data.layout=auto")
            raise UserError(f"{file}: {what}; {expected}; to join no files, {remedy}")
        pressure.append(counts[()])
        names = recording.channel_names
        if not names:
            names = [str(number) for number in range(1, counts.shape[2] + 1)]
        channels += [f"{part}_{name}" for name in names]
        left_out += recording.left_out
    joined = np.concatenate(pressure, axis=-1)
    if rows == 1:
        columns = _chosen_channels(channels, form)
        joined = joined[..., columns]
        left_out += set(channels).intersection(form.left_out)
        channels = [channels[column] for column in columns]
    else:
        channels = []
    return replace(
        first,
        values=first.values | {"pressure": joined},
        channel_names=channels,
        left_out=left_out,
    )


def _chosen_channels(channels: list[str], form: Form) -> list[int]:
    """Return the indices of the channels that are kept.

    If the channels hold all sensors of a model, they are these sensors in the model's order.
    Otherwise they are all channels that the form does not leave out.
    """
    are_unlike = len(set(channels)) == len(channels)
    if form.sensors and are_unlike and set(form.sensors) <= set(channels):
        return [channels.index(name) for name in form.sensors]
    return [index for index, name in enumerate(channels) if name not in form.left_out]


def doubled(recordings: Sequence[Named]) -> dict[Path, str]:
    """Return the file of the first recording that occurs twice, with a text for the user."""
    known = dict[str, Path]()
    doubles = list[tuple[str, Path, Path]]()
    for recording in recordings:
        name = recording.names["recording"]
        file = recording.found.file
        if name in known:
            doubles.append((name, known[name], file))
        known.setdefault(name, file)
    if not doubles:
        return {}
    name, earlier, file = doubles[0]
    text = f"{file}: it holds recording {name!r}, as {earlier} does"
    if len(doubles) > 1:
        text += f", and {several(len(doubles) - 1, 'more recording')} likewise"
    if earlier.suffix == file.suffix:
        remedy = "give the files different names, or in HDF5 different attributes `recording`"
        return {file: f"{text}; {remedy}"}
    folder = common_folder([earlier, file])
    copied = f"--include='*/' --include='*{earlier.suffix}' --exclude='*'"
    target = f"{folder}_{earlier.suffix[1:]}"
    remedy = f"rsync -a {copied} {quote(str(folder))}/ {quote(target)}/"
    text += f"; are {earlier.suffix} and {file.suffix} two forms of the same recordings?"
    return {file: f"{text} Copy one form, and inspect the copy: {remedy}"}


def unlike(recordings: Sequence[Named]) -> dict[Path, str]:
    """Return the files whose recordings differ from most others, with a text for each.

    If a recording differs in several traits, its text names the last one. Channels come last, since
    they often explain the other differences.
    """
    mistakes = dict[Path, str]()
    traits = [_traits(recording) for recording in recordings]
    files = [recording.found.file for recording in recordings]
    for what in ("columns", "shape", "channels"):
        texts = [str(of_recording[what]) for of_recording in traits]
        of_files = dict.fromkeys(zip(files, texts, strict=True))  # each pair once
        counts = Counter(text for _, text in of_files)
        if len(counts) < 2:
            continue
        usual = counts.most_common(1)[0][0]
        example = texts.index(usual)
        for file, text, of_recording in zip(files, texts, traits, strict=True):
            if text == usual:
                continue
            remedy = ". Correct the file, or move it elsewhere"
            if what == "channels":
                left_out = _without_others(of_recording[what], traits[example][what])
                remedy = left_out or remedy
            mistakes[file] = (
                f"{file}: {what} {text}; expected {usual} as in {files[example]}{remedy}"
            )
    return mistakes


def _traits(recording: Named) -> dict[str, Any]:
    """Return the traits that all recordings of a source must share."""
    found = recording.found
    columns = [name for name in found.recording.values if name not in ("frame", "split")]
    if recording.has_split:
        columns.append("split")
    return {
        "columns": columns,
        "shape": found.shape,
        "channels": found.recording.channel_names,
    }


def _without_others(channels: list[str], usual: list[str]) -> str:
    """Return the remedy that leaves out the channels that only some recordings have."""
    if not channels or not usual:
        return ""
    others = sorted(set(channels) ^ set(usual))
    if not others:
        return ""
    left_out = [f"leave_out:{name}" for name in others]
    return f"; {columns_setting(*left_out)}"
