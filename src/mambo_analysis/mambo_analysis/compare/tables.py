"""Results of comparisons as text and as CSV."""

from __future__ import annotations

from collections.abc import Mapping
import csv
from pathlib import Path
from typing import Any

from mambo_model.whole_file import COMPARISON, replacing

SHOWN = 12  # largest number of differing parameters in a text


def main_row(entry: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the main row of a section: after take-off, else the whole flight."""
    rows = {row['part']: row for row in entry['rows']}
    return rows.get('after take-off', entry['rows'][0])


def too_few(entry: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return (part, reason) for the parts of a section with too few samples for statistics."""
    return [(part, f'{count} sample{"s" * (count != 1)}: too few for statistics')
            for part, count in entry['too_few'].items()]


def end(entry: Mapping[str, Any]) -> str:
    """Return where a section has its last error: a time, if the flight goes on after it."""
    return f'at {entry["rows"][0]["drift_at"]:.2f} s' if entry['ends_early'] else 'at the end'


def section(entry: Mapping[str, Any]) -> list[str]:
    """Return the lines of a section: RMS by part, the error at the end, the delay."""
    axes, unit = entry['axes'], entry['unit']
    width = max(9, *(len(axis) + 1 for axis in axes))
    head = ''.join(f'{axis:>{width}}' for axis in (*axes, 'total'))
    lines = [entry['title'], f'{f"RMS [{unit}]":<18}{head}{"max":>{width}}{"samples":>9}']
    for row in entry['rows']:
        if not row['count']:
            if row['part'] not in entry['too_few']:
                lines.append(f'  {row["part"]:<16}  nothing to compare')
            continue
        numbers = ''.join(_cell(value, width) for value in (
            *row['rms'], row['rms_total'], row['maximum_total']))
        lines.append(f'  {row["part"]:<16}{numbers}{row["count"]:9d}')
    lines += [f'  {part:<16}  {why}' for part, why in too_few(entry)]
    last, main = entry['rows'][0], main_row(entry)
    if last['count']:
        numbers = ''.join(
            _cell(value, width) for value in (*last['drift'], last['drift_total']))
        lines.append(f'  {f"{end(entry)} [{unit}]":<16}{numbers}')
    if any(value is not None for value in main['delay']):
        lines.append(f'  {"delay [s]":<16}' + ''.join(
            f'{"-":>{width}}' if value is None else _cell(value, width)
            for value in main['delay']))
    return lines


def _cell(value: float, width: int) -> str:
    """Return a number right in its column, with a space before it however large it is."""
    text = f'{value:.4f}'
    return f'{text if len(text) < width else f"{value:.{max(width - 7, 1)}g}":>{width}}'


def times(result: Mapping[str, Any]) -> list[str]:
    """Return the known times of take-off and landing, one line each."""
    lines = []
    if result['takeoff_end'] is not None:
        lines.append(f'take-off ends at {result["takeoff_end"]:.2f} s: {result["takeoff"]}')
    elif result['takeoff'] and not any('never took off' in line for line in result['ending']):
        lines.append(result['takeoff'])
    if result['landing_start'] is not None:
        lines.append(f'landing begins at {result["landing_start"]:.2f} s')
    return lines


def _of_two(result: Mapping[str, Any]) -> str:
    lines = [f'{letter}: {bag}, {topic}' for letter, bag, topic in zip(
        'AB', result['bags'], result['compared'])]
    lines += [f'{result["duration"]:.2f} s in common', *result['ending'], *times(result)]
    for entry in result['errors']:
        lines += ['', *section({**entry, 'title': f'{entry["quantity"]}: A minus B'})]
    if result['differences']:
        every = [(name, *('-' if value is None else str(value) for value in values))
                 for name, *values in result['differences']]
        width = max(len(name) for name, _, _ in every[:SHOWN])
        lines += ['', f'{"parameters that differ":<{width}}  {"A":>14}  {"B":>14}']
        lines += [
            f'{name:<{width}}  {ours:>14}  {theirs:>14}' for name, ours, theirs in every[:SHOWN]]
        if len(every) > SHOWN:
            lines.append(f'and {len(every) - SHOWN} more, see --json')
    return '\n'.join([*lines, '', *(f'note: {note}' for note in result['notes'])]).rstrip()


def table(result: Mapping[str, Any]) -> str:
    """Return the result of a comparison as plain text, if possible within 80 columns."""
    if 'bags' in result:
        return _of_two(result)
    head = f'{result["bag"]}: {result["duration"]:.2f} s'
    if result['real_time_factor'] is not None:
        head += f', real-time factor {result["real_time_factor"]:.2f}'
    if result['source']:
        head += f', imported from {result["source"]}'
    lines = [head, *result['ending'], *times(result)]
    for entry in result['errors']:
        lines += ['', *section(entry)]
    width = max([len(entry['topic']) for entry in result['topics']] + [10])
    lines += ['', f'{"topic":<{width}}{"messages":>10}{"Hz":>9}{"lost":>7}']
    for entry in result['topics']:
        rate = '-' if entry['rate'] is None else f'{entry["rate"]:.1f}'
        lost = '-' if entry['lost'] is None else str(entry['lost'])
        lines.append(f'{entry["topic"]:<{width}}{entry["messages"]:>10}{rate:>9}{lost:>7}')
    if any(entry['lost'] is None for entry in result['topics']):
        lines.append('lost "-": nothing counts the messages of this topic')
    if result['notes']:
        lines += ['', *(f'note: {note}' for note in result['notes'])]
    return '\n'.join(lines)


def write_csv(result: Mapping[str, Any], path: Path) -> Path:
    """
    Write the numbers of a comparison, one line per axis and part of the flight.

    Raises
    ------
    InputError, JobError
        If the file cannot be written, or exists and is not that of a comparison.

    """
    with replacing(path, COMPARISON) as part, part.open('w', newline='', encoding='utf-8') as file:
        out = csv.writer(file)
        out.writerow(['comparison', 'quantity', 'unit', 'part', 'axis', 'samples', 'rms',
                      'maximum', 'final_drift', 'delay_s', 'drift_at_s'])
        for entry in result['errors']:
            for row in entry['rows']:
                start = [entry['title'], entry['quantity'], entry['unit'], row['part']]
                for axis, *values in zip(entry['axes'], row['rms'], row['maximum'],
                                         row['drift'], row['delay']):
                    out.writerow([*start, axis, row['count'], *values, row['drift_at']])
                out.writerow([*start, 'total', row['count'], row['rms_total'],
                              row['maximum_total'], row['drift_total'], None,
                              row['drift_at']])
    return path
