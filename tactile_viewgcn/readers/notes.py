"""Write the notes on a source that need all of its recordings together."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactile_viewgcn.messages import Note, several
from tactile_viewgcn.readers.discovery import Source, unread_notes
from tactile_viewgcn.readers.formats import ARRAYS, has_ending
from tactile_viewgcn.readers.layout import doubles_notes, joining, names_in
from tactile_viewgcn.readers.lines import LABELS_TOPIC
from tactile_viewgcn.readers.naming import Named, Naming, takes_of
from tactile_viewgcn.readers.recurring import session_notes
from tactile_viewgcn.readers.source import MODEL_TOPIC, Form, setting, side_of

FEW_ROWS = 10  # fewer rows are the rows of a frame, since so few frames are no recording


def source_notes(
    source: Source,
    recordings: Sequence[Named],
    naming: Naming,
    form: Form,
    *,
    unread: Mapping[Path, str],
) -> list[Note]:
    """Return the notes on a source.

    Args:
        source: the source.
        recordings: its recordings with their names, at least one.
        naming: the object that gave the names.
        form: the form in which the files were read.
        unread: the mistake in each file that was not read, "" if only its ending is the reason.
    """
    notes = [note for note in recordings[0].notes if note.topic != LABELS_TOPIC]
    notes += _unused_labels(recordings)
    found = {id(recording.found): recording.found for recording in recordings}
    dropped = sum(in_files.recording.dropped for in_files in found.values())
    if dropped:
        text = f"{several(dropped, 'frame')} without readings or object are left out"
        notes.append(Note(text, topic="frames"))
    notes += _left_by_others(recordings)
    notes += _parts_notes(recordings, naming.layout)
    if source.given is not None:
        if source.left_out:
            text = f"{several(source.left_out, 'line')} of {source.path.name} left out, as it says"
            notes.append(Note(text, topic="files"))
        return notes
    if source.is_raw:
        return notes
    files = naming.files
    notes += unread_notes(source.path, files, unread, naming.object_of)
    if not form.labelled:
        return notes
    places = [source.place_of(file) for file in files]
    if not naming.has_labels:
        notes += stack_notes(recordings, naming.layout, source, form)
    notes += doubles_notes(places, source.path)
    if len({recording.names["session"] for recording in recordings}) == 1:
        objects = [naming.object_of(file) for file in files]
        notes += session_notes(places, objects, naming.layout, has_labels=naming.has_labels)
    return notes


def _unused_labels(recordings: Sequence[Named]) -> list[Note]:
    """Return the first warning of a column of labels that is not used, and in how many files."""
    files = dict[Path, Note]()
    for recording in recordings:
        for note in recording.notes:
            if note.topic == LABELS_TOPIC:
                files.setdefault(recording.found.file, note)
    if not files:
        return []
    file, first = next(iter(files.items()))
    place = file.name
    if len(files) > 1:
        place += f" and {several(len(files) - 1, 'other file')}"
    return [replace(first, text=f"{place}: {first.text}")]


def _left_by_others(recordings: Sequence[Named]) -> list[Note]:
    """Return notes on columns that are left out of any recording but the first.

    The notes of the first recording are listed already.
    """
    first = {note.text for note in recordings[0].notes}
    texts = dict[str, None]()
    for recording in recordings:
        for note in recording.notes:
            if note.topic == MODEL_TOPIC and note.text not in first:
                texts[note.text] = None
    return [Note(text, topic=MODEL_TOPIC) for text in texts]


def _parts_notes(recordings: Sequence[Named], layout: str) -> list[Note]:
    """Return a warning of recordings that are held out together because of their names."""
    takes = takes_of(recordings)
    twins = np.flatnonzero(takes < np.arange(len(takes)))
    if not len(twins) or "take" in recordings[0].names:
        return []
    names = [recording.names["recording"] for recording in recordings]
    twin = int(twins[0])
    text = f"{len(takes):,} recordings have only {len(np.unique(takes)):,} different names "
    text += "without hand, axis, device, part or copy; recordings such as "
    text += f"{names[takes[twin]]} and {names[twin]} are held out together"
    other = joining(names, layout)
    if other:
        text += f"; to join their sensors, {setting(f'data.layout={other}')}"
    return [Note(text, "warning", "parts")]


def stack_notes(recordings: Sequence[Named], layout: str, source: Source, form: Form) -> list[Note]:
    """Return a warning if arrays (n, T, C), read as n frames of T rows, can be n recordings.

    That is so if each object has one array, or one in each published set. It is so too if no array
    has as many frames as rows. Square frames and frames of few rows are taken for grids. There is
    no warning if the form gives the shape.
    """
    axes = dict[Path, tuple[int, ...]]()
    for recording in recordings:
        if has_ending(recording.found.file, ARRAYS):
            axes[recording.found.file] = recording.found.axes
    if form.shape != "auto" or not axes or any(len(sizes) != 3 for sizes in axes.values()):
        return []
    if any(rows < FEW_ROWS or rows == columns for _, rows, columns in axes.values()):
        return []
    arrays_of = Counter[tuple[str | None, int | None]]()
    for file in axes:
        place = source.place_of(file)
        side = side_of(place.rpartition("/")[2])
        arrays_of[names_in(place, layout).get("object"), side] += 1
    is_one_each = max(arrays_of.values()) == 1 and len(arrays_of) > 1
    if not is_one_each and any(count >= rows for count, rows, _ in axes.values()):
        return []
    file, (count, rows, columns) = next(iter(axes.items()))
    text = f"{source.place_of(file)}, an array {(count, rows, columns)}, is read as one recording "
    text += f"of {several(count, 'frame')} of {rows} x {columns}. "
    text += f"If it holds {several(count, 'recording')} of {several(rows, 'frame')}, "
    text += f"{setting(f'data.shape=[1,{columns}]')}; if not, data.shape=[{rows},{columns}]."
    return [Note(text, "warning", "shape")]
