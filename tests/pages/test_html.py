"""HTML pages: texts are escaped, and no request leaves a page."""

import re
from html import unescape
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest
from matplotlib.figure import Figure

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.pages.html import Verdict, environment, write

NASTY = '<script>alert("x")</script> & "Öl" 気'
PAGE = """{% extends "page.html" %}
{% import "macros.html" as page %}
{% block head %}<h1>{{ text }}</h1>
{{ page.verdict(verdict) }}{{ page.tile(text, text) }}{% endblock %}
{% block sections %}
{% call page.section(text) %}
{{ page.steps([step]) }}
{% call page.table([text, "error"], "tn") %}
<tr><td>{{ page.named(text, text) }}</td><td class="n">{{ page.bar(0.5) }}</td></tr>
{% endcall %}
{{ page.picture(figure, text) }}
{% endcall %}
{% endblock %}
"""


def parsed(text):
    """Collects the tags of a page and the addresses that it names. The page is XML, so every
    element is closed in order.
    """
    elements = list(ElementTree.fromstring(text).iter())
    addresses = [
        each.get(name) for each in elements for name in ("src", "href", "srcset", "action")
    ]
    return SimpleNamespace(
        tags={each.tag for each in elements}, addresses=list(filter(None, addresses))
    )


def text_of(page):
    """Return what a reader sees of a page, in one line."""
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", page.partition("<body>")[2])))


def drawn(title="a"):
    figure = Figure(figsize=(2, 1))
    figure.add_subplot().set_title(title, parse_math=False)
    return figure


def page_of(text):
    content = {"verdict": Verdict("bad", text, [text]), "step": (text, text), "figure": drawn()}
    return environment().from_string(PAGE).render(title=text, text=text, **content)


def test_everything_that_is_given_is_escaped_once():
    text = page_of(NASTY)
    assert "script" not in parsed(text).tags and "&amp;lt;" not in text
    # in sentences; a name keeps its marks
    assert page_of("`a`").count("<li><b><code>a</code></b>") == 1
    places = page_of("QQQ").count("QQQ")
    assert (
        text.count("alert(")
        == text.count("&lt;script&gt;alert(&#34;x&#34;)&lt;/script&gt; &amp; ")
        == places
        > 8
    )


def test_a_page_names_no_address_but_its_own_parts_and_forbids_requests():
    text = page_of("Öl")
    addresses = [
        address
        for address in parsed(text).addresses
        if not address.startswith("data:image/svg+xml;base64,")
    ]
    assert addresses == ["#next"]
    assert text.startswith("<!DOCTYPE html>") and "default-src 'none'" in text
    assert "http://" not in text and "url(" not in text


def test_a_page_takes_the_place_of_a_page_and_of_no_other_text(tmp_path):
    path = tmp_path / "page.html"
    for text in ("first", "second"):
        write(path, page_of(text))
        assert path.read_text("utf-8") == page_of(text)
    for text in (f"{page_of('first')}\nmy notes", "<!DOCTYPE html><html>my own</html>"):
        path.write_text(text, "utf-8")
        with pytest.raises(UserError, match=r"page\.html: "):
            write(path, page_of("third"))
        assert path.read_text("utf-8") == text
