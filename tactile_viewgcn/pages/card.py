"""The model card of a finished run, in Markdown: what its classifier is, and how often it is wrong.

Its headings follow Mitchell et al., "Model cards for model reporting" (2019). Every value from a
file is escaped, so that no name of an object or a folder becomes markup.
"""

import re
from hashlib import md5
from pathlib import Path
from typing import Any

from jinja2 import Environment
from markupsafe import Markup

from tactile_viewgcn.evaluation.finished_run import MODEL, FinishedRun
from tactile_viewgcn.evaluation.live import SURE
from tactile_viewgcn.files import write_file
from tactile_viewgcn.messages import EMPTY_HAND, UserError, several, shown
from tactile_viewgcn.pages.html import environment
from tactile_viewgcn.pages.run_page import (
    date_in_words,
    model_name,
    prediction_command,
    run_facts,
    versions,
)
from tactile_viewgcn.readers.formats import STAG_METADATA
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.schema import as_change

MARKUP = r"[\\`*{}\[\]<>#|~&$]"  # letters that Markdown reads as markup
UNDERSCORE = r"(?<![^\W_])_|_(?![^\W_])"  # at an edge of a word; within a word it is no markup
LIST_MARK = r"^(\d*)([-+.)])(?=\s)"  # begins a list: a hyphen, a plus sign, or a number such as 12.
STAG = r"(?<![a-z])stag(?![a-z])"  # as a word of its own, unlike `staging`
SIGNATURE = "<!-- Written by tactile-viewgcn report. md5 of the lines above: {} -->"


def model_card(run: FinishedRun, recogniser: Recogniser) -> str:
    """Return the card of a run's classifier as Markdown.

    Args:
        run: the finished run.
        recogniser: the classifier of the run.

    Raises:
        UserError: the classifier is not of the run.
    """
    if recogniser.classes != run.predictions.classes.tolist():
        raise UserError(
            "the model and the results have different objects; run `dvc repro`, which brings both "
            "up to date"
        )
    source = run.params["data.source"]
    text = (
        _environment()
        .get_template("card.md")
        .render(
            run_facts(run),
            recogniser=recogniser,
            plan=recogniser.plan,
            content=recogniser.content,
            name=run.records["evaluate"].name or run.params["model.system"],
            of_stag=of_stag(source),
            is_metadata=Path(source).name == STAG_METADATA,
            sure=[row for row in run.live if row["answer"] == "sure" and row["share"]],
            frame_rate=_frame_rate(recogniser.plan.rates),
            lowest_sure=SURE[0],
            model=model_name(run),
            model_file=MODEL,
            predict=prediction_command(run),
            trained=date_in_words(run.records["finetune"].origin["time"]),
            made=_how_it_was_made(run, recogniser.content.version),
        )
    )
    return f"{text}\n{SIGNATURE.format(_digest(text))}\n"


def write_card(path: Path, card: str) -> str:
    """Write a card, and return a line that says so.

    Args:
        path: of the file; a card there is replaced, unless somebody has edited it.
        card: of `model_card`.

    Raises:
        UserError: at `path` is a file that is no card, or one that was edited.
    """
    write_file(path, card, _is_unedited_card)
    return f"{path}: the model card, {several(len(card.split()), 'word')}"


def _is_unedited_card(text: str) -> bool:
    content, _, signature = text.removesuffix("\n").rpartition("\n")
    return signature == SIGNATURE.format(_digest(content))


def _digest(text: str) -> str:
    return md5(text.encode(), usedforsecurity=False).hexdigest()


def of_stag(source: str) -> bool:
    """Return whether a path names STAG, in any of its parts."""
    return bool(re.search(STAG, source.lower()))


def _frame_rate(rates: list[float]) -> str:
    """Return the lowest and the highest frame rate in words; "" where the times are unknown."""
    low, high = (f"{rate:.3g}" for rate in rates)
    if rates[0] == 0:
        return ""
    if low == high:
        return f"{low} Hz"
    return f"{low} to {high} Hz"


def _how_it_was_made(run: FinishedRun, version: str) -> list[tuple[str, str]]:
    """Return the rows of a table: what made the recordings, the classifier and its evaluation.

    Args:
        run: the finished run.
        version: of this package, at the training of the classifier.
    """
    trained = run.records["finetune"].origin
    evaluated = run.records["evaluate"].origin
    of_training = _circumstances(trained)
    of_evaluation = {
        what: text for what, text in _circumstances(evaluated).items() if text != of_training[what]
    }
    changed = [as_change(key, value) for key, value in run.changed.items()]
    parameters = {"Changed parameters": ", ".join(changed) or "none"}
    if "Code" in of_evaluation:  # the parameters differ from those of this commit
        of_evaluation |= parameters
    else:
        of_training |= parameters
    of_training["Versions"] = f"tactile-viewgcn {version}, {of_training['Versions']}"
    return [
        ("Recordings", f"md5 {run.records['ingest'].inputs['source']['md5']}"),
        ("Trained", date_in_words(trained["time"])),
        *of_training.items(),
        ("Evaluated", date_in_words(evaluated["time"])),
        *((f"{what}, in the evaluation", text) for what, text in of_evaluation.items()),
        ("MLflow run", run.records["evaluate"].run_id or "none"),
    ]


def _circumstances(origin: dict[str, str]) -> dict[str, str]:
    """Return by what code, on which machine and with which versions a stage ran, in words.

    Args:
        origin: of the stage's record.
    """
    code = origin.get("mlflow.source.git.commit", "outside git")
    if origin.get("git.dirty") == "true":
        code += ", with changes that were not committed: the commit does not restore it"
    return {
        "Code": code,
        "Machine": f"{origin['processor']}, {several(int(origin['cores']), 'core')}",
        "Computed on": f"{origin['device']} in {origin['precision']}",
        "Versions": ", ".join(versions(origin)),
    }


def _environment() -> Environment:
    """Return the environment of the card's template, whose values are escaped for Markdown."""
    templates = environment(escaped)
    templates.globals |= {"empty_hand": EMPTY_HAND}
    templates.filters |= {"prose": _prose, "code": _code, "command": _command}
    return templates


def escaped(value: Any) -> str:
    """Return a value as Markdown that shows its text, and no markup."""
    text = re.sub(f"{MARKUP}|{UNDERSCORE}", r"\\\g<0>", shown(value))
    return re.sub(LIST_MARK, r"\1\\\2", text)


def _prose(text: str) -> Markup:
    """Return a text for people, with what stands in backticks as code."""
    parts = re.split("(`[^`|]+`)", shown(text))
    for index in range(0, len(parts), 2):
        parts[index] = escaped(parts[index])
    return Markup("".join(parts))


def _code(value: Any) -> Markup:
    """Return a value as code within a line; with a backtick or a bar in it, as plain text."""
    text = shown(value)
    if re.search("[`|]", text):
        return Markup(escaped(text))
    return Markup(f"`{text}`")


def _command(text: str) -> Markup:
    """Return the lines of a command, for a block of code."""
    return Markup("\n".join(map(shown, text.split("\n"))))
