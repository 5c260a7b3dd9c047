"""Definitions of messages as rosbag2 writes them, from the prefixes that ament names."""

import json

from mambo_bags import message_definition as definitions
from mambo_bags.message_definition import DefinitionError
import pytest


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    """Return a function that installs a message; nothing else is installed."""
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))

    def install(name, text, hashes=None):
        package, kind = name.split('/')
        folder = tmp_path / 'share' / package / 'msg'
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f'{kind}.msg').write_text(text)
        if hashes is not None:
            (folder / f'{kind}.json').write_text(hashes)
    return install


def test_what_a_message_needs_follows_depth_first_and_once(prefix):
    prefix('a/Root', 'b/Leaf one\nMiddle[] two\nb/Leaf[3] three\nfloat64 x\n')
    prefix('a/Middle', 'b/Leaf inner # a comment with other/Type in it\nstring<=8 name\n')
    prefix('b/Leaf', 'int32 K=3\nuint8[<=4] data\n')
    line = '=' * 80
    assert definitions.full_text('a/msg/Root') == (
        'b/Leaf one\nMiddle[] two\nb/Leaf[3] three\nfloat64 x\n'
        f'\n{line}\nMSG: a/Middle\nb/Leaf inner # a comment with other/Type in it\n'
        'string<=8 name\n'
        f'\n{line}\nMSG: b/Leaf\nint32 K=3\nuint8[<=4] data\n')


@pytest.mark.parametrize(('text', 'needs'), [
    ('float64 x\n# Other y\n', []), ('Other y', ['p/Other']), ('q/Other[<=3] y\n', ['q/Other']),
    ('  Other  y', ['p/Other']), ('Other CONSTANT\nOther b\n', ['p/Other']), ('', []),
    ('string<=3 s\nwstring w\nbool b\nbyte c\nchar d', [])])
def test_the_types_that_a_text_names(text, needs):
    assert definitions.dependencies(text, 'p') == needs


def test_messages_that_hold_each_other_end(prefix):
    prefix('a/One', 'Two x\n')
    prefix('a/Two', 'One y\n')
    text = definitions.full_text('a/One')
    assert text.count('MSG: a/Two') == 1 and text.count('MSG: a/One') == 1


def test_nesting_has_the_limit_of_rosbag2(prefix):
    for k in range(60):
        prefix(f'a/M{k}', f'M{k + 1} x\n')
    prefix('a/M60', 'float64 x\n')
    with pytest.raises(DefinitionError, match='nested deeper than 50'):
        definitions.full_text('a/M0')
    assert definitions.full_text('a/M11').count('MSG: ') == 49


def test_the_first_prefix_that_has_it_counts(tmp_path, monkeypatch):
    for name in 'ab':
        folder = tmp_path / name / 'share/p/msg'
        folder.mkdir(parents=True)
        (folder / 'X.msg').write_text(f'# {name}\n')
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path / "none"}::{tmp_path / "b"}:{tmp_path}/a')
    assert definitions.find_file('p/X', '.msg') == tmp_path / 'b/share/p/msg/X.msg'


@pytest.mark.parametrize('name', ['X', 'a/b/c', 'a/msg/', '', 'a b/X', '../a/X'])
def test_what_is_no_name_of_a_type_is_refused(name):
    with pytest.raises(DefinitionError, match='is not a message type: expected package/msg/Name'):
        definitions.full_text(name)


def test_a_type_that_is_not_installed_is_named_with_what_to_do(prefix):
    prefix('a/Root', 'b/Gone x\n')
    for name in ('a/Root', 'b/Gone', 'b/msg/Gone'):
        with pytest.raises(DefinitionError, match=r'no definition of b/.*Gone \(b/msg/Gone.msg\)'):
            definitions.full_text(name)


def test_the_hash_is_that_of_the_installed_description(prefix):
    hashes = [{'type_name': 'a/msg/Other', 'hash_string': 'no'},
              {'type_name': 'a/msg/Root', 'hash_string': 'RIHS01_abc'}]
    prefix('a/Root', '', json.dumps({'type_hashes': hashes}))
    assert definitions.type_hash('a/msg/Root') == definitions.type_hash('a/Root') == 'RIHS01_abc'


@pytest.mark.parametrize('text', ['{', '[]', '{}', '{"type_hashes": [{}]}', '{"type_hashes": []}'])
def test_a_description_without_the_hash_is_refused(prefix, text):
    prefix('a/Root', '', text)
    with pytest.raises(DefinitionError, match=r'Root\.json: no type hash of a/Root: rebuild a'):
        definitions.type_hash('a/Root')
