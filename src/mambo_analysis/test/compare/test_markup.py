"""Tables and folded texts are well-formed whatever stands in them."""

from html.parser import HTMLParser

from hypothesis import given, strategies as st
from mambo_analysis.compare import markup

TEXTS = st.text(st.characters(exclude_categories=('C',)), max_size=20)


class Reader(HTMLParser):
    """Collects the texts of cells, and refuses tags that do not close."""

    def __init__(self, text):
        super().__init__()
        self.open, self.cells, self.attributes, self.tags = [], [], [], []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        self.tags.append(tag)
        self.attributes += attrs
        if tag in ('td', 'th', 'caption', 'summary', 'pre'):
            self.cells.append('')

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.cells[-1] += data


@given(TEXTS, st.lists(st.tuples(TEXTS, TEXTS, TEXTS), max_size=4), st.lists(
    st.tuples(TEXTS, TEXTS), max_size=2))
def test_a_table_shows_every_text_as_it_is(caption, rows, texts):
    read = Reader(markup.table(caption, ('a', 'b', '<c>'), rows, texts))
    assert read.cells == [caption, 'a', 'b', '<c>', *(cell for row in rows for cell in row),
                          *(cell for pair in texts for cell in pair)]
    assert read.attributes.count(('scope', 'row')) == len(rows) + len(texts)
    assert read.attributes.count(('scope', 'col')) == 3
    assert ('aria-label', caption) in read.attributes and ('tabindex', '0') in read.attributes
    assert read.attributes.count(('colspan', '2')) == len(texts)


@given(TEXTS, TEXTS)
def test_a_folded_text_is_as_it_was(name, text):
    read = Reader(markup.details(name, text))
    assert read.cells == [name, text] and read.tags == ['details', 'summary', 'pre']
