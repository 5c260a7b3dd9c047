"""A headless Chromium for tests of pages, where there is one."""

import json
import os
from pathlib import Path
import re
import shutil
import subprocess
from urllib.parse import unquote

import pytest

CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser')
NEEDED = pytest.mark.skipif(CHROMIUM is None, reason='no Chromium is installed')
AXE = next((path for path in (
    Path(os.environ.get('AXE_CORE', 'no file')),
    Path(__file__).parents[3] / 'node_modules/axe-core/axe.min.js') if path.is_file()), None)
AXE_NEEDED = pytest.mark.skipif(
    AXE is None or CHROMIUM is None, reason='needs Chromium, and axe-core: `npm install axe-core` '
    'in the workspace, or AXE_CORE=path/to/axe.min.js')


def run(page, folder, *options, width=1100, height=9000, timeout=120):
    """Open a page, a path or text, without a network; return what Chromium prints."""
    if isinstance(page, str):
        (folder / 'page.html').write_text(page, encoding='utf-8')
        page = folder / 'page.html'
    done = subprocess.run(
        [CHROMIUM, '--headless', '--no-sandbox', '--disable-gpu', '--disable-quic',
         '--no-first-run', '--disable-background-networking', '--disable-component-update',
         '--disable-sync', '--hide-scrollbars', f'--user-data-dir={folder / "profile"}',
         f'--window-size={width},{height}', '--virtual-time-budget=20000', *options,
         page.as_uri()], text=True, capture_output=True, timeout=timeout)
    assert done.returncode == 0, done.stderr
    return done.stdout


def ask(page, script, folder, **options):
    """Return what a script, the body of an async function, returns in a page, as JSON."""
    probe = ('<script>addEventListener("load", async () => { let out; try { out = await (async () '
             f'=> {{ {script} }})(); }} catch (error) {{ out = {{ error: String(error) }}; }}'
             'const box = document.createElement("template"); box.id = "answer"; '
             'box.setAttribute("data-json", encodeURIComponent(JSON.stringify(out))); '
             'document.body.append(box); });</script></body>')
    head, _, tail = page.rpartition('</body>')
    shown = run(head + probe + tail, folder, '--dump-dom', **options)
    found = re.search(r'id="answer" data-json="([^"]*)"', shown)
    assert found, 'the script of the test did not end'
    return json.loads(unquote(found[1]))


def serious(page, folder, **options):
    """Return the serious and critical findings of axe-core, as texts."""
    script = AXE.read_text(encoding='utf-8').replace('</script', '<\\/script')
    head, _, tail = page.rpartition('</body>')
    found = ask(f'{head}<script>{script}</script></body>{tail}', (
        'await new Promise((done) => setTimeout(done, 2000));'
        'document.querySelectorAll("details").forEach((box) => { box.open = true; });'
        'const { violations } = await axe.run(); return violations.flatMap((v) => v.nodes.map('
        '(n) => [v.impact, v.id, n.target.join(" "), n.failureSummary]));'), folder, **options)
    assert isinstance(found, list), found
    return [row for row in found if row[0] in ('serious', 'critical')]
