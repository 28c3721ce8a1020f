"""Self-contained HTML pages from the templates in `templates/`: no script, and no request leaves a page.

Jinja2 escapes whatever a template is given, and names are shown, see `names.shown`.
"""

import base64
import re
import warnings
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.names import shown
from tactile_viewgcn.notes import several

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GLOSSARY = "index.md"  # a link to the manual's first page
NARROWEST = 0.7  # of its width that a picture keeps on a phone; it scrolls sideways then
PIXELS = 96 / 72  # of a point


@dataclass(frozen=True)
class Picture:
    """A drawn figure as an SVG: what it shows, its address, its width in pixels and the least that it keeps of it."""

    caption: str
    address: str
    width: int
    narrowest: int


@dataclass(frozen=True)
class Verdict:
    """Whether something is good: `good`, `unsure` or `bad`, the answer in a sentence, and the reasons for it."""

    kind: str
    answer: str
    reasons: list[str]


def picture(figure: "Figure", caption: str) -> Picture:
    """A figure as a template takes it."""
    from matplotlib import rc_context

    buffer = BytesIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "page"}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # the browser has the letters that matplotlib's font lacks
        figure.savefig(buffer, format="svg", bbox_inches="tight", pad_inches=0.05, metadata={"Date": None})
    data = base64.b64encode(buffer.getvalue()).decode()
    width = PIXELS * float(re.findall(rb'width="([\d.]+)pt"', buffer.getvalue())[0])
    return Picture(caption, f"data:image/svg+xml;base64,{data}", round(width), round(NARROWEST * width))


def render(template: str, **content: Any) -> str:
    """The whole page; a name that the template uses and is not given is an error."""
    return environment().get_template(template).render(content)


def environment() -> Environment:
    """Of the templates."""
    loader = PackageLoader("tactile_viewgcn.pages")
    made = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_finalize,
    )
    made.globals["words"] = re.findall(r"^\| (.+) \| (.+) \|$", loader.get_source(made, GLOSSARY)[0], re.MULTILINE)[1:]
    made.filters |= {"anchor": _anchor, "headings": _headings, "several": several, "percent": percent}
    made.filters |= {"duration": duration, "lines": _lines}
    return made


def _finalize(value: Any) -> Any:
    """A value as a page shows it; what is markup already is not touched."""
    return shown(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _lines(commands: str) -> Markup:
    """Commands, one a line."""
    return Markup("\n").join(map(shown, commands.split("\n")))


def write(path: Path, text: str) -> str:
    """Write a page, and say so in a line."""
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")
    return f"{path}: {len(text) / 1e6:.1f} MB; open it in a browser"


def percent(share: float) -> str:
    """47.3 %, in one word."""
    return f"{100 * share:.1f}\N{NO-BREAK SPACE}%"


def duration(seconds: float) -> str:
    """3.7 s, 2 min 19 s, or 1 h 4 min."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, left = divmod(round(seconds), 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min {left} s"


def _anchor(name: str) -> str:
    return re.sub(r"\W+", "-", name.lower()).strip("-")


def _headings(body: Markup) -> list[tuple[str, Markup]]:
    """Anchor and title of each section of a page's body."""
    return [(anchor, Markup(title)) for anchor, title in re.findall(r'<section id="(.+?)">\s*<h2>(.+?)</h2>', body)]
