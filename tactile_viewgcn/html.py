"""One self-contained HTML page: sections, tables and pictures; no script, and no request leaves it.

Every function returns `Html` and escapes what it is given, unless that is `Html` already.
"""

import base64
import html
import re
import warnings
from collections.abc import Iterable, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from tactile_viewgcn.files import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NARROWEST = 0.7  # of its width that a picture keeps on a phone; it scrolls sideways then
PIXELS = 96 / 72  # of a point
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"

STYLE = """
:root { color-scheme: light; --ink: #1a2227; --soft: #56646c; --line: #d5dde1; --tint: #eef4f6; --bar: #bcdbe6; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1.5rem 1rem 4rem; max-width: 62rem; background: #fff; color: var(--ink);
  font: 1rem/1.55 system-ui, "Segoe UI", Roboto, "Noto Sans", "DejaVu Sans", sans-serif; overflow-wrap: break-word; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.3rem; margin: 2.6rem 0 .6rem; padding-top: .7rem; border-top: 2px solid var(--line); }
h3 { font-size: 1.05rem; margin: 1.4rem 0 .3rem; }
p { margin: .5rem 0; max-width: 46rem; }
a { color: #0b5c7d; }
code { font: .9em ui-monospace, "DejaVu Sans Mono", Consolas, monospace; background: var(--tint); padding: .1em .3em;
  border-radius: 3px; overflow-wrap: anywhere; }
pre { background: var(--tint); padding: .6rem .8rem; border-radius: 6px; white-space: pre-wrap; font-size: .85rem; }
pre code { background: none; padding: 0; }
nav { margin: 1.2rem 0 0; font-size: .9rem; }
nav a { margin-right: .9rem; white-space: nowrap; }
td .soft { display: block; max-width: 30rem; line-height: 1.35; }
.soft { color: var(--soft); font-size: .92rem; }
.lead { font-size: 1.2rem; line-height: 1.45; max-width: 52rem; }
.badge { display: inline-block; background: #fff1cf; border: 1px solid #dcae45; border-radius: 1rem;
  padding: .1rem .8rem; font-size: .9rem; font-weight: 600; }
.warning { border-left: 5px solid #cf7d00; background: #fff6e5; padding: .5rem .9rem; max-width: 52rem; }
.good { border-left: 5px solid #3c8a5a; background: #eef8f1; padding: .5rem .9rem; max-width: 52rem; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(10.5rem, 1fr)); gap: .8rem; margin: 1.2rem 0; }
.tile { border: 1px solid var(--line); border-radius: 8px; padding: .7rem .9rem; }
.tile b { display: block; font-size: 1.6rem; line-height: 1.25; }
.tile span { display: block; color: var(--soft); font-size: .88rem; line-height: 1.4; }
.scroll { overflow-x: auto; margin: .8rem 0; }
table { border-collapse: collapse; font-size: .93rem; }
caption { text-align: left; color: var(--soft); padding-bottom: .3rem; }
th, td { text-align: left; vertical-align: top; padding: .3rem .8rem .3rem .4rem;
  border-bottom: 1px solid var(--line); }
th { border-bottom-width: 2px; font-weight: 600; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
th.number { white-space: normal; }
.bars { display: block; width: 7em; }
.bar { display: inline-block; height: .8em; background: var(--bar); border-radius: 2px; vertical-align: baseline; }
figure { margin: 1rem 0; }
figcaption { color: var(--soft); font-size: .92rem; max-width: 46rem; }
img { display: block; max-width: 100%; height: auto; }
.side-by-side { display: grid; grid-template-columns: repeat(auto-fit, minmax(19rem, 1fr)); gap: .4rem 1.6rem; }
.side-by-side figure { margin: .4rem 0; }
details { margin: .8rem 0; }
@media (max-width: 40rem) { h1 { font-size: 1.5rem; } .lead { font-size: 1.08rem; } .side-by-side { display: block; }
  .tiles { grid-template-columns: 1fr 1fr; } .tile b { font-size: 1.35rem; } td, th { padding-right: .5rem; }
  .bars { width: 2em; } td:has(.soft) { min-width: 8.5rem; } }
@media print { @page { margin: 15mm; } body { max-width: none; padding: 0; font-size: 10pt; } nav { display: none; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; } .scroll { overflow: visible; }
  img { min-width: 0 !important; } h2, h3 { break-after: avoid; } tr, figure, .tile, .warning { break-inside: avoid; } }
"""


class Html(str):
    """Text that is HTML already and is not escaped again."""

    __slots__ = ()


def escape(text: object) -> Html:
    """The text as HTML."""
    return text if isinstance(text, Html) else Html(html.escape(str(text)))


def join(parts: Iterable[object], between: str = "\n") -> Html:
    """The parts one after the other."""
    return Html(between.join(map(escape, parts)))


