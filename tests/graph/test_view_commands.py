"""A flight commanded by clicks on its page in Chromium, and pages that may not command it."""

import base64
import functools
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
import subprocess
import sys
import threading
import time
import urllib.request

import browser
from flown_again import assert_one_process_gives
from free_port import free_port
from mambo_bags.reader import read_bag
from mambo_flight import commanded
from mambo_model.motion import flight_command as fc
from mambo_model.motion.trajectory import LANDED
import pytest
import viser

pytestmark = browser.NEEDED
REFUSALS = '/diagnostics'  # tells of the refused command too, which the second flight has not
BUSY = 240.0  # s that anything may take on a loaded machine
RUN = ('--commanded', '--paused', '--composed', '--estimator', 'ground_truth', '--controller',
       'cascaded', '--duration', '16', '--no-report')
PLACE = """
    const one = [...document.querySelectorAll('button, [role=tab]')].find(
      (each) => each.innerText.trim() === '%s');
    if (!one || one.disabled) return null;
    one.scrollIntoView({block: 'center'});
    const middle = () => {
      const box = one.getBoundingClientRect();
      return [box.x + box.width / 2, box.y + box.height / 2];
    };
    const before = middle();
    await new Promise((done) => setTimeout(done, 200));
    const now = middle();  // of a button that has come to rest and is covered by nothing
    return before.join() === now.join() && one.contains(document.elementFromPoint(...now)) && now;
"""
FIELD = """
    const label = [...document.querySelectorAll('label')].find(
      (each) => each.innerText.trim() === '%s');
    const row = label && label.closest('div').parentElement.parentElement;
    const field = row && row.querySelectorAll('input')[%d];
    if (!field) return null;
    field.focus();
    field.select();
    return true;
"""
CONNECTS = """
    return await new Promise((done) => {
      const socket = new WebSocket('%s', 'viser-v%s');
      socket.onopen = () => done(true);
      socket.onerror = () => done(false);
    });
"""


class Tab(browser.Browser):
    """A tab with the page of a flight."""

    def open(self, url):
        self.call('Emulation.setDeviceMetricsOverride', width=1400, height=1000,
                  deviceScaleFactor=1, mobile=False)
        self.events = []
        self.call('Page.navigate', url=url)
        self.wait_for('Page.loadEventFired')

    def until(self, script):
        """Return what a script returns as soon as it is something."""
        limit = time.monotonic() + BUSY
        while not (found := self.evaluate(script)):
            assert time.monotonic() < limit, (script, self.text())
            time.sleep(0.05)
        return found

    def text(self):
        return self.evaluate('return document.body.innerText;')

    def press(self, label):
        """Click a button or tab with the mouse, once it is there and on."""
        self.click(*self.until(PLACE % label))

    def enter(self, label, value, number=0):
        """Type a value over what a field holds."""
        self.until(FIELD % (label, number))
        self.call('Input.insertText', text=value)
        time.sleep(0.3)  # viser drops what is typed within 50 ms before a click

    def shows(self, text):
        self.until(f'return document.body.innerText.includes({text!r});')


def until_served(url, process):
    limit = time.monotonic() + BUSY
    while True:
        try:
            return urllib.request.urlopen(url, timeout=5).close()
        except OSError:
            assert time.monotonic() < limit and process.poll() is None
            time.sleep(0.1)


def other_site(folder):
    """Return the server of another site, with an empty page."""
    (folder / 'index.html').write_text('<html></html>')

    class Handler(SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass
    server = ThreadingHTTPServer(('127.0.0.1', 0), functools.partial(
        Handler, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server


@pytest.fixture(scope='module')
def flown(tmp_path_factory):
    """Return the bag of a flight that was commanded on its page, and which pages could connect."""
    folder, port = tmp_path_factory.mktemp('page'), free_port()
    process = subprocess.Popen([
        sys.executable, '-m', 'mambo_bringup.run', *RUN, '-o', str(folder / 'bag'),
        '--view', str(port)])
    tab, site = Tab(browser.WEBGL), other_site(folder)
    url, socket = f'http://127.0.0.1:{port}', f'ws://127.0.0.1:{port}/'
    connect = CONNECTS % (socket, viser.__version__)
    try:
        until_served(url, process)
        tab.open(f'http://127.0.0.1:{site.server_port}')
        connected = {'other port': tab.evaluate(connect)}
        tab.open(f'http://localhost:{site.server_port}')
        connected['other name'] = tab.evaluate(connect)
        (folder / 'page.html').write_text('<html></html>')
        tab.open((folder / 'page.html').as_uri())
        connected['file'] = tab.evaluate(connect)
        tab.open(url)
        connected['own'] = tab.evaluate(connect)
        tab.enter('height, m', '1.2')
        tab.press('Take off')
        tab.shows('take off to 1.2 m: from t = 0.000 s')
        tab.press('time')
        tab.enter('steps of 5 ms', '900')
        tab.press('Step')
        tab.shows('step 900: to t = 4.495 s')
        tab.shows('t = 4.5 s')
        tab.press('go to')
        tab.enter('x, y, z, m', '9')
        tab.press('Go to')
        tab.shows('the path leaves the volume: x = 9 m')
        tab.enter('x, y, z, m', '0.5')
        tab.press('Go to')
        tab.shows('go to 0.5, 0, 1 m: from t = 4.500 s')
        tab.press('time')
        tab.press('Step')
        tab.shows('step 900: to t = 8.995 s')
        tab.shows('t = 9.0 s')  # the steps were made
        tab.press('fly')
        tab.press('Land')
        tab.shows('land: from t = 9.000 s')
        (folder / 'page.png').write_bytes(base64.b64decode(
            tab.call('Page.captureScreenshot')['data']))
        tab.press('time')
        tab.press('Resume')
        assert process.wait(BUSY) == 0
    finally:
        process.kill()
        tab.close()
        site.shutdown()
    return folder / 'bag', connected


def test_what_was_clicked_is_what_was_flown(flown):
    commands = commanded.commands_of(flown[0])
    assert [fc.NAMES[command.kind] for command in commands] == ['takeoff', 'go_to', 'land']
    assert [command.t for command in commands] == [0, 4_500_000_000, 9_000_000_000]
    assert commands[0].height == 1.2
    reference = read_bag(flown[0])['/mambo/reference']
    assert reference['phase'][-1] == LANDED
    assert reference.position[-1][:2] == pytest.approx([0.5, 0.0], abs=1e-6)


def test_one_process_flies_it_again_to_the_last_bit(flown, tmp_path):
    assert_one_process_gives(flown[0], tmp_path, REFUSALS)


def test_no_page_but_its_own_can_connect(flown):
    assert flown[1] == {'other port': False, 'other name': False, 'file': False, 'own': True}
