"""The command `tactile-viewgcn`: inspect recordings, print presets, predict, live, report."""

import io
import os
import shlex
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactile_viewgcn.files import readable
from tactile_viewgcn.messages import UserError, program, several, shown
from tactile_viewgcn.params import MAX_SIDE, PreprocessSection, default_params, preset_changes

if TYPE_CHECKING:
    from tactile_viewgcn.evaluation.finished_run import FinishedRun
    from tactile_viewgcn.readers.source import Form

_SET_DATA = click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="data.KEY=VALUE",
    help="How to read the recordings: a value for a key of the section data in params.yaml.",
)
INTERRUPTED = 130  # exit code after Ctrl-C, the same as of commands in a shell
SIDE = click.IntRange(1, MAX_SIDE)  # rows or columns of a frame


@click.group()
@click.version_option(package_name="tactile-viewgcn")
@click.option("--debug", is_flag=True, expose_value=False, help="Show the traceback of an error.")
def cli() -> None:
    """Recognise held objects from tactile frames. To run the pipeline, type `dvc repro`."""


@cli.command()
@click.argument("source", type=click.Path(path_type=Path))
@click.option(
    "--html",
    "page",
    type=click.Path(path_type=Path),
    help="Write a page with pictures to this file.",
)
@click.option(
    "--shape",
    type=(SIDE, SIDE),
    metavar="ROWS COLUMNS",
    help="Shape of a frame in arrays or tables, see data.shape in params.yaml.",
)
@click.option(
    "--catalogue",
    type=click.Path(path_type=Path),
    help="Write a table with a line for each recording to this .csv. You can correct the table and "
    "read it as SOURCE.",
)
@click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="SECTION.KEY=VALUE",
    help="Read the recordings with another value for a key of the section data in params.yaml, or "
    "try a value for a key of the section preprocess.",
)
def inspect(
    source: Path,
    page: Path | None,
    shape: tuple[int, int] | None,
    catalogue: Path | None,
    changes: tuple[str, ...],
) -> None:
    """Describe the recordings SOURCE and recommend parameters for them, with reasons.

    SOURCE is a folder with a file for each recording, one file with all recordings, STAG's
    metadata.mat or STAG's folder, or a catalogue as `--catalogue` writes it.

    A file of recordings is an array (.npy, .npz or .mat), HDF5 (.h5 or .hdf5) or a table (.csv,
    .tsv, .csv.gz or .txt).

    The objects are named by the folders or files, as in OBJECT/1.npy, by a column `object` of the
    table, or by a labels.csv that lists the files. All mistakes in SOURCE are listed.
    """
    from tactile_viewgcn.pages.html import write
    from tactile_viewgcn.pages.inspection import inspection_lines, inspection_page
    from tactile_viewgcn.pages.source_inspection import inspect_source
    from tactile_viewgcn.readers.catalogue import check_is_new

    form, preprocess = _form(changes, "preprocess")
    if shape:
        form = replace(form, shape=shape)
    if catalogue:
        check_is_new(catalogue)
    inspection = inspect_source(source, form, preprocess, catalogue=catalogue)
    _say(*inspection_lines(inspection))
    if catalogue:
        count = several(len(inspection.recordings.recordings), "recording")
        words = ["tactile-viewgcn", "inspect", str(catalogue)]
        if shape:
            words += ["--shape", *map(str, shape)]
        for change in changes:
            words += ["--set", change]
        _say(f"{catalogue}: {count}; correct this file, then read it:", f"  {shlex.join(words)}")
    if page:
        _say(write(page, inspection_page(inspection)))


@cli.command()
@click.argument("name", default="")
def preset(name: str) -> None:
    """Print a preset (best, kernels, network, released, stag) as options of `dvc exp run`."""
    try:
        _say(" ".join(f"-S {change}" for change in preset_changes(name)))
    except UserError:
        # DVC refuses this option; without any option it would run the default
        _say(f"-S no-such-preset={name}")
        raise