def element(tag: str, *content: object, kind: str = "") -> Html:
    """`<tag class="kind">content</tag>`."""
    attribute = f' class="{kind}"' if kind else ""
    return Html(f"<{tag}{attribute}>{join(content, '')}</{tag}>")


def paragraph(*text: object, kind: str = "") -> Html:
    """A paragraph: `lead`, `soft`, `warning` and `good` look as they are called."""
    return element("p", *text, kind=kind)


def bold(text: object) -> Html:
    return element("b", text)


def code(text: object) -> Html:
    """A name or a command inside a sentence."""
    return element("code", text)


def badge(text: object) -> Html:
    """A word that one must not overlook."""
    return element("span", text, kind="badge")


def several(count: int, thing: str) -> str:
    """1 frame, 1,701 frames."""
    return f"{count:,} {thing}{'' if count == 1 else 's'}"


def named(name: object, text: object) -> Html:
    """A name in a table, with what it is under it."""
    return Html(f"{bold(name)}{element('span', text, kind='soft')}")


def command(text: str) -> Html:
    """A command on a line of its own."""
    return element("pre", code(text))


def bullets(items: Iterable[object]) -> Html:
    return element("ul", *(element("li", item) for item in items))


def details(summary: str, *parts: object) -> Html:
    """What is folded away until it is asked for."""
    return element("details", element("summary", summary), *parts)


def tiles(entries: Iterable[tuple[object, object]]) -> Html:
    """Pairs of a figure and what it is, as cards."""
    cards = (element("div", bold(figure), element("span", text), kind="tile") for figure, text in entries)
    return element("div", *cards, kind="tiles")


def bar(share: float) -> Html:
    """A bar as long as a share of its cell."""
    width = 100 * min(max(share, 0.0), 1.0)
    return Html(f'<span class="bars"><span class="bar" style="width:{width:.1f}%"></span></span>')


def table(header: Sequence[object], rows: Iterable[Sequence[object]], caption: str = "", numbers: str = "") -> Html:
    """A table that scrolls sideways where it is too wide.

    Args:
        numbers: a letter for each column, `n` where it is set as numbers; text where it is left out.
    """

    def line(tag: str, cells: Sequence[object]) -> Html:
        kinds = numbers.ljust(len(cells), "t")[: len(cells)]
        return element(
            "tr",
            *(element(tag, cell, kind="number" if k == "n" else "") for k, cell in zip(kinds, cells, strict=True)),
        )

    head = (element("caption", caption) if caption else Html(""), element("thead", line("th", header)))
    body = element("tbody", *(line("td", row) for row in rows))
    return element("div", element("table", *head, body), kind="scroll")


def picture(figure: "Figure", alt: str, caption: object = "") -> Html:
    """A drawn figure as an SVG inside the page.

    Args:
        alt: what it shows, for those who do not see it.
    """
    from matplotlib import rc_context

    buffer = BytesIO()
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "page"}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # the browser has the letters that matplotlib's font lacks
        figure.savefig(buffer, format="svg", bbox_inches="tight", pad_inches=0.05, metadata={"Date": None})
    data = base64.b64encode(buffer.getvalue()).decode()
    width = round(float(re.findall(rb'width="([\d.]+)pt"', buffer.getvalue())[0]) * PIXELS)
    image = Html(
        f'<img alt="{escape(alt)}" style="width:{width}px;min-width:{round(NARROWEST * width)}px" '
        f'src="data:image/svg+xml;base64,{data}">'
    )
    return element("figure", element("div", image, kind="scroll"), element("figcaption", caption))


def section(title: str, *parts: object) -> tuple[str, Html]:
    """A title, and what stands under it."""
    return title, join(parts)


def page(title: str, head: Iterable[object], sections: Iterable[tuple[str, Html]]) -> str:
    """The whole page.

    Args:
        title: of the browser's window; the page's own heading is in `head`.
        head: what stands above the list of the sections.
    """
    placed = [(name, _anchor(name), content) for name, content in sections]
    links = (Html(f'<a href="#{anchor}">{escape(name)}</a>') for name, anchor, _ in placed)
    body = (
        Html(f'<section id="{anchor}">\n<h2>{escape(name)}</h2>\n{content}\n</section>')
        for name, anchor, content in placed
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<header>\n{join(head)}\n"
        f"{element('nav', join(links))}\n</header>\n<main>\n{join(body)}\n</main>\n</body>\n</html>\n"
    )


def write(path: Path, text: str) -> str:
    """Write a page, and say so in a line."""
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8")
    return f"{path}: {len(text) / 1e6:.1f} MB; open it in a browser"


def _anchor(name: str) -> str:
    return re.sub(r"\W+", "-", name.lower()).strip("-")
