"""A headless Chromium for tests of pages, where there is one: one process for all of them."""

import atexit
import base64
import fcntl
import functools
import itertools
import json
import os
from pathlib import Path
import select
import shutil
import subprocess
import tempfile
import time

import pytest

CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser')
NEEDED = pytest.mark.skipif(
    CHROMIUM is None, reason='needs Chromium: `apt-get install chromium`')
AXE = next((path for path in (
    Path(os.environ.get('AXE_CORE', 'no file')),
    Path(__file__).parents[3] / 'node_modules/axe-core/axe.min.js') if path.is_file()), None)
AXE_NEEDED = pytest.mark.skipif(
    AXE is None or CHROMIUM is None, reason='needs Chromium, and axe-core: `npm install axe-core` '
    'in the workspace, or AXE_CORE=path/to/axe.min.js')
OPTIONS = ('--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run',
           '--disable-background-networking', '--disable-component-update', '--disable-sync',
           '--hide-scrollbars', '--remote-debugging-pipe')
WEBGL = ('--use-angle=swiftshader', '--enable-unsafe-swiftshader',
         *(option for option in OPTIONS if option != '--disable-gpu'))
"""For a page in 3-D."""
LIMIT = 180.0  # s, for an answer of the browser


class Browser:
    """A Chromium with one tab, spoken to through pipes by the DevTools protocol."""

    def __init__(self, options=OPTIONS):
        self.folder = tempfile.mkdtemp(prefix='chromium-')
        ends = [*os.pipe(), *os.pipe()]
        theirs_in, self.out, self.inward, theirs_out = (
            fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in ends)
        self.process = subprocess.Popen(
            ['bash', '-c', f'exec "$@" 3<&{theirs_in} 4>&{theirs_out}', 'bash', CHROMIUM,
             *options, f'--user-data-dir={self.folder}'], pass_fds=(theirs_in, theirs_out),
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for end in (*ends, theirs_in, theirs_out):
            os.close(end)
        self.left, self.numbers, self.events = b'', itertools.count(1), []
        target = self.call('Target.createTarget', url='about:blank')['targetId']
        self.session = self.call(
            'Target.attachToTarget', targetId=target, flatten=True)['sessionId']
        self.call('Page.enable')

    def close(self):
        self.process.kill()
        self.process.wait()
        shutil.rmtree(self.folder, ignore_errors=True)

    def read(self, limit):
        while b'\0' not in self.left:
            ready, _, _ = select.select([self.inward], [], [], max(0.0, limit - time.monotonic()))
            assert ready, 'Chromium does not answer'
            more = os.read(self.inward, 1 << 20)
            assert more, 'Chromium has ended'
            self.left += more
        message, _, self.left = self.left.partition(b'\0')
        return json.loads(message)

    def call(self, method, **params):
        number = next(self.numbers)
        request = {'id': number, 'method': method, 'params': params}
        if hasattr(self, 'session'):
            request['sessionId'] = self.session
        data = json.dumps(request).encode() + b'\0'
        while data:
            data = data[os.write(self.out, data):]
        limit = time.monotonic() + LIMIT
        while True:
            answer = self.read(limit)
            if answer.get('id') == number:
                assert 'error' not in answer, answer
                return answer['result']
            self.events.append(answer.get('method'))

    def wait_for(self, event):
        limit = time.monotonic() + LIMIT
        while event not in self.events:
            self.events.append(self.read(limit).get('method'))

    def show(self, file, width=1100, height=3000, theme='light'):
        """Open a file in a window of some size, without a network."""
        self.call('Emulation.setDeviceMetricsOverride', width=width, height=height,
                  deviceScaleFactor=1, mobile=False)
        self.call('Emulation.setEmulatedMedia', features=[
            {'name': 'prefers-color-scheme', 'value': theme}])
        self.events = []
        self.call('Page.navigate', url=file.as_uri())
        self.wait_for('Page.loadEventFired')

    def evaluate(self, script):
        """Return what a script, the body of an async function, returns, as JSON."""
        answer = self.call('Runtime.evaluate', expression=f'(async () => {{ {script} }})()',
                           awaitPromise=True, returnByValue=True)
        assert 'exceptionDetails' not in answer, answer['exceptionDetails']
        return answer['result'].get('value')

    def click(self, x, y, count=1):
        for kind in ('mouseMoved', 'mousePressed', 'mouseReleased'):
            self.call('Input.dispatchMouseEvent', type=kind, x=x, y=y, button='left',
                      clickCount=count)

    def double_click(self, x, y):
        for count, kind in ((1, 'mousePressed'), (1, 'mouseReleased'), (2, 'mousePressed'),
                            (2, 'mouseReleased')):
            self.call('Input.dispatchMouseEvent', type=kind, x=x, y=y, button='left',
                      clickCount=count)


@functools.cache
def started():
    """Return the browser of this run of the tests, which ends with it."""
    made = Browser()
    atexit.register(made.close)
    return made


def opened(page, folder, **options):
    """Return the browser with a page, given as text, in it; every plot is drawn."""
    file = folder / 'page.html'
    file.write_text(page, encoding='utf-8')
    tab = started()
    tab.show(file, **options)
    tab.evaluate("""
        const { dataset } = document.documentElement; // a page with a script says that it is ready
        for (let k = 0; k < 600 && document.getElementById('data') && !dataset.ready; k += 1)
          await new Promise((done) => setTimeout(done, 50));
        const due = () => document.querySelectorAll('.plot').length
          > document.querySelectorAll('.plot[data-live]').length;
        for (const plot of document.querySelectorAll('.plot')) {
          plot.scrollIntoView();
          await new Promise((done) => setTimeout(done, 20));
        }
        for (let k = 0; k < 200 && due(); k += 1) await new Promise((r) => setTimeout(r, 50));
        window.scrollTo(0, 0);
        await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    """)
    return tab


def findings(page, folder, **options):
    """Return the findings of axe-core, of any weight, as texts."""
    tab = opened(page, folder, **options)
    tab.call('Runtime.evaluate', expression=AXE.read_text(encoding='utf-8'))
    return tab.evaluate(
        'document.querySelectorAll("details").forEach((box) => { box.open = true; });'
        'const { violations } = await axe.run(); return violations.flatMap((v) => v.nodes.map('
        '(n) => [v.impact, v.id, n.target.join(" "), n.failureSummary]));')


def printed(page, folder, **options):
    """Return the path of a page as PDF."""
    tab = opened(page, folder, **options)
    data = tab.call('Page.printToPDF', printBackground=True)['data']
    (folder / 'page.pdf').write_bytes(base64.b64decode(data))
    return folder / 'page.pdf'


def screenshot(page, folder, **options):
    """Return a whole page as PNG, in bytes."""
    tab = opened(page, folder, **options)
    return base64.b64decode(tab.call(
        'Page.captureScreenshot', captureBeyondViewport=True)['data'])
