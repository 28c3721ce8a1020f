"""Self-contained HTML pages from the templates in `templates/`: no script, and no request leaves a page.

Jinja2 escapes every value, and `messages.shown` escapes control characters.
"""

import base64
import re
import warnings
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from tactile_viewgcn.files import write_file
from tactile_viewgcn.messages import NEW_SESSION, several, shown
from tactile_viewgcn.schema import as_change

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MEGABYTE = 1_000_000  # bytes
GLOSSARY = "words.md"
# marks the pages that may be replaced
GENERATOR = '<meta name="generator" content="tactile-viewgcn" />'


class Verdict(NamedTuple):
    """What is known of something: `open`, `unsure` or `bad`, the answer in a sentence, and the reasons for it.

    There is no kind for good: what no check found may be there all the same.
    """

    kind: str
    answer: str
    reasons: list[str]


def environment() -> Environment:
    """The templates' environment, with the filters that they use; a name that a page lacks is an error."""
    loader = PackageLoader("tactile_viewgcn.pages")
    templates = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=lambda value: value if isinstance(value, Markup) else shown(value),
    )
    glossary = loader.get_source(templates, GLOSSARY)[0]
    templates.globals["words"] = re.findall(r"^\| (.+) \| (.+) \|$", glossary, re.MULTILINE)[1:]
    templates.globals |= {
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


def write(path: Path, text: str) -> str:
    """Write a page, and say so in a line."""
    write_file(path, text, lambda old: GENERATOR in old and old.endswith("</html>"))
    size = f"{len(text) / 1e6:.1f} MB"
    if len(text) < MEGABYTE:
        size = f"{len(text) / 1e3:.0f} kB"
    return f"{path}: {size}; open it in a browser"


def prose(text: str) -> Markup:
    """A text for people, with what stands in backticks as code."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(shown(text)))))


def svg(figure: "Figure") -> str:
    """A figure as the address of an SVG."""
    from matplotlib import rc_context

    buffer = BytesIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "page"}), warnings.catch_warnings():
        # the browser has the letters that matplotlib's font lacks
        warnings.filterwarnings("ignore", "Glyph")
        figure.savefig(
            buffer, format="svg", bbox_inches="tight", pad_inches=0.05, metadata={"Date": None}
        )
    return f"data:image/svg+xml;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def heat_map(frame: np.ndarray, top: float) -> str:
    """A frame (H, W) as the address of a PNG of a pixel a sensor, dark at 0 and bright at `top`; NaN is grey."""
    from matplotlib import colormaps, image

    buffer, colours = BytesIO(), colormaps["viridis"].with_extremes(bad="lightgrey")
    image.imsave(buffer, frame, vmin=0, vmax=top or 1, cmap=colours)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"


def percent(share: float) -> str:
    """47.3 %, in one word."""
    return f"{100 * share:.1f}\N{NO-BREAK SPACE}%"


def duration(seconds: float) -> str:
    """3.7 s, 2 min 19 s, or 1 h 4 min."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, left = divmod(round(seconds), 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min {left} s"
