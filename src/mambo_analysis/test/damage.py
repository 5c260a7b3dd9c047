"""Damage to files, the same at each run of a seed, and what an importer may make of it."""

import re
import shutil

WORDS = ('NaN', 'Infinity', 'null', '[]', '{}', '""', '1e999', '1e308', '-1', 'true', '"a"',
         '[[1]]', '9' * 5000, '\0', ',', '\n', '"', '[' * 2000, '²')


def mutated(rng, content):
    """Return bytes with a part changed, doubled, taken out, put in, emptied or cut off."""
    data = bytearray(content)
    at, other, size = rng.randrange(len(data)), rng.randrange(len(data)), rng.choice((1, 8, 64))
    kind = rng.randrange(6)
    if kind == 0:
        return content[:at]
    if kind == 1:
        data[at] = rng.randrange(256)
    elif kind == 2:
        del data[at:at + size]
    elif kind == 3:
        data[at:at] = rng.randbytes(size)
    elif kind == 4:
        data[at:at + size] = bytes(len(data[at:at + size]))
    else:
        data[at:at + size] = data[other:other + size]
    return bytes(data)


def reworded(rng, content):
    """Return a text with one word or number replaced, or any mutation."""
    words = list(re.finditer(r'[-\w.]+|"[^"]*"', content.decode()))
    if rng.random() < 0.4:
        return mutated(rng, content)
    word, text = rng.choice(words), content.decode()
    return (text[:word.start()] + rng.choice(WORDS) + text[word.end():]).encode()


def check(main, arguments, out, capfd):
    """Run an importer; return whether there is a bag."""
    shutil.rmtree(out, ignore_errors=True)
    code = main([*arguments[:1], str(out), *arguments[1:]])
    error = capfd.readouterr().err
    if code == 0:
        assert not error and out.exists()
        return True
    assert code == 2 and error.count('\n') == 1 and len(error) < 1500, error
    assert not re.search(r'Error\(|Exception|Traceback', error), error
    assert not out.exists()
    return False
