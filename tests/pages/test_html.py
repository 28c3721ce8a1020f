"""HTML pages: what is given is escaped, and nothing leaves the page."""

import base64
from html.parser import HTMLParser

from matplotlib.figure import Figure

from tactile_viewgcn.pages.html import Step, Verdict, environment, picture

NASTY = '<script>alert("x")</script> & "Öl" 気'
EMPTY = {"meta", "img", "br"}  # elements without an end
PAGE = """
{% extends "page.html" %}
{% import "macros.html" as page %}
{% block head %}<h1>{{ given }}</h1>{{ page.verdict(verdict, given) }}{{ page.tile(given, given) }}{% endblock %}
{% block sections %}
{% call page.section(given) %}
{{ page.steps([step]) }}
{% call page.table([given, "error"], "tn") %}
<tr><td>{{ page.named(given, given) }}</td><td class="n">{{ page.bar(0.5) }}</td></tr>
{% endcall %}
{% call page.picture(image) %}{{ given }}{% endcall %}
{% endcall %}
{% call page.section("Error and time") %}{% endcall %}
{{ page.words({given: given}) }}
{% endblock %}
"""


class Balanced(HTMLParser):
    """Checks that every element is closed in order, and keeps the addresses that the page names."""

    def __init__(self):
        super().__init__()
        self.open, self.addresses, self.tags = [], [], set()

    def handle_starttag(self, tag, attributes):
        self.tags.add(tag)
        self.addresses += [value for name, value in attributes if name in ("src", "href", "srcset", "action")]
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def parsed(text):
    parser = Balanced()
    parser.feed(text)
    parser.close()
    assert parser.open == []
    return parser


def drawn(title="a", alt="b"):
    figure = Figure(figsize=(2, 1))
    figure.add_subplot().set_title(title, parse_math=False)
    return picture(figure, alt)


def page_of(given):
    content = {"verdict": Verdict("bad", given, [given]), "step": Step(given, given, given), "image": drawn(alt=given)}
    return environment().from_string(PAGE).render(title=given, given=given, **content)


def test_everything_that_is_given_is_escaped_once():
    text = page_of(NASTY)
    assert "script" not in parsed(text).tags and "&amp;lt;" not in text
    places = page_of("QQQ").count("QQQ")  # the addresses of sections are in small letters
    assert text.count("alert(") == text.count("&lt;script&gt;alert(&#34;x&#34;)&lt;/script&gt; &amp; ") == places > 9


def test_a_page_names_no_address_but_its_own_parts_and_forbids_requests():
    text = page_of("Öl")
    addresses = [address for address in parsed(text).addresses if not address.startswith("data:image/svg+xml;base64,")]
    assert addresses == ["#what-to-do-next", "#öl", "#error-and-time", "#words"]
    assert all(f'id="{name}"' in text for name in ("error-and-time", "öl"))
    assert "default-src 'none'" in text and "http://" not in text and "url(" not in text


def test_a_picture_is_an_svg_with_its_letters_as_text():
    encoded = drawn("Öl 気 $x$").address.partition("base64,")[2]
    svg = base64.b64decode(encoded).decode()
    assert ">Öl 気 $x$</text>" in svg and "<script" not in svg
    assert drawn() == drawn(), "equal pictures give equal pages"
