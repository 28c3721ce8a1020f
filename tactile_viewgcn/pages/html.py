"""Makes self-contained HTML pages from `templates/`: they have no script and send no request.

Jinja2 escapes every value, and `messages.shown` escapes control characters.
"""

import base64
import re
import warnings
from collections.abc import Callable
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from tactile_viewgcn.files import write_file
from tactile_viewgcn.intervals import percent
from tactile_viewgcn.messages import NEW_SESSION, several, shown
from tactile_viewgcn.schema import as_change

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KILOBYTE = 1_000  # bytes
MEGABYTE = 1_000_000  # bytes
MINUTE = 60  # seconds
HOUR = 60  # minutes
GLOSSARY = "words.md"
# marks the pages that this program wrote and so can replace
GENERATOR = '<meta name="generator" content="tactile-viewgcn" />'


class Verdict(NamedTuple):
    """A judgement in one sentence, with its reasons.

    Attributes:
        kind: `open`, `unsure` or `bad`. There is no kind for good, since the checks can miss a
            fault.
        answer: the sentence.
        reasons: further sentences.
    """

    kind: str
    answer: str
    reasons: list[str]


def environment(escaped: Callable[[Any], str] | None = None) -> Environment:
    """Return the templates' environment, in which an unknown name is an error.

    Args:
        escaped: returns a value as text of a page that is not HTML. Without it Jinja2 escapes every
            value for HTML.
    """
    loader = PackageLoader("tactile_viewgcn.pages")
    templates = Environment(
        loader=loader,
        autoescape=escaped is None,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=partial(_printed, escaped=escaped or shown),
    )
    glossary = loader.get_source(templates, GLOSSARY)[0]
    rows = re.findall(r"^\| (.+) \| (.+) \|$", glossary, re.MULTILINE)
    templates.globals |= {
        "words": rows[1:],
        "as_change": as_change,
        "new_session": NEW_SESSION,
        "generator": Markup(GENERATOR),
    }
    templates.filters |= {
        "several": several,
        "percent": percent,
        "svg": svg,
        "duration": duration,
        "prose": prose,
    }
    return templates


def _printed(value: Any, escaped: Callable[[Any], str]) -> str:
    """Return a value as a page prints it: markup unchanged, other text `escaped`."""
    if isinstance(value, Markup):
        return value
    return escaped(value)


def write(path: Path, text: str) -> str:
    """Write a page, and return a line that says so.

    Args:
        path: of the page. A file at this path is replaced only if this program wrote it.
        text: the page as HTML.

    Raises:
        UserError: at `path` is a file that this program did not write.
    """
    write_file(path, text, _is_page)
    if len(text) < MEGABYTE:
        size = f"{len(text) / KILOBYTE:.0f} kB"
    else:
        size = f"{len(text) / MEGABYTE:.1f} MB"
    return f"{path}: {size}; open it in a browser"


def _is_page(text: str) -> bool:
    return GENERATOR in text and text.endswith("</html>")


def prose(text: str) -> Markup:
    """Return a text for people as markup; text in backticks becomes code."""
    escaped = str(escape(shown(text)))
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", escaped))


def svg(figure: "Figure") -> str:
    """Return a figure as the address of an SVG."""
    from matplotlib import rc_context

    buffer = BytesIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "page"}), warnings.catch_warnings():
        # the browser has letters that matplotlib's font lacks
        warnings.filterwarnings("ignore", "Glyph")
        figure.savefig(
            buffer, format="svg", bbox_inches="tight", pad_inches=0.05, metadata={"Date": None}
        )
    return _address("image/svg+xml", buffer)


def heat_map(frame: np.ndarray, top: float) -> str:
    """Return a frame as the address of a PNG with one pixel for each sensor.

    Args:
        frame: (H, W); NaN becomes grey.
        top: the value of the brightest colour; 0 has the darkest colour.
    """
    from matplotlib import colormaps, image

    buffer = BytesIO()
    colours = colormaps["viridis"].with_extremes(bad="lightgrey")
    image.imsave(buffer, frame, vmin=0, vmax=top or 1, cmap=colours)
    return _address("image/png", buffer)


def _address(kind: str, content: BytesIO) -> str:
    """Return a picture as an address that holds the whole picture."""
    return f"data:{kind};base64,{base64.b64encode(content.getvalue()).decode()}"


def duration(seconds: float) -> str:
    """Return a duration in words, such as 3.7 s, 2 min 19 s, or 1 h 4 min."""
    if seconds < MINUTE:
        return f"{seconds:.1f} s"
    minutes, seconds = divmod(round(seconds), MINUTE)
    if minutes < HOUR:
        return f"{minutes} min {seconds} s"
    hours, minutes = divmod(minutes, HOUR)
    return f"{hours} h {minutes} min"