@cli.command()
@click.argument("model")
@click.argument("source")
@click.option(
    "--csv", "csv_path", type=click.Path(path_type=Path), help="Write the answers to this file too."
)
@_SET_DATA
def predict(changes: tuple[str, ...], **options: Any) -> None:
    """Recognise with MODEL the objects that are held in the recordings SOURCE.

    MODEL is models/classifier.pt, the id of an MLflow run, runs:/ID, models:/NAME/VERSION or
    models:/NAME@ALIAS. SOURCE is anything that `inspect` reads. Its recordings need no object here.
    """
    from tactile_viewgcn.recognition import prediction

    prediction.predict(echo=_say, form=_form(changes)[0], **options)


@cli.command()
@click.argument("model")
@click.option("--json", "as_json", is_flag=True, help="Print a line of JSON for each change.")
@click.option(
    "--sure",
    type=click.FloatRange(0, 1, min_open=True),
    metavar="P",
    help="Close a grasp as soon as the probability of its object is P or more.",
)
@click.option(
    "--every",
    type=click.IntRange(1),
    metavar="N",
    help="Answer every N frames in contact, however fast they come. Without this option, answers "
    "are skipped while frames wait in the pipe.",
)
@click.option(
    "--longest",
    type=click.IntRange(1),
    metavar="N",
    help="Close a grasp after N frames in contact. The default is 2000.",
)
@click.option(
    "--tare",
    is_flag=True,
    help="Take the first steady frames as the open hand, whatever the open hand read in training. "
    "It has no effect if the training showed no open hand.",
)
def live(model: str, as_json: bool, every: int | None, **options: Any) -> None:
    """Say with MODEL which object the hand holds, while it still holds the object.

    Each frame is a line of numbers on standard input, with a column for each sensor. Commas,
    semicolons, tabs or blanks separate the columns. A line above the numbers can name the columns;
    a column called `time` holds the time. Begin with an open hand. MODEL is as for `predict`.
    """
    with _interrupted():
        code = _live(model, as_json=as_json, every=every, **options)
    if code:
        raise SystemExit(code)


def _live(model: str, *, as_json: bool, every: int | None, **options: Any) -> int:
    """Run the command `live`, and return its exit code."""
    from tactile_viewgcn.live.command import EVERY_FRAME, LiveCommand
    from tactile_viewgcn.live.lines import FrameLines
    from tactile_viewgcn.live.source import LineSource
    from tactile_viewgcn.live.view import view_of
    from tactile_viewgcn.recognition.prediction import first_line, load_model

    remedy = f"expected lines of numbers from a program: PROGRAM | tactile-viewgcn live {model}"
    if sys.stdin is None:
        raise UserError(f"standard input is closed; {remedy}")
    if sys.stdin.isatty():
        raise UserError(f"standard input is a terminal; {remedy}")
    descriptor = sys.stdin.fileno()
    is_file = stat.S_ISREG(os.fstat(descriptor).st_mode)  # the lines of a file can wait
    source = LineSource(lambda size: os.read(descriptor, size))
    click.echo(shown(f"loading {model}"), err=True)  # since it takes seconds
    recogniser = load_model(model)
    set_options = {name: value for name, value in options.items() if value is not None}
    stream = recogniser.stream(every=every or 1, **set_options)
    view = view_of(stream.classes, as_json=as_json)
    view.say(first_line(recogniser))
    if "sure" in set_options and not recogniser.calibrated:
        view.say(
            "warning: --sure: the probabilities are not calibrated; `tactile-viewgcn report` has "
            "the errors of sure answers"
        )
    if not recogniser.separates_grasps:
        view.say(EVERY_FRAME)
    reader = FrameLines(recogniser.shape, recogniser.plan.channel_names)
    skips = every is None and not is_file
    command = LiveCommand(stream, reader, view, skips=skips, is_paced=not is_file)
    return command.run(source)


