"""Finish the pages of notebooks, which mkdocs-jupyter turns into HTML.

Formulas become MathML, which a browser shows without a network. Links to pages lead to their
addresses on the site. Pictures get the descriptions that their cells gave them.
"""

import json
import logging
import posixpath
import re
from pathlib import Path

from bs4 import BeautifulSoup, Tag
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page

LOG = logging.getLogger("mkdocs.hooks.notebook")  # a warning fails a strict build
FORMULA = re.compile(r"\$\$(.+?)\$\$|\$(.+?)\$", re.DOTALL)
NUMBER = re.compile(r"\\tag\{(\w+)\}")  # of an equation


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Return the page of a notebook with formulas, links and descriptions; others as they are."""
    if not page.file.src_uri.endswith(".ipynb"):
        return html
    soup = BeautifulSoup(html, "html.parser")
    for text in soup.select(".jp-RenderedMarkdown"):
        show_formulas(text)
        for link in text.select("a[href]"):
            link["href"] = address(str(link["href"]), page, files)
    describe_pictures(soup, Path(str(page.file.abs_src_path)))
    return str(soup)


def show_formulas(text: Tag) -> None:
    """Replace the formulas of a text by MathML."""
    for string in text.find_all(string=FORMULA):
        if string.find_parent("code") is None:
            shown = FORMULA.sub(mathml, string)
            string.replace_with(BeautifulSoup(shown, "html.parser"))


def mathml(formula: re.Match[str]) -> str:
    """Return a formula as MathML; one in double dollars is a block, with its number."""
    block, inline = formula.groups()
    if block is None:
        return convert(inline)
    number = NUMBER.search(block)
    shown = convert(NUMBER.sub("", block), display="block")
    if number:
        shown += f"<span>({number[1]})</span>"
    return f'<span class="equation">{shown}</span>'


def address(link: str, page: Page, files: Files) -> str:
    """Return the address of a link, relative to the page; links to other sites stay."""
    if re.match(r"\w+:|#", link):
        return link
    path, _, anchor = link.partition("#")
    target = files.get_file_from_path(
        posixpath.normpath(posixpath.join(posixpath.dirname(page.file.src_uri), path))
    )
    if target is None:
        LOG.warning("%s: link to %s, which is no page", page.file.src_uri, link)
        return link
    url = target.url_relative_to(page.file)
    if anchor:
        url += f"#{anchor}"
    return url


def describe_pictures(soup: BeautifulSoup, notebook: Path) -> None:
    """Give each picture the text `alt` of its output; a warning names a notebook that lacks one."""
    descriptions = []
    for cell in json.loads(notebook.read_text())["cells"]:
        for output in cell.get("outputs", []):
            if "image/png" in output.get("data", {}):
                descriptions.append(output["metadata"].get("image/png", {}).get("alt"))
    if not all(descriptions):
        LOG.warning("%s: a picture without a description", notebook.name)
    pictures = soup.select(".jp-RenderedImage img")
    for picture, description in zip(pictures, descriptions, strict=True):
        picture["alt"] = description or ""
