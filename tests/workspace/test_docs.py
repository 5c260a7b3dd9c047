"""The documentation: it builds without a warning, covers the code, and its tutorials run."""

from html.parser import HTMLParser
import os
from pathlib import Path
import re
import subprocess
import sys

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / 'tools'))

import docs  # noqa: E402
from docs_pages import animation, commands, graph, parameters, source, topics  # noqa: E402
from mambo_analysis.compare.compare import compare, table  # noqa: E402
from mambo_model import schema  # noqa: E402
import remake  # noqa: E402

TUTORIALS = [*sorted((ROOT / 'docs/tutorials').glob('*.md')), ROOT / 'docs/how-to/course.md']
BLOCK = re.compile(
    r'^```(bash|python|text|yaml)(?: title="([^"]*)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL)
ELSEWHERE = ('./run', 'source env.bash')  # the graph has its own tests; the shell is there
needs_mkdocs = pytest.mark.skipif(
    not docs.installed(), reason='MkDocs is not installed: python3 tools/docs.py install')


class Links(HTMLParser):
    """Collects what a page fetches by itself: scripts, styles, pictures, fonts."""

    def __init__(self):
        super().__init__()
        self.fetched = []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        if tag in ('script', 'img', 'iframe', 'source', 'video', 'audio', 'object', 'embed'):
            self.fetched += [given.get('src'), given.get('data')]
        elif tag == 'link' and given.get('rel') not in ('canonical', 'prev', 'next'):
            self.fetched.append(given.get('href'))


@pytest.fixture(scope='module')
def site(tmp_path_factory):
    """Return the folder of the site as it is built, without a warning."""
    folder = tmp_path_factory.mktemp('site')
    done = docs.mkdocs('build', '--site-dir', str(folder), capture_output=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.long
@needs_mkdocs
def test_the_site_builds_without_a_warning(site):
    assert len(list(site.rglob('*.html'))) > 50
    assert not [page for page in site.rglob('*.html') if '<!-- generated' in page.read_text()]


@pytest.mark.long
@needs_mkdocs
def test_no_page_asks_another_host_for_anything(site):
    for page in site.rglob('*.html'):
        links = Links()
        links.feed(page.read_text(encoding='utf-8'))
        assert not [link for link in links.fetched if link and '//' in link], page
    foreign = re.compile(r'(?:url\(|@import)\s*["\']?(?:https?:)?//')
    assert not [style for style in site.rglob('*.css') if foreign.search(style.read_text())]


@pytest.mark.long
@needs_mkdocs
def test_the_site_has_a_page_for_every_folder_of_code(site):
    wanted = [folder for package in source.packages() for folder in source.folders(package)]
    assert len(wanted) > 15
    for folder in wanted:
        page = (site / f'reference/api/{folder}.html').read_text(encoding='utf-8')
        package = folder.split('.')[0]
        assert not [name for name in source.folders(package)[folder] if f'id="{name}"' not in page]


@pytest.mark.long
@needs_mkdocs
def test_fields_of_compiled_parameters_are_a_table(site):
    page = (site / 'reference/api/mambo_estimation.html').read_text(encoding='utf-8')
    section = page[page.index('id="mambo_estimation.alignment.AlignmentValues"'):]
    table = section[:section.index('</table>')]
    assert '<th>Name</th>' in table and '>gyro_bias<' in table


def test_the_reference_has_every_parameter():
    page = parameters.all_parameters().replace('<wbr>', '')
    for node, params_type in parameters.nodes().items():
        section = page.partition(f'## {node} ')[2].partition('\n## ')[0]
        missing = [name for name, _ in schema.walk(params_type)
                   if f'| <code>{name}</code> |' not in section]
        assert not missing, node


def test_the_reference_has_the_parameters_of_every_node():
    declared = {name for file in source.SRC.glob('*/*/*_node.py')
                for name in re.findall(r'\b\w+NodeParams\b', file.read_text())}
    assert declared == {params_type.__name__ for params_type in parameters.nodes().values()}


def test_the_reference_has_every_console_script_with_its_help():
    page = commands.commands() + commands.nodes()
    for target, names in source.scripts().items():
        for name, packages in names.items():
            assert re.search(rf'^### {name}\b', page, re.MULTILINE)
            assert all(f'ros2 run {package} {name}\n' in page for package in packages)
        if not target.split(':')[0].endswith('_node'):
            assert 'usage: ' in commands.help_of(target), target


def test_the_reference_has_every_topic_with_who_uses_it():
    assert set(topics.USES) == {topic.name for topic in topics.all_topics()}
    files = {file.stem: file.read_text() for file in source.SRC.glob('*/*/*_node.py')}
    names = {getattr(topics.topics, name).name: name for name in dir(topics.topics)
             if isinstance(getattr(topics.topics, name), topics.topics.Topic)}
    for topic, use in topics.USES.items():
        for node in {*use.publishers, *use.subscribers} - {'every node'}:
            assert re.search(rf'topics\.{names[topic]}\b', files[node]), (topic, node)
        assert f'| `{topic}`<br>' in topics.topic_table()


def test_the_reference_has_every_field_of_every_message():
    page = topics.messages()
    for file in (source.SRC / 'mambo_interfaces/msg').glob('*.msg'):
        section = page.partition(f'### {file.stem}\n')[2].partition('\n### ')[0]
        for line in file.read_text().splitlines():
            words = line.partition('#')[0].partition('=')[0].split()
            assert not words or f'| `{words[1]}` |' in section, (file.name, line)


def numbers(text):
    """Return the numbers of a picture, and what stands between them."""
    pattern = re.compile(r'-?\d+\.\d+')
    return [float(value) for value in pattern.findall(text)], pattern.sub('#', text)


@pytest.mark.long
@pytest.mark.parametrize('name', ['circle', 'graph'])
def test_the_pictures_are_those_of_today(name):
    drawn = (animation if name == 'circle' else graph).svg()
    kept, rest = numbers((ROOT / f'docs/images/{name}.svg').read_text(encoding='utf-8'))
    made, same = numbers(drawn)
    assert rest == same, 'make them anew: python3 tools/docs.py pictures'
    assert made == pytest.approx(kept, abs=0.3)  # pixels


def has(output, shown):
    """Return whether a line is among those said: its words, and its numbers as far as it goes."""
    number = re.compile(r'-?\d+(?:\.\d+)?(?:e-?\d+)?')
    for line in output.splitlines():
        if ' '.join(number.sub('#', line).split()) == ' '.join(number.sub('#', shown).split()):
            pairs = zip(map(float, number.findall(line)), map(float, number.findall(shown)))
            if all(a == pytest.approx(b, rel=0.1, abs=0.003) for a, b in pairs):
                return True
    return False


@pytest.mark.long
def test_the_default_flight_is_the_one_that_is_shown(tmp_path):
    output = table(compare(remake.circle(tmp_path)))
    tutorial = (ROOT / 'docs/tutorials/first-flight.md').read_text(encoding='utf-8')
    printed = tutorial.partition('take-off ends at')[2].partition('\npage: ')[0].splitlines()[1:]
    assert len(printed) > 30
    assert not [line for line in printed if not has(output, line)], output


def blocks(page):
    """Return (language, title, text) of the blocks of a tutorial, in its order."""
    return BLOCK.findall(page.read_text(encoding='utf-8'))


@pytest.mark.long
@pytest.mark.parametrize('page', TUTORIALS, ids=lambda page: page.stem)
def test_what_a_tutorial_says_works(page, tmp_path):
    (tmp_path / 'examples').symlink_to(ROOT / 'examples')
    ran, done = 0, None
    for language, title, text in blocks(page):
        if language == 'text':
            shown = text.splitlines() if title == 'you see' else []
            assert not [line for line in shown if not has(done.stdout, line)], done.stdout
            continue
        if language == 'yaml':
            (tmp_path / title).write_text(text, encoding='utf-8')
            continue
        lines = [line for line in text.splitlines() if not line.startswith(ELSEWHERE)]
        command = ([sys.executable, '-c', text] if language == 'python'
                   else ['bash', '-euc', '\n'.join(lines)])
        done = subprocess.run(command, cwd=tmp_path, text=True, capture_output=True,
                              env={**os.environ, 'PYTHONSAFEPATH': '1'})
        assert done.returncode == 0, f'{text}\n{done.stdout}{done.stderr}'
        ran += len(lines)
    assert ran > 3


def test_the_readme_stays_short():
    assert len((ROOT / 'README.md').read_text(encoding='utf-8').splitlines()) <= 120


def test_the_readme_counts_what_the_reproduction_counts():
    page = (ROOT / 'docs/evidence/reproduction.md').read_text(encoding='utf-8')
    counted = re.search(r'a report: (.*)\.$', page, re.MULTILINE)[1].split(', ')
    row = re.search(r'^\| (\d+ claims of the thesis .*?) \|',
                    (ROOT / 'README.md').read_text(), re.MULTILINE)
    assert sorted(re.findall(r'\d+', row[1])) == sorted(part.split()[0] for part in counted)


def test_the_links_of_the_readme_lead_somewhere():
    links = re.findall(r'\]\(([^)#]+)(?:#([^)]+))?\)', (ROOT / 'README.md').read_text())
    assert len(links) > 15
    for path, anchor in links:
        assert (ROOT / path).exists(), path
        if anchor:
            titles = re.findall(r'^#+ (.*)$', (ROOT / path).read_text(), re.MULTILINE)
            assert anchor in [title.lower().replace(' ', '-') for title in titles], path


@pytest.mark.long
def test_without_a_network_one_line_says_so(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(docs, 'REQUIREMENTS', tmp_path / 'docs.txt')
    docs.REQUIREMENTS.write_text('mkdocs==0.0.0\n')
    monkeypatch.setenv('PIP_NO_INDEX', '1')
    assert docs.main(['build']) == 1
    installing, output = capsys.readouterr().err.splitlines()
    assert installing.startswith('docs: installing MkDocs')
    assert output.startswith('docs: MkDocs could not be installed (no network?): ERROR: ')