@cli.command()
@click.argument("recording")
@click.option(
    "--speed",
    type=click.FloatRange(0),
    default=1.0,
    show_default=True,
    help="2 is twice as fast as the recording, 0 is as fast as possible.",
)
@click.option("--name", metavar="NAME", help="The recording to print, if there are several.")
@_SET_DATA
def replay(recording: str, speed: float, name: str | None, changes: tuple[str, ...]) -> None:
    """Print the frames of RECORDING as lines of numbers for `live`, at the recorded rate.

    RECORDING is anything that `inspect` reads; it needs no object. If the sensors have names, the
    first line has the names.
    """
    from tactile_viewgcn.live import replay as live_replay

    form = replace(_form(changes)[0], labelled=False)
    with _interrupted():
        live_replay.replay(
            recording, form, name=name, speed=speed, out=click.echo, note=_say_to_person
        )


@cli.command()
@click.argument("run", default="")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="File of the page. By default it is report.html, or report-RUN.html if you name a RUN.",
)
@click.option(
    "--card",
    type=click.Path(path_type=Path),
    help="Write a model card of the classifier, in Markdown, to this file too.",
)
def report(run: str, out: Path | None, card: Path | None) -> None:
    """Write an HTML page on the workspace's last run, or on RUN.

    RUN is the name of a DVC experiment or revision, the id of an MLflow run, a folder with the
    `runs` and `results` of a run, or `workspace`.
    """
    from tactile_viewgcn.evaluation.finished_run import read_run
    from tactile_viewgcn.pages.html import write
    from tactile_viewgcn.pages.run_page import page_path, report_lines, run_page

    with readable(f"{run or 'the workspace'}: a file of runs/ or results/"):
        finished = read_run(run)
    if card:
        _say(_write_card(card, finished))
    _say(*report_lines(finished, write(out or page_path(finished.name), run_page(finished))))


def _write_card(path: Path, finished: "FinishedRun") -> str:
    """Write the model card of a run, and return a line that says so."""
    from tactile_viewgcn.evaluation.finished_run import model_file
    from tactile_viewgcn.pages.card import model_card, write_card
    from tactile_viewgcn.recognition.recogniser import Recogniser

    with model_file(finished.name) as file:
        recogniser = Recogniser(file)
    return write_card(path, model_card(finished, recogniser))


@cli.command()
@click.argument("names", nargs=-1, metavar="[A] [B]")
def compare(names: tuple[str, ...]) -> None:
    """Say whether the results of run B differ from those of run A.

    A and B are names of DVC experiments or revisions, ids of MLflow runs, folders with the `runs`
    and `results` of a run, or `workspace`. B is by default the workspace. A is by default the run
    of the workspace's commit. If the results of the commit are not here, A is the workspace, and B
    has to be named.
    """
    from tactile_viewgcn.pages.comparison import comparison_lines, read_both

    with readable("a file of runs/ or results/ of one of the runs"):
        first, second = read_both(names)
    _say(*comparison_lines(first, second))


@contextmanager
def _interrupted() -> Iterator[None]:
    """Let Ctrl-C end a command with its exit code and without a message.

    Ctrl-C ends all programs of a pipe, and another program may be writing to the terminal.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise SystemExit(INTERRUPTED) from None


def _form(changes: tuple[str, ...], *other: str) -> tuple["Form", PreprocessSection]:
    """Return the form of a source and the settings of `preprocess` that `--set` gives.

    Args:
        changes: `key=value` texts.
        *other: sections of params.yaml that can be changed, besides `data`.
    """
    from tactile_viewgcn.readers.source import Form

    # comes first, since a misspelt key is no key of `dvc exp run` either
    params = default_params(changes, "--set")
    sections = ("data", *other)
    for change in changes:
        section = change.partition(".")[0]
        if section not in sections:
            expected = " or ".join(f"{name}.KEY=VALUE" for name in sections)
            raise UserError(
                f"--set {change}: expected {expected}; use other keys with "
                f"`dvc exp run -S {change}`"
            )
    form = Form(params.data.shape, params.data.layout, params.data.columns)
    return form, params.preprocess


def _say(*lines: str) -> None:
    click.echo("\n".join(map(shown, lines)))


def _say_to_person(line: str) -> None:
    click.echo(shown(line), err=True)


def main() -> None:
    """Run the command; a mistake of the user ends in one line and exit code 1."""
    # characters that the terminal's encoding lacks are escaped
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    with program(debug="--debug" in sys.argv):
        cli()
