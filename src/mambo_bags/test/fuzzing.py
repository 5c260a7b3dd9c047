"""Damage to bags, YAML and MATLAB files by their structure, the same at each run of a seed."""

import struct
import zlib

from mambo_bags import mcap_reader
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer
import numpy as np
from scipy import io as matlab
import zstandard

NUMBERS = (0, 1, 2, 7, 127, 128, 255, 256, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40,
           2**62, 2**63, 2**64 - 1)


def spoilt(rng, data, most=4):
    """Return bytes with some of them changed, cut out, repeated or replaced by a number."""
    out = bytearray(data)
    for _ in range(rng.randint(1, most)):
        at, kind = rng.randrange(len(out) + 1), rng.randrange(6)
        size = min(rng.choice((1, 2, 4, 8, 16, 100, 1000)), len(out) - at)
        if kind == 0:
            out[at:at + size] = b''
        elif kind == 1:
            out[at:at] = out[at:at + size]
        elif kind == 2:
            out[at:at + size] = rng.randbytes(size)
        elif kind == 3:
            out[at:at + size] = bytes(size)
        elif kind == 4:
            width = rng.choice((1, 2, 4, 8))
            out[at:at + width] = rng.choice(NUMBERS).to_bytes(8, 'little')[:width]
        elif at < len(out):
            out[at] ^= 1 << rng.randrange(8)
    return bytes(out[:rng.randrange(len(out) + 1)] if rng.random() < 0.05 else out)


def records(data):
    return [(opcode, data[start:end])
            for opcode, start, end in mcap_reader._records(data, len(mcap_reader.MAGIC))]


def framed(parts):
    return b''.join(struct.pack('<BQ', opcode, len(body)) + body for opcode, body in parts)


def spoilt_records(rng, parts):
    """Return records of which some are gone, there twice, elsewhere or spoilt."""
    parts = list(parts)
    for _ in range(rng.randint(1, 3)):
        at, kind = rng.randrange(len(parts)), rng.randrange(5)
        if kind == 0:
            del parts[at]
        elif kind == 1:
            parts.insert(rng.randrange(len(parts)), parts[at])
        elif kind == 2:
            parts[at] = rng.randrange(18), parts[at][1]
        elif parts[at][0] == Opcode.CHUNK and kind == 3:
            parts[at] = Opcode.CHUNK, repacked(rng, parts[at][1])
        else:
            parts[at] = parts[at][0], spoilt(rng, parts[at][1])
        if not parts:
            break
    return parts


def repacked(rng, body):
    """Return a chunk whose records are spoilt before they are packed again."""
    chunk = mcap_reader.Chunk.read(mcap_reader.stream(body))
    data = zstandard.decompress(chunk.data, chunk.uncompressed_size)
    inside = [(opcode, data[start:end]) for opcode, start, end in mcap_reader._records(data, 0)]
    data = framed(spoilt_records(rng, inside)) if rng.random() < 0.7 else spoilt(rng, data)
    packed = zstandard.compress(data)
    return struct.pack('<QQQI', chunk.message_start_time, chunk.message_end_time, len(data),
                       zlib.crc32(data) if rng.random() < 0.7 else 0) + struct.pack(
        '<I', 4) + b'zstd' + struct.pack('<Q', len(packed)) + packed


def rewritten(rng, data, file):
    """Write a file that is whole, of messages and definitions that are not."""
    contents, often = mcap_reader.scan(data), rng.choice((0.0, 0.0003, 0.01))
    with file.open('wb') as stream:
        writer = Writer(stream, use_chunking=rng.random() < 0.8, compression=rng.choice(
            (CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE)))
        writer.start('ros2')
        for number, channel in contents.channels.items():
            schema = contents.schemas[channel.schema_id]
            text = spoilt(rng, schema.data) if rng.random() < 0.1 else schema.data
            its = writer.register_channel(
                channel.topic, channel.message_encoding,
                writer.register_schema(schema.name, schema.encoding, text), channel.metadata)
            for batch in contents.messages[number]:
                for log_time, publish_time, payload in batch:
                    if rng.random() < often:
                        payload = spoilt(rng, payload)
                    if rng.random() < 0.0003:
                        at, value = rng.randrange(len(payload) - 8), rng.choice(NUMBERS)
                        payload = payload[:at] + value.to_bytes(8, 'little') + payload[at + 8:]
                    if rng.random() < 0.2 * often:
                        log_time = rng.choice(NUMBERS)
                    writer.add_message(its, log_time, payload, publish_time)
        writer.finish()


