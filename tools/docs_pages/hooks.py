"""Hooks of MkDocs: what the pages take from the code, at each build."""

from __future__ import annotations

from pathlib import Path
import re
import sys

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from docs_pages import commands, formats, parameters, source, topics
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

GENERATED = {
    'parameters': parameters.all_parameters, 'scenario settings': parameters.scenario_settings,
    'sweep settings': parameters.sweep_settings, 'commands': commands.commands,
    'nodes': commands.nodes, 'tools': commands.tools, 'topics': topics.topic_table,
    'messages': topics.messages, 'services': topics.service_table,
    'import targets': formats.import_targets,
    'scenarios': formats.scenarios}
ROOT = Path(__file__).resolve().parents[2]
_MARK = re.compile(r'^<!-- generated: (.*) -->$', re.MULTILINE)


def _fill(found: re.Match[str]) -> str:
    """Return what stands in the place of a mark."""
    name = found[1]
    if name.startswith('docstring '):
        return source.docstring(name.split()[1])
    if name.startswith('example '):
        text = (ROOT / 'examples' / name.split()[1]).read_text(encoding='utf-8')
        return f'```python\n{text}```'
    if name not in GENERATED:
        raise PluginError(
            f'{found[0]}: known are {", ".join(GENERATED)}, docstring MODULE, example FILE')
    return GENERATED[name]()


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Fill the marks ``<!-- generated: NAME -->`` of a page."""
    return _MARK.sub(_fill, markdown)


def _api_page(folder: str, modules: list[str]) -> str:
    """Return the page of a folder of a package: each of its modules."""
    out = [f'# {folder}', '', source.docstring(folder), '']
    for module in modules:
        out += [f'::: {module}', '']
    return '\n'.join(out)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages of the API into the navigation."""
    pages = [{package: [{folder: f'reference/api/{folder}.md'}
                        for folder in source.folders(package)]} for package in source.packages()]
    reference = next(entry['Reference'] for entry in config.nav if 'Reference' in entry)
    reference.append({'API': pages})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the API."""
    for package in source.packages():
        for folder, modules in source.folders(package).items():
            files.append(File.generated(
                config, f'reference/api/{folder}.md', content=_api_page(folder, modules)))
    return files
