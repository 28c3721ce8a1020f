"""Shows an inspection as text of 80 columns and as a page.

Both have the same facts, tables, checks, warnings, commands and settings. The page also has
pictures.
"""

import textwrap
from collections.abc import Iterable

import numpy as np

from tactile_viewgcn.files import way_to_the_clone
from tactile_viewgcn.messages import NEW_SESSION
from tactile_viewgcn.pages import html
from tactile_viewgcn.pages.channels import Curves, channel_curves
from tactile_viewgcn.pages.inspection_commands import command_lines, each_fold_lines
from tactile_viewgcn.pages.inspection_facts import checks, facts, tables, unknown, verdict, warnings
from tactile_viewgcn.pages.source_inspection import SAMPLE, Overview
from tactile_viewgcn.params import VIRTUAL
from tactile_viewgcn.tables.counts import evenly

WIDTH = 80
NAME_LETTERS = 24  # letters of an object's or a session's name
PICTURE_TOP = 99.5  # percentile of all mean frames that has the brightest colour


def inspection_lines(overview: Overview) -> list[str]:
    """Return the lines of an inspection: its results, the settings with reasons, and commands.

    Args:
        overview: the inspected recordings.
    """
    warned = warnings(overview)
    lines = [str(overview.recordings.path)]
    lines += _wrapped(f"{figure} {text}" for figure, text in facts(overview))
    lines += _wrapped(note.text for note in overview.remarks if note.level == "info")
    lines += _table_lines(overview)
    judged = verdict(overview, warned)
    lines.append("Can they be used?")
    lines += _wrapped([" ".join([judged.answer, *judged.reasons])])
    lines += _wrapped(note.text for note in warned)
    lines.append("What was checked")
    lines += _wrapped(f"{check.what}: {check.outcome}" for check in checks(overview, warned))
    lines.append("What the files cannot tell")
    lines += _wrapped(unknown(overview))
    return lines + _usage_lines(overview)


def _table_lines(overview: Overview) -> list[str]:
    """Return the tables as lines, with names cut to 24 letters."""
    lines = list[str]()
    for title, table in tables(overview).items():
        rows = table.rename(index=_shortened).to_string()
        lines.append(title)
        lines += textwrap.indent(rows, "  ").splitlines()
    return lines


def _shortened(name: str) -> str:
    if len(name) <= NAME_LETTERS:
        return name
    return f"{name[: NAME_LETTERS - 1]}…"


def _usage_lines(overview: Overview) -> list[str]:
    """Return the settings and commands to use, or nothing if no command can work."""
    command = command_lines(overview)
    if not command:
        return []
    lines = ["To use", *_wrapped(map(str, overview.settings))]
    sentence, change_folder = way_to_the_clone()
    if sentence:
        lines += _wrapped([sentence])
    lines.append("")
    if change_folder:
        lines.append(change_folder)
    lines += command
    of_sessions = command_lines(overview, new_sessions=True)
    if of_sessions:
        lines += ["", f"To test it on {NEW_SESSION}", *of_sessions]
    each_fold = each_fold_lines(overview)
    if each_fold:
        lines += ["", "To test every part once, with a row for each part", *each_fold]
    return lines


def _wrapped(texts: Iterable[str]) -> list[str]:
    """Return the texts as lines of 80 columns; the later lines of a text are indented more."""
    wrapper = textwrap.TextWrapper(WIDTH, initial_indent="  ", subsequent_indent="    ")
    lines = list[str]()
    for text in texts:
        lines += wrapper.wrap(text)
    return lines


def inspection_page(overview: Overview) -> str:
    """Return the page of an inspection as HTML.

    Args:
        overview: the inspected recordings.
    """
    path = overview.recordings.path
    warned = warnings(overview)
    sentence, change_folder = way_to_the_clone()
    mean_frames = dict[str, str]()
    curves = list[Curves]()
    if overview.is_array:
        mean_frames = _mean_frames(overview)
    else:
        curves = channel_curves(overview.recordings)
    page = html.environment().get_template("inspection.html")
    return page.render(
        title=f"Recordings: {path.name}",
        path=path,
        simulated=str(path) == VIRTUAL,
        verdict=verdict(overview, warned),
        facts=facts(overview),
        command="\n".join(command_lines(overview)),
        of_sessions="\n".join(command_lines(overview, new_sessions=True)),
        each_fold="\n".join(each_fold_lines(overview)),
        settings=overview.settings,
        warnings=warned,
        remarks=[note for note in overview.remarks if note.level == "info"],
        tables=tables(overview),
        mean_frames=mean_frames,
        curves=curves,
        is_array=overview.is_array,
        checks=checks(overview, warned),
        unknown=unknown(overview),
        elsewhere=sentence,
        change_folder=change_folder,
    )


def _mean_frames(overview: Overview) -> dict[str, str]:
    """Return a picture of the mean frame in contact of each object, all with the same colours.

    Sensors that do not vary are grey. Objects without contact have no picture.
    """
    recordings = overview.recordings
    object_of_frame = recordings.columns["object"]
    means = dict[str, np.ndarray]()
    for label in np.unique(object_of_frame[overview.in_contact]):
        in_contact = np.flatnonzero(overview.in_contact & (object_of_frame == label))
        frame = np.full(recordings.shape, np.nan)
        frame[recordings.live] = overview.excess(evenly(in_contact, SAMPLE)).mean(axis=0)
        means[recordings.objects[label]] = frame
    if not means:
        return {}
    top = float(np.nanpercentile([*means.values()], PICTURE_TOP))
    return {name: html.heat_map(frame, top) for name, frame in means.items()}
