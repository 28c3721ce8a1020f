"""The HTML page: what is given is escaped, and nothing leaves the page."""

import base64
import re
from html.parser import HTMLParser

from matplotlib.figure import Figure

from tactile_viewgcn import html

NASTY = '<script>alert("x")</script> & "Öl" 気'
EMPTY = {"meta", "img", "br"}  # elements without an end


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


def drawn(title="a"):
    figure = Figure(figsize=(2, 1))
    figure.add_subplot().set_title(title, parse_math=False)
    return figure


def test_everything_that_is_given_is_escaped_once():
    parts = [
        html.paragraph(NASTY, html.bold(NASTY)),
        html.command(NASTY),
        html.bullets([NASTY]),
        html.tiles([(NASTY, NASTY)]),
        html.table((NASTY,), [(NASTY,)], caption=NASTY),
        html.details(NASTY, html.code(NASTY)),
        html.picture(drawn(), alt=NASTY, caption=NASTY),
    ]
    text = html.page(NASTY, [html.element("h1", NASTY)], [html.section(NASTY, *parts)])
    assert "script" not in parsed(text).tags and "&amp;lt;" not in text and "Öl&quot; 気" in text


def test_a_page_names_no_address_but_its_own_parts_and_forbids_requests():
    text = html.page("a", [], [html.section("Error and time", html.picture(drawn(), "b")), html.section("Öl", "c")])
    addresses = parsed(text).addresses
    assert [address for address in addresses if not address.startswith("data:image/svg+xml;base64,")] == [
        "#error-and-time",
        "#öl",
    ]
    assert all(f'id="{name}"' in text for name in ("error-and-time", "öl"))
    assert "default-src 'none'" in text and "http://" not in text and "url(" not in text


def test_a_picture_is_an_svg_with_its_letters_as_text():
    (data,) = re.findall(r'base64,([^"]+)"', html.picture(drawn("Öl 気 $x$"), "b"))
    svg = base64.b64decode(data).decode()
    assert ">Öl 気 $x$</text>" in svg and "<script" not in svg
    assert html.picture(drawn(), "b") == html.picture(drawn(), "b"), "equal pictures give equal pages"


def test_a_table_sets_the_columns_that_are_named_as_numbers():
    text = html.table(("object", "error"), [("mug", "3 %")], numbers="tn")
    assert "<td>mug</td>" in text and '<td class="number">3 %</td>' in text and '<th class="number">error</th>' in text


def test_a_bar_is_as_long_as_its_share_and_no_longer_than_all():
    assert "width:50.0%" in html.bar(0.5) and "width:100.0%" in html.bar(1.5) and "width:0.0%" in html.bar(-1)