def damage_bag(rng, whole, file):
    data, kind = whole.read_bytes(), rng.randrange(4)
    if kind == 0:
        file.write_bytes(spoilt(rng, data))
    elif kind == 1:
        file.write_bytes(data[:rng.randrange(len(data))])
    elif kind == 2:
        file.write_bytes(
            mcap_reader.MAGIC + framed(spoilt_records(rng, records(data))) + mcap_reader.MAGIC)
    else:
        rewritten(rng, whole, file)


TEXTS = ('1e400', '-1e308', '9' * 1000, '0x' + 'f' * 5000, '.nan', '2001-13-45', '!!int x', '~',
         '',
         '!!binary a', '[' * 300, '{a: ' * 300, '&a [*a, *a]', '*nothing', '<<: 1', '? [a]', '\0',
         '"\\ud800"', '2001-01-01', 'yes', "'", '!!set {a}', '- - - -', '!!python/name:os.system',
         'a' * 5000, '\N{GRINNING FACE}', '!!timestamp 1', '[1, [2]]', '{[a]: b}', '1:59:59:59')


def spoilt_text(rng, text):
    """Return YAML of which some words are others, or spoilt as bytes."""
    if rng.random() < 0.3:
        return spoilt(rng, text.encode()).decode('utf-8', 'replace')
    lines = text.split('\n')
    for _ in range(rng.randint(1, 4)):
        at, kind = rng.randrange(len(lines)), rng.randrange(4)
        if kind == 0:
            key, colon, _ = lines[at].partition(':')
            lines[at] = f'{key}{colon} {rng.choice(TEXTS)}'
        elif kind == 1:
            lines[at] = f'{rng.choice(TEXTS)}: 1'
        elif kind == 2:
            lines.insert(at, lines[rng.randrange(len(lines))])
        else:
            del lines[at]
            lines = lines or ['']
    return '\n'.join(lines)


def base_mat(folder):
    rng, out = np.random.default_rng(1), []
    pwm = np.linspace(40.0, 400.0, 30)
    bench = {'pwm': pwm, 'thrust': 4.3e-5 * pwm ** 1.47 * (1 + 0.01 * rng.standard_normal(30))}
    struct_of = {'bench': bench, 'cells': np.array([pwm, 'text'], object), 'flag': pwm > 100.0,
                 'int': np.arange(5, dtype='i2'), 'sparse': np.eye(3)}
    for number, (content, options) in enumerate((
            (bench, {'do_compression': False}), (struct_of, {'do_compression': False}),
            (struct_of, {'do_compression': True}), (bench, {'format': '4'}))):
        matlab.savemat(folder / f'{number}.mat', content, **options)
        out.append((folder / f'{number}.mat').read_bytes())
    return out


def damage_mat(rng, files, file):
    data = rng.choice(files)
    kind, width = data[128:132], 136
    if kind == b'\x0f\0\0\0' and rng.random() < 0.7:  # compressed: spoilt before it is packed
        parts, at = [data[:128]], 128
        while at + 8 <= len(data):
            size = int.from_bytes(data[at + 4:at + 8], 'little')
            inside = zlib.decompress(data[at + 8:at + 8 + size])
            if rng.random() < 0.5:
                inside = spoilt(rng, inside, 3)
            packed = zlib.compress(inside)
            parts.append(data[at:at + 4] + struct.pack('<I', len(packed)) + packed)
            at += 8 + size
        data = b''.join(parts)
    elif rng.random() < 0.7:  # behind the head of the file
        data = data[:width - 8] + spoilt(rng, data[width - 8:], 3)
    else:
        data = spoilt(rng, data)
    file.with_suffix('.mat').write_bytes(data)
