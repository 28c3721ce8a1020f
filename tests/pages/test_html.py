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
    """Return the tags of a page and the addresses that it names.

    The page must be XML, in which every element is closed in order.
    """
    tags = set()
    addresses = []
    for element in ElementTree.fromstring(text).iter():
        tags.add(element.tag)
        for name in ("src", "href", "srcset", "action"):
            if element.get(name):
                addresses.append(element.get(name))
    return SimpleNamespace(tags=tags, addresses=addresses)


def text_of(page):
    """Return the text that a reader sees of a page, in one line."""
    _, _, body = page.partition("<body>")
    without_tags = re.sub(r"<[^>]+>", " ", body)
    return re.sub(r"\s+", " ", unescape(without_tags))


def drawn(title="a"):
    """Return a small figure."""
    figure = Figure(figsize=(2, 1))
    figure.add_subplot().set_title(title, parse_math=False)
    return figure


def page_of(text):
    """Return a page that shows a text in every part."""
    content = {"verdict": Verdict("bad", text, [text]), "step": (text, text), "figure": drawn()}
    return environment().from_string(PAGE).render(title=text, text=text, **content)


def test_everything_that_is_given_is_escaped_once():
    text = page_of(NASTY)
    assert "script" not in parsed(text).tags and "&amp;lt;" not in text
    # backticks mark code in sentences, and stay as they are in a name
    assert page_of("`a`").count("<li><b><code>a</code></b>") == 1
    places = page_of("QQQ").count("QQQ")
    assert places > 8
    assert text.count("alert(") == places
    assert text.count("&lt;script&gt;alert(&#34;x&#34;)&lt;/script&gt; &amp; ") == places


def test_a_page_names_no_address_but_its_own_parts_and_forbids_requests():
    text = page_of("Öl")
    picture = "data:image/svg+xml;base64,"
    addresses = parsed(text).addresses
    assert [address for address in addresses if not address.startswith(picture)] == ["#next"]
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
