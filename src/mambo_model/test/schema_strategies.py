"""Values of parameters for property-based tests."""

from hypothesis import strategies as st


def words(longest):
    """Return any text in one line, also blank."""
    return st.text(
        st.characters(exclude_categories=('C', 'Zl', 'Zp')), min_size=1, max_size=longest)


def allowed(field, text):
    """Return every value of a parameter that its declaration allows; texts out of ``text``."""
    meta = field.metadata
    if 'options' in meta:
        return st.sampled_from(meta['options'])
    if 'component' in meta:
        return st.sampled_from(meta['component'].names)
    if 'flag' in meta:
        return st.booleans()
    if 'text' in meta:
        return text
    if isinstance(field.default, int):
        return st.integers(meta['low'], meta['high'])
    number = st.floats(meta['low'], meta['high'])
    many = isinstance(field.default, tuple)
    return st.tuples(*[number] * len(field.default)) if many else number
